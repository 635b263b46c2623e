//! Simulated people who walk through a field, and their keypoints in the cameras around it.

use farfield_proto::camera::{Distortion, Intrinsics};
use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};
use rand::seq::SliceRandom;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::adjustment::CameraState;
use crate::alignment::Similarity;
use crate::people::{DetectedFrame, Detection, Keypoint, PeopleCamera, PeopleRequest};

pub(super) const SIZE_PX: [u32; 2] = [1920, 1200];
pub(super) const RATE_HZ: f64 = 10.0;

/// A field with cameras around it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Field {
    pub(super) size_m: [f64; 2],
    pub(super) cameras: usize,
    pub(super) height_m: f64,
    pub(super) away_m: f64,
    pub(super) focal_px: f64,
}

pub(super) const SMALL: Field = Field {
    size_m: [5.0, 7.0],
    cameras: 8,
    height_m: 2.5,
    away_m: 1.5,
    focal_px: 1100.0,
};
pub(super) const HALL: Field = Field {
    size_m: [16.0, 24.0],
    cameras: 12,
    height_m: 4.0,
    away_m: 3.0,
    focal_px: 1200.0,
};
pub(super) const PITCH: Field = Field {
    size_m: [68.0, 105.0],
    cameras: 12,
    height_m: 12.0,
    away_m: 12.0,
    focal_px: 1300.0,
};

/// The motion of people, and the errors of their keypoints.
#[derive(Debug, Clone, Copy)]
pub(super) struct Walk {
    pub(super) people: usize,
    pub(super) seconds: f64,
    /// Extent of the walks relative to the field, along x and y.
    pub(super) extent: [f64; 2],
    /// Noise of a keypoint on the body, metres.
    pub(super) noise_m: f64,
    /// Noise of a keypoint in the picture, pixels.
    pub(super) noise_px: f64,
    /// Share of the variance on the body that stays for a second, independent for each keypoint, person and camera.
    pub(super) held_share: f64,
    /// Share of keypoints at another place on or near the body.
    pub(super) outlier_share: f64,
    /// Share of missing keypoints.
    pub(super) missed_share: f64,
    pub(super) seed: u64,
}

pub(super) const USUAL: Walk = Walk {
    people: 4,
    seconds: 30.0,
    extent: [1.0, 1.0],
    noise_m: 0.025,
    noise_px: 1.0,
    held_share: 0.0,
    outlier_share: 0.1,
    missed_share: 0.08,
    seed: 5,
};

/// Statures, metres; their mean is [`MEAN_STATURE_M`].
const STATURES_M: [f64; 4] = [1.62, 1.88, 1.73, 1.81];
pub(super) const MEAN_STATURE_M: f64 = 1.76;

/// Cameras around the field that look at its middle.
pub(super) fn cameras(field: &Field) -> Vec<CameraState> {
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
                period_s: 1.0 / RATE_HZ,
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

pub(super) fn looking(center: &Vector3<f64>, at: &Vector3<f64>) -> UnitQuaternion<f64> {
    let forward = (at - center).normalize();
    let right = forward.cross(&Vector3::z()).normalize();
    let down = forward.cross(&right);
    let rows = [right.transpose(), down.transpose(), forward.transpose()];
    UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(Matrix3::from_rows(
        &rows,
    )))
}

/// The position of a person on the floor.
fn place(field: &Field, walk: &Walk, person: usize, time_s: f64) -> Vector3<f64> {
    let phase = 1.9 * person as f64;
    // Slower on larger fields, so that people walk at most about 2 m/s.
    let pace = (6.0 / field.size_m[1]).min(1.0);
    let wave = |rate: f64, shift: f64| libm::sin(rate * pace * time_s + shift);
    Vector3::new(
        0.42 * field.size_m[0]
            * walk.extent[0]
            * (0.8 * wave(0.37, phase) + 0.2 * wave(1.1, 2.0 * phase)),
        0.42 * field.size_m[1]
            * walk.extent[1]
            * (0.8 * wave(0.29, 2.3 * phase + 1.0) + 0.2 * wave(0.8, phase)),
        0.0,
    )
}

