//! Weight of a view while another body stands in front: paper, eq. (9).
//!
//! The paper does not define "occluded by another". Here a body is a set of capsules along the
//! links of its predicted joints. A keypoint is occluded for a camera if the segment from the
//! camera's centre to the predicted keypoint passes through a nearer capsule of another person.
//! Self-occlusion is not modelled: the network has learned it.

mod touch;

use farfield_proto::venue::parameters::OcclusionParameters;
use nalgebra::Vector3;

use crate::body::skeleton::{Joint, Joints};

pub(crate) use self::touch::Touch;

/// Width of the soft edge of a capsule, metres: across it the weight goes from g to 1, so that a
/// passing limb does not switch a view on and off.
const EDGE_M: f64 = 0.03;

/// The part of a capsule; selects its radius.
#[derive(Debug, Clone, Copy)]
enum CapsulePart {
    Limb,
    Trunk,
    Head,
}

/// The capsules: axis ends and part. The shoulder and hip lines give the trunk its breadth; the
/// head is a sphere.
const CAPSULES: [(Joint, Joint, CapsulePart); 20] = [
    (Joint::Pelvis, Joint::Spine, CapsulePart::Trunk),
    (Joint::Spine, Joint::Neck, CapsulePart::Trunk),
    (Joint::Head, Joint::Head, CapsulePart::Head),
    (Joint::Neck, Joint::Head, CapsulePart::Limb),
    (Joint::LeftShoulder, Joint::RightShoulder, CapsulePart::Limb),
    (Joint::LeftHip, Joint::RightHip, CapsulePart::Limb),
    (Joint::LeftShoulder, Joint::LeftElbow, CapsulePart::Limb),
    (Joint::RightShoulder, Joint::RightElbow, CapsulePart::Limb),
    (Joint::LeftElbow, Joint::LeftWrist, CapsulePart::Limb),
    (Joint::RightElbow, Joint::RightWrist, CapsulePart::Limb),
    (Joint::LeftWrist, Joint::LeftHand, CapsulePart::Limb),
    (Joint::RightWrist, Joint::RightHand, CapsulePart::Limb),
    (Joint::LeftHip, Joint::LeftKnee, CapsulePart::Limb),
    (Joint::RightHip, Joint::RightKnee, CapsulePart::Limb),
    (Joint::LeftKnee, Joint::LeftAnkle, CapsulePart::Limb),
    (Joint::RightKnee, Joint::RightAnkle, CapsulePart::Limb),
    (Joint::LeftAnkle, Joint::LeftToe, CapsulePart::Limb),
    (Joint::RightAnkle, Joint::RightToe, CapsulePart::Limb),
    (Joint::LeftAnkle, Joint::LeftHeel, CapsulePart::Limb),
    (Joint::RightAnkle, Joint::RightHeel, CapsulePart::Limb),
];

/// One capsule, world, metres.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Capsule {
    /// The ends of its axis.
    axis: (Vector3<f64>, Vector3<f64>),
    radius_m: f64,
    middle_m: Vector3<f64>,
    /// From the middle to the end of its soft edge.
    reach_m: f64,
}

impl Capsule {
    fn between(axis: (Vector3<f64>, Vector3<f64>), radius_m: f64) -> Self {
        let half_m = (axis.1 - axis.0).norm() * 0.5;
        Self {
            axis,
            radius_m,
            middle_m: (axis.0 + axis.1) * 0.5,
            // Enlarged slightly for rounding errors.
            reach_m: (half_m + radius_m + EDGE_M) * (1.0 + 1e-9),
        }
    }
}

/// A subset of a body's capsules: one bit each.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CapsuleSet(u32);

const _: () = assert!(CAPSULES.len() <= u32::BITS as usize);

impl CapsuleSet {
    /// All capsules of a body.
    pub const ALL: Self = Self(u32::MAX);

    /// Whether it is empty.
    pub fn is_empty(self) -> bool {
        self.0 == 0
    }

    fn indices(self) -> impl Iterator<Item = usize> {
        let mut left = self.0 & ((1 << CAPSULES.len()) - 1);
        std::iter::from_fn(move || {
            let first = (left != 0).then(|| left.trailing_zeros() as usize);
            left &= left.wrapping_sub(1);
            first
        })
    }
}

/// A person as an occluder: capsules, and a sphere around them.
#[derive(Debug, Clone, PartialEq)]
pub struct BodyCapsules {
    capsules: [Capsule; CAPSULES.len()],
    center_m: Vector3<f64>,
    reach_m: f64,
}

