//! Mirrors in a scene. A camera sees the people in front of a mirror a second time, with left and
//! right exchanged, as far behind the glass as they stand in front of it.
//!
//! A mirror is flat and upright, and has a back. It reflects to the left of the direction from
//! `from_m` to `to_m`, and hides what is behind it on either side. Reflections of reflections and
//! of posters are not simulated.

use farfield_fusion::body::skeleton::Joint;
use farfield_fusion::body::skeleton::Joints;
use nalgebra::{Vector2, Vector3};

use super::file::MirrorEntry;
use super::truth::{N_SITES, PersonTruth};

/// A mirror.
#[derive(Debug, Clone, PartialEq)]
pub struct Mirror {
    from_m: Vector3<f64>,
    /// Unit vector from one corner to the other.
    along: Vector3<f64>,
    /// Unit normal of the reflecting side.
    outward: Vector3<f64>,
    width_m: f64,
    height_m: f64,
}

impl Mirror {
    pub(super) fn new(entry: &MirrorEntry) -> Self {
        let [from_m, to_m] = [entry.from_m, entry.to_m].map(Vector2::from);
        let along = (to_m - from_m).normalize();
        Self {
            from_m: Vector3::new(from_m.x, from_m.y, 0.0),
            along: Vector3::new(along.x, along.y, 0.0),
            outward: Vector3::new(-along.y, along.x, 0.0),
            width_m: (to_m - from_m).norm(),
            height_m: entry.height_m,
        }
    }

    /// Whether a point (world, metres) is on the reflecting side.
    pub fn is_before(&self, point_m: &Vector3<f64>) -> bool {
        self.height_above_m(point_m) > 0.0
    }

    /// The reflection of a point (world, metres).
    pub fn reflected(&self, point_m: &Vector3<f64>) -> Vector3<f64> {
        point_m - self.outward * (2.0 * self.height_above_m(point_m))
    }

    /// The reflection of a person: a true left side looks like a right side.
    pub fn reflected_person(&self, truth: &PersonTruth) -> PersonTruth {
        let joints_m: Joints = Joint::ALL.map(|joint| {
            let other = truth.joint_m(other_side(joint));
            self.reflected(&other)
        });
        let site = |site: usize| self.reflected(&truth.sites_m[other_site(site)]);
        PersonTruth {
            joints_m,
            sites_m: std::array::from_fn::<_, N_SITES, _>(site),
        }
    }

    /// Whether the line between two points (world, metres) passes through the mirror.
    pub fn is_between(&self, a_m: &Vector3<f64>, b_m: &Vector3<f64>) -> bool {
        let (a, b) = (self.height_above_m(a_m), self.height_above_m(b_m));
        if (a > 0.0) == (b > 0.0) {
            return false;
        }
        let meets_m = a_m + (b_m - a_m) * (a / (a - b)) - self.from_m;
        (0.0..=self.width_m).contains(&meets_m.dot(&self.along))
            && (0.0..=self.height_m).contains(&meets_m.z)
    }

    /// Distance from its plane, positive in front of it.
    fn height_above_m(&self, point_m: &Vector3<f64>) -> f64 {
        (point_m - self.from_m).dot(&self.outward)
    }
}

/// The same joint of the other side of the body; a central joint is unchanged.
fn other_side(joint: Joint) -> Joint {
    let name = joint.name();
    let other = match (name.strip_prefix("left_"), name.strip_prefix("right_")) {
        (Some(rest), _) => format!("right_{rest}"),
        (_, Some(rest)) => format!("left_{rest}"),
        (None, None) => return joint,
    };
    Joint::from_name(&other).unwrap_or(joint)
}

/// As [`other_side`], for COCO's keypoints: the nose, then pairs.
fn other_site(site: usize) -> usize {
    match site {
        0 => 0,
        site => ((site - 1) ^ 1) + 1,
    }
}

#[cfg(test)]
mod tests {
    use super::super::truth::{DefinitionOffsets, SITE_JOINTS};
    use super::*;

    /// A mirror on the x axis that reflects towards +y.
    fn mirror() -> Mirror {
        Mirror::new(&MirrorEntry {
            from_m: [-1.0, 0.0],
            to_m: [1.0, 0.0],
            height_m: 2.0,
        })
    }

    #[test]
    fn a_reflected_point_has_the_same_distance_from_the_glass() {
        let seen_m = mirror().reflected(&Vector3::new(0.3, 1.5, 0.7));
        assert!((seen_m - Vector3::new(0.3, -1.5, 0.7)).norm() < 1e-12);
        assert!(mirror().is_before(&Vector3::new(5.0, 0.1, 0.0)));
        assert!(!mirror().is_before(&seen_m));
    }

    #[test]
    fn only_lines_through_the_glass_meet_the_mirror() {
        let eye_m = Vector3::new(0.0, 4.0, 1.0);
        let meets = |x: f64, y: f64, z: f64| mirror().is_between(&eye_m, &Vector3::new(x, y, z));
        assert!(meets(0.0, -4.0, 1.0) && meets(1.9, -4.0, 1.0) && !meets(2.1, -4.0, 1.0));
        assert!(!meets(0.0, 1.0, 1.0), "it does not come so far");
        assert!(!meets(0.0, -4.0, 3.5), "it goes over it");
    }

    #[test]
    fn a_left_hand_looks_like_a_right_one() {
        let mut joints_m = [Vector3::zeros(); Joint::ALL.len()];
        for (i, joint) in joints_m.iter_mut().enumerate() {
            *joint = Vector3::new(0.1 * i as f64, 1.0 + 0.01 * i as f64, 1.0);
        }
        let truth = PersonTruth::new(&joints_m, &DefinitionOffsets::draw(1, 0), 0.0);
        let seen = mirror().reflected_person(&truth);
        let expected_m = mirror().reflected(&truth.joint_m(Joint::LeftWrist));
        assert!((seen.joint_m(Joint::RightWrist) - expected_m).norm() < 1e-12);
        let nose_m = mirror().reflected(&truth.joint_m(Joint::Nose));
        assert!((seen.joint_m(Joint::Nose) - nose_m).norm() < 1e-12);
        for (site, joint) in SITE_JOINTS.into_iter().enumerate() {
            assert!((seen.sites_m[site] - seen.joint_m(joint)).norm() < 1e-12);
        }
        // Two reflections give the original.
        let back = mirror().reflected_person(&seen);
        for (a, b) in back.joints_m.iter().zip(&truth.joints_m) {
            assert!((a - b).norm() < 1e-12);
        }
    }
}
