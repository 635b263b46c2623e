//! Which keypoint is which, and how long limbs are: shares of the stature of Drillis and Contini 1966 (as in Winter 2009,
//! figure 4.1).

use farfield_proto::keypoints::KeypointSet;

/// Usual noise of a keypoint on a body, metres, and in the picture, pixels.
pub(super) const KEYPOINT_M: f64 = 0.025;
pub(super) const KEYPOINT_PX: f64 = 1.0;

/// Heights of standing people's joints, shares of the stature.
pub(super) const ANKLE_HEIGHT: f64 = 0.039;
const HIP_HEIGHT: f64 = 0.530;
const SHOULDER_HEIGHT: f64 = 0.818;
/// From ankle to hip and to shoulder, upright.
pub(super) const LEG: f64 = HIP_HEIGHT - ANKLE_HEIGHT;
pub(super) const ANKLE_TO_SHOULDER: f64 = SHOULDER_HEIGHT - ANKLE_HEIGHT;
/// Stature of adults where none is given, metres. Only rough starts depend on it.
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
    /// `None`, with what is missing, where the network does not know shoulders, hips or ankles.
    pub(super) fn of(set: &KeypointSet) -> Result<Self, String> {
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

/// Per keypoint the one of the other side; itself in the middle.
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
