//! The body at one moment, and what it hides.

use farfield_fusion::body::skeleton::Joints;
use farfield_fusion::body::skeleton::{Joint, Side};
use nalgebra::{Matrix3, Vector3};

use super::build::Build;
use super::cone::{BodyPart, Cone};
use super::parts::{self, TrunkAxes};

/// A point this close behind a surface counts as on it, metres.
const ON_SURFACE_M: f64 = 0.02;

/// The body at one moment: its solids, world metres.
#[derive(Debug, Clone)]
pub struct Volume {
    /// The solids; they overlap.
    pub cones: Vec<Cone>,
    /// The middle between the ears, and the axes of the head as columns (forward, left, up), world.
    pub head_m: (Vector3<f64>, Matrix3<f64>),
    /// The same for the chest, at the base of the neck.
    pub chest_m: (Vector3<f64>, Matrix3<f64>),
    /// The same for the pelvis, between the hips.
    pub pelvis_m: (Vector3<f64>, Matrix3<f64>),
    /// The two eyes, left first, world metres.
    pub eyes_m: [Vector3<f64>; 2],
    /// A ball that contains the body: centre and radius, world metres.
    pub bound_m: (Vector3<f64>, f64),
}

impl Volume {
    /// The body around `joints_m` (world metres).
    pub fn new(joints_m: &Joints, build: &Build) -> Self {
        let axes = TrunkAxes::from_joints(joints_m);
        let mut cones = Vec::with_capacity(48);
        parts::add_trunk(&mut cones, joints_m, &axes, build);
        for side in Side::BOTH {
            parts::add_leg(&mut cones, joints_m, build, &axes, side);
            parts::add_arm(&mut cones, joints_m, &axes, build, side);
        }
        let at = |j: Joint| joints_m[j as usize];
        let bound_m = bound_of(&cones, at(Joint::Pelvis));
        Self {
            cones,
            head_m: ((at(Joint::LeftEar) + at(Joint::RightEar)) / 2.0, axes.head),
            chest_m: (at(Joint::Neck), axes.chest),
            pelvis_m: (at(Joint::Pelvis), axes.pelvis),
            eyes_m: [at(Joint::LeftEye), at(Joint::RightEye)],
            bound_m,
        }
    }

    /// The same with every point moved to `center_m` + `squeeze` x (point - `center_m`). A matrix
    /// without an inverse has no effect, because it would remove all depth.
    #[must_use]
    pub fn squeezed(mut self, squeeze: &Matrix3<f64>, center_m: &Vector3<f64>) -> Self {
        let Some(back) = squeeze.try_inverse() else {
            return self;
        };
        let moved = |p: &Vector3<f64>| center_m + squeeze * (p - center_m);
        for cone in &mut self.cones {
            cone.to_local *= back;
            cone.origin_m = moved(&cone.origin_m);
            cone.tip_m = moved(&cone.tip_m);
        }
        for (at_m, _) in [&mut self.head_m, &mut self.chest_m, &mut self.pelvis_m] {
            *at_m = moved(at_m);
        }
        self.eyes_m = self.eyes_m.map(|eye| moved(&eye));
        self.bound_m.0 = moved(&self.bound_m.0);
        self
    }

    /// Whether this body hides `point_m` from `eye_m` (world metres).
    ///
    /// `own_keypoint` is the COCO index if the point is a keypoint of this body. Parts that contain
    /// the point then hide it only by their thickness on the far side. A shoulder is not hidden by
    /// its own deltoid, but by the chest; an eye is hidden by the back of the head.
    pub fn covers(
        &self,
        eye_m: &Vector3<f64>,
        point_m: &Vector3<f64>,
        own_keypoint: Option<usize>,
    ) -> bool {
        let sight = point_m - eye_m;
        let (center, radius) = self.bound_m;
        if is_clear_of(eye_m, &sight, &center, radius) {
            return false;
        }
        let distance_m = sight.norm();
        self.cones.iter().any(|cone| {
            let allowed_m = own_keypoint.map_or(ON_SURFACE_M, |k| own_depth_m(k, cone.part));
            let (center, radius) = cone.bound_m();
            if allowed_m.is_infinite() || is_clear_of(eye_m, &sight, &center, radius) {
                return false;
            }
            cone.entry(eye_m, &sight)
                .is_some_and(|t| t > 0.0 && (1.0 - t) * distance_m > allowed_m)
        })
    }
}

/// Whether the ray from `eye` along `sight` misses a ball.
fn is_clear_of(
    eye: &Vector3<f64>,
    sight: &Vector3<f64>,
    center: &Vector3<f64>,
    radius: f64,
) -> bool {
    let to_center = center - eye;
    let share = (to_center.dot(sight) / sight.norm_squared().max(1e-12)).clamp(0.0, 1.0);
    (to_center - sight * share).norm_squared() > radius * radius
}

/// How deep below the surface of `part` the body's own keypoint may be and still be visible,
/// metres; infinite for the parts around it.
fn own_depth_m(keypoint: usize, part: BodyPart) -> f64 {
    use BodyPart::{
        Abdomen, Chest, Girdle, Hair, Head, LeftFoot, LeftForearm, LeftHand, LeftShank, LeftThigh,
        LeftUpperArm, Neck, Pelvis, RightFoot, RightForearm, RightHand, RightShank, RightThigh,
        RightUpperArm,
    };
    const ADJACENT: f64 = f64::INFINITY;
    match (keypoint, part) {
        (0..=4, Head | Hair) => 0.045,
        (5 | 6, Chest) => 0.15,
        (5 | 6, Girdle) => 0.2,
        (5 | 6, Neck | Abdomen) => 0.05,
        (5 | 7, LeftUpperArm)
        | (6 | 8, RightUpperArm)
        | (7 | 9, LeftForearm)
        | (8 | 10, RightForearm)
        | (9, LeftHand)
        | (10, RightHand)
        | (11 | 13, LeftThigh)
        | (12 | 14, RightThigh)
        | (13 | 15, LeftShank)
        | (14 | 16, RightShank)
        | (15, LeftFoot)
        | (16, RightFoot) => ADJACENT,
        (11 | 12, Pelvis | Abdomen) => 0.18,
        _ => ON_SURFACE_M,
    }
}

fn bound_of(cones: &[Cone], center: Vector3<f64>) -> (Vector3<f64>, f64) {
    let radius = cones
        .iter()
        .map(|cone| {
            let (c, r) = cone.bound_m();
            (c - center).norm() + r
        })
        .fold(0.0, f64::max);
    (center, radius)
}
