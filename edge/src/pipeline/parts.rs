//! Splitting of the persons and sightings of a tick into messages that are readable alone.

use farfield_proto::message::parts::split;
use farfield_proto::message::{PatchSet, PersonPatch, Sighting, SightingSet};
use farfield_proto::wire;

/// The patch sets of a tick: the persons split over numbered copies of `head`; at least one.
pub(super) fn patch_sets(head: &PatchSet, persons: Vec<PersonPatch>) -> Vec<PatchSet> {
    let mut probe = PatchSet {
        persons: Vec::new(),
        ..head.clone()
    };
    let empty = wire::encode(&probe).len();
    let groups = split(persons, empty, |person| {
        probe.persons.push(person);
        let bytes = wire::encode(&probe).len() - empty;
        (probe.persons.pop(), bytes)
    });
    let parts = groups.len() as u16;
    let numbered = (0..).zip(groups);
    numbered
        .map(|(part, persons)| PatchSet {
            part,
            parts,
            persons,
            ..head.clone()
        })
        .collect()
}

/// The sighting sets of a tick: the sightings split over numbered copies of `head`, so that each
/// fits a message of `version`; at least one.
pub(super) fn sighting_sets(
    head: &SightingSet,
    sightings: Vec<Sighting>,
    version: u8,
) -> Vec<SightingSet> {
    let mut probe = SightingSet {
        sightings: Vec::new(),
        ..head.clone()
    };
    let empty = wire::encode_as(&probe, version).len();
    let groups = split(sightings, empty, |sighting| {
        probe.sightings.push(sighting);
        let bytes = wire::encode_as(&probe, version).len() - empty;
        (probe.sightings.pop(), bytes)
    });
    let parts = groups.len() as u16;
    let numbered = (0..).zip(groups);
    numbered
        .map(|(part, sightings)| SightingSet {
            part,
            parts,
            sightings,
            ..head.clone()
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use farfield_proto::id::{CameraIndex, PersonId, SessionId, ViewpointIndex};
    use farfield_proto::message::KeypointPeak;
    use farfield_proto::message::parts::MESSAGE_BYTES;
    use farfield_proto::patch::EncodedMaps;
    use farfield_proto::tick::Tick;

    use super::*;

    fn head() -> PatchSet {
        PatchSet {
            session: SessionId(u64::MAX),
            tick: Tick(1_000_000),
            viewpoint: ViewpointIndex(3),
            part: 0,
            parts: 1,
            sighting_parts: 0,
            timing: None,
            persons: Vec::new(),
        }
    }

    fn person(id: u32, bytes: usize) -> PersonPatch {
        PersonPatch {
            person: PersonId(id),
            camera: CameraIndex(0),
            box_tick: Tick(1_000_000),
            capture_offset_us: 0,
            crops: Vec::new(),
            crop_of_keypoint: Vec::new(),
            maps: EncodedMaps {
                width: 48,
                height: 64,
                keypoints: 17,
                bytes: vec![7; bytes],
            },
        }
    }

    #[test]
    fn a_tick_without_persons_is_one_empty_message() {
        let sets = patch_sets(&head(), Vec::new());
        assert_eq!(sets.len(), 1);
        assert_eq!(
            (sets[0].part, sets[0].parts, sets[0].persons.len()),
            (0, 1, 0)
        );
    }

    #[test]
    fn small_persons_share_messages_and_every_message_fits() {
        let sets = patch_sets(&head(), (0..20).map(|i| person(i, 300)).collect());
        assert!(sets.len() > 1 && sets.len() < 10, "{}", sets.len());
        assert!(
            sets.iter()
                .all(|set| wire::encode(set).len() <= MESSAGE_BYTES)
        );
        let ids: Vec<u32> = sets
            .iter()
            .flat_map(|s| &s.persons)
            .map(|p| p.person.0)
            .collect();
        assert_eq!(ids, (0..20).collect::<Vec<_>>());
        for (i, set) in sets.iter().enumerate() {
            assert_eq!(
                (usize::from(set.part), usize::from(set.parts)),
                (i, sets.len())
            );
        }
    }

    #[test]
    fn sightings_of_a_crowd_fit_messages_of_every_written_version() {
        let person = |i: u16| {
            let peak = |k: u16| KeypointPeak {
                position_px: [90.3 * f32::from(i), 500.7 + 11.3 * f32::from(k)],
                score: 0.8,
            };
            let sighting = Sighting {
                camera: CameraIndex(i % 3),
                score: 0.9,
                keypoints: (0..17).map(|k| Some(peak(k))).collect(),
            };
            sighting.snapped()
        };
        let everybody: Vec<Sighting> = (0..40).map(person).collect();
        let head = SightingSet {
            session: SessionId(u64::MAX),
            tick: Tick(1_000_000),
            viewpoint: ViewpointIndex(3),
            part: 0,
            parts: 1,
            sightings: Vec::new(),
        };
        let messages = [wire::OLDEST_WRITTEN, wire::VERSION].map(|version| {
            let sets = sighting_sets(&head, everybody.clone(), version);
            for set in &sets {
                let bytes = wire::encode_as(set, version).len();
                assert!(bytes <= MESSAGE_BYTES, "version {version}: {bytes} bytes");
                assert_eq!(usize::from(set.parts), sets.len());
            }
            let all: Vec<Sighting> = sets.iter().flat_map(|set| set.sightings.clone()).collect();
            assert_eq!(all, everybody);
            sets.len()
        });
        assert!(messages.iter().all(|n| *n > 1), "{messages:?}");
    }

    #[test]
    fn a_person_larger_than_a_message_travels_alone() {
        let sets = patch_sets(
            &head(),
            vec![person(1, 100), person(2, 3000), person(3, 100)],
        );
        let counts: Vec<usize> = sets.iter().map(|s| s.persons.len()).collect();
        assert_eq!(counts, [1, 1, 1]);
    }
}
