//! Simulated sightings of a ball that is carried through a field with cameras around it.

use farfield_proto::camera::{Distortion, Intrinsics};
use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::adjustment::CameraState;
use crate::alignment::Similarity;
use crate::points::{PointCamera, PointRequest, Sighting, Timing};

/// A field with cameras around it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Field {
    pub(crate) size_m: [f64; 2],
    pub(crate) cameras: usize,
    pub(crate) height_m: f64,
    /// Distance of the cameras from the field's edge.
    pub(crate) away_m: f64,
    pub(crate) focal_px: f64,
    /// Largest height of the ball above the floor.
    pub(crate) ball_m: f64,
}

pub(crate) const SMALL: Field = Field {
    size_m: [5.0, 7.0],
    cameras: 8,
    height_m: 2.5,
    away_m: 1.5,
    focal_px: 1100.0,
    ball_m: 2.2,
};
pub(crate) const HALL: Field = Field {
    size_m: [16.0, 24.0],
    cameras: 12,
    height_m: 4.0,
    away_m: 3.0,
    focal_px: 1200.0,
    ball_m: 2.4,
};
pub(crate) const PITCH: Field = Field {
    size_m: [68.0, 105.0],
    cameras: 12,
    height_m: 12.0,
    away_m: 12.0,
    focal_px: 1300.0,
    ball_m: 2.5,
};

pub(crate) const SIZE_PX: [u32; 2] = [1920, 1200];

/// Cameras around the field that look at its middle.
pub(crate) fn cameras(field: &Field) -> Vec<CameraState> {
    let half = field.size_m.map(|s| 0.5 * s + field.away_m);
    (0..field.cameras)
        .map(|i| {
            let angle = std::f64::consts::TAU * (i as f64 + 0.3) / field.cameras as f64;
            let (c, s) = (libm::cos(angle), libm::sin(angle));
            // On the rectangle around the field.
            let reach = (half[0] / c.abs().max(1e-9)).min(half[1] / s.abs().max(1e-9));
            let height = field.height_m * (1.0 + 0.2 * libm::sin(5.0 * i as f64));
            let center = Vector3::new(reach * c, reach * s, height);
            CameraState {
                center_w: center,
                camera_from_world: looking(&center, &Vector3::new(0.0, 0.0, 0.8)),
                ..CameraState::at_origin(
                    Intrinsics {
                        fx_px: field.focal_px,
                        fy_px: field.focal_px,
                        cx_px: 960.0,
                        cy_px: 600.0,
                    },
                    Distortion {
                        k1: -0.08,
                        k2: 0.02,
                        ..Distortion::default()
                    },
                )
            }
        })
        .collect()
}

fn looking(center: &Vector3<f64>, at: &Vector3<f64>) -> UnitQuaternion<f64> {
    let forward = (at - center).normalize();
    let right = forward.cross(&Vector3::z()).normalize();
    let down = forward.cross(&right);
    let rows = [right.transpose(), down.transpose(), forward.transpose()];
    UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(Matrix3::from_rows(
        &rows,
    )))
}

/// The position of the ball, for 100 s: it moves over the whole field, up and down.
pub(crate) fn ball(field: &Field, time_s: f64) -> Vector3<f64> {
    let wave = |rate: f64, phase: f64| libm::sin(rate * time_s + phase);
    Vector3::new(
        0.48 * field.size_m[0] * (0.8 * wave(0.41, 0.0) + 0.2 * wave(1.3, 1.0)),
        0.48 * field.size_m[1] * (0.8 * wave(0.23, 1.0) + 0.2 * wave(0.9, 2.0)),
        field.ball_m * (0.5 + 0.35 * wave(1.1, 0.5) + 0.13 * wave(2.3, 0.1)),
    )
}

/// Errors of the sightings.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Errors {
    pub(crate) noise_px: f64,
    pub(crate) outlier_share: f64,
    /// Share of its frames in which the last camera sees the ball.
    pub(crate) last_camera_share: f64,
    pub(crate) seed: u64,
}

pub(crate) const USUAL: Errors = Errors {
    noise_px: 0.3,
    outlier_share: 0.1,
    last_camera_share: 1.0,
    seed: 5,
};

/// A request with sightings of 100 s, each camera on the clock of its state.
pub(crate) fn request(
    field: &Field,
    states: &[CameraState],
    errors: &Errors,
    timing: Timing,
) -> PointRequest {
    let mut rng = ChaCha8Rng::seed_from_u64(errors.seed);
    let cameras = states.iter().enumerate().map(|(index, state)| {
        let is_last = index + 1 == states.len();
        let share = if is_last {
            errors.last_camera_share
        } else {
            1.0
        };
        PointCamera {
            name: format!("c{index}"),
            size_px: SIZE_PX,
            intrinsics: state.intrinsics,
            lens: state.lens(),
            rate_hz: Some(1.0 / state.period_s),
            offset_s: Some(state.time_s(0.0)),
            sightings: sightings(field, state, errors, share, &mut rng),
        }
    });
    PointRequest::new(cameras.collect(), timing)
}

fn sightings(
    field: &Field,
    state: &CameraState,
    errors: &Errors,
    share: f64,
    rng: &mut ChaCha8Rng,
) -> Vec<Sighting> {
    let frames = (100.0 / state.period_s) as usize;
    let mut found = Vec::new();
    for frame in 0..frames {
        if rng.random_range(0.0..1.0) > share {
            continue;
        }
        let size = SIZE_PX.map(f64::from);
        let point = ball(field, state.time_s(frame as f64));
        let Some(px) = state.project(&point, state.fold_radius()) else {
            continue;
        };
        if px.x < 0.0 || px.y < 0.0 || px.x > size[0] - 1.0 || px.y > size[1] - 1.0 {
            continue;
        }
        let px = if rng.random_range(0.0..1.0) < errors.outlier_share {
            [
                rng.random_range(0.0..size[0]),
                rng.random_range(0.0..size[1]),
            ]
        } else {
            [
                px.x + errors.noise_px * gauss(rng),
                px.y + errors.noise_px * gauss(rng),
            ]
        };
        found.push(Sighting {
            frame: frame as f64,
            px,
        });
    }
    found
}

/// Standard normal (Box and Muller).
pub(crate) fn gauss(rng: &mut ChaCha8Rng) -> f64 {
    let radius = (-2.0 * libm::log(rng.random_range(1e-12..1.0))).sqrt();
    radius * libm::cos(std::f64::consts::TAU * rng.random_range(0.0..1.0))
}

/// Largest errors of a camera after similarity alignment of the centres: metres and degrees.
pub(crate) fn worst(found: &[CameraState], truth: &[CameraState]) -> (f64, f64) {
    let centers = |states: &[CameraState]| states.iter().map(|s| s.center_w).collect::<Vec<_>>();
    let similarity = Similarity::between(&centers(found), &centers(truth)).unwrap();
    let each = found.iter().zip(truth).map(|(found, truth)| {
        let moved = similarity.apply_to_camera(found);
        let off = (moved.center_w - truth.center_w).norm();
        let turned = moved.camera_from_world.angle_to(&truth.camera_from_world);
        (off, turned.to_degrees())
    });
    each.fold((0.0, 0.0), |(m, d), (off, turned)| {
        (off.max(m), turned.max(d))
    })
}
