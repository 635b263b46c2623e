//! Where edges show people that fusion does not follow, from patches that edges cut by boxes of
//! their own.
//!
//! While fusion or the links are silent, every edge follows people by itself, under the ids that
//! fusion gave. If several viewpoints show one id in one place, that person went there. This is a
//! hint and no pose: an edge may have moved to another person. So it is only one input of the
//! identity decision, next to bodies and places.

use std::collections::{BTreeMap, VecDeque};

use farfield_proto::id::PersonId;
use farfield_proto::message::{KeypointPeak, PersonPatch, Sighting};
use farfield_proto::patch::{Decoder, Encoder, Maps};
use farfield_proto::tick::Tick;

use super::whereabouts::{LastSeen, Whereabouts};
use crate::align::TickGroup;
use crate::body::skeleton::Joint;
use crate::method::Method;
use crate::sightings::finder::PersonFinder;

/// How long these places are remembered, seconds: until newcomers are confirmed.
const REMEMBERED_S: f64 = 0.6;

/// Which people were shown where, and when.
#[derive(Debug, Default)]
pub(crate) struct ShownPeople {
    places: BTreeMap<PersonId, VecDeque<LastSeen>>,
    decoder: Decoder,
    fitter: Encoder,
    maps: Maps,
}

impl ShownPeople {
    /// Records what the patches of a tick show of the `wanted` people (wire ids).
    pub(crate) fn see(
        &mut self,
        group: &TickGroup,
        wanted: &[PersonId],
        finder: &PersonFinder,
        method: &Method,
    ) {
        self.forget(group.tick, method.dt_s);
        for &id in wanted {
            let mut sightings = Vec::new();
            for patch in group.patch_sets.iter().flat_map(|set| &set.persons) {
                if patch.person == id && method.takes(&patch.maps) {
                    sightings.extend(self.sighting(patch));
                }
            }
            let Some(person) = finder.agreed(&sightings) else {
                continue;
            };
            let observed = person.observed(&method.sites);
            let joint_m = |joint| observed.position_m(joint);
            let hips_m = joint_m(Joint::LeftHip).zip(joint_m(Joint::RightHip));
            if let Some((left_m, right_m)) = hips_m {
                let whereabouts = Whereabouts::at(0.5 * (left_m + right_m)).facing(joint_m);
                let tick = group.tick;
                let places = self.places.entry(id).or_default();
                places.push_back(LastSeen { tick, whereabouts });
            }
        }
    }

    /// Where the person of that wire id was shown, in order of tick.
    pub(crate) fn places_of(&self, wire_id: PersonId) -> Vec<LastSeen> {
        let places = self.places.get(&wire_id);
        places.map_or_else(Vec::new, |places| places.iter().copied().collect())
    }

    fn forget(&mut self, now: Tick, dt_s: f64) {
        let longest = (REMEMBERED_S / dt_s) as i64;
        for places in self.places.values_mut() {
            while places.front().is_some_and(|at| now - at.tick > longest) {
                places.pop_front();
            }
        }
        self.places.retain(|_, places| !places.is_empty());
    }

    /// The highest peak of each map, as a detector would report it; `None` for unreadable maps.
    fn sighting(&mut self, patch: &PersonPatch) -> Option<Sighting> {
        self.decoder.decode(&patch.maps, &mut self.maps).ok()?;
        let peaks = self.fitter.peaks(&self.maps).into_iter();
        let keypoint = |(keypoint, peak): (usize, Option<([f32; 2], f32)>)| {
            let ([x, y], height) = peak?;
            let crop = usize::from(*patch.crop_of_keypoint.get(keypoint)?);
            let grid = patch.crops.get(crop).filter(|grid| grid.is_valid())?;
            let px = grid.pixel(x.into(), y.into());
            Some(KeypointPeak {
                position_px: [px.x() as f32, px.y() as f32],
                score: height / 255.0,
            })
        };
        Some(Sighting {
            camera: patch.camera,
            score: 1.0,
            keypoints: peaks.enumerate().map(keypoint).collect(),
        })
    }
}

