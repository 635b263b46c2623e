//! The lengths of a body between keypoints, and the stature that they give.

use farfield_proto::order_statistics::weighted_median;
use nalgebra::Vector3;

use super::observed::ObservedJoints;
use crate::body::skeleton::Joint;

/// An end of a length: the middle between two joints (the same joint twice for a single one).
type SegmentEnd = [Joint; 2];

const MID_SHOULDERS: SegmentEnd = [Joint::LeftShoulder, Joint::RightShoulder];
const MID_HIPS: SegmentEnd = [Joint::LeftHip, Joint::RightHip];
const MID_EARS: SegmentEnd = [Joint::LeftEar, Joint::RightEar];
const MID_EYES: SegmentEnd = [Joint::LeftEye, Joint::RightEye];

/// A length that is constant over a person's life, or nearly so.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Segment {
    UpperArm,
    Forearm,
    Thigh,
    Shank,
    ShoulderWidth,
    HipWidth,
    /// From the middle of the hips to the middle of the shoulders.
    Trunk,
    /// From the middle of the shoulders to the middle of the ears.
    HeadHeight,
    EarWidth,
    EyeWidth,
    /// From the middle of the ears to the middle of the eyes.
    EyeForward,
    /// From the middle of the ears to the nose.
    NoseForward,
}

impl Segment {
    /// Segments that give a stature, and that reveal a body from rays of several people. Faces are
    /// too small for both.
    pub(crate) const BODY: [Self; 7] = [
        Self::UpperArm,
        Self::Forearm,
        Self::Thigh,
        Self::Shank,
        Self::ShoulderWidth,
        Self::HipWidth,
        Self::Trunk,
    ];

    /// Length in statures: the table of the 29 joints (Drillis and Contini, as in Winter's tables).
    pub(crate) fn ratio(self) -> f64 {
        match self {
            Self::UpperArm => 0.172,
            Self::Forearm => 0.157,
            Self::Thigh => 0.245,
            Self::Shank => 0.246,
            Self::ShoulderWidth => 0.22,
            Self::HipWidth => 0.10,
            Self::Trunk => 0.27,
            Self::HeadHeight => 0.12,
            Self::EarWidth => 0.084,
            Self::EyeWidth => 0.038,
            Self::EyeForward => 0.0522,
            Self::NoseForward => 0.06,
        }
    }

    /// Weight of the segment in a stature. Long bones are best; a trunk bends, and hip keypoints of
    /// networks are off the joint centres by as much as the hips are wide.
    fn trust(self) -> f64 {
        match self {
            Self::Thigh | Self::Shank => 1.0,
            Self::UpperArm | Self::Forearm => 0.8,
            Self::ShoulderWidth | Self::Trunk => 0.5,
            _ => 0.1,
        }
    }

    /// Spread of the segment among people of one stature, including differences between networks:
    /// one sigma, as a share of the length.
    pub(crate) fn spread(self) -> f64 {
        match self {
            Self::UpperArm | Self::Forearm | Self::Thigh | Self::Shank => 0.08,
            Self::ShoulderWidth | Self::Trunk => 0.10,
            Self::HipWidth => 0.07,
            _ => 0.20,
        }
    }

    /// Where it is measured: one pair of ends for each side that has it.
    fn ends(self) -> Vec<[SegmentEnd; 2]> {
        use Joint as J;
        let bone = |near, far| [[near, near], [far, far]];
        match self {
            Self::UpperArm => vec![
                bone(J::LeftShoulder, J::LeftElbow),
                bone(J::RightShoulder, J::RightElbow),
            ],
            Self::Forearm => vec![
                bone(J::LeftElbow, J::LeftWrist),
                bone(J::RightElbow, J::RightWrist),
            ],
            Self::Thigh => vec![
                bone(J::LeftHip, J::LeftKnee),
                bone(J::RightHip, J::RightKnee),
            ],
            Self::Shank => vec![
                bone(J::LeftKnee, J::LeftAnkle),
                bone(J::RightKnee, J::RightAnkle),
            ],
            Self::ShoulderWidth => vec![bone(J::LeftShoulder, J::RightShoulder)],
            Self::HipWidth => vec![bone(J::LeftHip, J::RightHip)],
            Self::Trunk => vec![[MID_HIPS, MID_SHOULDERS]],
            Self::HeadHeight => vec![[MID_SHOULDERS, MID_EARS]],
            Self::EarWidth => vec![bone(J::LeftEar, J::RightEar)],
            Self::EyeWidth => vec![bone(J::LeftEye, J::RightEye)],
            Self::EyeForward => vec![[MID_EARS, MID_EYES]],
            Self::NoseForward => vec![[MID_EARS, [J::Nose, J::Nose]]],
        }
    }

    /// Its lengths in `body`, metres, each with the least weight of its points; up to two for
    /// paired bones.
    pub(crate) fn lengths_m(self, body: &ObservedJoints) -> impl Iterator<Item = (f64, f64)> {
        self.ends().into_iter().filter_map(|[near, far]| {
            let weights = near
                .iter()
                .chain(&far)
                .map(|&joint| Some(body.point(joint)?.weight));
            let least = weights.reduce(|a, b| Some(a?.min(b?))).flatten()?;
            Some(((body.middle_m(near)? - body.middle_m(far)?).norm(), least))
        })
    }
}

/// The stature that most of the segments agree on, metres: the weighted median of length over
/// ratio. `None` if no segment is known.
pub(crate) fn stature_m<'a>(ticks: impl IntoIterator<Item = &'a ObservedJoints>) -> Option<f64> {
    let mut votes = Vec::new();
    for body in ticks {
        for segment in Segment::BODY {
            let lengths = segment.lengths_m(body);
            votes.extend(lengths.map(|(l, w)| (l / segment.ratio(), w * segment.trust())));
        }
    }
    weighted_median(votes)
}
/// Least upward component of the trunk's direction for this test: a person who crawls or leans over
/// with the head raised has the nose behind.
const UPRIGHT: f64 = 0.75;

/// How far the nose is ahead of the shoulders, -1 to 1; `None` if the person is not upright. World,
/// metres; left before right.
///
/// ```text
///   f = u x (r - l)                  u: from the middle of the hips to that of the shoulders l and r
///   cos(n - (l + r)/2, f)            n: the nose; f points ahead if left and right are correct
/// ```
pub(crate) fn nose_ahead(
    nose_m: Vector3<f64>,
    [left_m, right_m]: [Vector3<f64>; 2],
    hips_m: [Vector3<f64>; 2],
) -> Option<f64> {
    let shoulders_m = 0.5 * (left_m + right_m);
    let up = shoulders_m - 0.5 * (hips_m[0] + hips_m[1]);
    let ahead = up.cross(&(right_m - left_m));
    let to_nose_m = nose_m - shoulders_m;
    let part = to_nose_m.dot(&ahead) / (to_nose_m.norm() * ahead.norm());
    (up.z >= UPRIGHT * up.norm() && part.is_finite()).then_some(part)
}
