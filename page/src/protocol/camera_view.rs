//! Kind 2: boxes, projected keypoints and sightings of one camera at a tick. Sent to clients that
//! selected the camera.

use farfield_proto::bounding_box::BoundingBox;
use farfield_proto::id::{CameraIndex, PersonId};
use farfield_proto::tick::Tick;

use super::{PROTOCOL, ReadError, Reader};

/// The kind of this message.
pub const KIND: u8 = 2;
const HEAD_BYTES: usize = 24;
/// Bytes of a person before its keypoints.
const PERSON_HEAD_BYTES: usize = 28;
/// Bytes of a sighting before its keypoints.
const SIGHTING_HEAD_BYTES: usize = 4;
/// Keypoint units per pixel.
const PER_PX: f32 = 4.0;
/// Both coordinates of a keypoint out of range.
const NOWHERE: i16 = i16::MIN;
const HAS_BOX: u8 = 1;
const IS_CHOSEN: u8 = 2;
const HAS_KEYPOINTS: u8 = 4;

/// What a camera sees at a tick; pixels are undistorted.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraView {
    /// The camera.
    pub camera: CameraIndex,
    /// The lower half of fusion's session.
    pub session: u32,
    /// The tick.
    pub tick: Tick,
    /// Keypoints of every person.
    pub keypoints: u8,
    /// The tracked people.
    pub persons: Vec<ViewedPerson>,
    /// People that the detector found without a box.
    pub sightings: Vec<ViewedSighting>,
}

/// One person in one camera.
#[derive(Debug, Clone, PartialEq)]
pub struct ViewedPerson {
    /// Its id.
    pub id: PersonId,
    /// Predicted image region.
    pub bounding_box: Option<BoundingBox>,
    /// Whether the edge cropped the person from this camera.
    pub is_chosen: bool,
    /// Projected keypoints of the pose, pixels; `None` if out of range. Empty if unknown.
    pub keypoints_px: Vec<Option<[f32; 2]>>,
}

/// One detected person.
#[derive(Debug, Clone, PartialEq)]
pub struct ViewedSighting {
    /// The detector's confidence, 0 to 1.
    pub score: f32,
    /// The best peak of each keypoint, pixels.
    pub keypoints_px: Vec<Option<[f32; 2]>>,
}

fn quarter_px(position_px: Option<[f32; 2]>) -> [i16; 2] {
    let reach = f32::from(i16::MAX) / PER_PX;
    let in_reach = position_px.filter(|px| px.iter().all(|v| v.abs() <= reach));
    in_reach.map_or([NOWHERE; 2], |px| px.map(|v| (v * PER_PX).round() as i16))
}

fn put_keypoints(keypoints_px: &[Option<[f32; 2]>], n: u8, bytes: &mut Vec<u8>) {
    for i in 0..usize::from(n) {
        let quarters = quarter_px(keypoints_px.get(i).copied().flatten());
        bytes.extend(quarters.into_iter().flat_map(i16::to_le_bytes));
    }
}

fn read_keypoints(
    reader: &Reader<'_>,
    at: usize,
    n: u8,
) -> Result<Vec<Option<[f32; 2]>>, ReadError> {
    let one = |i: usize| -> Result<Option<[f32; 2]>, ReadError> {
        let quarters = [reader.i16(at + 4 * i)?, reader.i16(at + 4 * i + 2)?];
        let is_there = quarters != [NOWHERE; 2];
        Ok(is_there.then(|| quarters.map(|v| f32::from(v) / PER_PX)))
    };
    (0..usize::from(n)).map(one).collect()
}

impl CameraView {
    /// Encodes the message.
    pub fn encode(&self) -> Vec<u8> {
        let most = usize::from(u16::MAX);
        let (n, s) = (self.persons.len().min(most), self.sightings.len().min(most));
        let mut bytes =
            Vec::with_capacity(HEAD_BYTES + (n + s) * (28 + 4 * usize::from(self.keypoints)));
        bytes.extend([PROTOCOL, KIND]);
        bytes.extend(self.camera.0.to_le_bytes());
        bytes.extend(self.session.to_le_bytes());
        bytes.extend(self.tick.0.to_le_bytes());
        bytes.extend((n as u16).to_le_bytes());
        bytes.extend((s as u16).to_le_bytes());
        bytes.extend([self.keypoints, 0, 0, 0]);
        for person in self.persons.iter().take(n) {
            bytes.extend(person.id.0.to_le_bytes());
            let flag = |holds: bool, bit: u8| if holds { bit } else { 0 };
            let flags = flag(person.bounding_box.is_some(), HAS_BOX)
                | flag(person.is_chosen, IS_CHOSEN)
                | flag(!person.keypoints_px.is_empty(), HAS_KEYPOINTS);
            bytes.extend([flags, 0, 0, 0]);
            let [cx, cy, w, h, turn] = person.bounding_box.map_or([0.0; 5], |it| {
                let ([cx, cy], [w, h]) = (it.center_px, it.size_px);
                [cx, cy, w, h, it.rotation_rad]
            });
            for number in [cx, cy, w, h, turn] {
                bytes.extend(number.to_le_bytes());
            }
            put_keypoints(&person.keypoints_px, self.keypoints, &mut bytes);
        }
        for sighting in self.sightings.iter().take(s) {
            bytes.extend(sighting.score.to_le_bytes());
            put_keypoints(&sighting.keypoints_px, self.keypoints, &mut bytes);
        }
        bytes
    }

