//! Which points of a body are scored, and the limbs between them.

use std::str::FromStr;

use farfield_fusion::body::skeleton::{Joint, N_JOINTS};
use farfield_proto::message::PersonState;
use nalgebra::Vector3;
use serde::Serialize;

/// The set of compared points.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum PointSet {
    /// The 12 limb joints, as anatomical centres (`joints` of a line).
    #[default]
    Joints,
    /// The same 12 as the network defines them (`keypoints` of a line).
    Keypoints,
    /// The 12 keypoints and two head points derived from them, as in the Shelf literature.
    Shelf14,
}

impl FromStr for PointSet {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        match name {
            "joints" => Ok(Self::Joints),
            "keypoints" => Ok(Self::Keypoints),
            "shelf14" => Ok(Self::Shelf14),
            _ => Err(format!("`{name}` is not one of joints, keypoints, shelf14")),
        }
    }
}

/// The points of every set, in the order of [`ScoredBody::points_m`].
pub const LIMB_POINTS: [&str; 12] = [
    "left_shoulder",
    "right_shoulder",
    "left_elbow",
    "right_elbow",
    "left_wrist",
    "right_wrist",
    "left_hip",
    "right_hip",
    "left_knee",
    "right_knee",
    "left_ankle",
    "right_ankle",
];
const LEFT_SHOULDER: usize = 0;
const RIGHT_SHOULDER: usize = 1;
const LEFT_ELBOW: usize = 2;
const RIGHT_ELBOW: usize = 3;
const LEFT_WRIST: usize = 4;
const RIGHT_WRIST: usize = 5;
const LEFT_HIP: usize = 6;
const RIGHT_HIP: usize = 7;
const LEFT_KNEE: usize = 8;
const RIGHT_KNEE: usize = 9;
const LEFT_ANKLE: usize = 10;
const RIGHT_ANKLE: usize = 11;
const HEAD_BOTTOM: usize = 12;
const HEAD_TOP: usize = 13;
/// The head points that a truth may have; they follow [`LIMB_POINTS`] in this order.
pub const HEAD_POINTS: [&str; 2] = ["head_bottom", "head_top"];
/// Number of points in the largest set.
pub const N_POINTS: usize = 14;

/// Heel and toe, left then right, in the order of [`ScoredBody::feet_m`].
pub const FOOT_POINTS: [[&str; 2]; 2] = [["left_heel", "left_toe"], ["right_heel", "right_toe"]];

/// The points at the two ends of a limb; an end of two points is their middle.
type LimbEnds = [&'static [usize]; 2];

const BODY_LIMBS: [LimbEnds; 8] = [
    [&[LEFT_SHOULDER], &[LEFT_ELBOW]],
    [&[RIGHT_SHOULDER], &[RIGHT_ELBOW]],
    [&[LEFT_ELBOW], &[LEFT_WRIST]],
    [&[RIGHT_ELBOW], &[RIGHT_WRIST]],
    [&[LEFT_HIP], &[LEFT_KNEE]],
    [&[RIGHT_HIP], &[RIGHT_KNEE]],
    [&[LEFT_KNEE], &[LEFT_ANKLE]],
    [&[RIGHT_KNEE], &[RIGHT_ANKLE]],
];
const SHELF_LIMBS: [LimbEnds; 2] = [
    [&[HEAD_BOTTOM], &[HEAD_TOP]],
    [&[LEFT_HIP, RIGHT_HIP], &[HEAD_BOTTOM]],
];

impl PointSet {
    /// The compared limbs: 8, or 10 with the head and the torso.
    pub fn limbs(self) -> impl Iterator<Item = ScoredLimb> {
        let extra: &[LimbEnds] = if self == Self::Shelf14 {
            &SHELF_LIMBS
        } else {
            &[]
        };
        BODY_LIMBS
            .iter()
            .chain(extra)
            .map(|&ends| ScoredLimb { ends })
    }
}

/// One limb of a body.
#[derive(Debug, Clone, Copy)]
pub struct ScoredLimb {
    ends: LimbEnds,
}

impl ScoredLimb {
    /// The two ends of the limb on `body`; `None` if one is unknown.
    pub fn on(&self, body: &ScoredBody) -> Option<[Vector3<f64>; 2]> {
        let [a, b] = self.ends.map(|points| {
            let sum = points
                .iter()
                .try_fold(Vector3::zeros(), |sum, &p| Some(sum + body.points_m[p]?));
            sum.map(|sum| sum / points.len() as f64)
        });
        Some([a?, b?])
    }
}

/// The compared data of one person at one tick: world, metres; `None` is unknown.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ScoredBody {
    /// The limb points, then head bottom and head top.
    pub points_m: [Option<Vector3<f64>>; N_POINTS],
    /// `[left, right][heel, toe]`, always from the joints.
    pub feet_m: [[Option<Vector3<f64>>; 2]; 2],
    /// The keypoint sites under the names of [`LIMB_POINTS`], for every point set.
    pub sites_m: [Option<Vector3<f64>>; LIMB_POINTS.len()],
    /// All joints with their uncertainty, if these are compared.
    pub detail: Option<Box<JointDetail>>,
    /// Whether the line was written after confirmation of the person: it was not published live.
    pub is_tentative: bool,
}