impl BodyCapsules {
    /// The body with these joints (world, metres).
    pub fn from_joints(joints_m: &Joints, parameters: &OcclusionParameters) -> Self {
        let capsules = CAPSULES.map(|(a, b, part)| {
            let radius_m = match part {
                CapsulePart::Limb => parameters.limb_radius_m,
                CapsulePart::Trunk => parameters.trunk_radius_m,
                CapsulePart::Head => parameters.head_radius_m,
            };
            Capsule::between((joints_m[a as usize], joints_m[b as usize]), radius_m)
        });
        let center_m = joints_m.iter().sum::<Vector3<f64>>() / joints_m.len() as f64;
        let reach_m = capsules.iter().fold(0.0f64, |reach, c| {
            reach
                .max((c.axis.0 - center_m).norm() + c.radius_m)
                .max((c.axis.1 - center_m).norm() + c.radius_m)
        });
        Self {
            capsules,
            center_m,
            reach_m: reach_m + EDGE_M,
        }
    }

    /// The cone around the body and `more_m` around it, as seen from `eye_m` (world, metres).
    pub(crate) fn cone(&self, eye_m: &Vector3<f64>, more_m: f64) -> SightCone {
        SightCone::around(eye_m, &self.center_m, self.reach_m + more_m)
    }

    /// The capsules that may be between the eye and any point in `sight`; none is wrongly omitted.
    pub(crate) fn may_hide(&self, eye_m: &Vector3<f64>, sight: &SightCone) -> CapsuleSet {
        if sight.misses(eye_m, &self.center_m, self.reach_m) {
            return CapsuleSet(0);
        }
        let capsules = self.capsules.iter().enumerate();
        let near = capsules.filter(|(_, c)| !sight.misses(eye_m, &c.middle_m, c.reach_m));
        CapsuleSet(near.fold(0, |set, (i, _)| set | 1 << i))
    }

    /// How far inside the nearest of these capsules the view from `eye_m` to `point_m` (world,
    /// metres) passes, in front of the point: 1 inside, 0 next to it or behind, between across the
    /// edge.
    fn cover(&self, capsules: CapsuleSet, eye_m: Vector3<f64>, point_m: Vector3<f64>) -> f64 {
        let nearest_m = distance_to_segment(self.center_m, eye_m, point_m);
        // A NaN must not count as "near": it would reach a weight.
        if nearest_m.is_nan() || nearest_m > self.reach_m {
            return 0.0;
        }
        let view = point_m - eye_m;
        let length2 = view.norm_squared();
        let ahead = view / length2.sqrt();
        let covers = capsules.indices().map(|index| {
            let capsule = &self.capsules[index];
            // Most capsules are far from the line of sight, by their middles.
            let from_eye_m = capsule.middle_m - eye_m;
            let along_m = from_eye_m.dot(&ahead);
            let across2 = from_eye_m.norm_squared() - along_m * along_m;
            if across2 > capsule.reach_m * capsule.reach_m {
                return 0.0;
            }
            let (on_view, on_axis) = closest_between((eye_m, point_m), capsule.axis);
            // The capsule must be nearer than the point; otherwise it hides nothing.
            if (on_axis - eye_m).dot(&view) >= length2 {
                return 0.0;
            }
            let outside_m = (on_view - on_axis).norm() - capsule.radius_m;
            (1.0 - outside_m / EDGE_M).clamp(0.0, 1.0)
        });
        covers.fold(0.0, f64::max)
    }
}

/// The cone around a sphere as seen from a point; from inside, all directions.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SightCone {
    direction: Vector3<f64>,
    /// Of half its opening: at most a quarter turn, or a half turn for all directions.
    sine: f64,
    cosine: f64,
    /// End of the sphere, metres from the eye.
    far_m: f64,
}

impl SightCone {
    /// The cone around the sphere of `radius_m` about `center_m` (world, metres).
    pub(crate) fn around(eye_m: &Vector3<f64>, center_m: &Vector3<f64>, radius_m: f64) -> Self {
        let from_eye_m = center_m - eye_m;
        let distance_m = from_eye_m.norm();
        let sine = radius_m / distance_m;
        let (sine, cosine) = if sine <= 1.0 {
            (sine, (1.0 - sine * sine).sqrt())
        } else {
            (0.0, -1.0)
        };
        Self {
            direction: from_eye_m / distance_m,
            sine,
            cosine,
            far_m: distance_m + radius_m,
        }
    }

    /// Whether it does not touch a sphere (world, metres), and the sphere is not behind it; `eye_m`
    /// is the eye of the cone.
    fn misses(&self, eye_m: &Vector3<f64>, center_m: &Vector3<f64>, radius_m: f64) -> bool {
        let from_eye_m = center_m - eye_m;
        let along_m = from_eye_m.dot(&self.direction);
        let across_m = (from_eye_m - self.direction * along_m).norm();
        let outside_m = across_m * self.cosine - along_m * self.sine;
        // A NaN is never a miss.
        outside_m > radius_m
            || (along_m < -radius_m && !self.is_all_around())
            || along_m > self.far_m + radius_m
    }

