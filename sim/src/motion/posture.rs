//! A posture: the positions of the 29 joints at one moment, and operations on it.

use farfield_fusion::body::skeleton::Joints;
use farfield_fusion::body::skeleton::{Joint, N_JOINTS};
use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};

/// The joints of one moment, indexed by [`Joint`]; z up, right-handed, in statures if not stated
/// otherwise.
#[derive(Debug, Clone, PartialEq)]
pub struct Posture {
    /// The joints.
    pub joints: Joints,
}

impl Posture {
    /// The position of one joint.
    pub fn at(&self, joint: Joint) -> Vector3<f64> {
        self.joints[joint.index()]
    }

    /// The axes of the pelvis: x forward, y left (from hip to hip), z up (towards the spine).
    pub fn pelvis_axes(&self) -> UnitQuaternion<f64> {
        let left = self.at(Joint::LeftHip) - self.at(Joint::RightHip);
        axes(left, self.at(Joint::Spine) - self.at(Joint::Pelvis))
    }

    /// The axes of the head: x forward, y left (from ear to ear), z up.
    fn head_axes(&self) -> UnitQuaternion<f64> {
        let left = self.at(Joint::LeftEar) - self.at(Joint::RightEar);
        let forward = self.at(Joint::Nose) - self.at(Joint::Head);
        axes(left, forward.cross(&left))
    }

    /// The heading of the pelvis on the floor plane, radians from +x towards +y, in (-pi, pi].
    ///
    /// It is the twist about the vertical in the rotation of the pelvis: the direction that the
    /// pelvis would face if it were tilted upright the shortest way. For an upright person this is
    /// the facing direction. A person lying on the back or on the face has the heading after
    /// sitting or standing up. A cartwheel keeps its heading through the inverted moment. The
    /// heading is continuous except for a pelvis exactly upside down, where it is undefined; near
    /// that posture it changes fast.
    pub fn facing_rad(&self) -> f64 {
        let q = self.pelvis_axes();
        let heading = 2.0 * q.k.atan2(q.w);
        wrapped(heading)
    }

    /// The interpolated posture between this one (`share` 0) and `to` (1).
    ///
    /// The pelvis moves straight and turns by slerp. Every bone turns the shortest way in the axes
    /// of the pelvis, and its length changes linearly. The head turns as one piece.
    #[must_use]
    pub fn blend(&self, to: &Self, share: f64) -> Self {
        let share = share.clamp(0.0, 1.0);
        let pelvis = [self.pelvis_axes(), to.pelvis_axes()];
        let pelvis_now = slerp(pelvis[0], pelvis[1], share);
        let head = [
            pelvis[0].inverse() * self.head_axes(),
            pelvis[1].inverse() * to.head_axes(),
        ];
        let head_now = pelvis_now * slerp(head[0], head[1], share);
        let head = [pelvis[0] * head[0], pelvis[1] * head[1]];
        let mut joints = self.joints;
        joints[Joint::Pelvis.index()] = self.at(Joint::Pelvis).lerp(&to.at(Joint::Pelvis), share);
        for (joint, parent) in bones() {
            let on_head = parent == Joint::Head;
            let (from_axes, now) = if on_head {
                (&head, head_now)
            } else {
                (&pelvis, pelvis_now)
            };
            let a = from_axes[0].inverse() * (self.at(joint) - self.at(parent));
            let b = from_axes[1].inverse() * (to.at(joint) - to.at(parent));
            joints[joint.index()] = joints[parent.index()] + now * swung(&a, &b, share);
        }
        Self { joints }
    }

