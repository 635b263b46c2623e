//! Splits data that exceeds one datagram into messages, each readable alone.

use super::{BoxSet, PersonBoxes};
use crate::wire;

/// Largest message in one datagram, bytes. Zenoh fills datagrams of 1150 bytes over QUIC on any
/// path, including its own header. A message of two datagrams is lost with either.
pub const MESSAGE_BYTES: usize = 1120;
/// Extra bytes that part numbers and counts may take beyond one byte each in an empty message.
const SLACK_BYTES: usize = 8;

/// Splits `items` over messages of at most [`MESSAGE_BYTES`], in order. There is at least one
/// group, and only the first may be empty. An item that is too large gets a group of its own.
///
/// `empty` is the size of a message without items. `measure` returns an item with its additional
/// bytes.
pub fn split<T>(
    items: Vec<T>,
    empty: usize,
    mut measure: impl FnMut(T) -> (Option<T>, usize),
) -> Vec<Vec<T>> {
    let mut groups = vec![Vec::new()];
    let mut bytes = empty + SLACK_BYTES;
    for item in items {
        let (Some(item), more) = measure(item) else {
            continue;
        };
        let group = groups
            .last_mut()
            .filter(|group| group.is_empty() || bytes + more <= MESSAGE_BYTES);
        if let Some(group) = group {
            group.push(item);
            bytes += more;
        } else {
            groups.push(vec![item]);
            bytes = empty + SLACK_BYTES + more;
        }
    }
    groups
}

/// The messages of a box set for a node that reads `version`: its people in numbered parts.
pub fn box_messages(set: &BoxSet, version: u8) -> Vec<Vec<u8>> {
    let whole = wire::encode_as(set, version);
    if whole.len() <= MESSAGE_BYTES {
        return vec![whole];
    }
    let mut probe = BoxSet {
        persons: Vec::new(),
        ..set.clone()
    };
    let empty = wire::encode_as(&probe, version).len();
    let groups = split(
        set.persons.iter().collect(),
        empty,
        |person: &PersonBoxes| {
            probe.persons.push(person.clone());
            let bytes = wire::encode_as(&probe, version).len() - empty;
            probe.persons.clear();
            (Some(person), bytes)
        },
    );
    let parts = groups.len() as u16;
    let numbered = (0..).zip(groups);
    numbered
        .map(|(part, persons)| {
            (probe.part, probe.parts) = (part, parts);
            probe.persons.clear();
            probe.persons.extend(persons.into_iter().cloned());
            wire::encode_as(&probe, version)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bounding_box::{BoundingBox, BoxRate};
    use crate::id::{CameraIndex, PersonId, SessionId, ViewpointIndex};
    use crate::message::{CameraBox, Order};
    use crate::tick::Tick;

    fn boxes_of(persons: u32) -> BoxSet {
        let camera = |index| CameraBox {
            camera: CameraIndex(index),
            bounding_box: BoundingBox {
                center_px: [1203.25, 611.5],
                size_px: [84.0, 202.75],
                rotation_rad: 0.25,
            },
            rate: BoxRate::default(),
            torso_px: [1202.0, 620.0],
            neck_px: [1204.0, 560.0],
        };
        BoxSet {
            session: SessionId(u64::MAX),
            tick: Tick(1_000_000),
            viewpoint: ViewpointIndex(3),
            part: 0,
            parts: 1,
            order: Order::Track,
            live: None,
            detection_cameras: vec![CameraIndex(0)],
            persons: (0..persons)
                .map(|person| PersonBoxes {
                    person: PersonId(person),
                    cameras: (0..3).map(camera).collect(),
                })
                .collect(),
        }
    }

    fn read(messages: &[Vec<u8>]) -> Vec<BoxSet> {
        let sets = messages.iter().map(|bytes| wire::decode(bytes));
        sets.collect::<Result<_, _>>().unwrap()
    }

    #[test]
    fn the_boxes_of_a_crowd_travel_in_messages_that_fit_a_datagram() {
        let messages = box_messages(&boxes_of(22), wire::VERSION);
        assert!(messages.len() > 1);
        assert!(messages.iter().all(|bytes| bytes.len() <= MESSAGE_BYTES));
        let sets = read(&messages);
        for (part, set) in (0..).zip(&sets) {
            assert_eq!((set.part, usize::from(set.parts)), (part, sets.len()));
            assert_eq!(set.detection_cameras, boxes_of(0).detection_cameras);
        }
        let persons: Vec<PersonBoxes> = sets.into_iter().flat_map(|set| set.persons).collect();
        assert_eq!(persons, boxes_of(22).persons);
    }

    #[test]
    fn few_or_no_people_give_one_message() {
        for persons in [0, 3] {
            let set = boxes_of(persons);
            assert_eq!(read(&box_messages(&set, wire::VERSION)), [set]);
        }
    }
}
