//! The undistorted bodies that each camera saw, by tick and joined to tracklets.

use std::collections::BTreeMap;

use farfield_proto::camera::{CameraError, CameraModel};
use farfield_proto::frames::Transform;
use nalgebra::{Isometry3, Vector2};

use super::request::{Detection, PeopleCamera, PeopleError};
pub(super) use super::tracklet::{Body, Joint};
use super::tracklet::{Tracked, tracklets};
use crate::adjustment::CameraState;

/// Keypoints below this score are not used.
const LEAST_SCORE: f64 = 0.15;
/// Least number of keypoints of a body that is used.
const LEAST_KEYPOINTS: usize = 6;
/// Bodies are interpolated between frames up to this time apart, seconds.
const MOST_BETWEEN_S: f64 = 0.15;
/// For slow cameras, the same in processed frames.
const MOST_BETWEEN_FRAMES: f64 = 1.5;
/// Least number of processed frames per second of a camera that is not synchronised: at a lower rate people move too far between
/// frames to interpolate.
pub const LEAST_RATE_HZ: f64 = 3.0;
/// Largest share of a camera's keypoints outside of its picture.
const OUTSIDE_SHARE: f64 = 0.2;

/// One camera and the bodies that it saw by tick.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct View {
    /// Its lens; the pose has no meaning.
    pub(super) state: CameraState,
    pub(super) ticks: BTreeMap<i64, Vec<Body>>,
}

impl View {
    pub(super) fn focal_px(&self) -> f64 {
        (self.state.intrinsics.fx_px * self.state.intrinsics.fy_px).sqrt()
    }

    /// The view of the camera in a mirror; `other_sides` maps keypoints to those of the other side.
    pub(super) fn mirrored(&self, other_sides: &[usize]) -> Self {
        let turned = |body: &Body| {
            let joint = |other: &usize| {
                let mut joint = body.joints.get(*other).copied().flatten()?;
                joint.bearing.x = -joint.bearing.x;
                Some(joint)
            };
            Body {
                joints: other_sides.iter().map(joint).collect(),
                tracklet: body.tracklet,
            }
        };
        let ticks = self.ticks.iter();
        Self {
            state: self.state,
            ticks: ticks
                .map(|(tick, bodies)| (*tick, bodies.iter().map(turned).collect()))
                .collect(),
        }
    }
}

/// The ticks of a camera's frames: tick = round((frame period + offset) rate).
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Clock {
    /// Frames per second of the camera.
    pub(super) rate_hz: f64,
    /// Its processed frames per second.
    pub(super) processed_hz: f64,
    /// Time of its frame 0, seconds.
    pub(super) offset_s: f64,
    /// Ticks per second; `None` if frames of all cameras are ticks.
    pub(super) ticks_hz: Option<f64>,
}

/// One camera and its tracklets, by frame.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Tracks {
    state: CameraState,
    tracks: Vec<Vec<Tracked>>,
}

impl Tracks {
    /// The tracklets of `camera`, whose bodies have `count` keypoints, at `rate_hz` frames per second.
    pub(super) fn new(
        camera: &PeopleCamera,
        count: usize,
        rate_hz: f64,
    ) -> Result<Self, PeopleError> {
        check_lens(camera)?;
        let state = CameraState::at_origin(camera.intrinsics, camera.lens);
        let fold_radius = state.fold_radius();
        let mut outside = 0;
        let mut all = 0;
        let mut frames = Vec::new();
        let mut last = f64::NEG_INFINITY;
        for it in &camera.frames {
            if !(it.frame.is_finite() && it.frame > last) {
                return Err(PeopleError::Frames {
                    camera: camera.name.clone(),
                    found: it.frame,
                    before: last,
                });
            }
            last = it.frame;
            let mut bodies = Vec::new();
            for detection in &it.bodies {
                if detection.keypoints.len() != count {
                    return Err(PeopleError::KeypointCount {
                        camera: camera.name.clone(),
                        frame: it.frame,
                        found: detection.keypoints.len(),
                        expected: count,
                    });
                }
                let seen = detection.keypoints.iter().flatten();
                // Keypoints that were not seen often have arbitrary positions.
                let seen = seen.filter(|keypoint| keypoint.score >= LEAST_SCORE);
                all += seen.clone().count();
                outside += seen.filter(|k| is_outside(k.px, camera.size_px)).count();
                bodies.extend(body(detection, camera.size_px, &state, fold_radius));
            }
            frames.push((it.frame, bodies));
        }
        if outside as f64 > OUTSIDE_SHARE * all as f64 {
            return Err(PeopleError::OutsidePicture {
                camera: camera.name.clone(),
                outside,
                of: all,
                size_px: camera.size_px,
            });
        }
        Ok(Self {
            state,
            tracks: tracklets(frames, rate_hz),
        })
    }