impl ScoredBody {
    /// Gathers the points of `set`.
    ///
    /// `point` gives the position under a name in the set's own group of points, `joint` that of an anatomical centre. Head
    /// points come from `point` if it has them (as the Shelf truth does), else from face keypoints and shoulders.
    pub fn gather(
        set: PointSet,
        point: impl Fn(&str) -> Option<Vector3<f64>>,
        joint: impl Fn(&str) -> Option<Vector3<f64>>,
    ) -> Self {
        let mut body = Self::default();
        for (slot, name) in body.points_m.iter_mut().zip(LIMB_POINTS) {
            *slot = point(name);
        }
        if set == PointSet::Shelf14 {
            let derived = shelf_head(&point);
            let [bottom, top] = HEAD_POINTS;
            body.points_m[HEAD_BOTTOM] = point(bottom).or(derived.map(|head| head[0]));
            body.points_m[HEAD_TOP] = point(top).or(derived.map(|head| head[1]));
        }
        body.feet_m = FOOT_POINTS.map(|foot| foot.map(&joint));
        body
    }

    /// Sets the keypoint sites; `keypoint` gives the position under a keypoint's name.
    pub fn set_sites(&mut self, keypoint: impl Fn(&str) -> Option<Vector3<f64>>) {
        self.sites_m = LIMB_POINTS.map(keypoint);
    }

    /// Mean distance over the common points, metres; `None` if there are none.
    pub fn mean_distance_m(&self, other: &Self) -> Option<f64> {
        let pairs = self.points_m.iter().zip(&other.points_m);
        let (sum, n) = pairs
            .filter_map(|(a, b)| Some(((*a)? - (*b)?).norm()))
            .fold((0.0, 0u32), |(sum, n), d| (sum + d, n + 1));
        (n > 0).then(|| sum / f64::from(n))
    }
}

/// Head bottom and head top from shoulders, nose and ears: the conversion of COCO keypoints that evaluations on Shelf share.
///
/// ```text
///   ms = mid shoulders   hc = mid ears (nose if unknown)   hb = (ms + hc)/2
///   bottom = 0.75 (ms + 0.5 (nose - ms)) + 0.25 hb
///   top    = 0.75 (ms + (nose - ms) * (0.75, 0.75, 1.5)) + 0.25 (hb + 2 (hc - hb))   * elementwise
/// ```
fn shelf_head(point: impl Fn(&str) -> Option<Vector3<f64>>) -> Option<[Vector3<f64>; 2]> {
    let ms = (point("left_shoulder")? + point("right_shoulder")?) / 2.0;
    let nose = point("nose")?;
    let ears = point("left_ear").zip(point("right_ear"));
    let hc = ears.map_or(nose, |(left, right)| (left + right) / 2.0);
    let hb = (ms + hc) / 2.0;
    let up = (nose - ms).component_mul(&Vector3::new(0.75, 0.75, 1.5));
    let bottom = 0.75 * (ms + 0.5 * (nose - ms)) + 0.25 * hb;
    let top = 0.75 * (ms + up) + 0.25 * (hb + 2.0 * (hc - hb));
    Some([bottom, top])
}