    /// The same posture of a body with the mean lengths `to` instead of `from`, both by [`Joint`],
    /// distance to the parent. Every bone is scaled by its own ratio, so variations inside a clip
    /// remain.
    ///
    /// The pelvis moves, along and above the floor, by the ratio of the legs (hip to knee and knee
    /// to ankle). So feet stay on the floor and steps do not slide.
    #[must_use]
    pub fn with_mean_lengths(&self, from: &[f64; N_JOINTS], to: &[f64; N_JOINTS]) -> Self {
        let leg = |lengths: &[f64; N_JOINTS]| -> f64 {
            let bones = [
                Joint::LeftKnee,
                Joint::RightKnee,
                Joint::LeftAnkle,
                Joint::RightAnkle,
            ];
            bones.iter().map(|joint| lengths[joint.index()]).sum()
        };
        let hips = |lengths: &[f64; N_JOINTS]| {
            lengths[Joint::LeftHip.index()] + lengths[Joint::RightHip.index()]
        };
        let mut joints = self.joints;
        joints[Joint::Pelvis.index()] *= ratio(leg(from), leg(to));
        for (joint, parent) in bones() {
            let i = joint.index();
            let scale = if matches!(joint, Joint::LeftHip | Joint::RightHip) {
                // One ratio for both, because the pelvis is their midpoint.
                ratio(hips(from), hips(to))
            } else {
                ratio(from[i], to[i])
            };
            let bone = self.at(joint) - self.at(parent);
            joints[i] = joints[parent.index()] + bone * scale;
        }
        Self { joints }
    }

    /// The posture turned about the vertical axis through the origin by `yaw_rad`, then shifted.
    #[must_use]
    pub fn moved(&self, yaw_rad: f64, shift: Vector3<f64>) -> Self {
        let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), yaw_rad);
        Self {
            joints: self.joints.map(|joint| turn * joint + shift),
        }
    }

    /// The joints in metres for a person of that stature.
    pub fn scaled(&self, stature_m: f64) -> Joints {
        self.joints.map(|joint| joint * stature_m)
    }
}

/// Every joint with its parent; parents come first.
fn bones() -> impl Iterator<Item = (Joint, Joint)> {
    Joint::ALL
        .into_iter()
        .filter_map(|joint| Some((joint, joint.parent()?)))
}

fn ratio(from: f64, to: f64) -> f64 {
    let ratio = to / from;
    if ratio.is_finite() && ratio > 0.0 {
        ratio
    } else {
        1.0
    }
}

/// The equivalent angle in (-pi, pi].
fn wrapped(angle_rad: f64) -> f64 {
    let (sin, cos) = angle_rad.sin_cos();
    sin.atan2(cos)
}

/// The axes with y along `left` and z near `up`; the identity if these are parallel or zero.
fn axes(left: Vector3<f64>, up: Vector3<f64>) -> UnitQuaternion<f64> {
    let rotation = || {
        let y = left.try_normalize(f64::EPSILON)?;
        let x = y.cross(&up).try_normalize(f64::EPSILON)?;
        let matrix = Matrix3::from_columns(&[x, y, x.cross(&y)]);
        Some(Rotation3::from_matrix_unchecked(matrix))
    };
    let rotation = rotation().unwrap_or_else(Rotation3::identity);
    UnitQuaternion::from_rotation_matrix(&rotation)
}

fn slerp(from: UnitQuaternion<f64>, to: UnitQuaternion<f64>, share: f64) -> UnitQuaternion<f64> {
    from.try_slerp(&to, share, f64::EPSILON)
        .unwrap_or(if share < 0.5 { from } else { to })
}

/// The vector between `a` and `b`: the direction turned the shortest way, the length interpolated.
fn swung(a: &Vector3<f64>, b: &Vector3<f64>, share: f64) -> Vector3<f64> {
    let length = a.norm() * (1.0 - share) + b.norm() * share;
    let (Some(a), Some(b)) = (a.try_normalize(f64::EPSILON), b.try_normalize(f64::EPSILON)) else {
        return a.lerp(b, share);
    };
    // Opposite directions have no shortest way. A common axis for a vector and its opposite keeps
    // the pelvis between the hips.
    let turn = UnitQuaternion::rotation_between(&a, &b).unwrap_or_else(|| {
        let steep = a.x.abs() > 0.9;
        let axis = if steep { Vector3::z() } else { Vector3::x() };
        let across = (axis - a * a.dot(&axis)).normalize();
        UnitQuaternion::from_scaled_axis(across * std::f64::consts::PI)
    });
    UnitQuaternion::from_scaled_axis(turn.scaled_axis() * share) * a * length
}