    /// The bodies by frame, which is the tick, without a copy of them.
    pub(super) fn into_view(self) -> View {
        let mut ticks: BTreeMap<i64, Vec<Body>> = BTreeMap::new();
        for (number, track) in self.tracks.into_iter().enumerate() {
            for mut it in track {
                it.body.tracklet = number;
                let own = ticks.entry(it.frame.round() as i64).or_default();
                own.push(it.body);
            }
        }
        View {
            state: self.state,
            ticks,
        }
    }

    /// The bodies at whole ticks of `clock`.
    pub(super) fn view(&self, clock: &Clock) -> View {
        View {
            state: self.state,
            ticks: by_tick(&self.tracks, clock),
        }
    }
}

fn is_outside(px: [f64; 2], size_px: [u32; 2]) -> bool {
    (0..2).any(|axis| {
        let size = f64::from(size_px[axis]);
        !(px[axis] >= -0.02 * size && px[axis] <= 1.02 * size)
    })
}

fn body(
    detection: &Detection,
    size_px: [u32; 2],
    state: &CameraState,
    fold_radius: f64,
) -> Option<Body> {
    let joint = |keypoint: &Option<super::request::Keypoint>| {
        let it = keypoint.as_ref()?;
        if it.score.is_nan() || it.score < LEAST_SCORE || is_outside(it.px, size_px) {
            return None;
        }
        Some(Joint {
            px: it.px,
            bearing: state.bearing(it.px, fold_radius)?,
            score: it.score.min(1.0),
        })
    };
    let joints: Vec<Option<Joint>> = detection.keypoints.iter().map(joint).collect();
    (joints.iter().flatten().count() >= LEAST_KEYPOINTS).then_some(Body {
        joints,
        tracklet: 0,
    })
}

/// Refuses invalid numbers, but not a lens that folds in a corner of its picture.
fn check_lens(camera: &PeopleCamera) -> Result<(), PeopleError> {
    let model = CameraModel::new(
        &camera.name,
        camera.size_px,
        camera.intrinsics,
        camera.lens,
        Transform::new(Isometry3::identity()),
    );
    match model {
        Ok(_) | Err(CameraError::Folds { .. }) => Ok(()),
        Err(error) => Err(PeopleError::Camera(error)),
    }
}

/// Bodies at whole ticks: as seen, or interpolated between two frames of a tracklet if clocks differ.
fn by_tick(tracks: &[Vec<Tracked>], clock: &Clock) -> BTreeMap<i64, Vec<Body>> {
    let mut ticks: BTreeMap<i64, Vec<Body>> = BTreeMap::new();
    for (number, track) in tracks.iter().enumerate() {
        let numbered = |mut body: Body| {
            body.tracklet = number;
            body
        };
        let Some(ticks_hz) = clock.ticks_hz else {
            for it in track {
                let own = ticks.entry(it.frame.round() as i64).or_default();
                own.push(numbered(it.body.clone()));
            }
            continue;
        };
        let most_s = MOST_BETWEEN_S.max(MOST_BETWEEN_FRAMES / clock.processed_hz);
        let tick_of = |frame: f64| (frame / clock.rate_hz + clock.offset_s) * ticks_hz;
        for pair in track.windows(2) {
            let [a, b] = pair else { continue };
            if (b.frame - a.frame) / clock.rate_hz > most_s {
                continue;
            }
            let (from, to) = (tick_of(a.frame), tick_of(b.frame));
            for tick in from.ceil() as i64..to.ceil() as i64 {
                let share = (tick as f64 - from) / (to - from);
                let own = ticks.entry(tick).or_default();
                own.push(numbered(between(&a.body, &b.body, share)));
            }
        }
    }
    ticks
}

