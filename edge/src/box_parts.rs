//! Assembly of the messages of a box set.
//!
//! In live mode any message can be missing. Persons in a missing message keep the boxes of the
//! previous set, moved to the new tick. In lock-step all messages come in order, and a complete set
//! is processed.

use farfield_proto::message::{BoxSet, PersonBoxes};

/// A box set of which some messages have arrived.
#[derive(Debug, Clone)]
pub struct BoxParts {
    /// Which of its messages have arrived.
    came: Vec<bool>,
    /// Persons of the previous set, by id, that were in no message yet.
    carried: Vec<PersonBoxes>,
}

impl BoxParts {
    /// Starts with the first received message of a new set, and adds the persons of `before`.
    pub fn begin(set: &mut BoxSet, before: Option<&BoxSet>) -> Self {
        let mut came = vec![false; usize::from(set.parts)];
        came[usize::from(set.part)] = true;
        let mut this = Self {
            came,
            carried: Vec::new(),
        };
        if let (false, Some(before)) = (this.is_whole(), before) {
            let ticks = set.tick.0.saturating_sub(before.tick.0);
            this.carried = before
                .persons
                .iter()
                .map(|person| moved_on(person, ticks))
                .collect();
            this.forget_carried(&set.persons);
            set.persons.extend(this.carried.iter().cloned());
        }
        this
    }

    /// Adds another message of the same set to `whole`; `false` if it is a duplicate or of another
    /// set.
    pub fn add(&mut self, whole: &mut BoxSet, set: &BoxSet) -> bool {
        let came = self.came.get_mut(usize::from(set.part));
        let Some(came @ false) = came.filter(|_| set.parts == whole.parts) else {
            return false;
        };
        *came = true;
        let new = |person: &PersonBoxes| set.persons.iter().any(|of| of.person == person.person);
        whole.persons.retain(|person| !new(person));
        whole.persons.extend(set.persons.iter().cloned());
        self.forget_carried(&set.persons);
        if self.is_whole() {
            // Persons in none of its messages have left.
            let carried = std::mem::take(&mut self.carried);
            let left = |person: &PersonBoxes| carried.iter().any(|of| of.person == person.person);
            whole.persons.retain(|person| !left(person));
            whole.persons.sort_by_key(|person| person.person);
        }
        true
    }

    /// Whether all of its messages have come.
    pub fn is_whole(&self) -> bool {
        self.came.iter().all(|came| *came)
    }

    fn forget_carried(&mut self, new: &[PersonBoxes]) {
        self.carried
            .retain(|person| new.iter().all(|of| of.person != person.person));
    }
}

fn moved_on(person: &PersonBoxes, ticks: i64) -> PersonBoxes {
    let mut person = person.clone();
    for camera in &mut person.cameras {
        let [x, y] = camera.rate.center_px.map(|rate| rate * ticks as f32);
        for joint in [&mut camera.torso_px, &mut camera.neck_px] {
            *joint = [joint[0] + x, joint[1] + y];
        }
        camera.bounding_box = camera.bounding_box.moved_on(&camera.rate, ticks);
    }
    person
}

#[cfg(test)]
pub(crate) mod tests {
    use farfield_proto::bounding_box::{BoundingBox, BoxRate};
    use farfield_proto::id::{CameraIndex, PersonId, SessionId, ViewpointIndex};
    use farfield_proto::message::live::LiveBoxes;
    use farfield_proto::message::{CameraBox, Order};
    use farfield_proto::tick::Tick;
    use proptest::prelude::*;

    use super::*;

    /// Message `part` of `parts` of a set with `persons`, each at x = `tick` pixels and moving by
    /// one per tick.
    pub(crate) fn message(tick: i64, [part, parts]: [u16; 2], persons: &[u32]) -> BoxSet {
        let camera = CameraBox {
            camera: CameraIndex(0),
            bounding_box: BoundingBox {
                center_px: [tick as f32, 50.0],
                size_px: [40.0, 80.0],
                rotation_rad: 0.0,
            },
            rate: BoxRate {
                center_px: [1.0, 0.0],
                ..BoxRate::default()
            },
            torso_px: [tick as f32, 50.0],
            neck_px: [tick as f32, 20.0],
        };
        let person = |&person: &u32| PersonBoxes {
            person: PersonId(person),
            cameras: vec![camera],
        };
        BoxSet {
            session: SessionId(1),
            tick: Tick(tick),
            viewpoint: ViewpointIndex(0),
            part,
            parts,
            order: Order::Track,
            live: Some(LiveBoxes {
                sequence: tick as u32,
                epoch_us: 0,
                clock_correction_us: None,
                heard: None,
                every_nth_tick: 0,
            }),
            detection_cameras: Vec::new(),
            persons: persons.iter().map(person).collect(),
        }
    }

    fn ids(set: &BoxSet) -> Vec<u32> {
        let mut ids: Vec<u32> = set.persons.iter().map(|person| person.person.0).collect();
        ids.sort_unstable();
        ids
    }

    #[test]
    fn persons_of_a_missing_message_are_moved_from_the_previous_set() {
        let before = message(10, [0, 1], &[1, 2, 3]);
        let mut whole = message(12, [0, 2], &[1, 2]);
        let parts = BoxParts::begin(&mut whole, Some(&before));
        assert!(!parts.is_whole());
        assert_eq!(ids(&whole), [1, 2, 3]);
        let third = &whole.persons[2].cameras[0];
        let [x, neck_x] = [third.bounding_box.center_px[0], third.neck_px[0]];
        assert!((x - 12.0).abs() < 1e-3 && (neck_x - 12.0).abs() < 1e-3);
    }

    #[test]
    fn a_person_in_no_message_has_left() {
        let before = message(10, [0, 1], &[1, 2, 9]);
        let mut whole = message(11, [1, 2], &[2]);
        let mut parts = BoxParts::begin(&mut whole, Some(&before));
        assert!(parts.add(&mut whole, &message(11, [0, 2], &[1])));
        assert!(parts.is_whole());
        assert_eq!(ids(&whole), [1, 2]);
    }

    #[test]
    fn duplicates_and_messages_with_another_count_are_ignored() {
        let mut whole = message(11, [0, 2], &[1]);
        let mut parts = BoxParts::begin(&mut whole, None);
        assert!(!parts.add(&mut whole, &message(11, [0, 2], &[7])));
        assert!(!parts.add(&mut whole, &message(11, [1, 3], &[7])));
        assert_eq!(ids(&whole), [1]);
    }

    proptest! {
        #[test]
        fn a_complete_set_has_its_persons_in_any_order_of_messages(
            mut order in Just((0u16..5).collect::<Vec<_>>()).prop_shuffle(),
            before in prop::collection::btree_set(0u32..20, 0..12),
        ) {
            let before: Vec<u32> = before.into_iter().collect();
            let before = message(3, [0, 1], &before);
            let first = order.remove(0);
            let persons = |part: u16| [u32::from(part) * 2, u32::from(part) * 2 + 1];
            let mut whole = message(5, [first, 5], &persons(first));
            let mut parts = BoxParts::begin(&mut whole, Some(&before));
            for part in order {
                prop_assert!(parts.add(&mut whole, &message(5, [part, 5], &persons(part))));
            }
            prop_assert!(parts.is_whole());
            prop_assert_eq!(ids(&whole), (0..10).collect::<Vec<u32>>());
            let x = |person: &PersonBoxes| person.cameras[0].bounding_box.center_px[0];
            prop_assert!(whole.persons.iter().all(|person| (x(person) - 5.0).abs() < 1e-3));
        }
    }
}
