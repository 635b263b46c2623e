//! Cameras that see people elsewhere than the others do: what a camera's noise does not tell, because bodies that fit
//! nobody take no part in it.

use std::collections::BTreeSet;

use nalgebra::Vector3;

use crate::people::adjust::Adjusted;
use crate::people::request::PeopleRequest;
use crate::people::view::View;

/// Part of the picture at its edges where a body may be missed.
const EDGE_SHARE: f64 = 0.1;

/// Per camera of the problem: of the persons that others put well inside its picture, the share that it does not see there
/// although it sees somebody whom nobody else does.
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
        let (mut contradicting, mut all) = (0, 0);
        for (person, body) in adjusted.persons.iter().zip(&bodies) {
            if person.members.iter().any(|(camera, _)| camera == index) {
                all += 1;
                continue;
            }
            let seen: Vec<&Vector3<f64>> = body.iter().flatten().collect();
            if seen.is_empty() || !seen.iter().all(|at| is_inside(at)) {
                continue;
            }
            let own = view.ticks.get(&person.tick).map_or(0, Vec::len);
            if (0..own).any(|body| !known.contains(&(person.tick, *index, body))) {
                contradicting += 1;
                all += 1;
            }
        }
        f64::from(contradicting) / f64::from(all.max(1))
    });
    each.collect()
}
