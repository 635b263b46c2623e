//! Values of a frame, one per channel, and their bytes in both protocol versions.
//!
//! Channels: the tick (modulo 2^24, which `f32` represents exactly), then per place the person's id
//! (modulo 2^24; 0 for none), 1 if seen or 0 if predicted, and the joints' x, y and z, metres, z
//! up; NaN for an empty place. For a tick without a frame, every id is -1.

use farfield_fusion::body::skeleton::Joint;
use farfield_proto::message::PersonState;
use farfield_proto::tick::Tick;

use super::{OLD_VERSION, PLACES};
use crate::frame::Frame;
use crate::people::Places;

/// Number of channels per place.
const PER_PLACE: usize = 2 + 3 * Joint::ALL.len();
/// Number of channels of the stream.
pub const N_CHANNELS: usize = 1 + PLACES as usize * PER_PLACE;
/// Id of a place for a tick without a frame.
const UNKNOWN: f32 = -1.0;
/// Integers below this are exact.
const EXACT: i64 = 1 << 24;
/// First byte of a sample with a time stamp.
const STAMPED: u8 = 2;
/// Time stamp of test samples.
const TEST_STAMP_S: f64 = 123_456.789;

/// The channels of a frame with these `places`.
pub fn channels(frame: &Frame, places: &Places) -> Vec<f32> {
    let mut values = vec![f32::NAN; N_CHANNELS];
    let exact = |number: i64| number.rem_euclid(EXACT) as f32;
    let Some((tick, blocks)) = values.split_first_mut() else {
        return values;
    };
    *tick = exact(frame.tick.0);
    let mut blocks: Vec<&mut [f32]> = blocks.chunks_exact_mut(PER_PLACE).collect();
    for block in &mut blocks {
        block.iter_mut().take(2).for_each(|value| *value = 0.0);
    }
    for person in frame.confirmed() {
        let place = places.get(person.id).map(usize::from);
        let Some(block) = place.and_then(|place| blocks.get_mut(place)) else {
            continue;
        };
        let is_seen = person.state != PersonState::Coasting;
        let head = [exact(i64::from(person.id.0)), f32::from(u8::from(is_seen))];
        let joints = person.joints_m.iter().flat_map(|at_m| at_m.iter());
        let numbers = head.into_iter().chain(joints.map(|v| *v as f32));
        for (value, number) in block.iter_mut().zip(numbers) {
            *value = number;
        }
    }
    values
}

/// The channels of a tick without a frame.
pub fn unknown_channels(tick: Tick) -> Vec<f32> {
    let mut values = vec![f32::NAN; N_CHANNELS];
    let Some((first, blocks)) = values.split_first_mut() else {
        return values;
    };
    *first = tick.0.rem_euclid(EXACT) as f32;
    for block in blocks.chunks_exact_mut(PER_PLACE) {
        for (value, number) in block.iter_mut().zip([UNKNOWN, 0.0]) {
            *value = number;
        }
    }
    values
}

/// Appends a sample with these channels and the time `stamp_s` of the outlet's clock, in a protocol
/// version.
pub fn write(version: u32, stamp_s: f64, channels: &[f32], to: &mut Vec<u8>) {
    if version == OLD_VERSION {
        write_integer(u64::from(STAMPED), to);
        write_integer(stamp_s.to_bits(), to);
        for value in channels {
            write_integer(u64::from(bits(*value)), to);
        }
    } else {
        to.push(STAMPED);
        to.extend_from_slice(&stamp_s.to_le_bytes());
        to.extend(channels.iter().flat_map(|value| value.to_le_bytes()));
    }
}

/// The bytes before all samples: in the old version the description; then two test samples with
/// known values.
pub fn opening(version: u32, short_xml: &str) -> Vec<u8> {
    let mut bytes = Vec::new();
    if version == OLD_VERSION {
        // Archive header and version; a text; then class information of version 0 without tracking.
        bytes.push(0x7f);
        write_integer(9, &mut bytes);
        write_integer(short_xml.len() as u64, &mut bytes);
        bytes.extend_from_slice(short_xml.as_bytes());
        bytes.extend_from_slice(&[0, 0]);
    }
    for offset in [4, 2] {
        let number = |channel: usize| {
            let size = (channel + offset) as f32;
            if channel.is_multiple_of(2) {
                size
            } else {
                -size
            }
        };
        let numbers: Vec<f32> = (0..N_CHANNELS).map(number).collect();
        write(version, TEST_STAMP_S, &numbers, &mut bytes);
    }
    bytes
}

/// An integer of the old version: its number of bytes, then the bytes, lowest first.
fn write_integer(number: u64, to: &mut Vec<u8>) {
    let n_bytes = 8 - number.leading_zeros() as usize / 8;
    to.push(n_bytes as u8);
    to.extend(number.to_le_bytes().into_iter().take(n_bytes));
}

