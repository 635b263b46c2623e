//! Simulated cameras as sources of a venue: an edge's requests, answered from a scene.
//!
//! Tick n of a scene is the venue's tick `first_tick` + n. A separate thread renders pictures
//! slightly in advance. Maps are made on request.

mod camera;
pub mod in_memory;
mod sources;
mod venue_text;

use crate::fault_profile::FaultProfile;
use crate::scene::Scene;

pub use camera::SimulatedSource;
pub use sources::VenueSources;
pub use venue_text::{VenueText, quoted};

/// The scene as pictures show it: its cameras may be free-running, all other faults are those of
/// maps. Without them the truth's keypoint sites agree with the body.
#[must_use]
pub fn without_map_faults(scene: Scene) -> Scene {
    let faults = FaultProfile {
        free_running: scene.faults().free_running,
        ..FaultProfile::none()
    };
    scene.with_faults(faults)
}

#[cfg(test)]
mod tests;
