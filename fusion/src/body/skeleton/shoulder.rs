//! The shoulder: swing and twist, because people raise their arms through the poles of Euler angles.
//!
//! ```text
//!   R = exp([s]×) R₀ Rz(± t),   s = s₁ e₁ + s₂ e₂ ⟂ r₀        scapula_from_upper_arm
//! ```
//!
//! r₀ is the direction of the upper arm at zero swing, in the scapula's frame: forward, outward and
//! a little down, in the middle of what people reach. R₀ is the least rotation that takes the hanging
//! arm (-z) to r₀. s₁ > 0 raises the arm, s₂ > 0 carries it inward across the chest, t > 0 turns it
//! inward about its own axis (+z on the right, -z on the left). The one singularity, |s| = π, is the
//! arm that points along -r₀: backward, inward and up, where no arm points. The arm that hangs with
//! the elbow's axis to the side has R = 1 and t = 0.

use std::f64::consts::PI;
use std::sync::LazyLock;

use nalgebra::{Matrix3, Vector3};

use super::dof::Axis;
use super::joint::Side;

/// Direction of the arm at zero swing, outward from straight ahead, radians (45 degrees).
const CENTRE_AZIMUTH_RAD: f64 = PI / 4.0;
/// And below the horizontal, radians (20 degrees).
const CENTRE_DROP_RAD: f64 = PI / 9.0;
/// Below this swing the series of the left Jacobian is exact to rounding, radians.
const SMALL_RAD: f64 = 1e-4;

/// The constants of one shoulder.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SwingTwist {
    /// Direction of the arm at zero swing, unit, in the scapula.
    pub(crate) centre: Vector3<f64>,
    /// Axis of the raising swing, unit.
    raise: Vector3<f64>,
    /// Axis of the inward swing, unit.
    inward: Vector3<f64>,
    /// Takes the hanging arm to `centre`.
    rest: Matrix3<f64>,
    /// Sign of the twist about the arm's z.
    twist_sign: f64,
}

/// A shoulder's rotation and how it changes.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ShoulderState {
    /// Scapula from upper arm.
    pub(crate) rotation: Matrix3<f64>,
    /// Axes of the three DoF in the scapula: angular velocity per unit of s₁, s₂, t. The first two
    /// are not unit vectors.
    pub(crate) axes: [Vector3<f64>; 3],
}

impl SwingTwist {
    /// The shoulder of `side`.
    pub(crate) fn for_side(side: Side) -> &'static Self {
        static BOTH: LazyLock<[SwingTwist; 2]> = LazyLock::new(|| Side::BOTH.map(SwingTwist::new));
        &BOTH[side as usize]
    }

    fn new(side: Side) -> Self {
        // Computed for the right and mirrored: a direction flips its y, a rotation vector its x, z.
        let m = side.mirror();
        let (sin_a, cos_a) = libm::sincos(CENTRE_AZIMUTH_RAD);
        let (sin_d, cos_d) = libm::sincos(CENTRE_DROP_RAD);
        let right = Vector3::new(cos_d * cos_a, -cos_d * sin_a, -sin_d);
        let raise = (-Vector3::z()).cross(&right).normalize();
        let inward = raise.cross(&right);
        let (mirror_direction, mirror_rotation) =
            (Vector3::new(1.0, m, 1.0), Vector3::new(m, 1.0, m));
        let raise = raise.component_mul(&mirror_rotation);
        Self {
            centre: right.component_mul(&mirror_direction),
            raise,
            inward: inward.component_mul(&mirror_rotation),
            rest: exp(&(raise * (PI / 2.0 - CENTRE_DROP_RAD))),
            twist_sign: m,
        }
    }

    fn swing(&self, s1: f64, s2: f64) -> Vector3<f64> {
        self.raise * s1 + self.inward * s2
    }

    /// Direction of the arm, unit, in the scapula.
    pub(crate) fn direction(&self, s1: f64, s2: f64) -> Vector3<f64> {
        exp(&self.swing(s1, s2)) * self.centre
    }

    /// Rotation and axes at `q` = (s₁, s₂, t), radians. Cost: two sine-cosine pairs.
    pub(crate) fn evaluate(&self, q: &[f64]) -> ShoulderState {
        let s = self.swing(q[0], q[1]);
        let series = Rodrigues::of(&s);
        let swung = series.rotation() * self.rest;
        let mut rotation = swung;
        turn_about(&mut rotation, Axis::Z, self.twist_sign * q[2]);
        let left = series.left_jacobian();
        let axes = [
            left * self.raise,
            left * self.inward,
            swung.column(2) * self.twist_sign,
        ];
        ShoulderState { rotation, axes }
    }

    /// The coordinates (s₁, s₂, t) of a rotation, |s| <= π; the inverse of [`Self::evaluate`] there.
    pub(crate) fn coordinates_of(&self, rotation: &Matrix3<f64>) -> [f64; 3] {
        let [s1, s2] = self.swing_to(&-rotation.column(2));
        let s = self.swing(s1, s2);
        let twist = (exp(&s) * self.rest).tr_mul(rotation);
        let angle = libm::atan2(twist[(1, 0)], twist[(0, 0)]);
        [s1, s2, self.twist_sign * angle]
    }

    /// The swing (s1, s2) that points the arm along `direction` (unit), |s| <= π.
    pub(crate) fn swing_to(&self, direction: &Vector3<f64>) -> [f64; 2] {
        let axis = self.centre.cross(direction);
        let (sine, cosine) = (axis.norm(), self.centre.dot(direction));
        // Along or against the centre every axis is as good.
        let axis = if sine > f64::EPSILON {
            axis / sine
        } else {
            self.raise
        };
        let s = axis * libm::atan2(sine, cosine);
        [s.dot(&self.raise), s.dot(&self.inward)]
    }
}

