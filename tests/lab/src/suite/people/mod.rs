//! What becomes of the people of a scene: their bodies, who is there, who meets whom, who is lost and found.

pub mod bodies;
pub mod gaps;
pub mod id_changes;
pub mod meetings;
pub mod presence;
pub mod recovery;