    /// Whether it contains all directions.
    fn is_all_around(&self) -> bool {
        self.cosine < 0.0
    }

    /// Whether two cones from the same eye share a direction; true for NaN.
    pub(crate) fn overlaps(&self, other: &Self) -> bool {
        let of_both = self.cosine * other.cosine - self.sine * other.sine;
        let cosine = self.direction.dot(&other.direction);
        cosine.is_nan() || cosine >= of_both || self.is_all_around() || other.is_all_around()
    }
}

/// The weight w of eq. (9) of one view for one keypoint: g = `parameters.weight` if another body
/// stands between `eye_m` (the camera's centre) and `point_m` (the predicted keypoint, both world,
/// metres), else 1. Across a soft edge of 3 cm it is in between.
///
/// `others` are the bodies of all other persons, with their capsules that may matter. Cost: one
/// distance per body out of the line of sight, and one more per capsule of the others.
pub fn view_weight<'a>(
    eye_m: Vector3<f64>,
    point_m: Vector3<f64>,
    others: impl IntoIterator<Item = (&'a BodyCapsules, CapsuleSet)>,
    parameters: &OcclusionParameters,
) -> f64 {
    let cover = others
        .into_iter()
        .map(|(body, capsules)| body.cover(capsules, eye_m, point_m))
        .fold(0.0, f64::max);
    1.0 - cover * (1.0 - parameters.weight)
}

/// Distance of `p` from the segment `a`-`b`.
fn distance_to_segment(p: Vector3<f64>, a: Vector3<f64>, b: Vector3<f64>) -> f64 {
    let d = b - a;
    let length2 = d.norm_squared();
    let t = if length2 > 0.0 {
        ((p - a).dot(&d) / length2).clamp(0.0, 1.0)
    } else {
        0.0
    };
    (a + d * t - p).norm()
}