/// COCO's 17 keypoints of a walking body, world.
pub(super) fn body(field: &Field, walk: &Walk, person: usize, time_s: f64) -> Vec<Vector3<f64>> {
    let stature = STATURES_M[person % STATURES_M.len()];
    // Proportions differ from the mean.
    let legs = 1.0 + 0.02 * libm::sin(3.0 * person as f64 + 1.0);
    let at = place(field, walk, person, time_s);
    let step =
        place(field, walk, person, time_s + 0.05) - place(field, walk, person, time_s - 0.05);
    let ahead = step.try_normalize(1e-9).unwrap_or(Vector3::x());
    let left = Vector3::z().cross(&ahead);
    let gait = std::f64::consts::TAU * 0.9 * time_s + 1.3 * person as f64;
    let (thigh, shank) = (0.245 * stature * legs, 0.246 * stature * legs);
    let leg = |side: f64| {
        let phase = gait
            + if side > 0.0 {
                0.0
            } else {
                std::f64::consts::PI
            };
        let hip_angle = 0.38 * libm::sin(phase);
        let knee_angle = 0.08 + 0.9 * libm::cos(phase).max(0.0);
        let down = |angle: f64| ahead * libm::sin(angle) - Vector3::z() * libm::cos(angle);
        let knee = down(hip_angle) * thigh;
        (knee, knee + down(hip_angle - knee_angle) * shank)
    };
    let (left_leg, right_leg) = (leg(1.0), leg(-1.0));
    let ankle_m = 0.039 * stature;
    // The lower foot is on the floor.
    let lowest = left_leg.1.z.min(right_leg.1.z);
    let hips = at + Vector3::z() * (ankle_m - lowest);
    let hip = |side: f64| hips + left * (side * 0.085 * stature / 1.75);
    let lean = 0.05 * ahead + 0.02 * libm::sin(gait) * left;
    let shoulders = hips + (Vector3::z() + lean) * (0.288 * stature);
    let shoulder = |side: f64| shoulders + left * (side * 0.19 * stature / 1.75);
    let arm = |side: f64| {
        let swing = -0.5 * side * libm::sin(gait);
        let down = |angle: f64| ahead * libm::sin(angle) - Vector3::z() * libm::cos(angle);
        let elbow = shoulder(side) + down(swing) * (0.186 * stature);
        (elbow, elbow + down(swing + 0.4) * (0.146 * stature))
    };
    let head = shoulders + (Vector3::z() + lean) * (0.11 * stature);
    let (left_arm, right_arm) = (arm(1.0), arm(-1.0));
    vec![
        head + ahead * 0.11,
        head + ahead * 0.09 + left * 0.03 + Vector3::z() * 0.03,
        head + ahead * 0.09 - left * 0.03 + Vector3::z() * 0.03,
        head + left * 0.075,
        head - left * 0.075,
        shoulder(1.0),
        shoulder(-1.0),
        left_arm.0,
        right_arm.0,
        left_arm.1,
        right_arm.1,
        hip(1.0),
        hip(-1.0),
        hip(1.0) + left_leg.0,
        hip(-1.0) + right_leg.0,
        hip(1.0) + left_leg.1,
        hip(-1.0) + right_leg.1,
    ]
}

/// A request with the sights of synchronised cameras, with everything known except their poses.
pub(super) fn request(field: &Field, states: &[CameraState], walk: &Walk) -> PeopleRequest {
    let mut rng = ChaCha8Rng::seed_from_u64(walk.seed);
    let cameras = states.iter().enumerate().map(|(index, state)| {
        let frames = (0..(walk.seconds / state.period_s) as usize).map(|frame| DetectedFrame {
            frame: frame as f64,
            bodies: seen(field, state, walk, state.time_s(frame as f64), &mut rng),
        });
        PeopleCamera {
            name: format!("c{index}"),
            size_px: SIZE_PX,
            intrinsics: state.intrinsics,
            lens: state.lens(),
            rate_hz: None,
            offset_s: None,
            frames: frames.collect(),
        }
    });
    let mut request = PeopleRequest::new(cameras.collect(), RATE_HZ);
    request.stature_m = Some(MEAN_STATURE_M);
    request
}

