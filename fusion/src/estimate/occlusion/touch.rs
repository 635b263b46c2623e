//! Contacts where two bodies overlap.

use nalgebra::Vector3;

use super::{BodyCapsules, CAPSULES, Capsule, closest_between};
use crate::body::skeleton::{Joint, Joints};

/// Axes closer than this have no direction from one to the other, metres.
const LEAST_APART_M: f64 = 1e-6;

/// Two overlapping capsules of different persons.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Touch {
    /// Displacement from the second to the first that separates them, world, metres.
    pub(crate) apart_m: Vector3<f64>,
    /// Place on the first body.
    pub(crate) first: OnLink,
    /// Place on the second body.
    pub(crate) second: OnLink,
}

/// A place on the axis of a capsule.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct OnLink {
    joints: (Joint, Joint),
    /// 0 at the first joint, 1 at the second.
    along: f64,
}

impl OnLink {
    /// The values of the two joints, weighted by their nearness.
    pub(crate) fn weighed(&self, value: impl Fn(Joint) -> f64) -> f64 {
        (1.0 - self.along) * value(self.joints.0) + self.along * value(self.joints.1)
    }

    /// Moves the place by `move_m` with the least motion of the two joints; of several moves, a
    /// joint keeps the longest.
    pub(crate) fn push(&self, move_m: Vector3<f64>, joints_m: &mut Joints) {
        let shares = [1.0 - self.along, self.along];
        let norm2 = shares[0] * shares[0] + shares[1] * shares[1];
        for (joint, share) in [self.joints.0, self.joints.1].into_iter().zip(shares) {
            let moved_m = move_m * (share / norm2);
            let known_m = &mut joints_m[joint.index()];
            if moved_m.norm_squared() > known_m.norm_squared() {
                *known_m = moved_m;
            }
        }
    }
}

impl BodyCapsules {
    /// The overlaps of two bodies, with capsules of `share` of their thickness. `before` are the
    /// predictions of the two: they determine on which side of each other limbs belong.
    pub(crate) fn touches<'a>(
        (first, second): (&'a Self, &'a Self),
        before: (&'a Self, &'a Self),
        share: f64,
    ) -> impl Iterator<Item = Touch> + 'a {
        let near = (first.center_m - second.center_m).norm() <= first.reach_m + second.reach_m;
        let pairs = (0..CAPSULES.len()).flat_map(|a| (0..CAPSULES.len()).map(move |b| (a, b)));
        pairs.filter(move |_| near).filter_map(move |(a, b)| {
            let now = (&first.capsules[a], &second.capsules[b]);
            let thick_m = thickness_m(now, share);
            if are_far(now, thick_m) {
                return None;
            }
            let (apart_m, along) = between(now);
            if apart_m.norm() >= thick_m {
                return None;
            }
            let (side, _) = between((&before.0.capsules[a], &before.1.capsules[b]));
            // A limb that has changed sides must also go back through the other.
            let changed = apart_m.dot(&side) < 0.0 && side.norm() > apart_m.norm();
            let (direction, deep_m) = if changed {
                (-apart_m, thick_m + apart_m.norm())
            } else {
                (apart_m, thick_m - apart_m.norm())
            };
            let direction = direction.try_normalize(LEAST_APART_M)?;
            let on_link = |capsule: usize, along| OnLink {
                joints: (CAPSULES[capsule].0, CAPSULES[capsule].1),
                along,
            };
            Some(Touch {
                apart_m: direction * deep_m,
                first: on_link(a, along.0),
                second: on_link(b, along.1),
            })
        })
    }
}

fn thickness_m((a, b): (&Capsule, &Capsule), share: f64) -> f64 {
    share * (a.radius_m + b.radius_m)
}

/// Whether the axes are farther apart than `thick_m`, by their middles; false is not certain.
fn are_far((a, b): (&Capsule, &Capsule), thick_m: f64) -> bool {
    // From the middles to the ends of the axes, and some centimetres more.
    let reach_m = (a.reach_m - a.radius_m) + (b.reach_m - b.radius_m);
    (a.middle_m - b.middle_m).norm_squared() > (thick_m + reach_m).powi(2)
}

/// From the second axis to the first at their closest points, and the position on each.
fn between((a, b): (&Capsule, &Capsule)) -> (Vector3<f64>, (f64, f64)) {
    let (on_a, on_b) = closest_between(a.axis, b.axis);
    let along = |(from, to): (Vector3<f64>, Vector3<f64>), at: Vector3<f64>| {
        let d = to - from;
        let length2 = d.norm_squared();
        if length2 > 0.0 {
            ((at - from).dot(&d) / length2).clamp(0.0, 1.0)
        } else {
            0.0
        }
    };
    (on_a - on_b, (along(a.axis, on_a), along(b.axis, on_b)))
}

