//! Body axes from joints: x forward, y to the person's left, z towards the head.

use farfield_fusion::body::skeleton::Joint;
use farfield_fusion::body::skeleton::Joints;
use nalgebra::{Matrix3, Vector3};

/// Shorter vectors have no reliable direction, metres.
const SHORT_M: f64 = 1e-3;

/// Axes of the three parts of the trunk, as columns (forward, left, up), world.
#[derive(Debug, Clone, Copy)]
pub(super) struct TrunkAxes {
    pub(super) pelvis: Matrix3<f64>,
    pub(super) chest: Matrix3<f64>,
    pub(super) head: Matrix3<f64>,
}

impl TrunkAxes {
    pub(super) fn of(joints: &Joints) -> Self {
        let at = |j: Joint| joints[j as usize];
        let spine = at(Joint::Neck) - at(Joint::Pelvis);
        let hips = at(Joint::LeftHip) - at(Joint::RightHip);
        let shoulders = at(Joint::LeftShoulder) - at(Joint::RightShoulder);
        // The lumbosacral joint is close to the pelvis, in some clips equal to it. The whole trunk
        // stabilises its direction.
        let low = at(Joint::Spine) - at(Joint::Pelvis) + spine * 0.2;
        let high = at(Joint::Neck) - at(Joint::Spine);
        let ears = at(Joint::LeftEar) - at(Joint::RightEar);
        let face = at(Joint::Nose) - (at(Joint::LeftEar) + at(Joint::RightEar)) / 2.0;
        let chest = up_first(high, shoulders);
        Self {
            pelvis: up_first(low, hips),
            chest,
            head: left_first(ears, face, &chest),
        }
    }
}

/// Axes whose up is exactly `up`, with the left as close to `left` as possible.
fn up_first(up: Vector3<f64>, left: Vector3<f64>) -> Matrix3<f64> {
    let z = up.try_normalize(SHORT_M).unwrap_or_else(Vector3::z);
    let y = across(left, &z);
    Matrix3::from_columns(&[y.cross(&z), y, z])
}

/// Axes whose left is exactly `left`, with the forward as close to `forward` as possible; the axes
/// of `other` if the joints do not define them.
fn left_first(left: Vector3<f64>, forward: Vector3<f64>, other: &Matrix3<f64>) -> Matrix3<f64> {
    let Some(y) = left.try_normalize(SHORT_M) else {
        return *other;
    };
    let rest = forward - y * y.dot(&forward);
    let Some(x) = rest.try_normalize(SHORT_M) else {
        return *other;
    };
    Matrix3::from_columns(&[x, y, x.cross(&y)])
}

/// The direction closest to `hint` perpendicular to the unit vector `axis`; an arbitrary one if the
/// two are parallel.
pub(super) fn across(hint: Vector3<f64>, axis: &Vector3<f64>) -> Vector3<f64> {
    let rest = |v: Vector3<f64>| (v - axis * axis.dot(&v)).try_normalize(SHORT_M);
    rest(hint)
        .or_else(|| rest(Vector3::x()))
        .or_else(|| rest(Vector3::y()))
        .unwrap_or_else(Vector3::z)
}