#[cfg(test)]
mod tests {
    use farfield_proto::grid::CellGrid;
    use farfield_proto::id::{SessionId, ViewpointIndex};
    use farfield_proto::message::PatchSet;
    use farfield_proto::patch::CompressionLevel;
    use nalgebra::Vector3;

    use super::*;
    use crate::body::fixture::{Noise, standing};
    use crate::identity::registry::tests::{method, venue};
    use crate::sightings::fixture::{TestHall, hall};

    const PERSON: PersonId = PersonId(7);

    /// A patch that an edge's own box cuts from the picture of `camera`, around the person that it
    /// follows.
    fn patch(hall: &TestHall, camera: usize, body: &[Vector3<f64>]) -> PersonPatch {
        let sighting = hall.sighting(camera, body, 0.0, &mut Noise(3));
        let peaks: Vec<[f32; 2]> = sighting
            .keypoints
            .iter()
            .map(|k| k.unwrap().position_px)
            .collect();
        let span = |i: usize| {
            peaks.iter().fold((f32::MAX, f32::MIN), |(low, high), px| {
                (low.min(px[i]), high.max(px[i]))
            })
        };
        let [x, y] = [span(0), span(1)];
        let step_px = ((x.1 - x.0) / 40.0).max((y.1 - y.0) / 54.0);
        let grid = CellGrid {
            origin_px: [
                f32::midpoint(x.0, x.1) - 24.0 * step_px,
                f32::midpoint(y.0, y.1) - 32.0 * step_px,
            ],
            step_px: [step_px, 0.0],
            width: 48,
            height: 64,
        };
        let mut maps = Maps::new(48, 64, peaks.len());
        for (k, [x, y]) in peaks.iter().enumerate() {
            let px = farfield_proto::frames::Pixel::new(f64::from(*x), f64::from(*y));
            let at = grid.cell(px);
            for (i, value) in maps.cells_mut(k).iter_mut().enumerate() {
                let (column, row) = ((i % 48) as f64, (i / 48) as f64);
                let squared = (column - at[0]).powi(2) + (row - at[1]).powi(2);
                *value = (230.0 * libm::exp(-squared / 4.5)) as u8;
            }
        }
        PersonPatch {
            person: PERSON,
            camera: sighting.camera,
            box_tick: Tick(0),
            capture_offset_us: 0,
            crops: vec![grid],
            crop_of_keypoint: vec![0; peaks.len()],
            maps: Encoder::new().encode(&maps, CompressionLevel::LOSSLESS),
        }
    }

    /// The place of a person, if viewpoint i follows `bodies[i]`.
    fn shown(bodies: [&[Vector3<f64>]; 4]) -> Option<Vector3<f64>> {
        let hall = hall();
        let method = method(&venue(&hall));
        let set = |(viewpoint, body): (usize, &&[Vector3<f64>])| PatchSet {
            session: SessionId(1),
            tick: Tick(9),
            viewpoint: ViewpointIndex(viewpoint as u16),
            part: 0,
            parts: 1,
            sighting_parts: 0,
            timing: None,
            persons: vec![patch(&hall, viewpoint, body)],
        };
        let group = TickGroup {
            tick: Tick(9),
            patch_sets: bodies.iter().enumerate().map(set).collect(),
            sighting_sets: Vec::new(),
        };
        let mut shown = ShownPeople::default();
        shown.see(&group, &[PERSON], &hall.finder(), &method);
        assert!(shown.places_of(PersonId(8)).is_empty());
        shown
            .places_of(PERSON)
            .first()
            .map(|at| at.whereabouts.place_m)
    }

    #[test]
    fn a_shown_place_needs_a_majority_of_edges() {
        let own = standing(1.0, 0.5, 1.8, &mut Noise(7));
        let other = standing(-1.5, -0.8, 1.7, &mut Noise(7));
        let near = |place_m: Option<Vector3<f64>>| {
            let off_m = (place_m.unwrap() - Vector3::new(1.0, 0.5, 0.0)).xy().norm();
            assert!(off_m < 0.1, "{off_m}");
        };
        near(shown([&own, &own, &own, &own]));
        near(shown([&own, &other, &own, &own]));
        assert_eq!(shown([&own, &other, &own, &other]), None);
    }
}
