//! Detects the scale of scores; ours go up to 1.
//!
//! Each camera has its own scale, since cameras may come from several programs. The scale depends
//! on most scores, never on a single one.

use farfield_calibration::formats::{Remark, RemarkKind};
use farfield_proto::order_statistics::reached_by;

use super::CameraFrames;

/// The scale is the score that this share of all scores reach; higher scores are clamped to 1.
/// Networks whose scores are not probabilities give 0.8 to 1.3, two percent of them more, and
/// rarely one near 10.
const DECIDING_SHARE: f64 = 0.05;
/// Scores up to this value are not reported: `OpenPose` overshoots by a few percent.
const OVERSHOOT: f64 = 1.25;
/// A deciding score up to this value is on the usual scale, 0 to 1: `RTMPose` gives up to 1.3.
const MOST_USUAL: f64 = 1.5;
/// Deciding scores from the first to the second value are percent, those up to the third are bytes.
const PERCENT_AND_BYTES: [f64; 3] = [20.0, 105.0, 256.0];

/// The divisor of scores; results are clamped to 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ScoreScale(f64);

impl ScoreScale {
    /// Returns the scale of each camera and reports unusual scales. All cameras off the usual scale
    /// share one scale.
    pub(super) fn per_camera(cameras: &[CameraFrames], remarks: &mut Vec<Remark>) -> Vec<Self> {
        let is_usual = |it: &CameraFrames| {
            reached_by(scores(it), DECIDING_SHARE).is_none_or(|score| score <= MOST_USUAL)
        };
        let usual: Vec<bool> = cameras.iter().map(is_usual).collect();
        let group = |of_usual: bool| {
            let both = cameras.iter().zip(&usual);
            both.filter(move |(_, is_usual)| **is_usual == of_usual)
                .map(|(camera, _)| camera)
        };
        let decides = reached_by(group(false).flat_map(scores), DECIDING_SHARE);
        let (other, kind, what) =
            decides.map_or((1.0, RemarkKind::Assumed, String::new()), meaning);
        if let Some(score) = decides {
            let share = 100.0 * DECIDING_SHARE;
            let text = format!("{share:.0} in a hundred scores reach {score:.2}: {what}");
            if usual.contains(&true) {
                let of_camera = |it: &CameraFrames| {
                    let text = format!("{text}; other cameras have scores up to 1");
                    Remark::of_camera(kind, &it.name, text)
                };
                remarks.extend(group(false).map(of_camera));
            } else {
                remarks.push(Remark::of_all(kind, text));
            }
        }
        let above = group(true)
            .flat_map(scores)
            .filter(|score| *score > OVERSHOOT);
        let (count, largest) = above.fold((0usize, 0.0), |(count, largest), score| {
            (count + 1, score.max(largest))
        });
        if count > 0 {
            let text = format!(
                "{count} scores are above {OVERSHOOT}, the largest {largest:?}: they were clamped to 1"
            );
            remarks.push(Remark::of_all(RemarkKind::Assumed, text));
        }
        let by = usual
            .iter()
            .map(|is_usual| if *is_usual { 1.0 } else { other });
        by.map(Self).collect()
    }

    /// Converts a score of the file to our scale.
    pub fn applied(self, score: f64) -> f64 {
        (score / self.0).clamp(0.0, 1.0)
    }
}

fn scores(camera: &CameraFrames) -> impl Iterator<Item = f64> {
    let keypoints = camera.frames.values().flatten().flatten().flatten();
    keypoints.map(|it| it.score)
}

/// The divisor for scores that go up to `score`, and the remark.
fn meaning(score: f64) -> (f64, RemarkKind, String) {
    let [percent, bytes, most] = PERCENT_AND_BYTES;
    let (by, word) = if (percent..bytes).contains(&score) {
        (100.0, "percent")
    } else if (bytes..most).contains(&score) {
        (255.0, "numbers up to 255")
    } else {
        let text = "the scale is unknown, so they were divided by that value; confidence may differ from what the network \
                    meant";
        return (score, RemarkKind::Doubtful, text.to_owned());
    };
    (by, RemarkKind::Assumed, format!("they were read as {word}"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::person::Candidate;
    use farfield_proto::keypoints::COCO23;

    fn camera(name: &str, scores: &[f64]) -> CameraFrames {
        let person = |score: &f64| {
            let mut person = [None; COCO23.len()];
            person[0] = Some(Candidate {
                x_px: 1.0,
                y_px: 1.0,
                score: *score,
            });
            person
        };
        CameraFrames {
            name: name.to_owned(),
            size_px: [2, 2],
            down: [0.0, 1.0],
            source: name.to_owned(),
            frames: [(0, scores.iter().map(person).collect())].into(),
        }
    }

    /// The scale of one camera's scores, and the text of the remarks.
    fn scale(scores: &[f64]) -> (ScoreScale, String) {
        let mut remarks = Vec::new();
        let scales = ScoreScale::per_camera(&[camera("a", scores)], &mut remarks);
        let texts: Vec<String> = remarks.into_iter().map(|it| it.text).collect();
        (scales[0], texts.join("; "))
    }

    /// 200 scores from 0.70 to 0.95.
    fn usual() -> Vec<f64> {
        (0..200).map(|i| 0.70 + 0.05 * f64::from(i % 6)).collect()
    }

    #[test]
    fn probabilities_are_kept_and_a_small_overshoot_is_clamped() {
        let (scale, remarked) = scale(&[0.5, 1.05]);
        assert_eq!(remarked, "");
        assert!(scale.applied(0.5).to_bits() == 0.5f64.to_bits());
        assert!(scale.applied(1.05).to_bits() == 1.0f64.to_bits());
    }

    #[test]
    fn percent_byte_and_unknown_scales_are_divided_and_reported() {
        for (by, word) in [
            (100.0, "percent"),
            (255.0, "up to 255"),
            (8.0, "unknown"),
            (1000.0, "unknown"),
        ] {
            let scores: Vec<f64> = usual().iter().map(|it| it * by).collect();
            let (divided, remarked) = scale(&scores);
            assert!(remarked.contains(word), "{by}: {remarked}");
            let middle = divided.applied(0.8 * by);
            assert!((0.75..0.95).contains(&middle), "{by}: {middle}");
        }
    }

    #[test]
    fn a_few_extreme_scores_do_not_change_the_scale() {
        for wild in [1.3, 9.7, 1e9, f64::MAX, 100.0] {
            let mut scores = usual();
            scores.extend([wild, 1.3, 1.3, 1.3]);
            let (usual, remarked) = scale(&scores);
            assert!(remarked.contains("4 scores are above 1.25"), "{remarked}");
            assert!(usual.applied(0.8).to_bits() == 0.8f64.to_bits());
            assert!(usual.applied(wild).to_bits() == 1.0f64.to_bits());
        }
    }

    #[test]
    fn each_camera_keeps_its_own_scale() {
        let percent: Vec<f64> = usual().iter().map(|it| it * 100.0).collect();
        let mut remarks = Vec::new();
        let cameras = [camera("a", &usual()), camera("b", &percent)];
        let scales = ScoreScale::per_camera(&cameras, &mut remarks);
        let ours = [scales[0].applied(0.8), scales[1].applied(80.0)];
        assert!(ours.iter().all(|it| (it - 0.8).abs() < 1e-9), "{ours:?}");
        assert_eq!(remarks.len(), 1);
        assert_eq!(remarks[0].camera.as_deref(), Some("b"));
        assert!(remarks[0].text.contains("percent"), "{remarks:?}");
    }
}
