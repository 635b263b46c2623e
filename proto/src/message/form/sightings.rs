//! The short form of sightings on the wire: integers.
//!
//! Edges make sightings of sixteenths of a pixel and 255ths ([`Sighting::snapped`]), because a
//! detection pass of a crowd is the largest burst on a thin link. Keypoints are relative to the
//! previous one. A sighting that does not fit this form is written in full. Both forms are
//! lossless.

use std::fmt;

use serde::de::{Error as _, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use crate::id::{CameraIndex, SessionId, ViewpointIndex};
use crate::message::{KeypointPeak, MAX_SIGHTINGS, Sighting, SightingSet};
use crate::tick::Tick;

/// Positions are multiples of 1/16 pixel: half a step is far below the accuracy of a detector's
/// peak.
const PER_PX: f32 = 16.0;
/// Integers up to here are exact in single precision.
const MOST: f32 = 16_777_216.0;
/// Scores are multiples of 1/255, as the cells of maps.
const PER_ONE: f32 = 255.0;

/// A [`SightingSet`] on the wire; `S` is its sightings.
#[derive(Serialize, Deserialize)]
struct Set<S> {
    session: SessionId,
    tick: Tick,
    viewpoint: ViewpointIndex,
    part: u16,
    parts: u16,
    sightings: S,
}

/// A [`Sighting`] on the wire; `S` is one in full, by reference or owned.
#[derive(Serialize, Deserialize)]
enum Form<S> {
    Whole(Whole),
    Other(S),
}

/// A sighting in integers.
#[derive(Serialize, Deserialize)]
struct Whole {
    camera: CameraIndex,
    score_255ths: u8,
    /// Number of the network's keypoints.
    count: u8,
    /// Bit k: keypoint k is present.
    seen: u64,
    /// The present keypoints, each relative to the previous one; the first to the pixel (0, 0).
    peaks: Vec<WholePeak>,
}

#[derive(Serialize, Deserialize)]
struct WholePeak {
    position_16ths: [i32; 2],
    score_255ths: u8,
}

impl Sighting {
    /// The sighting on the grid of the short form: sixteenths of a pixel and 255ths. Values too
    /// large for the grid, or not finite, are unchanged.
    #[must_use]
    pub fn snapped(self) -> Self {
        let snapped = self.whole().and_then(|whole| whole.read());
        snapped.unwrap_or(self)
    }

    /// The nearest sighting in integers; `None` if a number is too large or not finite.
    fn whole(&self) -> Option<Whole> {
        if self.keypoints.len() > crate::patch::MAX_KEYPOINTS {
            return None;
        }
        let mut whole = Whole {
            camera: self.camera,
            score_255ths: share(self.score)?,
            count: self.keypoints.len() as u8,
            seen: 0,
            peaks: Vec::with_capacity(self.keypoints.len()),
        };
        let mut before = [0; 2];
        for (k, peak) in self.keypoints.iter().enumerate() {
            let Some(peak) = peak else { continue };
            let [x, y] = peak.position_px;
            let at = [near(x)?, near(y)?];
            whole.seen |= 1 << k;
            whole.peaks.push(WholePeak {
                position_16ths: [at[0] - before[0], at[1] - before[1]],
                score_255ths: share(peak.score)?,
            });
            before = at;
        }
        Some(whole)
    }

    fn is_same_bits(&self, other: &Self) -> bool {
        let bits = |peak: &Option<KeypointPeak>| {
            let peak = (*peak)?;
            let [x, y] = peak.position_px;
            Some([x, y, peak.score].map(f32::to_bits))
        };
        // Compares bits, because -0 is equal to 0.
        self.camera == other.camera
            && self.score.to_bits() == other.score.to_bits()
            && self.keypoints.len() == other.keypoints.len()
            && self
                .keypoints
                .iter()
                .map(bits)
                .eq(other.keypoints.iter().map(bits))
    }
}

impl Whole {
    /// The sighting; `None` if the number of present keypoints does not match, or if one is farther
    /// away than any writer puts it.
    fn read(&self) -> Option<Sighting> {
        let all = usize::from(self.count);
        let fits = all <= crate::patch::MAX_KEYPOINTS
            && self.seen.checked_shr(all as u32).unwrap_or(0) == 0
            && self.seen.count_ones() as usize == self.peaks.len();
        if !fits {
            return None;
        }
        let mut keypoints = vec![None; all];
        let mut at = [0_i32; 2];
        let there = keypoints
            .iter_mut()
            .enumerate()
            .filter(|(k, _)| self.seen >> k & 1 == 1);
        for ((_, keypoint), peak) in there.zip(&self.peaks) {
            for (at, step) in at.iter_mut().zip(peak.position_16ths) {
                // Received numbers may have any size.
                *at = at
                    .checked_add(step)
                    .filter(|at| at.unsigned_abs() <= MOST as u32)?;
            }
            *keypoint = Some(KeypointPeak {
                position_px: at.map(|whole| whole as f32 / PER_PX),
                score: f32::from(peak.score_255ths) / PER_ONE,
            });
        }
        Some(Sighting {
            camera: self.camera,
            score: f32::from(self.score_255ths) / PER_ONE,
            keypoints,
        })
    }
}

fn near(px: f32) -> Option<i32> {
    let whole = (px * PER_PX).round();
    (whole.abs() <= MOST).then_some(whole as i32)
}

fn share(score: f32) -> Option<u8> {
    (0.0..=1.0)
        .contains(&score)
        .then(|| (score * PER_ONE).round() as u8)
}

/// A sighting in its shortest lossless form.
struct Shortest<'a>(&'a Sighting);