#[cfg(test)]
mod tests {
    use farfield_proto::venue::parameters::OcclusionParameters;
    use proptest::prelude::*;

    use super::*;
    use crate::body::skeleton::N_JOINTS;

    /// Thickness of two limbs of default radius at full share.
    const THICK_M: f64 = 0.14;

    /// A body far below the floor except for its left forearm.
    fn forearm(elbow_m: Vector3<f64>, wrist_m: Vector3<f64>, index: f64) -> BodyCapsules {
        let mut joints = [Vector3::new(50.0 * index, 0.0, -50.0); N_JOINTS];
        joints[Joint::LeftElbow.index()] = elbow_m;
        joints[Joint::LeftWrist.index()] = wrist_m;
        // Far from the forearm, so that no other link touches anything.
        joints[Joint::LeftShoulder.index()] = elbow_m;
        joints[Joint::LeftHand.index()] = wrist_m;
        joints[Joint::RightShoulder.index()] = elbow_m;
        BodyCapsules::from_joints(&joints, &OcclusionParameters::default())
    }

    fn along_x(y: f64, z: f64) -> BodyCapsules {
        forearm(Vector3::new(-0.15, y, z), Vector3::new(0.15, y, z), 0.0)
    }

    fn along_y(z: f64) -> BodyCapsules {
        forearm(Vector3::new(0.0, -0.15, z), Vector3::new(0.0, 0.15, z), 1.0)
    }

    fn deepest(
        now: (&BodyCapsules, &BodyCapsules),
        before: (&BodyCapsules, &BodyCapsules),
    ) -> Option<Touch> {
        let touches = BodyCapsules::touches(now, before, 1.0);
        touches.max_by(|a, b| a.apart_m.norm().total_cmp(&b.apart_m.norm()))
    }

    #[test]
    fn limbs_apart_do_not_touch() {
        let pair = (&along_x(0.0, 1.0 + THICK_M + 0.01), &along_y(1.0));
        assert!(deepest(pair, pair).is_none());
    }

    #[test]
    fn the_displacement_restores_the_thickness() {
        let pair = (&along_x(0.0, 1.05), &along_y(1.0));
        let touch = deepest(pair, pair).unwrap();
        assert!((touch.apart_m - Vector3::z() * (THICK_M - 0.05)).norm() < 1e-9);
    }

    #[test]
    fn a_limb_that_passed_another_goes_back() {
        let (above, lower, below) = (along_x(0.0, 1.1), along_y(1.0), along_x(0.0, 0.95));
        let touch = deepest((&below, &lower), (&above, &lower)).unwrap();
        assert!((touch.apart_m - Vector3::z() * (THICK_M + 0.05)).norm() < 1e-9);
    }

    fn point() -> impl Strategy<Value = Vector3<f64>> {
        prop::array::uniform3(-0.3f64..0.3).prop_map(Vector3::from)
    }

    proptest! {
        /// The displacement of the second is the opposite of that of the first.
        #[test]
        fn a_touch_is_symmetric(a in point(), b in point(), c in point(), d in point()) {
            let (first, second) = (forearm(a, b, 0.0), forearm(c, d, 1.0));
            let there = deepest((&first, &second), (&first, &second));
            let back = deepest((&second, &first), (&second, &first));
            prop_assert_eq!(there.is_some(), back.is_some());
            if let (Some(there), Some(back)) = (there, back) {
                prop_assert!((there.apart_m.norm() - back.apart_m.norm()).abs() < 1e-9);
            }
        }

        /// A decision from the middles alone is correct.
        #[test]
        fn limbs_that_are_far_apart_do_not_touch(
            a in point(), b in point(), c in point(), d in point(), thick_m in 0.0f64..0.3,
        ) {
            let capsules = (&Capsule::between((a, b), 0.07), &Capsule::between((c, d), 0.07));
            prop_assert!(!are_far(capsules, thick_m) || between(capsules).0.norm() > thick_m);
        }

        /// A push moves the place of the contact by the given displacement.
        #[test]
        fn a_push_moves_its_place(along in 0.0f64..=1.0, move_m in point()) {
            let place = OnLink { joints: (Joint::LeftElbow, Joint::LeftWrist), along };
            let mut joints = [Vector3::zeros(); N_JOINTS];
            place.push(move_m, &mut joints);
            let moved_m = joints[Joint::LeftElbow.index()] * (1.0 - along)
                + joints[Joint::LeftWrist.index()] * along;
            prop_assert!((moved_m - move_m).norm() < 1e-9);
        }
    }
}
