//! Simulated cameras as sources of a venue: what an edge asks of a camera, answered from a scene.
//!
//! The n-th tick of a scene is the venue's `first_tick` + n. Pictures are rendered by a thread of
//! their own, a little ahead of whoever takes them; maps are made when they are asked for.

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
/// maps. Without them the truth's keypoint sites are where the body has them.
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
