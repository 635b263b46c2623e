//! The modules of all crates, and who among them knows whom.

pub mod arrows;
pub mod cycles;
pub mod families;
pub mod resolve;
pub mod tree;