#[cfg(test)]
mod tests {
    use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI};

    use proptest::prelude::*;

    use super::*;

    /// An upright person at the origin who faces +x, with typical proportions.
    fn upright() -> Posture {
        let mut joints = [Vector3::zeros(); N_JOINTS];
        let mut set = |joint: Joint, x: f64, y: f64, z: f64| {
            joints[joint.index()] = Vector3::new(x, y, z);
        };
        set(Joint::Pelvis, 0.0, 0.0, 0.53);
        set(Joint::Spine, 0.0, 0.0, 0.60);
        set(Joint::Neck, -0.01, 0.0, 0.82);
        set(Joint::Head, 0.0, 0.0, 0.92);
        set(Joint::Nose, 0.06, 0.0, 0.91);
        for (side, y) in [(0, 1.0), (1, -1.0)] {
            for (i, x, out, z) in [
                (5, 0.05, 0.02, 0.935),
                (7, 0.0, 0.04, 0.92),
                (9, 0.02, 0.02, 0.80),
                (11, 0.0, 0.11, 0.80),
                (13, 0.0, 0.12, 0.63),
                (15, 0.03, 0.13, 0.48),
                (17, 0.04, 0.13, 0.43),
                (19, 0.0, 0.05, 0.53),
                (21, 0.01, 0.05, 0.29),
                (23, 0.0, 0.05, 0.04),
                (25, -0.03, 0.05, 0.0),
                (27, 0.12, 0.06, 0.0),
            ] {
                set(Joint::ALL[i + side], x, y * out, z);
            }
        }
        Posture { joints }
    }

    fn turned(posture: &Posture, axis: Vector3<f64>, angle_rad: f64) -> Posture {
        let turn = Rotation3::new(axis * angle_rad);
        Posture {
            joints: posture.joints.map(|joint| turn * joint),
        }
    }

    fn furthest(a: &Posture, b: &Posture) -> f64 {
        let both = a.joints.iter().zip(&b.joints);
        both.map(|(a, b)| (a - b).norm()).fold(0.0, f64::max)
    }

    fn lengths(posture: &Posture) -> [f64; N_JOINTS] {
        let mut lengths = [0.0; N_JOINTS];
        for (joint, parent) in bones() {
            lengths[joint.index()] = (posture.at(joint) - posture.at(parent)).norm();
        }
        lengths
    }

    #[test]
    fn facing_is_the_heading_of_the_pelvis_tilted_upright() {
        let posture = turned(&upright(), Vector3::z(), 2.0);
        assert!((posture.facing_rad() - 2.0).abs() < 1e-9);
        // On the back with the feet towards +x, and on the face with the feet towards -x.
        let back = turned(&upright(), Vector3::y(), -FRAC_PI_2);
        let face = turned(&upright(), Vector3::y(), FRAC_PI_2);
        assert!(back.facing_rad().abs() < 1e-9 && face.facing_rad().abs() < 1e-9);
        for i in 0..200 {
            let cartwheel = turned(&upright(), Vector3::x(), f64::from(i) * 0.0313);
            assert!(cartwheel.facing_rad().abs() < 1e-9);
        }
    }

    #[test]
    fn a_blend_connects_two_postures_and_keeps_bone_lengths() {
        let from = upright();
        let to = turned(&upright(), Vector3::z(), 2.5).moved(0.0, Vector3::new(0.1, 0.2, -0.03));
        assert!(furthest(&from.blend(&to, 0.0), &from) < 1e-9);
        assert!(furthest(&from.blend(&to, 1.0), &to) < 1e-9);
        let half = from.blend(&to, 0.5);
        assert!((half.facing_rad() - 1.25).abs() < 1e-9);
        let blended = lengths(&half);
        for (a, b) in blended.iter().zip(&lengths(&from)) {
            assert!((a - b).abs() < 1e-9);
        }
    }

    #[test]
    fn a_blend_to_a_headstand_keeps_plausible_lengths() {
        let inverted = turned(&upright(), Vector3::x(), PI);
        for i in 0..=20 {
            let share = f64::from(i) / 20.0;
            let posture = upright().blend(&inverted, share);
            let hips = posture.at(Joint::LeftHip) + posture.at(Joint::RightHip);
            assert!((hips / 2.0 - posture.at(Joint::Pelvis)).norm() < 1e-9);
            let found = lengths(&posture);
            for (a, b) in found.iter().zip(&lengths(&upright())) {
                assert!((a - b).abs() < 1e-9);
            }
        }
    }

    #[test]
    fn changed_lengths_keep_directions_and_feet_on_the_floor() {
        let posture = upright();
        let from = lengths(&posture);
        let taller = from.map(|length| 1.1 * length);
        let scaled = posture.with_mean_lengths(&from, &taller);
        assert!(
            furthest(
                &scaled,
                &Posture {
                    joints: posture.scaled(1.1)
                }
            ) < 1e-9
        );
        let mut arms = from;
        arms[Joint::LeftElbow.index()] *= 1.2;
        let scaled = posture.with_mean_lengths(&from, &arms);
        assert!(
            (lengths(&scaled)[Joint::LeftElbow.index()] - arms[Joint::LeftElbow.index()]).abs()
                < 1e-9
        );
        assert!((scaled.at(Joint::LeftToe) - posture.at(Joint::LeftToe)).norm() < 1e-9);
        let same = posture.with_mean_lengths(&[0.0; N_JOINTS], &[0.0; N_JOINTS]);
        assert!(furthest(&same, &posture) < 1e-9);
    }

    #[test]
    fn moved_turns_about_the_origin_before_the_shift() {
        let moved = upright()
            .moved(FRAC_PI_4, Vector3::new(1.0, 2.0, 0.0))
            .scaled(2.0);
        let pelvis = moved[Joint::Pelvis.index()];
        assert!((pelvis - Vector3::new(2.0, 4.0, 1.06)).norm() < 1e-12);
        let nose = moved[Joint::Nose.index()] - moved[Joint::Head.index()];
        assert!((nose.y - nose.x).abs() < 1e-12);
    }

    proptest! {
        #[test]
        fn facing_turns_with_the_body(
            tilt in -2.5..2.5_f64, about in -3.0..3.0_f64, yaw in -3.0..3.0_f64,
        ) {
            let axis = Vector3::new(about.cos(), about.sin(), 0.0);
            let tilted = turned(&upright(), axis, tilt);
            let turned = tilted.moved(yaw, Vector3::zeros());
            let off = wrapped(turned.facing_rad() - tilted.facing_rad() - yaw);
            prop_assert!(off.abs() < 1e-6);
        }

        #[test]
        fn a_blend_is_always_finite(
            a in proptest::collection::vec(-1.0..1.0_f64, 3 * N_JOINTS),
            b in proptest::collection::vec(-1.0..1.0_f64, 3 * N_JOINTS),
            share in 0.0..1.0_f64,
        ) {
            let posture = |v: &[f64]| Posture {
                joints: std::array::from_fn(|i| Vector3::new(v[3 * i], v[3 * i + 1], v[3 * i + 2])),
            };
            let now = posture(&a).blend(&posture(&b), share);
            prop_assert!(now.joints.iter().all(|joint| joint.norm().is_finite()));
        }
    }
}
