//! Bytes on the wire against accuracy: our codec at every compression level and other codecs, through the same loop of
//! edges and fusion.

pub mod codec;
pub mod run;
