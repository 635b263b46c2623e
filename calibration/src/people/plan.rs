//! Indices of the keypoints of a body, and lengths of limbs as shares of the stature: Drillis and Contini 1966 (as in
//! Winter 2009, figure 4.1).

use farfield_proto::keypoints::KeypointSet;

/// Usual noise of a keypoint on a body, metres.
pub(super) const KEYPOINT_M: f64 = 0.025;
/// Usual noise of a keypoint in the picture, pixels.
pub(super) const KEYPOINT_PX: f64 = 1.0;

/// Heights of standing people's joints, shares of the stature.
pub(super) const ANKLE_HEIGHT: f64 = 0.039;
const HIP_HEIGHT: f64 = 0.530;
const SHOULDER_HEIGHT: f64 = 0.818;
/// Upright distances from ankle to hip and to shoulder.
pub(super) const LEG: f64 = HIP_HEIGHT - ANKLE_HEIGHT;
pub(super) const ANKLE_TO_SHOULDER: f64 = SHOULDER_HEIGHT - ANKLE_HEIGHT;
/// Stature of adults if none is given, metres. Only rough starts depend on it.
pub(super) const USUAL_STATURE_M: f64 = 1.70;

/// Indices of keypoints, left and right.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct BodyPlan {
    pub(super) shoulders: [usize; 2],
    pub(super) hips: [usize; 2],
    pub(super) knees: Option<[usize; 2]>,
    pub(super) ankles: [usize; 2],
    pub(super) count: usize,
}

impl BodyPlan {
    /// The error is the first missing keypoint among shoulders, hips and ankles.
    pub(super) fn new(set: &KeypointSet) -> Result<Self, String> {
        let both = |part: &str| {
            let index = |side: &str| {
                let name = format!("{side}_{part}");
                set.index_of(&name).ok_or(name)
            };
            Ok::<[usize; 2], String>([index("left")?, index("right")?])
        };
        Ok(Self {
            shoulders: both("shoulder")?,
            hips: both("hip")?,
            knees: both("knee").ok(),
            ankles: both("ankle")?,
            count: set.len(),
        })
    }
}

/// Per keypoint, the index of the one on the other side; itself if it is in the middle.
pub(super) fn other_sides(set: &KeypointSet) -> Vec<usize> {
    let names = set.names().iter().enumerate();
    let each = names.map(|(index, name)| {
        let other = name
            .strip_prefix("left_")
            .map(|part| format!("right_{part}"))
            .or_else(|| {
                let part = name.strip_prefix("right_")?;
                Some(format!("left_{part}"))
            });
        other.and_then(|it| set.index_of(&it)).unwrap_or(index)
    });
    each.collect()
}
