//! What was found of cameras and people, before it is judged.

use crate::adjustment::{CameraState, Covariance};
use crate::alignment::{Alignment, Anchors};
use crate::people::adjust::Adjusted;
use crate::people::request::PeopleRequest;
use crate::people::start::pair::Pair;
use crate::people::venue::{Floor, Scale, Standing};
use crate::people::view::Clock;

/// What was learnt on the way, by the index of the camera in the request.
pub(in crate::people) struct Told {
    pub(in crate::people) pairs: Vec<Pair>,
    /// Cameras that fit only in a mirror.
    pub(in crate::people) mirrored: Vec<usize>,
    /// Per camera how many bodies told of its ground.
    pub(in crate::people) bodies: Vec<usize>,
    /// Per camera of the problem, [`super::contradiction::contradictions`].
    pub(in crate::people) contradictions: Vec<f64>,
    /// The clock of each camera.
    pub(in crate::people) clocks: Vec<Clock>,
}

/// All that a report is made of.
pub(in crate::people) struct Found<'a> {
    pub(in crate::people) request: &'a PeopleRequest,
    pub(in crate::people) ticks_hz: f64,
    pub(in crate::people) told: Told,
    pub(in crate::people) adjusted: Adjusted,
    pub(in crate::people) covariance: Option<Covariance>,
    pub(in crate::people) alignment: Alignment,
    pub(in crate::people) scale: Scale,
    pub(in crate::people) standing: Standing,
    pub(in crate::people) floor: Option<Floor>,
    /// The cameras of the problem by name.
    pub(in crate::people) named: Vec<(String, CameraState)>,
    /// What is known of these.
    pub(in crate::people) anchors: Anchors,
}

impl Found<'_> {
    /// The cameras in the venue.
    pub(in crate::people) fn states(&self) -> Vec<CameraState> {
        let venue = &self.alignment.venue_from_found;
        let each = self.adjusted.problem.cameras.iter();
        each.map(|camera| venue.apply_to_camera(&camera.state))
            .collect()
    }

    pub(in crate::people) fn name(&self, index: usize) -> &str {
        let camera = self.request.cameras.get(index);
        camera.map_or("", |camera| camera.name.as_str())
    }

    /// The largest distance between two cameras, metres.
    pub(super) fn span_m(&self) -> f64 {
        let states = self.states();
        let mut most: f64 = 0.0;
        for a in &states {
            for b in &states {
                most = most.max((a.center_w - b.center_w).norm());
            }
        }
        most
    }
}
