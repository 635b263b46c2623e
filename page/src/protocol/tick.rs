//! Kind 1: the people of a tick, about 240 bytes each; encoded once for all clients.

use super::text::json;
use farfield_proto::id::PersonId;
use farfield_proto::message::PersonState;
use farfield_proto::tick::Tick;
use serde::Serialize;

use super::{PROTOCOL, ReadError, Reader};

/// The kind of this message.
pub const KIND: u8 = 1;
/// Bytes before the first person.
const HEAD_BYTES: usize = 48;
/// Bytes of a person before its joints.
const PERSON_HEAD_BYTES: usize = 32;
/// Position of the flags.
const FLAGS_AT: usize = 2;
/// Flag: the tick just arrived from fusion.
const LIVE: u16 = 1;
/// Flag: the joints of the person are known.
const HAS_JOINTS: u8 = 1;
/// Metres of one unit of a standard deviation.
pub const SIGMA_STEP_M: f32 = 0.002;
/// Code of a standard deviation that exceeds the range.
const SIGMA_MORE: u8 = 254;
/// Code of an unknown standard deviation.
const SIGMA_UNKNOWN: u8 = 255;
/// Possible joint steps, metres, finest first; the coarsest reaches 655 m in each direction.
const STEPS_M: [f32; 6] = [0.000_5, 0.001, 0.002, 0.005, 0.01, 0.02];
/// Margin around the field in which joints are exact, metres.
const MARGIN_M: f32 = 5.0;

/// Origin and step of quantised joints.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JointGrid {
    /// World, metres.
    pub origin_m: [f32; 3],
    /// Metres.
    pub step_m: f32,
}

impl JointGrid {
    /// The finest grid that covers the field from `min_m` to `max_m` and a margin.
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

    /// Quantises a point; points out of range are clamped.
    pub fn steps(&self, point_m: [f32; 3]) -> [i16; 3] {
        // `as` saturates, and converts NaN to 0.
        std::array::from_fn(|i| ((point_m[i] - self.origin_m[i]) / self.step_m).round() as i16)
    }

    /// The point of quantised coordinates, metres.
    pub fn point_m(&self, steps: [i16; 3]) -> [f32; 3] {
        std::array::from_fn(|i| self.origin_m[i] + self.step_m * f32::from(steps[i]))
    }
}

/// The people of one tick.
#[derive(Debug, Clone, PartialEq)]
pub struct TickMessage {
    /// Whether it just arrived from fusion.
    pub is_live: bool,
    /// The lower half of fusion's session.
    pub session: u32,
    /// The tick.
    pub tick: Tick,
    /// When fusion published it, microseconds of Unix time.
    pub at_us: i64,
    /// Grid of the joints.
    pub grid: JointGrid,
    /// Number of joints of every person.
    pub joints: u8,
    /// The people.
    pub persons: Vec<TickPerson>,
}

/// One person of a tick.
#[derive(Debug, Clone, PartialEq)]
pub struct TickPerson {
    /// Its id.
    pub id: PersonId,
    /// Phase of the track.
    pub state: PersonState,
    /// Number of viewpoints with evidence.
    pub views: u16,
    /// Bit v: viewpoint v sent maps of the person for this tick.
    pub viewpoints: u64,
    /// Bit a: angle a comes from a prior.
    pub unobserved: u64,
    /// Bit a: angle a is at a limit of its range.
    pub clamped: u64,
    /// Quantised joints; as many as the message states, or none if unknown.
    pub joints: Vec<[i16; 3]>,
    /// Standard deviations in units of [`SIGMA_STEP_M`], one per joint; 254: larger, 255: unknown.
    pub sigma: Vec<u8>,
}

/// Encodes a standard deviation.
pub fn sigma_code(sigma_m: Option<f32>) -> u8 {
    match sigma_m {
        Some(sigma_m) if sigma_m.is_finite() => {
            ((sigma_m / SIGMA_STEP_M).round() as u8).min(SIGMA_MORE)
        }
        _ => SIGMA_UNKNOWN,
    }
}

/// Decodes a standard deviation, metres; the largest code stands for all larger values.
pub fn sigma_m(code: u8) -> Option<f32> {
    (code != SIGMA_UNKNOWN).then(|| f32::from(code) * SIGMA_STEP_M)
}

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
    /// Encodes the message. People beyond 65,535 are dropped; missing joints are 0.
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

    /// Decodes a message; strides longer than today's are accepted.
    ///
    /// # Errors
    /// [`ReadError`] if the bytes are not such a message.
    pub fn decode(bytes: &[u8]) -> Result<Self, ReadError> {
        let reader = Reader::with_kind(bytes, KIND)?;
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

/// Marks an encoded tick as past, no longer live.
pub fn as_history(encoded: &[u8]) -> Vec<u8> {
    let mut bytes = encoded.to_vec();
    if let Some(flags) = bytes.get_mut(FLAGS_AT) {
        *flags &= !(LIVE as u8);
    }
    bytes
}

/// The serialised form of a tick.
#[derive(Serialize)]
#[serde(tag = "type", rename = "tick")]
struct JsonTick<'a> {
    live: bool,
    session: u32,
    tick: Tick,
    at_us: i64,
    persons: Vec<JsonPerson<'a>>,
}

