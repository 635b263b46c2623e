//! Cameras that see people elsewhere than the others do: what a camera's noise does not tell, because bodies that fit
//! nobody take no part in it.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::Vector3;

use crate::people::adjust::Adjusted;
use crate::people::request::PeopleRequest;
use crate::people::view::View;

/// Part of the picture at its edges where a body may be missed.
const EDGE_SHARE: f64 = 0.1;

/// Per camera of the problem: of the persons that others put well inside its picture, the share that it does not see there
/// although it sees somebody whom nobody else does. One whom nobody else sees stands for one who is missing, not for all.
pub(in crate::people) fn contradictions(
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
        let (Some(view), Some(asked)) = (views.get(*index), request.cameras.get(*index)) else {
            return 0.0;
        };
        let fold_radius = camera.state.fold_radius();
        let is_inside = |at: &Vector3<f64>| {
            let px = camera.state.project(at, fold_radius);
            px.is_some_and(|px| {
                (0..2).all(|axis| {
                    let size = f64::from(asked.size_px[axis]);
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