impl Serialize for Shortest<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let whole = self.0.whole().filter(|whole| {
            let again = whole.read();
            again.is_some_and(|again| again.is_same_bits(self.0))
        });
        let form = match whole {
            Some(whole) => Form::Whole(whole),
            None => Form::Other(self.0),
        };
        form.serialize(serializer)
    }
}

/// A sighting that was read.
struct Read(Sighting);

impl<'de> Deserialize<'de> for Read {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let read = match Form::<Sighting>::deserialize(deserializer)? {
            Form::Whole(whole) => whole.read(),
            Form::Other(sighting) => Some(sighting),
        };
        read.map(Self)
            .ok_or_else(|| D::Error::custom("a wrong number of keypoints"))
    }
}

/// Sightings limited to the number that a message may have: absent keypoints take no bytes, but
/// memory.
struct Sightings(Vec<Sighting>);

impl<'de> Deserialize<'de> for Sightings {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_seq(SightingsVisitor)
    }
}

struct SightingsVisitor;

impl<'de> Visitor<'de> for SightingsVisitor {
    type Value = Sightings;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "at most {MAX_SIGHTINGS} sightings")
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut sequence: A) -> Result<Self::Value, A::Error> {
        let mut sightings = Vec::new();
        while let Some(Read(sighting)) = sequence.next_element()? {
            if sightings.len() == MAX_SIGHTINGS {
                return Err(A::Error::custom(format_args!(
                    "more than {MAX_SIGHTINGS} sightings"
                )));
            }
            sightings.push(sighting);
        }
        Ok(Sightings(sightings))
    }
}

/// Appends the set with its sightings in short form.
pub(in crate::message) fn write(set: &SightingSet, bytes: Vec<u8>) -> postcard::Result<Vec<u8>> {
    let sightings: Vec<Shortest<'_>> = set.sightings.iter().map(Shortest).collect();
    let set = Set {
        session: set.session,
        tick: set.tick,
        viewpoint: set.viewpoint,
        part: set.part,
        parts: set.parts,
        sightings,
    };
    postcard::to_extend(&set, bytes)
}

