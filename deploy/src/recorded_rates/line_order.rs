//! Whether the lines of keypoint files are in the order of their pictures.

use farfield_edge::source::{LeapingFrames, SourceInfo};

/// Keypoint files whose lines show everybody leap.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct LeapingKeypoints {
    /// Whose they are, and how often in each.
    of_camera: Vec<(String, LeapingFrames)>,
}

impl LeapingKeypoints {
    /// What is wrong, with what it does.
    pub(crate) fn problem(&self) -> String {
        let counts = self.of_camera.iter().map(|(camera, found)| {
            let LeapingFrames { leaps, frames } = found;
            format!("camera `{camera}`: at {leaps} of {frames} lines")
        });
        let counts: Vec<String> = counts.collect();
        format!(
            "{} everybody is suddenly elsewhere, and nobody goes on: lines that are not in the order of their pictures (sorted by \
             the names of files: 1, 10, 100, 2), are of two cameras by turns, or show one person at a time, another each time. People \
             who are followed leap, too",
            counts.join(", ")
        )
    }

    /// What mends it.
    pub(crate) const REMEDY: &str =
        "write one line per picture in the order of their numbers, and all people whom it shows";
}

/// The keypoint files whose lines leap, together; `None` where there are none.
pub(crate) fn leaping_keypoints(infos: &[(String, SourceInfo)]) -> Option<LeapingKeypoints> {
    let leaping = |(camera, info): &(String, SourceInfo)| Some((camera.clone(), info.leaps?));
    let of_camera: Vec<_> = infos.iter().filter_map(leaping).collect();
    (!of_camera.is_empty()).then_some(LeapingKeypoints { of_camera })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_whose_lines_leap_are_told_together_with_how_often() {
        let info = |leaps: Option<LeapingFrames>| SourceInfo {
            leaps,
            ..SourceInfo::default()
        };
        let leaping = |leaps: u64| Some(LeapingFrames { leaps, frames: 119 });
        let all = [
            ("c0".to_owned(), info(leaping(19))),
            ("c1".to_owned(), info(None)),
            ("c2".to_owned(), info(leaping(21))),
        ];
        let said = leaping_keypoints(&all).unwrap().problem();
        for words in ["`c0`: at 19 of 119", "`c2`: at 21 of 119", "1, 10, 100, 2"] {
            assert!(said.contains(words), "{words}: {said}");
        }
        assert!(!said.contains("c1"), "{said}");
        assert_eq!(leaping_keypoints(&all[1..2]), None);
    }
}
