//! Names that people and programs give keypoints: `left_knee`, `LKnee`, `knee_l`, `Left Knee`.

/// Parts of a body that have two sides.
const PAIRED: [&str; 8] = [
    "eye", "ear", "shoulder", "elbow", "wrist", "hip", "knee", "ankle",
];

/// The name that COCO has for a keypoint called `name`; `None` where it has none.
///
/// Case, spaces, `-`, `_` and `.` do not count; the side is a word or a letter before or behind the part.
pub fn coco_name(name: &str) -> Option<&'static str> {
    // Names are short; what is longer is none.
    const MAX_CHARS: usize = 40;
    let letters = |c: &char| c.is_ascii_alphanumeric();
    if name.chars().count() > MAX_CHARS {
        return None;
    }
    let name: String = name
        .chars()
        .filter(letters)
        .map(|c| c.to_ascii_lowercase())
        .collect();
    if name == "nose" {
        return Some("nose");
    }
    let left = ["left", "l"];
    let right = ["right", "r"];
    PAIRED.iter().enumerate().find_map(|(i, part)| {
        let side = name
            .strip_suffix(part)
            .or_else(|| name.strip_prefix(part))?;
        if left.contains(&side) {
            Some(LEFT[i])
        } else if right.contains(&side) {
            Some(RIGHT[i])
        } else {
            None
        }
    })
}

const LEFT: [&str; 8] = [
    "left_eye",
    "left_ear",
    "left_shoulder",
    "left_elbow",
    "left_wrist",
    "left_hip",
    "left_knee",
    "left_ankle",
];
const RIGHT: [&str; 8] = [
    "right_eye",
    "right_ear",
    "right_shoulder",
    "right_elbow",
    "right_wrist",
    "right_hip",
    "right_knee",
    "right_ankle",
];

#[cfg(test)]
mod tests {
    use farfield_proto::keypoints::COCO17;

    use super::*;

    #[test]
    fn sides_are_words_or_letters_before_or_behind() {
        for name in COCO17 {
            assert_eq!(coco_name(name), Some(name));
        }
        for name in [
            "LKnee",
            "knee_L",
            "Left Knee",
            "left-knee",
            "kneeleft",
            "l.knee",
        ] {
            assert_eq!(coco_name(name), Some("left_knee"), "{name}");
        }
        assert_eq!(coco_name("REar"), Some("right_ear"));
    }

    #[test]
    fn what_is_no_keypoint_of_coco_is_none() {
        for name in [
            "knee",
            "left_eye_inner",
            "MidHip",
            "left_heel",
            "LBigToe",
            "head",
            "",
            "Lléft",
            "left_left_knee",
        ] {
            assert_eq!(coco_name(name), None, "{name}");
        }
    }
}
