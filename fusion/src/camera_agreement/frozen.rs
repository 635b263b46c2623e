//! Whether the pictures of a camera are frozen while people move in front of it, because a
//! recording stopped or because keypoints were written again and again.
//!
//! Sightings are never bit-identical for long, except of something static such as a poster in a
//! compressed video. So a person that others follow must have moved through the picture.

use farfield_proto::tick::Tick;
use nalgebra::{Vector2, Vector3};

use super::geometry::SightLines;
use super::samples::{PassSample, PosedTick, Samples, SeenBody};

/// Least number of identical detection passes in a row, and least time from the first to the last,
/// seconds. Passes may be a second apart.
const MIN_PASSES: usize = 3;
const MIN_S: f64 = 1.5;
/// Largest age of the newest of these passes, seconds. An older one means that people left.
const MAX_AGE_S: f64 = 2.5;
/// Least number of keypoints of a sighting. Keypoints with low scores are not kept, and sightings
/// without keypoints are always the same.
const MIN_SEEN: usize = 5;
/// Least distance that a person must have moved, as a share of the width of the picture.
const MIN_MOVED_RATIO: f64 = 0.05;

/// The tick since which all passes of `camera` with sightings are identical, if people moved in its
/// picture. Passes without sightings do not count, because some run in other cameras only.
pub(super) fn frozen_since(
    samples: &Samples,
    (camera, lines): (usize, &SightLines),
    rate_hz: f64,
) -> Option<Tick> {
    let shown = |pass: &PassSample| -> Vec<SeenBody> {
        let bodies = pass.of_camera[camera].iter();
        let clear = bodies.filter(|body| body.iter().flatten().count() >= MIN_SEEN);
        clear.cloned().collect()
    };
    let own = samples.passes.iter().rev();
    let own = own.map(|pass| (pass, shown(pass)));
    let mut own = own.filter(|(_, shown)| !shown.is_empty()).peekable();
    let (newest, now) = own.peek()?.clone();
    let same = own.map_while(|(pass, shown)| (shown == now).then_some(pass));
    let ticks: Vec<Tick> = same.map(|pass| pass.tick).collect();
    let since = *ticks.last()?;
    let is_long = (newest.tick - since) as f64 >= MIN_S * rate_hz;
    let age = samples.passes.back()?.tick - newest.tick;
    if ticks.len() < MIN_PASSES || !is_long || age as f64 > MAX_AGE_S * rate_hz {
        return None;
    }
    let places = |tick: Tick| places(samples, tick, lines);
    let first = places(since);
    let moved_px = MIN_MOVED_RATIO * lines.size_px().x;
    let moves = |tick: Tick| {
        places(tick).iter().any(|(person, now_px)| {
            let before = first.iter().find(|(other, _)| other == person);
            before.is_some_and(|(_, before_px)| (now_px - before_px).norm() >= moved_px)
        })
    };
    ticks.into_iter().any(moves).then_some(since)
}

/// The people whose middle is in the picture at a tick, and the middle, pixels.
fn places(samples: &Samples, tick: Tick, lines: &SightLines) -> Vec<(u32, Vector2<f64>)> {
    let off = |posed: &PosedTick| (posed.tick.0 - tick.0).abs();
    let posed = samples.poses.iter().min_by_key(|posed| off(posed));
    let Some(posed) = posed.filter(|posed| off(posed) < samples.pose_every_ticks()) else {
        return Vec::new();
    };
    let size_px = lines.size_px();
    let people = posed.people.iter().filter_map(|(person, body)| {
        let at = body.iter().filter_map(|m| {
            let m = Vector3::from(m.map(f64::from));
            Some(lines.project(&m)?.0)
        });
        let at: Vec<Vector2<f64>> = at.collect();
        if at.is_empty() {
            return None;
        }
        let middle = at.iter().sum::<Vector2<f64>>() / at.len() as f64;
        let is_inside =
            (0.0..size_px.x).contains(&middle.x) && (0.0..size_px.y).contains(&middle.y);
        is_inside.then_some((*person, middle))
    });
    people.collect()
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::super::samples::{PassSample, SeenBody, SeenKeypoint};
    use super::*;
    use crate::sightings::fixture::hall;

    const RATE_HZ: f64 = 30.0;

    /// The frozen tick of the first camera in a hall, with a pass every half second. `shown` is the
    /// x of its sighting in a pass, pixels; NaN for none. A person walks along the hall.
    fn since(shown: impl Fn(u32) -> f32, speed_m_s: f64, passes: u32) -> Option<i64> {
        since_of(shown, speed_m_s, passes, true)
    }

    /// The same; the keypoints are kept only if `is_clear`.
    fn since_of(
        shown: impl Fn(u32) -> f32,
        speed_m_s: f64,
        passes: u32,
        is_clear: bool,
    ) -> Option<i64> {
        let hall = hall();
        let lines = SightLines::from_camera(&hall.cameras[0].1);
        let mut samples = Samples::new(RATE_HZ, 1);
        for pass in 0..passes {
            let tick = Tick(15 * i64::from(pass));
            let x = shown(pass);
            let seen = |k: usize| {
                is_clear.then_some(SeenKeypoint {
                    pixel: [x + k as f32, 600.0],
                    score: 0.8,
                })
            };
            let body: SeenBody = (0..17).map(seen).collect();
            let bodies = if x.is_finite() {
                vec![body]
            } else {
                Vec::new()
            };
            samples.passes.push_back(Arc::new(PassSample {
                tick,
                of_camera: vec![bodies],
                unsure: vec![Vec::new()],
            }));
            let at_m = -1.5 + speed_m_s * 0.5 * f64::from(pass);
            samples.poses.push_back(Arc::new(PosedTick {
                tick,
                people: vec![(1, vec![[at_m as f32, 0.0, 1.0]; 17])],
            }));
        }
        frozen_since(&samples, (0, &lines), RATE_HZ).map(|tick| tick.0)
    }

    #[test]
    fn a_camera_with_identical_sightings_of_a_moving_person_is_frozen() {
        let stops_at_2 = |pass: u32| 900.0 + 10.0 * pass.min(2) as f32;
        assert_eq!(since(stops_at_2, 0.5, 8), Some(30));
        // Every other pass runs in other cameras.
        let every_other = |pass: u32| match pass {
            0 => 800.0,
            _ if pass.is_multiple_of(2) => 900.0,
            _ => f32::NAN,
        };
        assert_eq!(since(every_other, 0.5, 8), Some(30));
    }

    #[test]
    fn a_camera_is_not_frozen_without_a_moving_person_or_after_a_change() {
        let always = |_: u32| 900.0;
        assert_eq!(since(always, 0.0, 8), None, "the person stands");
        assert_eq!(since(always, 0.5, 3), None, "one second");
        let leaves = |pass: u32| if pass < 8 { 900.0 } else { f32::NAN };
        assert_eq!(since(leaves, 0.5, 15), None, "the person left");
        assert_eq!(since(|_| f32::NAN, 0.5, 8), None, "no sightings");
        assert_eq!(since_of(always, 0.5, 8, false), None, "low scores");
        let goes_on = |pass: u32| if pass < 7 { 900.0 } else { 910.0 };
        assert_eq!(since(goes_on, 0.5, 8), None, "it goes on");
        let flickers = |pass: u32| 900.0 + 0.1 * (pass % 2) as f32;
        assert_eq!(since(flickers, 0.5, 8), None, "it flickers");
    }
}
