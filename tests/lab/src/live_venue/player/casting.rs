//! Whom of a recording fusion means by an id, by where its boxes are.
//!
//! As long as fusion goes the way of the recording, its ids are those of the recording. Where it has lost somebody and
//! found them again, the box has another id than the patches that were recorded of the person in it.

use std::collections::BTreeMap;

use farfield_proto::id::{CameraIndex, PersonId};
use farfield_proto::message::{BoxSet, PersonPatch};
use farfield_proto::tick::Tick;

/// Farthest that a box may be from the crop of who is in it, by its height, as the mean of all viewpoints.
const FARTHEST: f32 = 0.4;

/// Where a person is in a camera, undistorted pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct CameraPlace {
    pub(super) camera: CameraIndex,
    pub(super) centre_px: [f32; 2],
    /// Height of the box; 0 of crops.
    pub(super) height_px: f32,
}

/// Places of persons in a viewpoint.
pub(super) type Places = BTreeMap<PersonId, CameraPlace>;

/// Where `boxes` have everybody at `tick`.
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

/// Where the crops of `patches` are.
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

/// Whom of the recording each id means.
#[derive(Debug, Default)]
pub(super) struct Casting {
    of: BTreeMap<PersonId, PersonId>,
}

impl Casting {
    /// Finds out whom the ids of `boxes` mean, by where the `recorded` are; both by viewpoint. Who is where it was stays
    /// who it was.
    pub(super) fn update(&mut self, boxes: &[Places], recorded: &[Places]) {
        let ids = |places: &[Places]| {
            let mut all: Vec<PersonId> =
                places.iter().flat_map(|own| own.keys().copied()).collect();
            all.sort_unstable();
            all.dedup();
            all
        };
        let known = ids(recorded);
        let mut of = BTreeMap::new();
        for id in ids(boxes) {
            let off = |known: PersonId| mean_off(boxes, id, recorded, known);
            let before = self.of.get(&id).copied().unwrap_or(id);
            let is_still = off(before).is_some_and(|off| off <= FARTHEST);
            let found = if is_still {
                Some(before)
            } else {
                let near = known.iter().filter_map(|&known| Some((off(known)?, known)));
                let nearest = near.min_by(|a, b| a.0.total_cmp(&b.0));
                nearest.and_then(|(off, known)| (off <= FARTHEST).then_some(known))
            };
            of.extend(found.map(|known| (id, known)));
        }
        self.of = of;
    }

    /// Whom of the recording `id` means, if anybody.
    pub(super) fn of(&self, id: PersonId) -> Option<PersonId> {
        self.of.get(&id).copied()
    }
}

/// How far the boxes of `id` are from the crops of `known`, by their height, as the mean of the viewpoints that have both;
/// `None` where none has.
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

    fn places(of: &[(u32, f32)]) -> Places {
        let place = |&(id, x_px): &(u32, f32)| {
            let place = CameraPlace {
                camera: CameraIndex(0),
                centre_px: [x_px, 300.0],
                height_px: 100.0,
            };
            (PersonId(id), place)
        };
        of.iter().map(place).collect()
    }

    #[test]
    fn ids_mean_whom_they_meant_in_the_recording() {
        let mut casting = Casting::default();
        casting.update(
            &[places(&[(1, 100.0), (2, 130.0)])],
            &[places(&[(1, 110.0), (2, 140.0), (3, 130.0)])],
        );
        assert_eq!(casting.of(PersonId(1)), Some(PersonId(1)));
        assert_eq!(casting.of(PersonId(2)), Some(PersonId(2)));
        assert_eq!(casting.of(PersonId(3)), None);
    }

    #[test]
    fn an_id_that_was_not_in_the_recording_is_who_is_in_its_boxes() {
        let mut casting = Casting::default();
        let recorded = [
            places(&[(1, 100.0), (2, 500.0)]),
            places(&[(1, 700.0), (2, 130.0)]),
        ];
        casting.update(&[places(&[(9, 480.0)]), places(&[(9, 140.0)])], &recorded);
        assert_eq!(casting.of(PersonId(9)), Some(PersonId(2)));
        casting.update(&[places(&[(9, 300.0)]), places(&[(9, 400.0)])], &recorded);
        assert_eq!(casting.of(PersonId(9)), None);
    }
}
