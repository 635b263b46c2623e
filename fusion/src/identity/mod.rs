//! Who is who: how persons are found, confirmed, followed, lost, recognised and let go.
//!
//! ```text
//!   sighted persons -> track, with its phase, in the registry -> output: poses and boxes
//!   tentative: trial (contradiction, poster) -> recognise: who was here before (memory)
//!   what nothing explains -> detection_scheduler: which cameras look again
//! ```

mod confirmation;
mod detection_scheduler;
mod duplicates;
pub mod journal;
mod memory;
mod output;
pub mod phase;
mod poster;
mod recognise;
pub mod registry;
mod tentative;
pub mod track;
mod trial;