    /// Decodes a message.
    ///
    /// # Errors
    /// [`ReadError`] if the bytes are not such a message.
    pub fn decode(bytes: &[u8]) -> Result<Self, ReadError> {
        let reader = Reader::with_kind(bytes, KIND)?;
        let (n, s) = (usize::from(reader.u16(16)?), usize::from(reader.u16(18)?));
        let keypoints = reader.u8(20)?;
        let person_bytes = PERSON_HEAD_BYTES + 4 * usize::from(keypoints);
        let sighting_bytes = SIGHTING_HEAD_BYTES + 4 * usize::from(keypoints);
        let sightings_at = HEAD_BYTES + n * person_bytes;
        reader.holds(sightings_at + s * sighting_bytes)?;
        let person = |i| read_person(&reader, HEAD_BYTES + i * person_bytes, keypoints);
        let sighting = |i: usize| -> Result<ViewedSighting, ReadError> {
            let at = sightings_at + i * sighting_bytes;
            Ok(ViewedSighting {
                score: reader.f32(at)?,
                keypoints_px: read_keypoints(&reader, at + SIGHTING_HEAD_BYTES, keypoints)?,
            })
        };
        Ok(Self {
            camera: CameraIndex(reader.u16(2)?),
            session: reader.u32(4)?,
            tick: Tick(reader.i64(8)?),
            keypoints,
            persons: (0..n).map(person).collect::<Result<_, _>>()?,
            sightings: (0..s).map(sighting).collect::<Result<_, _>>()?,
        })
    }
}

fn read_person(reader: &Reader<'_>, at: usize, keypoints: u8) -> Result<ViewedPerson, ReadError> {
    let flags = reader.u8(at + 4)?;
    let number = |i: usize| reader.f32(at + 8 + 4 * i);
    let bounding_box = BoundingBox {
        center_px: [number(0)?, number(1)?],
        size_px: [number(2)?, number(3)?],
        rotation_rad: number(4)?,
    };
    let has_keypoints = flags & HAS_KEYPOINTS != 0;
    let n = if has_keypoints { keypoints } else { 0 };
    Ok(ViewedPerson {
        id: PersonId(reader.u32(at)?),
        bounding_box: (flags & HAS_BOX != 0).then_some(bounding_box),
        is_chosen: flags & IS_CHOSEN != 0,
        keypoints_px: read_keypoints(reader, at + PERSON_HEAD_BYTES, n)?,
    })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn keypoints(n: usize) -> impl Strategy<Value = Vec<Option<[f32; 2]>>> {
        // Quarter pixels, so that encoding is lossless.
        let one = prop::option::of((-8000i16..8000, -8000i16..8000));
        let exact = |(x, y): (i16, i16)| [f32::from(x) / 4.0, f32::from(y) / 4.0];
        prop::collection::vec(one.prop_map(move |px| px.map(exact)), n)
    }

    fn any_view() -> impl Strategy<Value = CameraView> {
        (1..=30u8).prop_flat_map(|k| {
            let n = usize::from(k);
            let number = -4000.0f32..4000.0;
            let bounding_box =
                (number.clone(), number.clone(), number).prop_map(|(x, y, turn)| BoundingBox {
                    center_px: [x, y],
                    size_px: [y, x],
                    rotation_rad: turn,
                });
            let person = (
                any::<u32>(),
                prop::option::of(bounding_box),
                any::<bool>(),
                keypoints(n),
            );
            let person =
                person.prop_map(|(id, bounding_box, is_chosen, keypoints_px)| ViewedPerson {
                    id: PersonId(id),
                    bounding_box,
                    is_chosen,
                    keypoints_px,
                });
            let sighting =
                (0.0f32..1.0, keypoints(n)).prop_map(|(score, keypoints_px)| ViewedSighting {
                    score,
                    keypoints_px,
                });
            let lists = (
                prop::collection::vec(person, 0..5),
                prop::collection::vec(sighting, 0..4),
            );
            (any::<u16>(), any::<u32>(), any::<i64>(), lists).prop_map(
                move |(camera, session, tick, (persons, sightings))| CameraView {
                    camera: CameraIndex(camera),
                    session,
                    tick: Tick(tick),
                    keypoints: k,
                    persons,
                    sightings,
                },
            )
        })
    }

    proptest! {
        #[test]
        fn camera_views_round_trip(view in any_view()) {
            prop_assert_eq!(CameraView::decode(&view.encode()).unwrap(), view);
        }

        #[test]
        fn arbitrary_bytes_are_a_view_or_an_error(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
            let mut begun = vec![PROTOCOL, KIND];
            begun.extend(bytes);
            let _read = CameraView::decode(&begun);
        }
    }

    #[test]
    fn keypoints_out_of_range_have_a_special_code() {
        assert_eq!(quarter_px(Some([9000.0, 3.0])), [NOWHERE; 2]);
        assert_eq!(quarter_px(Some([f32::NAN, 3.0])), [NOWHERE; 2]);
        assert_eq!(quarter_px(Some([-1.13, 3.0])), [-5, 12]);
    }
}
