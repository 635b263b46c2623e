//! Writes a camera of a scene as a file of maps; [`Course`] maps the ticks of the file to the time
//! of the scene.

use std::io::{self, Write};
use std::ops::Range;
use std::sync::Arc;

use farfield_proto::tick::Tick;
use serde::Serialize;

use super::{CameraFailure, Header, MAGIC};
use crate::faults::{MapFaults, SceneCrowd, StoredMapObservation};
use crate::scene::Scene;

/// Writes `ticks` ticks of the maps of camera `camera` over `course`. Returns false, with the file
/// unfinished, as soon as `goes_on` returns false.
///
/// Slow errors of the simulated network restart with each repetition of a course.
///
/// # Errors
/// An error of `out`.
///
/// # Panics
/// When the scene has no such camera.
pub fn write_maps(
    crowd: &Arc<SceneCrowd>,
    camera: usize,
    (course, ticks): (Course, u32),
    failure: Option<CameraFailure>,
    out: &mut impl Write,
    goes_on: &dyn Fn() -> bool,
) -> io::Result<bool> {
    let scene = crowd.scene();
    let model = &scene.cameras()[camera];
    let mut maps = MapFaults::with_crowd(Arc::clone(crowd), camera);
    let header = Header {
        camera: model.name().to_owned(),
        size_px: model.size_px(),
        rate_hz: scene.rate_hz(),
        ticks,
        repeats: matches!(course, Course::ThereAndBack { .. }),
        capture_offset_us: maps.capture_offset_us(),
        failure,
    };
    let mut out = Hashed {
        out,
        hasher: blake3::Hasher::new(),
    };
    out.write(&MAGIC)?;
    out.record(&header)?;
    let offset_s = f64::from(header.capture_offset_us) * 1e-6;
    for tick in (0..i64::from(ticks)).map(Tick) {
        if !goes_on() {
            return Ok(false);
        }
        let time_s = course.time_s(tick.seconds(scene.rate_hz()) + offset_s);
        out.record(&StoredMapObservation::new(&maps.observe_at(tick, time_s)))?;
    }
    let checksum = *out.hasher.finalize().as_bytes();
    out.write(&checksum)?;
    Ok(true)
}

/// A writer that also computes the checksum.
struct Hashed<'a, W> {
    out: &'a mut W,
    hasher: blake3::Hasher,
}

impl<W: Write> Hashed<'_, W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.hasher.update(bytes);
        self.out.write_all(bytes)
    }

    fn record(&mut self, record: &impl Serialize) -> io::Result<()> {
        let bytes = postcard::to_stdvec(record).map_err(io::Error::other)?;
        let length = u32::try_from(bytes.len()).map_err(io::Error::other)?;
        self.write(&length.to_le_bytes())?;
        self.write(&bytes)
    }
}

/// Time that people take to stop at an end of the scene, and to start on the way back, seconds.
const TURN_S: f64 = 1.0;

/// The mapping from the ticks of a recording to the time of a scene.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Course {
    /// Every tick shows its own moment.
    Once {
        /// The scene's time at the first tick, seconds.
        start_s: f64,
    },
    /// Forwards and backwards, repeated. At either end time slows down to a stop within `TURN_S`
    /// and then runs backwards, so positions and speeds have no jumps.
    ThereAndBack {
        /// The scene's time at the first tick, seconds.
        start_s: f64,
        /// Length of the covered part, seconds of the scene.
        length_s: f64,
    },
}

impl Course {
    /// The course through `ticks` of `scene`, and the number of ticks of its recording: the same
    /// number for one pass, a whole period for forwards and backwards.
    pub fn new(scene: &Scene, ticks: &Range<Tick>, there_and_back: bool) -> (Self, u32) {
        let n = u32::try_from(ticks.end - ticks.start).unwrap_or(0);
        let start_s = scene.time_s(ticks.start);
        if !there_and_back {
            return (Self::Once { start_s }, n);
        }
        // One way lasts a whole number of ticks: the turn adds half of itself at either end.
        let turn = (TURN_S * scene.rate_hz()).round() as u32;
        let one_way = (n.saturating_sub(1) + turn).max(2 * turn + 1);
        let length_s = f64::from(one_way) / scene.rate_hz() - TURN_S;
        (Self::ThereAndBack { start_s, length_s }, 2 * one_way)
    }

    /// The scene's time `elapsed_s` after the first tick of the recording, seconds.
    pub fn time_s(&self, elapsed_s: f64) -> f64 {
        match *self {
            Self::Once { start_s } => start_s + elapsed_s,
            Self::ThereAndBack { start_s, length_s } => {
                let one_way_s = length_s + TURN_S;
                let phase_s = elapsed_s.rem_euclid(2.0 * one_way_s);
                // The way back mirrors the way there.
                let on_the_way_s = if phase_s <= one_way_s {
                    phase_s
                } else {
                    2.0 * one_way_s - phase_s
                };
                start_s + gone_s(on_the_way_s, length_s)
            }
        }
    }
}

/// Distance along a way of `length_s` after `t_s`; the speed is 0 at both ends and 1 between.
///
/// ```text
///   t^2 / 2 T  for t < T,   t - T / 2  between,   L - (L + T - t)^2 / 2 T  for t > L        T: TURN_S
/// ```
fn gone_s(t_s: f64, length_s: f64) -> f64 {
    let left_s = length_s + TURN_S - t_s;
    if t_s < TURN_S {
        t_s * t_s / (2.0 * TURN_S)
    } else if left_s < TURN_S {
        length_s - left_s * left_s / (2.0 * TURN_S)
    } else {
        t_s - TURN_S / 2.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::embedded;

    #[test]
    fn a_single_pass_follows_the_time_of_the_scene() {
        let scene = embedded::scene("futsal").unwrap();
        let (course, n) = Course::new(&scene, &(Tick(30)..Tick(90)), false);
        assert_eq!(n, 60);
        assert!((course.time_s(0.5) - 1.0).abs() < 1e-12);
    }

    #[test]
    fn there_and_back_has_no_jump_in_position_or_speed() {
        let scene = embedded::scene("futsal").unwrap();
        let (course, n) = Course::new(&scene, &(Tick(0)..Tick(301)), true);
        assert_eq!(n, 2 * (300 + 60));
        let dt_s = 1.0 / 60.0;
        let at = |tick: u32| course.time_s(f64::from(tick) * dt_s);
        let (mut farthest, mut last_speed) = (0.0f64, at(1) - at(0));
        for tick in 0..2 * n {
            let speed = at(tick + 1) - at(tick);
            assert!(speed.abs() <= dt_s + 1e-12);
            // The start takes a second: a sixtieth of the regular step per tick.
            assert!(
                (speed - last_speed).abs() <= dt_s / 60.0 + 1e-12,
                "tick {tick}"
            );
            last_speed = speed;
            farthest = farthest.max(at(tick));
        }
        assert!((at(0) - 0.0).abs() < 1e-12 && (at(n) - 0.0).abs() < 1e-12);
        assert!((farthest - 5.0).abs() < 1e-9, "{farthest}");
    }

    #[test]
    fn a_very_short_way_is_extended_to_the_length_of_a_turn() {
        let scene = embedded::scene("futsal").unwrap();
        let (course, n) = Course::new(&scene, &(Tick(0)..Tick(3)), true);
        assert!(n >= 240);
        assert!((0..n).all(|tick| course.time_s(f64::from(tick) / 60.0) >= -1e-12));
    }
}
