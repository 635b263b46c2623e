//! Owners of the patches of a recording in a different replay, where tracks may be initiated at
//! other ticks and get other ids.
//!
//! A patch belongs to a person of the recorded run. The corresponding person of the replay is the
//! one whose predicted boxes fit the recorded crops best, over all viewpoints. A match is kept
//! while it fits at all, so that two persons who cross do not swap their patches. Patches that fit
//! no person are dropped: their person is initiated from sightings, as in any run.

use std::collections::{BTreeMap, BTreeSet};

use farfield_proto::id::{CameraIndex, PersonId};
use farfield_proto::message::{BoxSet, PersonPatch};

use crate::align::TickGroup;

/// Distance of a crop's centre from the box's, in heights of the box, up to which they are matched.
const NEW_MATCH: f64 = 0.35;
/// The same for a pair that was matched at the last tick.
const REPEATED_MATCH: f64 = 0.6;

/// Matches the persons of a recording with those of a replay.
#[derive(Debug, Default)]
pub(super) struct Renumber {
    names: BTreeMap<PersonId, PersonId>,
}

/// Expected place of a replayed person: centre and height, pixels.
type Expected = BTreeMap<(CameraIndex, PersonId), ([f64; 2], f64)>;

impl Renumber {
    /// Gives the patches of `group` the ids of the persons of `boxes`; returns how many were
    /// dropped.
    pub(super) fn apply(&mut self, group: &mut TickGroup, boxes: &[BoxSet]) -> u64 {
        let expected = expected(boxes);
        let misfits = misfits(group, &expected);
        self.names = matched(&misfits, &self.names);
        let mut dropped = 0;
        for set in &mut group.patch_sets {
            let before = set.persons.len();
            set.persons
                .retain_mut(|patch| match self.names.get(&patch.person) {
                    Some(&name) => {
                        patch.person = name;
                        true
                    }
                    None => false,
                });
            dropped += (before - set.persons.len()) as u64;
        }
        dropped
    }
}

fn expected(boxes: &[BoxSet]) -> Expected {
    let persons = boxes.iter().flat_map(|set| &set.persons);
    let boxes =
        persons.flat_map(|person| person.cameras.iter().map(move |camera| (person, camera)));
    boxes
        .map(|(person, camera)| {
            let region = &camera.bounding_box;
            let place = (
                region.center_px.map(f64::from),
                f64::from(region.size_px[1]),
            );
            ((camera.camera, person.person), place)
        })
        .collect()
}

/// Per recorded and replayed person: the mean misfit over the viewpoints that have both.
fn misfits(group: &TickGroup, expected: &Expected) -> BTreeMap<(PersonId, PersonId), f64> {
    let mut sums: BTreeMap<(PersonId, PersonId), (f64, f64)> = BTreeMap::new();
    for patch in group.patch_sets.iter().flat_map(|set| &set.persons) {
        let of_camera = (patch.camera, PersonId(0))..=(patch.camera, PersonId(u32::MAX));
        for (&(_, person), place) in expected.range(of_camera) {
            let sum = sums.entry((patch.person, person)).or_default();
            *sum = (sum.0 + misfit(patch, place), sum.1 + 1.0);
        }
    }
    sums.into_iter()
        .map(|(pair, (sum, n))| (pair, sum / n))
        .collect()
}

/// Distance of the crop's centre from the box's, in heights of the box.
fn misfit(patch: &PersonPatch, &(center_px, height_px): &([f64; 2], f64)) -> f64 {
    let Some(crop) = patch.crops.first() else {
        return f64::INFINITY;
    };
    let middle = |cells: u16| f64::from(cells - 1) / 2.0;
    let center = crop.pixel(middle(crop.width), middle(crop.height));
    libm::hypot(center.x() - center_px[0], center.y() - center_px[1]) / height_px
}

