//! The short form of patches on the wire; common and usual values are omitted.
//!
//! A box belongs to the patch's own tick or to one shortly before. A crop has a grid of quarter
//! pixels ([`crate::grid::CellGrid::snapped`]). Most people have one crop, some two. Maps have one
//! of a few sizes. A patch that does not fit this form is written in full. Both forms are lossless.

use serde::{Deserialize, Deserializer, Serialize, Serializer};

use crate::grid::CellGrid;
use crate::id::{CameraIndex, PersonId, SessionId, ViewpointIndex};
use crate::message::live::PatchTiming;
use crate::message::{PatchSet, PersonPatch};
use crate::patch::EncodedMaps;
use crate::tick::Tick;

/// A [`PatchSet`] on the wire; `P` is its people, by reference or owned.
#[derive(Serialize, Deserialize)]
struct Set<P> {
    session: SessionId,
    tick: Tick,
    viewpoint: ViewpointIndex,
    part: u16,
    parts: u16,
    sighting_parts: u16,
    timing: Option<PatchTiming>,
    persons: P,
}

/// A [`PersonPatch`] on the wire.
#[derive(Serialize, Deserialize)]
struct Patch<B> {
    person: PersonId,
    camera: CameraIndex,
    /// Ticks from the box to the patch.
    age: i64,
    capture_offset_us: i32,
    crops: Crops,
    size: Size,
    bytes: B,
}

/// Common sizes of maps have a number; others are width, height, keypoints.
#[derive(Serialize, Deserialize)]
enum Size {
    Coco48x64,
    Coco72x96,
    Coco40x56,
    Other(u16, u16, u8),
}

const USUAL: [(u16, u16, u8); 3] = [(48, 64, 17), (72, 96, 17), (40, 56, 17)];

/// The grids, and the assignment of maps to them.
#[derive(Serialize, Deserialize)]
enum Crops {
    One([i32; 4]),
    /// Bit k: keypoint k uses the second grid.
    Two([i32; 4], [i32; 4], u64),
    Other(Vec<CellGrid>, Vec<u8>),
}

impl Serialize for PatchSet {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let set = Set {
            session: self.session,
            tick: self.tick,
            viewpoint: self.viewpoint,
            part: self.part,
            parts: self.parts,
            sighting_parts: self.sighting_parts,
            timing: self.timing,
            persons: Persons(self),
        };
        set.serialize(serializer)
    }
}

struct Persons<'a>(&'a PatchSet);

impl Serialize for Persons<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let tick = self.0.tick;
        serializer.collect_seq(self.0.persons.iter().map(|patch| written(patch, tick)))
    }
}

impl<'de> Deserialize<'de> for PatchSet {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let set = Set::<Vec<Patch<Vec<u8>>>>::deserialize(deserializer)?;
        let tick = set.tick;
        let persons = set.persons.into_iter().map(|patch| read(patch, tick));
        Ok(Self {
            session: set.session,
            tick,
            viewpoint: set.viewpoint,
            part: set.part,
            parts: set.parts,
            sighting_parts: set.sighting_parts,
            timing: set.timing,
            persons: persons.collect(),
        })
    }
}

fn written(patch: &PersonPatch, tick: Tick) -> Patch<&[u8]> {
    let maps = &patch.maps;
    let size = match (maps.width, maps.height, maps.keypoints) {
        size if size == USUAL[0] => Size::Coco48x64,
        size if size == USUAL[1] => Size::Coco72x96,
        size if size == USUAL[2] => Size::Coco40x56,
        (width, height, keypoints) => Size::Other(width, height, keypoints),
    };
    Patch {
        person: patch.person,
        camera: patch.camera,
        age: tick.0.wrapping_sub(patch.box_tick.0),
        capture_offset_us: patch.capture_offset_us,
        crops: short(patch)
            .unwrap_or_else(|| Crops::Other(patch.crops.clone(), patch.crop_of_keypoint.clone())),
        size,
        bytes: &maps.bytes,
    }
}

/// The short form of the crops, if it is exact.
fn short(patch: &PersonPatch) -> Option<Crops> {
    let (maps, of_keypoint) = (&patch.maps, &patch.crop_of_keypoint);
    let fits = |grid: &CellGrid| (grid.width, grid.height) == (maps.width, maps.height);
    let n = usize::from(maps.keypoints);
    if of_keypoint.len() != n || n > 64 || !patch.crops.iter().all(fits) {
        return None;
    }
    match patch.crops[..] {
        [grid] if of_keypoint.iter().all(|&crop| crop == 0) => Some(Crops::One(grid.short()?)),
        [first, second] if of_keypoint.iter().all(|&crop| crop < 2) => {
            let bits = of_keypoint.iter().enumerate();
            let mask = bits.fold(0, |mask, (k, &crop)| mask | u64::from(crop) << k);
            Some(Crops::Two(first.short()?, second.short()?, mask))
        }
        _ => None,
    }
}

fn read(patch: Patch<Vec<u8>>, tick: Tick) -> PersonPatch {
    let (width, height, keypoints) = match patch.size {
        Size::Coco48x64 => USUAL[0],
        Size::Coco72x96 => USUAL[1],
        Size::Coco40x56 => USUAL[2],
        Size::Other(width, height, keypoints) => (width, height, keypoints),
    };
    // At most as many as a patch may have; the check refuses a patch with more.
    let n = usize::from(keypoints).min(crate::patch::MAX_KEYPOINTS);
    let grid = |short| CellGrid::from_short(short, width, height);
    let (crops, crop_of_keypoint) = match patch.crops {
        Crops::One(first) => (vec![grid(first)], vec![0; n]),
        Crops::Two(first, second, mask) => {
            let of_keypoint = (0..n).map(|k| (mask >> k & 1) as u8);
            (vec![grid(first), grid(second)], of_keypoint.collect())
        }
        Crops::Other(crops, of_keypoint) => (crops, of_keypoint),
    };
    PersonPatch {
        person: patch.person,
        camera: patch.camera,
        box_tick: Tick(tick.0.wrapping_sub(patch.age)),
        capture_offset_us: patch.capture_offset_us,
        crops,
        crop_of_keypoint,
        maps: EncodedMaps {
            width,
            height,
            keypoints,
            bytes: patch.bytes,
        },
    }
}
