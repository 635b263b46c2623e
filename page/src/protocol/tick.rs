//! Kind 1: the people of a tick, about 240 bytes each; encoded once for all who watch.

use farfield_proto::id::PersonId;
use farfield_proto::message::PersonState;
use farfield_proto::tick::Tick;

use super::reader::Reader;
use super::{PROTOCOL, ReadError};

/// The kind of this message.
pub const KIND: u8 = 1;
/// Bytes before the first person.
const HEAD_BYTES: usize = 48;
/// Bytes of a person before its joints.
const PERSON_HEAD_BYTES: usize = 32;
/// Where the flags of a message are.
const FLAGS_AT: usize = 2;
/// It came just now from fusion.
const LIVE: u16 = 1;
/// The joints of a person are known.
const HAS_JOINTS: u8 = 1;
/// Metres of one unit of a standard deviation.
pub const SIGMA_STEP_M: f32 = 0.002;
/// A standard deviation that is larger than any that can be written.
const SIGMA_MORE: u8 = 254;
/// A standard deviation that is not known.
const SIGMA_UNKNOWN: u8 = 255;
/// Steps of joints, metres, the finest first; the coarsest reaches 655 m either way.
const STEPS_M: [f32; 6] = [0.000_5, 0.001, 0.002, 0.005, 0.01, 0.02];
/// How far outside the field joints are still told exactly, metres.
const MARGIN_M: f32 = 5.0;

/// Where joints are counted from, and in which steps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JointGrid {
    /// World, metres.
    pub origin_m: [f32; 3],
    /// Metres.
    pub step_m: f32,
}

impl JointGrid {
    /// The finest that reaches some metres beyond the field from `min_m` to `max_m`.
    pub fn of_field(min_m: [f64; 3], max_m: [f64; 3]) -> Self {
        let middle = |i: usize| (0.5 * (min_m[i] + max_m[i])) as f32;
        let half = (0..3).map(|i| (0.5 * (max_m[i] - min_m[i])).abs() as f32);
        let reach = half.fold(0.0, f32::max) + MARGIN_M;
        let fine = STEPS_M
            .into_iter()
            .find(|step_m| step_m * f32::from(i16::MAX) >= reach);
        Self {
            origin_m: [middle(0), middle(1), middle(2)],
            step_m: fine.unwrap_or(STEPS_M[STEPS_M.len() - 1]),
        }
    }

    /// A point in steps; what is too far away is as far as can be written.
    pub fn steps(&self, point_m: [f32; 3]) -> [i16; 3] {
        // `as` saturates, and takes what is no number for 0.
        std::array::from_fn(|i| ((point_m[i] - self.origin_m[i]) / self.step_m).round() as i16)
    }

    /// The point of a number of steps, metres.
    pub fn point_m(&self, steps: [i16; 3]) -> [f32; 3] {
        std::array::from_fn(|i| self.origin_m[i] + self.step_m * f32::from(steps[i]))
    }
}

/// The people of one tick.
#[derive(Debug, Clone, PartialEq)]
pub struct TickMessage {
    /// Whether it came just now from fusion.
    pub is_live: bool,
    /// The lower half of fusion's session.
    pub session: u32,
    /// The tick.
    pub tick: Tick,
    /// When fusion published it, microseconds of Unix time.
    pub at_us: i64,
    /// What joints are counted in.
    pub grid: JointGrid,
    /// Joints of every person.
    pub joints: u8,
    /// The people.
    pub persons: Vec<TickPerson>,
}

/// One person of a tick.
#[derive(Debug, Clone, PartialEq)]
pub struct TickPerson {
    /// Who.
    pub id: PersonId,
    /// Phase of the track.
    pub state: PersonState,
    /// How many viewpoints gave evidence.
    pub views: u16,
    /// Bit v: viewpoint v sent maps of the person for this tick.
    pub viewpoints: u64,
    /// Bit a: angle a is carried by a prior.
    pub unobserved: u64,
    /// Bit a: angle a is at a bound of its range.
    pub clamped: u64,
    /// The joints in steps; as many as the message says, or none where they are not known.
    pub joints: Vec<[i16; 3]>,
    /// Standard deviations in units of [`SIGMA_STEP_M`], 254: more, 255: not known; as many as joints.
    pub sigma: Vec<u8>,
}

/// A standard deviation as it is written.
pub fn sigma_code(sigma_m: Option<f32>) -> u8 {
    match sigma_m {
        Some(sigma_m) if sigma_m.is_finite() => {
            ((sigma_m / SIGMA_STEP_M).round() as u8).min(SIGMA_MORE)
        }
        _ => SIGMA_UNKNOWN,
    }
}

/// What a written standard deviation says, metres; one that is too large is the largest.
pub fn sigma_m(code: u8) -> Option<f32> {
    (code != SIGMA_UNKNOWN).then(|| f32::from(code) * SIGMA_STEP_M)
}

