//! The solution for cameras and people before it is assessed, and the persons that single cameras contradict.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::Vector3;

use super::adjust::Adjusted;
use super::request::PeopleRequest;
use super::start::pair::Pair;
use super::venue::{Floor, Scale, Standing};
use super::view::{Clock, View};
use crate::adjustment::{CameraState, Covariance};
use crate::alignment::{Alignment, Anchors};

/// Results of the intermediate stages, by the index of the camera in the request.
pub(super) struct Evidence {
    pub(super) pairs: Vec<Pair>,
    /// Cameras that fit only in a mirror.
    pub(super) mirrored: Vec<usize>,
    /// Per camera, the number of usable bodies for its ground.
    pub(super) bodies: Vec<usize>,
    /// Per camera of the problem, [`contradictions`].
    pub(super) contradictions: Vec<f64>,
    /// The clock of each camera.
    pub(super) clocks: Vec<Clock>,
}

/// All inputs of a report.
pub(super) struct Found<'a> {
    pub(super) request: &'a PeopleRequest,
    pub(super) ticks_hz: f64,
    pub(super) evidence: Evidence,
    pub(super) adjusted: Adjusted,
    pub(super) covariance: Option<Covariance>,
    pub(super) alignment: Alignment,
    pub(super) scale: Scale,
    pub(super) standing: Standing,
    pub(super) floor: Option<Floor>,
    /// The cameras of the problem by name.
    pub(super) named: Vec<(String, CameraState)>,
    /// The known facts about these cameras.
    pub(super) anchors: Anchors,
}

impl Found<'_> {
    /// The cameras in the venue.
    pub(super) fn states(&self) -> Vec<CameraState> {
        let venue = &self.alignment.venue_from_found;
        let each = self.adjusted.problem.cameras.iter();
        each.map(|camera| venue.apply_to_camera(&camera.state))
            .collect()
    }

    pub(super) fn name(&self, index: usize) -> &str {
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

/// Share of the picture at each edge where a body may be missed.
const EDGE_SHARE: f64 = 0.1;

/// Per camera of the problem, among the persons that others put well inside its picture, the share that it sees elsewhere.
/// A person counts as seen elsewhere if the camera does not see it, but has an unmatched body at that tick. Each unmatched body
/// stands for one missing person.
pub(super) fn contradictions(
    request: &PeopleRequest,
    views: &[View],
    adjusted: &Adjusted,
    keypoints: usize,
) -> Vec<f64> {
    let members = adjusted.persons.iter().flat_map(|person| {
        let own = person.members.iter();
        own.map(|(camera, body)| (person.tick, *camera, *body))
    });
    let known: BTreeSet<(i64, usize, usize)> = members.collect();
    let bodies = adjusted.bodies(keypoints);
    let each = adjusted.posed.iter().zip(&adjusted.problem.cameras);
    let each = each.map(|(index, camera)| {
        let (Some(view), Some(camera_request)) = (views.get(*index), request.cameras.get(*index))
        else {
            return 0.0;
        };
        let fold_radius = camera.state.fold_radius();
        let is_inside = |at: &Vector3<f64>| {
            let px = camera.state.project(at, fold_radius);
            px.is_some_and(|px| {
                (0..2).all(|axis| {
                    let size = f64::from(camera_request.size_px[axis]);
                    (EDGE_SHARE..1.0 - EDGE_SHARE).contains(&(px[axis] / size))
                })
            })
        };
        let mut seen_too = 0;
        let mut missing: BTreeMap<i64, usize> = BTreeMap::new();
        for (person, body) in adjusted.persons.iter().zip(&bodies) {
            if person.members.iter().any(|(camera, _)| camera == index) {
                seen_too += 1;
                continue;
            }
            let seen: Vec<&Vector3<f64>> = body.iter().flatten().collect();
            if seen.is_empty() || !seen.iter().all(|at| is_inside(at)) {
                continue;
            }
            *missing.entry(person.tick).or_default() += 1;
        }
        let contradicting = missing.iter().map(|(tick, missing)| {
            let own = view.ticks.get(tick).map_or(0, Vec::len);
            let is_unmatched = |body: &usize| !known.contains(&(*tick, *index, *body));
            (0..own).filter(is_unmatched).count().min(*missing)
        });
        let contradicting: usize = contradicting.sum();
        contradicting as f64 / (seen_too + contradicting).max(1) as f64
    });
    each.collect()
}