/// All joints of one line, with their uncertainty; world, metres, NaN where unknown.
#[derive(Debug, Clone, PartialEq)]
pub struct JointDetail {
    /// The 29 joints. (f32 is 0.01 mm within 100 m.)
    pub joints_m: [[f32; 3]; N_JOINTS],
    /// The reported uncertainty; `None` for a truth, and for poses that report none.
    pub sureness: Option<Sureness>,
}

/// The uncertainty that a pose reports.
#[derive(Debug, Clone, PartialEq)]
pub struct Sureness {
    /// Its state.
    pub state: PersonState,
    /// Number of viewpoints with evidence.
    pub views: u16,
    /// One standard deviation per joint and axis, metres; NaN where unknown.
    pub sigma_m: [f32; N_JOINTS],
}

impl JointDetail {
    /// Gathers the joints for which `joint` gives a position.
    pub fn gather(
        joint: impl Fn(&str) -> Option<Vector3<f64>>,
        sureness: Option<Sureness>,
    ) -> Self {
        let unknown = Vector3::repeat(f64::NAN);
        let at = |j: Joint| {
            let at_m = joint(j.name()).unwrap_or(unknown);
            [at_m.x as f32, at_m.y as f32, at_m.z as f32]
        };
        Self {
            joints_m: Joint::ALL.map(at),
            sureness,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn upright(name: &str) -> Option<Vector3<f64>> {
        let [x, y, z] = match name {
            "left_shoulder" => [0.0, 0.2, 1.4],
            "right_shoulder" => [0.0, -0.2, 1.4],
            "nose" => [0.1, 0.0, 1.6],
            "left_ear" => [0.0, 0.1, 1.64],
            "right_ear" => [0.0, -0.1, 1.64],
            _ => return None,
        };
        Some(Vector3::new(x, y, z))
    }

    #[test]
    fn head_points_follow_the_shelf_conversion() {
        // ms = (0, 0, 1.4), hc = (0, 0, 1.64), hb = (0, 0, 1.52), nose - ms = (0.1, 0, 0.2).
        let body = ScoredBody::gather(PointSet::Shelf14, upright, |_| None);
        let bottom = body.points_m[HEAD_BOTTOM].unwrap();
        let top = body.points_m[HEAD_TOP].unwrap();
        assert!((bottom - Vector3::new(0.0375, 0.0, 1.505)).norm() < 1e-12);
        assert!((top - Vector3::new(0.05625, 0.0, 1.715)).norm() < 1e-12);
    }

    #[test]
    fn without_both_ears_the_nose_is_the_head_centre() {
        let body = ScoredBody::gather(
            PointSet::Shelf14,
            |name| upright(name).filter(|_| name != "left_ear"),
            |_| None,
        );
        // hc = nose, hb = (0.05, 0, 1.5).
        let bottom = body.points_m[HEAD_BOTTOM].unwrap();
        assert!((bottom - Vector3::new(0.05, 0.0, 1.5)).norm() < 1e-12);
    }

    #[test]
    fn head_points_of_the_file_replace_derived_ones_on_shelf_only() {
        let given = |name: &str| match name {
            "head_top" => Some(Vector3::new(1.0, 2.0, 3.0)),
            _ => upright(name),
        };
        let body = ScoredBody::gather(PointSet::Shelf14, given, |_| None);
        assert_eq!(body.points_m[HEAD_TOP], Some(Vector3::new(1.0, 2.0, 3.0)));
        let body = ScoredBody::gather(PointSet::Keypoints, given, |_| None);
        assert_eq!(body.points_m[HEAD_TOP], None);
    }

    #[test]
    fn there_are_eight_limbs_and_ten_on_shelf() {
        assert_eq!(PointSet::Joints.limbs().count(), 8);
        assert_eq!(PointSet::Shelf14.limbs().count(), 10);
    }

    #[test]
    fn a_distance_is_over_the_common_points() {
        let mut a = ScoredBody::default();
        let mut b = ScoredBody::default();
        assert_eq!(a.mean_distance_m(&b), None);
        a.points_m[0] = Some(Vector3::new(0.0, 0.0, 0.0));
        b.points_m[0] = Some(Vector3::new(0.0, 0.3, 0.4));
        a.points_m[1] = Some(Vector3::new(9.0, 9.0, 9.0));
        assert!((a.mean_distance_m(&b).unwrap() - 0.5).abs() < 1e-12);
    }
}