/// The bodies of one picture in random order, with missing and false ones.
fn seen(
    field: &Field,
    state: &CameraState,
    walk: &Walk,
    time_s: f64,
    rng: &mut ChaCha8Rng,
) -> Vec<Detection> {
    let mut bodies = Vec::new();
    for person in 0..walk.people {
        if rng.random_range(0.0..1.0) < 0.04 {
            continue;
        }
        let joints = body(field, walk, person, time_s);
        // The constant part changes every second, with its own random numbers.
        let second = time_s.floor() as i64 as u64;
        let camera = state.center_w.x.to_bits() ^ state.center_w.y.to_bits().rotate_left(17);
        let held = ChaCha8Rng::seed_from_u64(camera ^ (second << 8) ^ person as u64);
        bodies.extend(detection(&joints, state, walk, held, rng));
    }
    // A false detection now and then.
    if rng.random_range(0.0..1.0) < 0.05 {
        let false_body = (0..17).map(|_| {
            Some(Keypoint {
                px: [
                    rng.random_range(100.0..400.0),
                    rng.random_range(300.0..700.0),
                ],
                score: 0.4,
            })
        });
        bodies.push(Detection {
            keypoints: false_body.collect(),
        });
    }
    bodies.shuffle(rng);
    bodies
}

fn detection(
    joints: &[Vector3<f64>],
    state: &CameraState,
    walk: &Walk,
    mut held: ChaCha8Rng,
    rng: &mut ChaCha8Rng,
) -> Option<Detection> {
    let fold = state.fold_radius();
    let mut keypoints = Vec::new();
    for (index, joint) in joints.iter().enumerate() {
        let depth_m = (state.camera_from_world * (joint - state.center_w)).z;
        // An outlier is the same joint of the other side, or a point near the body.
        let is_outlier = rng.random_range(0.0..1.0) < walk.outlier_share;
        let mut at = *joint;
        if is_outlier {
            let other = match index {
                0 => 0,
                odd if odd % 2 == 1 => odd + 1,
                even => even - 1,
            };
            at = if rng.random_range(0.0..1.0) < 0.5 {
                joints[other]
            } else {
                let mut aside = || rng.random_range(-0.5..0.5);
                joint + Vector3::new(aside(), aside(), aside())
            };
        }
        let sigma_px = walk.noise_m * state.intrinsics.fx_px / depth_m.max(0.5);
        let (stays, goes) = (walk.held_share.sqrt(), (1.0 - walk.held_share).sqrt());
        let mut noise = || {
            let on_body = stays * gauss(&mut held) + goes * gauss(rng);
            sigma_px * on_body + walk.noise_px * gauss(rng)
        };
        let noise = [noise(), noise()];
        let is_missed = rng.random_range(0.0..1.0) < walk.missed_share;
        let score = if is_outlier {
            rng.random_range(0.2..0.8)
        } else {
            rng.random_range(0.6..1.0)
        };
        let seen = state
            .project(&at, fold)
            .map(|px| [px.x + noise[0], px.y + noise[1]]);
        let is_inside = |px: &[f64; 2]| {
            (0..2).all(|axis| px[axis] >= 0.0 && px[axis] <= f64::from(SIZE_PX[axis]) - 1.0)
        };
        let seen = seen.filter(|px| is_inside(px) && !is_missed);
        keypoints.push(seen.map(|px| Keypoint { px, score }));
    }
    (keypoints.iter().flatten().count() >= 8).then_some(Detection { keypoints })
}

/// Standard normal (Box and Muller).
pub(super) fn gauss(rng: &mut ChaCha8Rng) -> f64 {
    let radius = (-2.0 * libm::log(rng.random_range(1e-12..1.0))).sqrt();
    radius * libm::cos(std::f64::consts::TAU * rng.random_range(0.0..1.0))
}

/// Largest errors of a camera after similarity alignment of the centres: metres and degrees.
pub(super) fn worst(found: &[CameraState], truth: &[CameraState]) -> (f64, f64) {
    let centers = |states: &[CameraState]| states.iter().map(|s| s.center_w).collect::<Vec<_>>();
    let similarity = Similarity::between(&centers(found), &centers(truth)).unwrap();
    let each = found.iter().zip(truth).map(|(found, truth)| {
        let moved = similarity.apply_to_camera(found);
        let turn = moved.camera_from_world.angle_to(&truth.camera_from_world);
        ((moved.center_w - truth.center_w).norm(), turn.to_degrees())
    });
    each.fold((0.0, 0.0), |(m, deg), it| {
        (f64::max(m, it.0), f64::max(deg, it.1))
    })
}