/// A state as it is written.
fn state_code(state: PersonState) -> u8 {
    match state {
        PersonState::Tentative => 0,
        PersonState::Tracked => 1,
        PersonState::Coasting => 2,
    }
}

fn person_bytes(joints: u8) -> usize {
    (PERSON_HEAD_BYTES + 7 * usize::from(joints)).next_multiple_of(4)
}

impl TickMessage {
    /// The message as bytes. More than 65,535 people are left out; joints that a person lacks are 0.
    pub fn encode(&self) -> Vec<u8> {
        let n = self.persons.len().min(usize::from(u16::MAX));
        let stride = person_bytes(self.joints);
        let mut bytes = Vec::with_capacity(HEAD_BYTES + n * stride);
        bytes.extend([PROTOCOL, KIND]);
        bytes.extend((if self.is_live { LIVE } else { 0 }).to_le_bytes());
        bytes.extend(self.session.to_le_bytes());
        bytes.extend(self.tick.0.to_le_bytes());
        bytes.extend(self.at_us.to_le_bytes());
        for number in self.grid.origin_m.into_iter().chain([self.grid.step_m]) {
            bytes.extend(number.to_le_bytes());
        }
        bytes.extend((n as u16).to_le_bytes());
        bytes.extend([self.joints, (stride / 4) as u8]);
        bytes.extend([0; 4]);
        for person in self.persons.iter().take(n) {
            self.encode_person(person, &mut bytes);
            bytes.resize(bytes.len().next_multiple_of(4), 0);
        }
        bytes
    }

    fn encode_person(&self, person: &TickPerson, bytes: &mut Vec<u8>) {
        let n = usize::from(self.joints);
        bytes.extend(person.id.0.to_le_bytes());
        let has_joints = if person.joints.is_empty() {
            0
        } else {
            HAS_JOINTS
        };
        bytes.extend([state_code(person.state), has_joints]);
        bytes.extend(person.views.to_le_bytes());
        for bits in [person.viewpoints, person.unobserved, person.clamped] {
            bytes.extend(bits.to_le_bytes());
        }
        for i in 0..n {
            let joint = person.joints.get(i).copied().unwrap_or_default();
            bytes.extend(joint.into_iter().flat_map(i16::to_le_bytes));
        }
        bytes.extend((0..n).map(|i| person.sigma.get(i).copied().unwrap_or(SIGMA_UNKNOWN)));
    }

    /// Reads a message; longer strides than today's are stepped over.
    ///
    /// # Errors
    /// [`ReadError`] where the bytes are no such message.
    pub fn decode(bytes: &[u8]) -> Result<Self, ReadError> {
        let reader = Reader::of_kind(bytes, KIND)?;
        let n = usize::from(reader.u16(40)?);
        let joints = reader.u8(42)?;
        let stride = 4 * usize::from(reader.u8(43)?);
        let expected = PERSON_HEAD_BYTES + 7 * usize::from(joints);
        if stride < expected && n > 0 {
            return Err(ReadError::ShortStride {
                got: stride,
                expected,
            });
        }
        reader.holds(HEAD_BYTES + n * stride)?;
        let person = |i| decode_person(&reader, HEAD_BYTES + i * stride, joints);
        Ok(Self {
            is_live: reader.u16(FLAGS_AT)? & LIVE != 0,
            session: reader.u32(4)?,
            tick: Tick(reader.i64(8)?),
            at_us: reader.i64(16)?,
            grid: JointGrid {
                origin_m: [reader.f32(24)?, reader.f32(28)?, reader.f32(32)?],
                step_m: reader.f32(36)?,
            },
            joints,
            persons: (0..n).map(person).collect::<Result<_, _>>()?,
        })
    }
}

fn decode_person(reader: &Reader<'_>, at: usize, joints: u8) -> Result<TickPerson, ReadError> {
    let joints_at = at + PERSON_HEAD_BYTES;
    let sigma_at = joints_at + 6 * usize::from(joints);
    let has_joints = reader.u8(at + 5)? & HAS_JOINTS != 0;
    let n = if has_joints { usize::from(joints) } else { 0 };
    let joint = |i: usize| -> Result<[i16; 3], ReadError> {
        let first = joints_at + 6 * i;
        Ok([
            reader.i16(first)?,
            reader.i16(first + 2)?,
            reader.i16(first + 4)?,
        ])
    };
    Ok(TickPerson {
        id: PersonId(reader.u32(at)?),
        state: match reader.u8(at + 4)? {
            0 => PersonState::Tentative,
            1 => PersonState::Tracked,
            _ => PersonState::Coasting,
        },
        views: reader.u16(at + 6)?,
        viewpoints: reader.u64(at + 8)?,
        unobserved: reader.u64(at + 16)?,
        clamped: reader.u64(at + 24)?,
        joints: (0..n).map(joint).collect::<Result<_, _>>()?,
        sigma: (0..n)
            .map(|i| reader.u8(sigma_at + i))
            .collect::<Result<_, _>>()?,
    })
}