/// The matches: first the pairs that still fit, then the others, the best fit first.
fn matched(
    misfits: &BTreeMap<(PersonId, PersonId), f64>,
    known: &BTreeMap<PersonId, PersonId>,
) -> BTreeMap<PersonId, PersonId> {
    let is_known = |pair: &(PersonId, PersonId)| known.get(&pair.0) == Some(&pair.1);
    let mut pairs: Vec<(bool, f64, (PersonId, PersonId))> = misfits
        .iter()
        .map(|(&pair, &misfit)| (!is_known(&pair), misfit, pair))
        .filter(|(new, misfit, _)| *misfit <= if *new { NEW_MATCH } else { REPEATED_MATCH })
        .collect();
    pairs.sort_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
    let (mut names, mut taken) = (BTreeMap::new(), BTreeSet::new());
    for (_, _, (recorded, replayed)) in pairs {
        if !names.contains_key(&recorded) && taken.insert(replayed) {
            names.insert(recorded, replayed);
        }
    }
    names
}

#[cfg(test)]
mod tests {
    use farfield_proto::bounding_box::{BoundingBox, BoxRate};
    use farfield_proto::grid::CellGrid;
    use farfield_proto::id::{SessionId, ViewpointIndex};
    use farfield_proto::message::{CameraBox, Order, PatchSet, PersonBoxes};
    use farfield_proto::patch::EncodedMaps;
    use farfield_proto::tick::Tick;

    use super::*;

    /// A crop of 100 x 200 pixels around (`x_px`, 100).
    fn patch(person: u32, x_px: f32) -> PersonPatch {
        PersonPatch {
            person: PersonId(person),
            camera: CameraIndex(0),
            box_tick: Tick(0),
            capture_offset_us: 0,
            crops: vec![CellGrid {
                origin_px: [x_px - 48.0, 2.0],
                step_px: [4.0, 0.0],
                width: 25,
                height: 50,
            }],
            crop_of_keypoint: vec![0],
            maps: EncodedMaps {
                width: 25,
                height: 50,
                keypoints: 1,
                bytes: Vec::new(),
            },
        }
    }

    fn group(persons: Vec<PersonPatch>) -> TickGroup {
        let set = PatchSet {
            session: SessionId(1),
            tick: Tick(5),
            viewpoint: ViewpointIndex(0),
            part: 0,
            parts: 1,
            sighting_parts: 0,
            timing: None,
            persons,
        };
        TickGroup {
            tick: Tick(5),
            patch_sets: vec![set],
            sighting_sets: Vec::new(),
        }
    }

    fn boxes(persons: &[(u32, f32)]) -> Vec<BoxSet> {
        let person = |&(person, x_px): &(u32, f32)| PersonBoxes {
            person: PersonId(person),
            cameras: vec![CameraBox {
                camera: CameraIndex(0),
                bounding_box: BoundingBox {
                    center_px: [x_px, 100.0],
                    size_px: [100.0, 200.0],
                    rotation_rad: 0.0,
                },
                rate: BoxRate::default(),
                torso_px: [0.0; 2],
                neck_px: [0.0; 2],
            }],
        };
        vec![BoxSet {
            session: SessionId(1),
            tick: Tick(5),
            viewpoint: ViewpointIndex(0),
            part: 0,
            parts: 1,
            order: Order::Track,
            live: None,
            detection_cameras: Vec::new(),
            persons: persons.iter().map(person).collect(),
        }]
    }

    fn ids(group: &TickGroup) -> Vec<u32> {
        let persons = &group.patch_sets[0].persons;
        persons.iter().map(|patch| patch.person.0).collect()
    }

    #[test]
    fn patches_go_to_the_person_with_the_fitting_box() {
        let mut group = group(vec![patch(1, 500.0), patch(2, 100.0), patch(3, 900.0)]);
        let dropped = Renumber::default().apply(&mut group, &boxes(&[(1, 105.0), (2, 510.0)]));
        assert_eq!(ids(&group), [2, 1]);
        assert_eq!(dropped, 1, "no person is where the third was");
    }

    #[test]
    fn two_crossing_people_keep_their_patches() {
        let mut renumber = Renumber::default();
        let mut apart = group(vec![patch(1, 100.0), patch(2, 300.0)]);
        renumber.apply(&mut apart, &boxes(&[(7, 100.0), (8, 300.0)]));
        let mut crossing = group(vec![patch(1, 210.0), patch(2, 190.0)]);
        renumber.apply(&mut crossing, &boxes(&[(7, 185.0), (8, 215.0)]));
        assert_eq!(ids(&crossing), [7, 8]);
    }
}