/// The set that [`write`] wrote, and the rest.
pub(in crate::message) fn read(bytes: &[u8]) -> postcard::Result<(SightingSet, &[u8])> {
    let (set, rest) = postcard::take_from_bytes::<Set<Sightings>>(bytes)?;
    let set = SightingSet {
        session: set.session,
        tick: set.tick,
        viewpoint: set.viewpoint,
        part: set.part,
        parts: set.parts,
        sightings: set.sightings.0,
    };
    Ok((set, rest))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn set(sightings: Vec<Sighting>) -> SightingSet {
        SightingSet {
            session: SessionId(9),
            tick: Tick(64),
            viewpoint: ViewpointIndex(2),
            part: 0,
            parts: 1,
            sightings,
        }
    }

    /// A person 180 px tall.
    fn usual() -> Sighting {
        let peak = |k: usize| KeypointPeak {
            position_px: [1_203.31 + 9.0 * (k % 2) as f32, 500.2 + 11.3 * k as f32],
            score: 0.9 - 0.01 * k as f32,
        };
        Sighting {
            camera: CameraIndex(3),
            score: 0.87,
            keypoints: (0..17).map(|k| (k != 4).then(|| peak(k))).collect(),
        }
    }

    fn again(set: &SightingSet) -> SightingSet {
        let bytes = write(set, Vec::new()).unwrap();
        let (read, rest) = read(&bytes).unwrap();
        assert!(rest.is_empty());
        read
    }

    #[test]
    fn the_short_form_takes_less_than_half_the_bytes() {
        let bytes = |set: &SightingSet| write(set, Vec::new()).unwrap().len();
        let empty = bytes(&set(Vec::new()));
        let short = bytes(&set(vec![usual().snapped()])) - empty;
        let full = bytes(&set(vec![usual()])) - empty;
        assert!(2 * short < full, "{short} and {full} bytes");
    }

    #[test]
    fn keypoints_with_wrong_counts_or_positions_are_refused() {
        let whole = |count, seen, peaks: usize| Whole {
            camera: CameraIndex(0),
            score_255ths: 9,
            count,
            seen,
            peaks: std::iter::repeat_with(|| WholePeak {
                position_16ths: [3, -2],
                score_255ths: 1,
            })
            .take(peaks)
            .collect(),
        };
        let mut far = whole(2, 0b11, 2);
        far.peaks[0].position_16ths = [MOST as i32, 0];
        assert!(far.read().is_none());
        far.peaks[1].position_16ths = [i32::MAX, 0];
        assert!(far.read().is_none());
        far.peaks[1].position_16ths = [0, -(MOST as i32)];
        assert!(far.read().is_some());
        assert!(whole(2, 0b11, 2).read().is_some());
        assert!(whole(64, u64::MAX, 64).read().is_some());
        assert!(whole(2, 0b11, 1).read().is_none());
        assert!(whole(2, 0b01, 2).read().is_none());
        assert!(whole(2, 0b100, 1).read().is_none());
        assert!(whole(65, 0b1, 1).read().is_none());
    }

    #[test]
    fn the_number_of_read_sightings_is_limited() {
        let empty = |camera| Sighting {
            camera: CameraIndex(camera),
            score: 1.0,
            keypoints: vec![None; 64],
        };
        let full = set((0..MAX_SIGHTINGS as u16).map(empty).collect());
        assert_eq!(again(&full), full);
        let more = set((0..=MAX_SIGHTINGS as u16).map(empty).collect());
        let bytes = write(&more, Vec::new()).unwrap();
        assert!(read(&bytes).is_err());
    }

    fn any_sighting() -> impl Strategy<Value = Sighting> {
        let number = || prop_oneof![-4000.0f32..4000.0, any::<f32>()];
        let peak = (number(), number(), prop_oneof![0.0f32..=1.0, any::<f32>()]).prop_map(
            |(x, y, score)| KeypointPeak {
                position_px: [x, y],
                score,
            },
        );
        let keypoints = prop::collection::vec(prop::option::of(peak), 0..70);
        (any::<u16>(), 0.0f32..=1.0, keypoints).prop_map(|(camera, score, keypoints)| Sighting {
            camera: CameraIndex(camera),
            score,
            keypoints,
        })
    }

    proptest! {
        #[test]
        fn every_written_set_is_read_back(one in any_sighting(), snap in any::<bool>()) {
            let one = if snap { one.snapped() } else { one };
            let read = again(&set(vec![one.clone()]));
            prop_assert!(read.sightings[0].is_same_bits(&one), "{:?} of {:?}", read, one);
        }

        #[test]
        fn a_snapped_sighting_moves_at_most_half_a_grid_step(x in -4000.0f32..4000.0, score in 0.0f32..=1.0) {
            let mut moved = usual();
            moved.keypoints[2] = Some(KeypointPeak { position_px: [x, 0.0], score });
            let snapped = moved.snapped();
            let peak = snapped.keypoints[2].unwrap();
            prop_assert!((peak.position_px[0] - x).abs() <= 0.0315);
            prop_assert!((peak.score - score).abs() <= 0.002);
            prop_assert!((0.0..=1.0).contains(&peak.score));
            prop_assert_eq!(snapped.clone().snapped(), snapped);
        }

        #[test]
        fn arbitrary_bytes_are_a_set_or_an_error(bytes in prop::collection::vec(any::<u8>(), 0..120)) {
            drop(read(&bytes));
        }

        #[test]
        fn every_read_sighting_can_be_written_again(
            count in 0u8..70, seen in prop_oneof![0u64..0x2_0000, any::<u64>()], rest in prop::collection::vec(any::<u8>(), 0..120),
        ) {
            let mut bytes = postcard::to_allocvec(&(9u64, 64i64, 2u16, 0u16, 1u16, 1u8, 0u8, 3u16, 8u8, count, seen)).unwrap();
            bytes.extend(rest);
            if let Ok((set, _)) = read(&bytes) {
                prop_assert_eq!(set.sightings[0].keypoints.len(), usize::from(count));
                prop_assert!(set.sightings[0].is_same_bits(&again(&set).sightings[0]));
            }
        }
    }
}
