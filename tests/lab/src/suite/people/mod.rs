//! The people of a scene for scoring: bodies, presence, gaps, id changes, recoveries.

pub mod bodies;
pub mod gaps;
pub mod id_changes;
pub mod meetings;
pub mod presence;
pub mod recovery;