/// The closest points of two segments (first on the first). Source: Ericson 2005, section 5.1.9.
fn closest_between(
    (p1, q1): (Vector3<f64>, Vector3<f64>),
    (p2, q2): (Vector3<f64>, Vector3<f64>),
) -> (Vector3<f64>, Vector3<f64>) {
    let (d1, d2, r) = (q1 - p1, q2 - p2, p1 - p2);
    let (a, e, f) = (d1.norm_squared(), d2.norm_squared(), d2.dot(&r));
    let c = d1.dot(&r);
    if a <= f64::EPSILON {
        let t = if e <= f64::EPSILON {
            0.0
        } else {
            (f / e).clamp(0.0, 1.0)
        };
        return (p1, p2 + d2 * t);
    }
    if e <= f64::EPSILON {
        return (p1 + d1 * (-c / a).clamp(0.0, 1.0), p2);
    }
    let b = d1.dot(&d2);
    let denominator = a * e - b * b;
    let s = if denominator > f64::EPSILON * a * e {
        ((b * f - c * e) / denominator).clamp(0.0, 1.0)
    } else {
        0.0
    };
    let t = (b * s + f) / e;
    let (s, t) = if t < 0.0 {
        ((-c / a).clamp(0.0, 1.0), 0.0)
    } else if t > 1.0 {
        (((b - c) / a).clamp(0.0, 1.0), 1.0)
    } else {
        (s, t)
    };
    (p1 + d1 * s, p2 + d2 * t)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::body::skeleton::N_JOINTS;

    /// A person that is one upright line of joints: pelvis to head, 0.9 m to 1.7 m.
    fn post(x: f64, y: f64) -> BodyCapsules {
        let mut joints = [Vector3::new(x, y, 0.9); N_JOINTS];
        for (k, joint) in [Joint::Spine, Joint::Neck, Joint::Head]
            .into_iter()
            .enumerate()
        {
            joints[joint as usize].z = 1.1 + 0.3 * k as f64;
        }
        BodyCapsules::from_joints(&joints, &OcclusionParameters::default())
    }

    fn whole(bodies: &[BodyCapsules]) -> impl Iterator<Item = (&BodyCapsules, CapsuleSet)> {
        bodies.iter().map(|body| (body, CapsuleSet::ALL))
    }

    fn check(eye: [f64; 3], point: [f64; 3], others: &[BodyCapsules], expected: f64) {
        let weight = view_weight(
            eye.into(),
            point.into(),
            whole(others),
            &OcclusionParameters {
                weight: G,
                ..OcclusionParameters::default()
            },
        );
        assert!(
            (weight - expected).abs() < 1e-12,
            "{weight}, expected {expected}"
        );
    }

    const G: f64 = 0.3;
    const EYE: [f64; 3] = [-10.0, 0.0, 1.2];
    const KEYPOINT: [f64; 3] = [0.0, 0.0, 1.2];

    #[test]
    fn a_person_in_front_lowers_the_weight_to_g() {
        check(EYE, KEYPOINT, &[post(-3.0, 0.0)], G);
    }

    #[test]
    fn a_person_elsewhere_does_not_change_the_weight() {
        check(
            EYE,
            KEYPOINT,
            &[post(2.0, 0.0), post(-3.0, 1.0), post(-12.0, 0.0)],
            1.0,
        );
    }

    #[test]
    fn a_person_touching_from_behind_hides_nothing() {
        check(EYE, KEYPOINT, &[post(0.05, 0.0)], 1.0);
    }

    #[test]
    fn a_person_touching_from_the_front_hides_the_keypoint() {
        check(EYE, KEYPOINT, &[post(-0.10, 0.0)], G);
    }

    #[test]
    fn without_others_the_weight_is_full() {
        check(EYE, KEYPOINT, &[], 1.0);
    }

    #[test]
    fn the_weight_is_continuous_as_a_person_passes() {
        let weight = |y: f64| {
            view_weight(
                EYE.into(),
                KEYPOINT.into(),
                whole(&[post(-3.0, y)]),
                &OcclusionParameters::default(),
            )
        };
        let steps = (0..400).map(|k| weight(0.001 * f64::from(k)));
        let pairs = steps.clone().zip(steps.skip(1));
        assert!(pairs.clone().all(|(a, b)| b >= a && b - a < 0.05));
    }

    fn point() -> impl Strategy<Value = Vector3<f64>> {
        prop::array::uniform3(-2.0f64..2.0).prop_map(Vector3::from)
    }

    #[test]
    fn from_inside_a_cone_no_body_is_excluded() {
        let (eye, around) = (Vector3::zeros(), Vector3::new(0.0, 1.0, 0.0));
        let all = SightCone::around(&eye, &around, 2.0);
        let behind = post(0.0, -2.0);
        assert!(!behind.may_hide(&eye, &all).is_empty());
        assert!(behind.cone(&eye, 0.0).overlaps(&all) && all.overlaps(&behind.cone(&eye, 0.0)));
    }

    proptest! {
        #[test]
        fn an_occluder_is_never_excluded(
            eye in point(), target in point(), around in point(), x in -3.0f64..3.0, y in -3.0f64..3.0,
        ) {
            let (body, p) = (post(x, y), OcclusionParameters::default());
            let sight = SightCone::around(&eye, &around, (target - around).norm() * (1.0 + 1e-9));
            let near = body.may_hide(&eye, &sight);
            let [of_near, of_all] =
                [near, CapsuleSet::ALL].map(|capsules| view_weight(eye, target, [(&body, capsules)], &p));
            prop_assert_eq!(of_near.to_bits(), of_all.to_bits());
            prop_assert!(!near.is_empty() || of_all >= 1.0);
        }

        #[test]
        fn cones_overlap_by_their_angles(eye in point(), x in 1.0f64..6.0, y in -4.0f64..4.0) {
            let (one, other) = (post(3.0, 0.0), post(x, y));
            let half_rad = |body: &BodyCapsules| {
                let sine = body.reach_m / (body.center_m - eye).norm();
                if sine > 1.0 { std::f64::consts::PI } else { libm::asin(sine) }
            };
            let apart_rad = (one.center_m - eye).angle(&(other.center_m - eye));
            let margin_rad = half_rad(&one) + half_rad(&other) - apart_rad;
            prop_assume!(margin_rad.abs() > 1e-6);
            prop_assert_eq!(one.cone(&eye, 0.0).overlaps(&other.cone(&eye, 0.0)), margin_rad > 0.0);
        }

        #[test]
        fn no_two_points_of_the_segments_are_closer(
            a in point(), b in point(), c in point(), d in point(), s in 0.0f64..=1.0, t in 0.0f64..=1.0,
        ) {
            let (p, q) = closest_between((a, b), (c, d));
            let other = (a.lerp(&b, s) - c.lerp(&d, t)).norm();
            prop_assert!((p - q).norm() <= other + 1e-9);
        }

        #[test]
        fn the_bounding_sphere_changes_no_weight(eye in point(), target in point()) {
            let body = post(0.3, -0.2);
            let unbounded = BodyCapsules { reach_m: f64::INFINITY, ..body.clone() };
            let p = OcclusionParameters::default();
            let [with, without] =
                [&body, &unbounded].map(|body| view_weight(eye, target, [(body, CapsuleSet::ALL)], &p));
            prop_assert!((with - without).abs() < 1e-12);
        }
    }
}
