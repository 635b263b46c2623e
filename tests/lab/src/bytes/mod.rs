//! What maps cost on the wire against what they are worth: our codec at every compression level and what others
//! send, each through the very same loop of edges and fusion, bytes beside errors.

pub mod codec;
pub mod errors;
pub mod framing;
pub mod plot;
pub mod run;
