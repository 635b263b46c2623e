//! The keypoints of a network. Their number is never a constant of the wire.

/// The 17 COCO keypoints, in COCO's order.
pub const COCO17: [&str; 17] = [
    "nose",
    "left_eye",
    "right_eye",
    "left_ear",
    "right_ear",
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

/// COCO's 17 keypoints and the six of its extension for feet, as in COCO-WholeBody.
pub const COCO23: [&str; 23] = coco17_and([
    "left_big_toe",
    "left_small_toe",
    "left_heel",
    "right_big_toe",
    "right_small_toe",
    "right_heel",
]);

/// Halpe's 26, as of `RTMPose`'s networks with feet. The top of the head and the middle of the
/// shoulders are on no joint of the body.
const HALPE26: [&str; 26] = coco17_and([
    "head_top",
    "mid_shoulder",
    "mid_hip",
    "left_big_toe",
    "right_big_toe",
    "left_small_toe",
    "right_small_toe",
    "left_heel",
    "right_heel",
]);

/// [`COCO17`] and then `more`.
const fn coco17_and<const MORE: usize, const ALL: usize>(
    more: [&'static str; MORE],
) -> [&'static str; ALL] {
    let mut all = [""; ALL];
    let (coco, rest) = all.split_at_mut(COCO17.len());
    coco.copy_from_slice(&COCO17);
    rest.copy_from_slice(&more);
    all
}

/// The names of a network's keypoints, in the order of its maps.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct KeypointSet {
    names: Vec<String>,
}

impl KeypointSet {
    /// The 17 COCO keypoints.
    pub fn coco17() -> Self {
        Self {
            names: COCO17.map(str::to_owned).to_vec(),
        }
    }

    /// The set that files call `name`.
    ///
    /// # Errors
    /// If no set has this name; says which there are.
    pub fn named(name: &str) -> Result<Self, String> {
        let names: &[&str] = match name {
            "coco17" => &COCO17,
            "coco23" => &COCO23,
            "halpe26" => &HALPE26,
            other => {
                return Err(format!(
                    "found \"{other}\", expected \"coco17\", or with feet \"coco23\" or \"halpe26\""
                ));
            }
        };
        Ok(Self {
            names: names.iter().copied().map(str::to_owned).collect(),
        })
    }

    /// A network's own list.
    pub fn new(names: Vec<String>) -> Self {
        Self { names }
    }

    /// The names in map order.
    pub fn names(&self) -> &[String] {
        &self.names
    }

    /// The number of keypoints.
    pub fn len(&self) -> usize {
        self.names.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.names.is_empty()
    }

    /// Index of `name`, if the network has it.
    pub fn index_of(&self, name: &str) -> Option<usize> {
        self.names.iter().position(|n| n == name)
    }

    /// Whether the keypoint comes from the rotated crop if there is one: everything above the hips.
    /// The legs come from the upright crop (paper, below eq. (4)).
    pub fn is_upper(&self, index: usize) -> bool {
        const LOWER: [&str; 6] = ["hip", "knee", "ankle", "heel", "toe", "foot"];
        self.names
            .get(index)
            .is_some_and(|n| !LOWER.iter().any(|part| n.contains(part)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sets_have_their_names() {
        assert_eq!(
            KeypointSet::named("halpe26").unwrap().names()[25],
            "right_heel"
        );
        assert_eq!(KeypointSet::named("coco23").unwrap().names(), COCO23);
        let error = KeypointSet::named("coco18").unwrap_err();
        assert!(
            error.contains("coco18") && error.contains("coco23"),
            "{error}"
        );
    }

    #[test]
    fn eleven_coco_keypoints_come_from_the_rotated_crop() {
        let set = KeypointSet::coco17();
        assert_eq!((0..set.len()).filter(|&i| set.is_upper(i)).count(), 11);
    }
}
