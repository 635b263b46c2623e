//! Maps ids of fusion to ids of a recording, by the positions of boxes.
//!
//! The ids are equal as long as fusion decides as in the recording. When it has lost a person and found it again, the box has
//! another id than the recorded patches of that person.

use std::collections::BTreeMap;

use farfield_proto::id::{CameraIndex, PersonId};
use farfield_proto::message::{BoxSet, PersonPatch};
use farfield_proto::tick::Tick;

/// Largest distance of a box from the crop of its person, relative to the height, as the mean of all viewpoints.
const FARTHEST: f32 = 0.4;

/// Position of a person in a camera, undistorted pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct CameraPlace {
    pub(super) camera: CameraIndex,
    pub(super) centre_px: [f32; 2],
    /// Height of the box; 0 for crops.
    pub(super) height_px: f32,
}

/// Positions of persons in a viewpoint.
pub(super) type Places = BTreeMap<PersonId, CameraPlace>;

/// Positions of all `boxes`, extrapolated to `tick`.
pub(super) fn places_of_boxes(boxes: &BoxSet, tick: Tick) -> Places {
    let person = boxes.persons.iter().filter_map(|person| {
        let first = person.cameras.first()?;
        let now = first.bounding_box.moved_on(&first.rate, tick - boxes.tick);
        let place = CameraPlace {
            camera: first.camera,
            centre_px: now.center_px,
            height_px: now.size_px[1],
        };
        Some((person.person, place))
    });
    person.collect()
}

/// Positions of the crops of `patches`.
pub(super) fn places_of_patches<'a>(patches: impl Iterator<Item = &'a PersonPatch>) -> Places {
    let place = |patch: &PersonPatch| {
        let crop = patch.crops.first()?;
        let middle = [crop.width, crop.height].map(|cells| f64::from(cells) / 2.0);
        let centre = crop.pixel(middle[0], middle[1]);
        Some(CameraPlace {
            camera: patch.camera,
            centre_px: [centre.x() as f32, centre.y() as f32],
            height_px: 0.0,
        })
    };
    let own = patches.filter_map(|patch| Some((patch.person, place(patch)?)));
    own.collect()
}

/// Recorded ids by fusion's ids.
#[derive(Debug, Default)]
pub(super) struct IdMapping {
    recorded_ids: BTreeMap<PersonId, PersonId>,
}

impl IdMapping {
    /// Updates the recorded ids of `boxes` from the positions of the `recorded` crops; both by viewpoint. An id keeps its person as
    /// long as that person is in its boxes.
    pub(super) fn update(&mut self, boxes: &[Places], recorded: &[Places]) {
        let ids = |places: &[Places]| {
            let mut all: Vec<PersonId> =
                places.iter().flat_map(|own| own.keys().copied()).collect();
            all.sort_unstable();
            all.dedup();
            all
        };
        let known = ids(recorded);
        let mut recorded_ids = BTreeMap::new();
        for id in ids(boxes) {
            let off = |known: PersonId| mean_off(boxes, id, recorded, known);
            let before = self.recorded_ids.get(&id).copied().unwrap_or(id);
            let is_still = off(before).is_some_and(|off| off <= FARTHEST);
            let matched = if is_still {
                Some(before)
            } else {
                let near = known.iter().filter_map(|&known| Some((off(known)?, known)));
                let nearest = near.min_by(|a, b| a.0.total_cmp(&b.0));
                nearest.and_then(|(off, known)| (off <= FARTHEST).then_some(known))
            };
            recorded_ids.extend(matched.map(|known| (id, known)));
        }
        self.recorded_ids = recorded_ids;
    }

    /// The recorded id of fusion's `id`, if any.
    pub(super) fn recorded_id(&self, id: PersonId) -> Option<PersonId> {
        self.recorded_ids.get(&id).copied()
    }
}

/// Distance of the boxes of `id` from the crops of `known`, relative to the height, as the mean of the viewpoints that have
/// both; `None` if none has.
fn mean_off(boxes: &[Places], id: PersonId, recorded: &[Places], known: PersonId) -> Option<f32> {
    let (mut sum, mut n) = (0.0, 0.0);
    for (boxes, recorded) in boxes.iter().zip(recorded) {
        let pair = boxes.get(&id).zip(recorded.get(&known));
        let Some((place, crop)) = pair.filter(|(place, crop)| place.camera == crop.camera) else {
            continue;
        };
        let [x, y] = [0, 1].map(|i| place.centre_px[i] - crop.centre_px[i]);
        sum += (x * x + y * y).sqrt() / place.height_px;
        n += 1.0;
    }
    (n > 0.0).then(|| sum / n)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn places(recorded_ids: &[(u32, f32)]) -> Places {
        let place = |&(id, x_px): &(u32, f32)| {
            let place = CameraPlace {
                camera: CameraIndex(0),
                centre_px: [x_px, 300.0],
                height_px: 100.0,
            };
            (PersonId(id), place)
        };
        recorded_ids.iter().map(place).collect()
    }

    #[test]
    fn ids_of_the_recording_keep_their_persons() {
        let mut mapping = IdMapping::default();
        mapping.update(
            &[places(&[(1, 100.0), (2, 130.0)])],
            &[places(&[(1, 110.0), (2, 140.0), (3, 130.0)])],
        );
        assert_eq!(mapping.recorded_id(PersonId(1)), Some(PersonId(1)));
        assert_eq!(mapping.recorded_id(PersonId(2)), Some(PersonId(2)));
        assert_eq!(mapping.recorded_id(PersonId(3)), None);
    }

    #[test]
    fn a_new_id_maps_to_the_person_in_its_boxes() {
        let mut mapping = IdMapping::default();
        let recorded = [
            places(&[(1, 100.0), (2, 500.0)]),
            places(&[(1, 700.0), (2, 130.0)]),
        ];
        mapping.update(&[places(&[(9, 480.0)]), places(&[(9, 140.0)])], &recorded);
        assert_eq!(mapping.recorded_id(PersonId(9)), Some(PersonId(2)));
        mapping.update(&[places(&[(9, 300.0)]), places(&[(9, 400.0)])], &recorded);
        assert_eq!(mapping.recorded_id(PersonId(9)), None);
    }
}
