//! Whether triangulated keypoints can be one human body.
//!
//! A false body is made of rays of different people: its arms may be as long as its legs, or it may
//! be as tall as a house. Proportions decide, postures do not: people lie, crouch and stand on
//! their hands.

use crate::body::observed::ObservedJoints;
use crate::body::segment::{Segment, stature_m};
use crate::body::skeleton::Joint;

/// Statures of people, metres, from small children to the tallest, with the error of keypoints.
pub(super) const STATURES_M: std::ops::RangeInclusive<f64> = 0.95..=2.4;

/// Limits of a segment's length relative to that of the stature, as factors. Networks put shoulders
/// and hips up to 50 mm off the joints, and two views alone measure lengths to a tenth.
const SEGMENT_FACTORS: std::ops::RangeInclusive<f64> = 0.5..=1.6;

/// The same for the width of the hips, which are 0.18 m apart and 50 mm off.
const HIP_FACTORS: std::ops::RangeInclusive<f64> = 0.3..=2.4;

/// Largest share of wrong segments: with more it is a false body, not one with a badly seen limb.
const MAX_WRONG: f64 = 0.25;

/// Least segments that make a body.
const MIN_SEGMENTS: usize = 3;

/// Largest distance of two points of a body, in statures: a raised hand and the other side's foot.
const MAX_EXTENT: f64 = 1.45;

const ARMS: [[Joint; 3]; 2] = [
    [Joint::LeftShoulder, Joint::LeftElbow, Joint::LeftWrist],
    [Joint::RightShoulder, Joint::RightElbow, Joint::RightWrist],
];

const LEGS: [[Joint; 3]; 2] = [
    [Joint::LeftHip, Joint::LeftKnee, Joint::LeftAnkle],
    [Joint::RightHip, Joint::RightKnee, Joint::RightAnkle],
];

/// Checks `body`, and removes the ends of limbs of an impossible length.
///
/// Returns whether the rest is a body: both shoulders or both hips, a human stature, and
/// proportions that fit it.
pub(crate) fn is_plausible(body: &mut ObservedJoints) -> bool {
    let Some(stature) = stature_m([&*body]) else {
        return false;
    };
    if !STATURES_M.contains(&stature) {
        return false;
    }
    let (mut known, mut wrong) = (0_usize, 0_usize);
    for segment in Segment::BODY {
        let allowed = if segment == Segment::HipWidth {
            HIP_FACTORS
        } else {
            SEGMENT_FACTORS
        };
        for (length, _) in segment.lengths_m(body) {
            known += 1;
            wrong += usize::from(!allowed.contains(&(length / (segment.ratio() * stature))));
        }
    }
    if known < MIN_SEGMENTS || wrong as f64 > MAX_WRONG * known as f64 {
        return false;
    }
    cut_impossible_limbs(body, stature);
    let whole_trunk = [
        [Joint::LeftShoulder, Joint::RightShoulder],
        [Joint::LeftHip, Joint::RightHip],
    ]
    .iter()
    .any(|pair| pair.iter().all(|&joint| body.point(joint).is_some()));
    whole_trunk && extent_m(body) <= MAX_EXTENT * stature
}

/// Removes the far end of every bone of an impossible length, from the trunk outwards, and the
/// joints beyond it.
fn cut_impossible_limbs(body: &mut ObservedJoints, stature: f64) {
    for (upper, lower, limbs) in [
        (Segment::UpperArm, Segment::Forearm, ARMS),
        (Segment::Thigh, Segment::Shank, LEGS),
    ] {
        for [root, middle, end] in limbs {
            if is_impossible(body, upper, [root, middle], stature) {
                body.remove(middle);
                body.remove(end);
            }
            if is_impossible(body, lower, [middle, end], stature) {
                body.remove(end);
            }
        }
    }
}

fn is_impossible(
    body: &ObservedJoints,
    segment: Segment,
    [near, far]: [Joint; 2],
    stature: f64,
) -> bool {
    let ends = body.position_m(near).zip(body.position_m(far));
    ends.is_some_and(|(near, far)| {
        !SEGMENT_FACTORS.contains(&((near - far).norm() / (segment.ratio() * stature)))
    })
}

/// Largest distance between two points, metres.
fn extent_m(body: &ObservedJoints) -> f64 {
    let points: Vec<_> = body.iter().map(|(_, point)| point.position_m).collect();
    let pairs = points
        .iter()
        .enumerate()
        .flat_map(|(i, a)| points[i + 1..].iter().map(move |b| (a - b).norm()));
    pairs.fold(0.0, f64::max)
}