#[derive(Serialize)]
struct JsonPerson<'a> {
    id: u32,
    state: PersonState,
    views: u16,
    viewpoints: Vec<u8>,
    joints_m: Vec<[f64; 3]>,
    sigma_m: Vec<Option<f64>>,
    angles: &'a [f32],
    unobserved: Vec<u8>,
    clamped: Vec<u8>,
}

/// The set bits, ascending.
fn bits(mask: u64) -> Vec<u8> {
    (0..64).filter(|bit| mask >> bit & 1 == 1).collect()
}

/// Rounds a length to remove the digits that single precision adds.
fn tidy_m(length_m: f32) -> f64 {
    (f64::from(length_m) * 1e4).round() / 1e4
}

/// The JSON of a tick; `angles` contains those of every person, in the message's order.
pub fn json_tick(tick: &TickMessage, angles: &[&[f32]]) -> String {
    let person = |(i, person): (usize, &TickPerson)| JsonPerson {
        id: person.id.0,
        state: person.state,
        views: person.views,
        viewpoints: bits(person.viewpoints),
        joints_m: person
            .joints
            .iter()
            .map(|&steps| tick.grid.point_m(steps).map(tidy_m))
            .collect(),
        sigma_m: person
            .sigma
            .iter()
            .map(|&code| sigma_m(code).map(tidy_m))
            .collect(),
        angles: angles.get(i).copied().unwrap_or_default(),
        unobserved: bits(person.unobserved),
        clamped: bits(person.clamped),
    };
    json(&JsonTick {
        live: tick.is_live,
        session: tick.session,
        tick: tick.tick,
        at_us: tick.at_us,
        persons: tick.persons.iter().enumerate().map(person).collect(),
    })
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
        fn ticks_round_trip(tick in any_tick()) {
            let bytes = tick.encode();
            prop_assert_eq!(bytes.len() % 4, 0);
            let again = TickMessage::decode(&bytes).unwrap();
            prop_assert_eq!(&again, &tick);
            let past = TickMessage::decode(&as_history(&bytes)).unwrap();
            prop_assert_eq!(past, TickMessage { is_live: false, ..again });
        }

        #[test]
        fn arbitrary_bytes_are_a_tick_or_an_error(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
            let _read = TickMessage::decode(&bytes);
            let mut begun = vec![PROTOCOL, KIND];
            begun.extend(bytes);
            let _read = TickMessage::decode(&begun);
        }

        #[test]
        fn joints_in_the_field_are_exact_to_half_a_step(x in -60.0f32..60.0, y in -40.0f32..40.0, z in 0.0f32..3.0) {
            let grid = JointGrid::of_field([-60.0, -40.0, 0.0], [60.0, 40.0, 3.0]);
            let again = grid.point_m(grid.steps([x, y, z]));
            for (found, decoded) in [x, y, z].into_iter().zip(again) {
                prop_assert!((found - decoded).abs() <= 0.51 * grid.step_m);
            }
        }
    }

    #[test]
    fn a_person_of_29_joints_takes_236_bytes() {
        assert_eq!(person_bytes(29), 236);
    }

    #[test]
    fn small_fields_get_fine_steps_and_large_ones_full_range() {
        let step = |half: f64| JointGrid::of_field([-half, -half, 0.0], [half, half, 3.0]).step_m;
        assert!((step(5.0) - 0.000_5).abs() < 1e-9);
        assert!((step(60.0) - 0.002).abs() < 1e-9);
        assert!((step(10_000.0) - 0.02).abs() < 1e-9);
        let far = JointGrid::of_field([-5.0; 3], [5.0; 3]).steps([1e9, -1e9, f32::NAN]);
        assert_eq!(far, [i16::MAX, i16::MIN, 0]);
    }

    #[test]
    fn standard_deviations_are_unknown_too_large_or_encoded() {
        assert_eq!(sigma_code(None), 255);
        assert_eq!(sigma_code(Some(f32::NAN)), 255);
        assert_eq!(sigma_code(Some(7.0)), 254);
        assert_eq!(sigma_code(Some(0.013)), 7);
        assert_eq!(sigma_m(255), None);
    }

    #[test]
    fn json_ticks_match_the_manual() {
        let tick = TickMessage {
            is_live: true,
            session: 77,
            tick: Tick(1000),
            at_us: 1_767_225_600_000_000,
            grid: JointGrid {
                origin_m: [0.0; 3],
                step_m: 0.001,
            },
            joints: 1,
            persons: vec![TickPerson {
                id: PersonId(3),
                state: PersonState::Tracked,
                views: 4,
                viewpoints: 0b1111,
                unobserved: 1 << 12,
                clamped: 0,
                joints: vec![[0, 0, 950]],
                sigma: vec![6],
            }],
        };
        assert_eq!(
            json_tick(&tick, &[&[0.1]]),
            "{\"type\":\"tick\",\"live\":true,\"session\":77,\"tick\":1000,\"at_us\":1767225600000000,\
             \"persons\":[{\"id\":3,\"state\":\"tracked\",\"views\":4,\"viewpoints\":[0,1,2,3],\
             \"joints_m\":[[0.0,0.0,0.95]],\"sigma_m\":[0.012],\"angles\":[0.1],\"unobserved\":[12],\"clamped\":[]}]}"
        );
    }
}