/// Interpolates the keypoints that both bodies have, by `share` from `a` to `b`.
fn between(a: &Body, b: &Body, share: f64) -> Body {
    let joints = a.joints.iter().zip(&b.joints).map(|(a, b)| {
        let (a, b) = (a.as_ref()?, b.as_ref()?);
        let mix = |x: f64, y: f64| x + share * (y - x);
        Some(Joint {
            px: [mix(a.px[0], b.px[0]), mix(a.px[1], b.px[1])],
            bearing: (a.bearing + (b.bearing - a.bearing) * share).normalize(),
            score: a.score.min(b.score),
        })
    });
    Body {
        joints: joints.collect(),
        tracklet: a.tracklet,
    }
}

/// Velocity of a keypoint in the picture, pixels per tick, from the same tracklet at the farthest ticks before and after within
/// `reach`: a longer time reduces the noise.
pub(super) fn velocity_px(
    view: &View,
    tick: i64,
    body: usize,
    keypoint: usize,
    reach: i64,
) -> Option<Vector2<f64>> {
    let own = view.ticks.get(&tick)?.get(body)?;
    let at = |(tick, bodies): (&i64, &Vec<Body>)| {
        let same = bodies.iter().find(|it| it.tracklet == own.tracklet)?;
        let joint = same.joints.get(keypoint).copied().flatten()?;
        Some((*tick as f64, Vector2::from(joint.px)))
    };
    let before = view.ticks.range(tick - reach..tick).find_map(at)?;
    let after = view
        .ticks
        .range(tick + 1..=tick + reach)
        .rev()
        .find_map(at)?;
    Some((after.1 - before.1) / (after.0 - before.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn track(frames: u32, every: u32) -> Vec<Tracked> {
        let joints = Vec::new();
        let body = Body {
            joints,
            tracklet: 0,
        };
        let each = (0..frames).map(|frame| Tracked {
            frame: f64::from(every * frame),
            body: body.clone(),
        });
        each.collect()
    }

    #[test]
    fn slow_cameras_have_bodies_between_frames() {
        for rate_hz in [LEAST_RATE_HZ, 5.0, 6.0, 7.0, 25.0] {
            let clock = Clock {
                rate_hz,
                processed_hz: rate_hz,
                offset_s: 0.01,
                ticks_hz: Some(rate_hz.min(10.0)),
            };
            let ticks = by_tick(&[track(50, 1)], &clock);
            let expected = 49.0 / rate_hz * rate_hz.min(10.0);
            assert!((ticks.len() as f64 - expected).abs() <= 1.0, "{rate_hz}");
        }
    }

    #[test]
    fn bodies_are_interpolated_between_processed_frames() {
        let clock = Clock {
            rate_hz: 30.0,
            processed_hz: 5.0,
            offset_s: 0.01,
            ticks_hz: Some(10.0),
        };
        let ticks = by_tick(&[track(50, 6)], &clock);
        assert!((ticks.len() as f64 - 98.0).abs() <= 1.0, "{}", ticks.len());
    }

    #[test]
    fn an_offset_beyond_all_whole_numbers_terminates() {
        let clock = Clock {
            rate_hz: 10.0,
            processed_hz: 10.0,
            offset_s: 1e18,
            ticks_hz: Some(10.0),
        };
        assert!(by_tick(&[track(3, 1)], &clock).len() <= 2);
    }
}