/// The bytes of an encoded tick as a part of the past: no longer what came just now.
pub fn as_history(encoded: &[u8]) -> Vec<u8> {
    let mut bytes = encoded.to_vec();
    if let Some(flags) = bytes.get_mut(FLAGS_AT) {
        *flags &= !(LIVE as u8);
    }
    bytes
}

#[cfg(test)]
pub(super) mod tests {
    use proptest::prelude::*;

    use super::*;

    fn any_person(joints: u8) -> impl Strategy<Value = TickPerson> {
        let n = usize::from(joints);
        let known = prop_oneof![Just(n), Just(0)];
        let body = known.prop_flat_map(|n| {
            (
                prop::collection::vec(any::<[i16; 3]>(), n),
                prop::collection::vec(any::<u8>(), n),
            )
        });
        (any::<u32>(), 0..3u8, any::<u16>(), any::<[u64; 3]>(), body).prop_map(
            |(id, state, views, [viewpoints, unobserved, clamped], (joints, sigma))| TickPerson {
                id: PersonId(id),
                state: [
                    PersonState::Tentative,
                    PersonState::Tracked,
                    PersonState::Coasting,
                ][usize::from(state)],
                views,
                viewpoints,
                unobserved,
                clamped,
                joints,
                sigma,
            },
        )
    }

    fn any_tick() -> impl Strategy<Value = TickMessage> {
        (1..=64u8).prop_flat_map(|joints| {
            let persons = prop::collection::vec(any_person(joints), 0..5);
            (
                any::<bool>(),
                any::<u32>(),
                any::<i64>(),
                any::<i64>(),
                persons,
            )
                .prop_map(move |(is_live, session, tick, at_us, persons)| {
                    TickMessage {
                        is_live,
                        session,
                        tick: Tick(tick),
                        at_us,
                        grid: JointGrid {
                            origin_m: [1.0, -2.0, 0.5],
                            step_m: 0.001,
                        },
                        joints,
                        persons,
                    }
                })
        })
    }

    proptest! {
        #[test]
        fn what_is_written_is_read_again(tick in any_tick()) {
            let bytes = tick.encode();
            prop_assert_eq!(bytes.len() % 4, 0);
            let again = TickMessage::decode(&bytes).unwrap();
            prop_assert_eq!(&again, &tick);
            let past = TickMessage::decode(&as_history(&bytes)).unwrap();
            prop_assert_eq!(past, TickMessage { is_live: false, ..again });
        }

        #[test]
        fn bytes_of_strangers_are_a_tick_or_an_error(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
            let _read = TickMessage::decode(&bytes);
            let mut begun = vec![PROTOCOL, KIND];
            begun.extend(bytes);
            let _read = TickMessage::decode(&begun);
        }

        #[test]
        fn a_joint_in_the_field_is_told_to_half_a_step(x in -60.0f32..60.0, y in -40.0f32..40.0, z in 0.0f32..3.0) {
            let grid = JointGrid::of_field([-60.0, -40.0, 0.0], [60.0, 40.0, 3.0]);
            let again = grid.point_m(grid.steps([x, y, z]));
            for (found, told) in [x, y, z].into_iter().zip(again) {
                prop_assert!((found - told).abs() <= 0.51 * grid.step_m);
            }
        }
    }

    #[test]
    fn a_person_of_29_joints_takes_236_bytes() {
        assert_eq!(person_bytes(29), 236);
    }

    #[test]
    fn a_small_field_is_told_finely_and_a_large_one_wholly() {
        let step = |half: f64| JointGrid::of_field([-half, -half, 0.0], [half, half, 3.0]).step_m;
        assert!((step(5.0) - 0.000_5).abs() < 1e-9);
        assert!((step(60.0) - 0.002).abs() < 1e-9);
        assert!((step(10_000.0) - 0.02).abs() < 1e-9);
        let far = JointGrid::of_field([-5.0; 3], [5.0; 3]).steps([1e9, -1e9, f32::NAN]);
        assert_eq!(far, [i16::MAX, i16::MIN, 0]);
    }

    #[test]
    fn a_standard_deviation_is_unknown_large_or_told() {
        assert_eq!(sigma_code(None), 255);
        assert_eq!(sigma_code(Some(f32::NAN)), 255);
        assert_eq!(sigma_code(Some(7.0)), 254);
        assert_eq!(sigma_code(Some(0.013)), 7);
        assert_eq!(sigma_m(255), None);
    }
}