/// The same rotation with |s| <= π and |t| <= π.
pub(crate) fn wrapped(q: [f64; 3]) -> [f64; 3] {
    let angle = libm::hypot(q[0], q[1]);
    let factor = if angle > PI { wrap(angle) / angle } else { 1.0 };
    [q[0] * factor, q[1] * factor, wrap(q[2])]
}

/// `angle_rad` in [-π, π].
pub(crate) fn wrap(angle_rad: f64) -> f64 {
    if angle_rad.abs() <= PI {
        angle_rad
    } else {
        angle_rad - 2.0 * PI * (angle_rad / (2.0 * PI)).round()
    }
}

/// The rotation of a rotation vector.
pub(crate) fn exp(s: &Vector3<f64>) -> Matrix3<f64> {
    Rodrigues::of(s).rotation()
}

/// What rotation and Jacobian of a rotation vector s are made of, θ = |s|.
struct Rodrigues {
    /// `[s]×`.
    cross: Matrix3<f64>,
    /// Its square.
    squared: Matrix3<f64>,
    /// sin θ/θ.
    a: f64,
    /// (1 - cos θ)/θ².
    b: f64,
    /// (θ - sin θ)/θ³.
    c: f64,
}

impl Rodrigues {
    fn of(s: &Vector3<f64>) -> Self {
        let cross = s.cross_matrix();
        let angle = s.norm();
        let squared = angle * angle;
        let (a, b, c) = if angle < SMALL_RAD {
            (
                1.0 - squared / 6.0,
                0.5 - squared / 24.0,
                1.0 / 6.0 - squared / 120.0,
            )
        } else {
            let (sin, cos) = libm::sincos(angle);
            (
                sin / angle,
                (1.0 - cos) / squared,
                (angle - sin) / (squared * angle),
            )
        };
        Self {
            cross,
            squared: cross * cross,
            a,
            b,
            c,
        }
    }

    fn rotation(&self) -> Matrix3<f64> {
        Matrix3::identity() + self.cross * self.a + self.squared * self.b
    }

    /// J of d exp(s) = `[J ds]× exp(s)`.
    fn left_jacobian(&self) -> Matrix3<f64> {
        Matrix3::identity() + self.cross * self.b + self.squared * self.c
    }
}

/// Turns a frame about one of its own axes: the other two columns mix.
pub(crate) fn turn_about(rotation: &mut Matrix3<f64>, axis: Axis, angle_rad: f64) {
    let (sin, cos) = libm::sincos(angle_rad);
    let (i, j) = match axis {
        Axis::X => (1, 2),
        Axis::Y => (2, 0),
        Axis::Z => (0, 1),
    };
    for row in 0..3 {
        let (u, v) = (rotation[(row, i)], rotation[(row, j)]);
        rotation[(row, i)] = cos * u + sin * v;
        rotation[(row, j)] = cos * v - sin * u;
    }
}