/// The bits of a value of the old version, which has a single NaN.
fn bits(value: f32) -> u32 {
    if value.is_nan() {
        0x7fff_ffff
    } else {
        value.to_bits()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lsl::VERSION;
    use crate::synthetic;

    fn places_of(frame: &Frame) -> Places {
        let mut places = Places::new(PLACES);
        places.assign(frame.roster.ids());
        places
    }

    #[test]
    fn ticks_without_frames_have_unknown_ids() {
        let values = unknown_channels(Tick(70));
        assert_eq!(values.len(), N_CHANNELS);
        let heads = values[1..].chunks_exact(PER_PLACE).map(|it| &it[..2]);
        let mut heads = heads.map(|head| [head[0].to_bits(), head[1].to_bits()]);
        assert!(heads.all(|head| head == [UNKNOWN.to_bits(), 0]));
        let numbers = values.iter().filter(|value| !value.is_nan());
        assert_eq!(numbers.count(), 1 + 2 * usize::from(PLACES));
    }

    #[test]
    fn channels_contain_the_tick_and_all_joints() {
        let frame = synthetic::frame(77);
        let values = channels(&frame, &places_of(&frame));
        assert_eq!(values.len(), 713);
        let is = |at: usize, expected: f32| (values[at] - expected).abs() < 1e-6;
        assert!(is(0, 77.0) && is(1, 1.0) && is(2, 1.0));
        let second = 1 + PER_PLACE;
        assert!(is(second, 2.0));
        let knee = second + 2 + 3 * Joint::LeftKnee.index();
        let at_m = frame.persons[1].joints_m[Joint::LeftKnee.index()];
        assert!(is(knee, at_m.x as f32) && is(knee + 2, at_m.z as f32));
        // The third place is empty.
        let third = second + PER_PLACE;
        assert!(is(third, 0.0) && is(third + 1, 0.0));
        assert!(
            values[third + 2..]
                .iter()
                .step_by(PER_PLACE)
                .all(|v| v.is_nan())
        );
    }

    #[test]
    fn predicted_people_are_unseen_and_surplus_people_dropped() {
        let mut maker = crate::FrameMaker::new(synthetic::facts());
        let mut poses = synthetic::poses_at(11, -1);
        poses.persons[0].state = PersonState::Coasting;
        let frame = maker.frame(&poses);
        let values = channels(&frame, &places_of(&frame));
        assert_eq!(values.len(), N_CHANNELS);
        assert!((values[0] - 16_777_215.0).abs() < 0.5);
        assert!(values[2].abs() < 1e-9);
        let ids = values[1..].iter().step_by(PER_PLACE);
        assert_eq!(
            ids.map(|id| *id as u32).collect::<Vec<_>>(),
            [1, 2, 3, 4, 5, 6, 7, 8]
        );
    }

    #[test]
    fn samples_match_liblsl_in_both_versions() {
        // Output of `liblsl` 1.18 for the channels 1, NaN, -0 at 1.5 s, and 0, 2, 3 at 2.5 s.
        const OLD: &[u8] = b"\x01\x02\x08\x00\x00\x00\x00\x00\x00\xf8?\x04\x00\x00\x80?\x04\xff\xff\xff\x7f\x04\x00\x00\x00\x80\
            \x01\x02\x08\x00\x00\x00\x00\x00\x00\x04@\x00\x04\x00\x00\x00@\x04\x00\x00@@";
        const NEW: &[u8] =
            b"\x02\x00\x00\x00\x00\x00\x00\xf8?\x00\x00\x80?\x00\x00\xc0\x7f\x00\x00\x00\x80\
            \x02\x00\x00\x00\x00\x00\x00\x04@\x00\x00\x00\x00\x00\x00\x00@\x00\x00@@";
        for (version, theirs) in [(OLD_VERSION, OLD), (VERSION, NEW)] {
            let mut ours = Vec::new();
            write(version, 1.5, &[1.0, f32::NAN, -0.0], &mut ours);
            write(version, 2.5, &[0.0, 2.0, 3.0], &mut ours);
            assert_eq!(ours, theirs, "{version}");
        }
    }

    #[test]
    fn the_opening_contains_two_test_samples() {
        let bytes = opening(VERSION, "");
        assert_eq!(bytes.len(), 2 * (9 + 4 * N_CHANNELS));
        assert_eq!(bytes[..9], *b"\x02\xc9v\xbe\x9f\x0c$\xfe@");
        let number = |at: usize| f32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
        let second = 9 + 4 * N_CHANNELS + 9;
        let numbers = [number(9), number(13), number(second), number(second + 4)];
        assert!(
            numbers
                .iter()
                .zip([4.0, -5.0, 2.0, -3.0])
                .all(|(a, b)| (a - b).abs() < 1e-6)
        );
        // `liblsl` 1.18 starts the old version so, with a text of 0x278 bytes.
        let old = opening(OLD_VERSION, &"x".repeat(0x278));
        assert_eq!(old[..6], *b"\x7f\x01\x09\x02\x78\x02");
        assert_eq!(
            old[6 + 0x278..][..13],
            *b"\x00\x00\x01\x02\x08\xc9v\xbe\x9f\x0c$\xfe@"
        );
    }
}
