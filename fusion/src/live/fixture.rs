//! Patch sets for tests.

use farfield_proto::id::{CameraIndex, PersonId, SessionId, ViewpointIndex};
use farfield_proto::message::{PatchSet, PersonPatch};
use farfield_proto::patch::EncodedMaps;
use farfield_proto::tick::Tick;

/// The session of all sets.
pub const SESSION: SessionId = SessionId(7);

/// A set without persons.
pub fn patches(tick: i64, viewpoint: u16, part: u16, parts: u16) -> PatchSet {
    PatchSet {
        session: SESSION,
        tick: Tick(tick),
        viewpoint: ViewpointIndex(viewpoint),
        part,
        parts,
        sighting_parts: 0,
        timing: None,
        persons: Vec::new(),
    }
}

/// The smallest patch.
pub fn patch(person: u32) -> PersonPatch {
    PersonPatch {
        person: PersonId(person),
        camera: CameraIndex(0),
        box_tick: Tick(0),
        capture_offset_us: 0,
        crops: Vec::new(),
        crop_of_keypoint: Vec::new(),
        maps: EncodedMaps {
            width: 1,
            height: 1,
            keypoints: 1,
            bytes: Vec::new(),
        },
    }
}

/// The set with a patch of each of `persons`.
pub fn of_persons(mut set: PatchSet, persons: std::ops::Range<u32>) -> PatchSet {
    set.persons = persons.map(patch).collect();
    set
}
