//! On which scale scores are. Ours go to 1.

use farfield_calibration::formats::RemarkKind;

use super::CameraFrames;
use crate::report::RemarkReport;

/// Scores so little above 1 are those of networks that overshoot, as `OpenPose` by a few percent: they are taken for 1.
const OVERSHOOT: f64 = 1.25;
/// Scores that fewer than this share of all exceed are the exceptions of a network whose scores are no probabilities, as
/// those of `RTMPose` are: they are taken for 1.
const EXCEPTIONS: f64 = 0.01;
/// Largest scores from here up to 100 are percent.
const LEAST_PERCENT: f64 = 20.0;

/// What scores are divided by before they are cut at 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ScoreScale(f64);

impl Default for ScoreScale {
    fn default() -> Self {
        Self(1.0)
    }
}

impl ScoreScale {
    /// The scale of all cameras together; what is not the usual one is said.
    pub(super) fn of(cameras: &[CameraFrames], remarks: &mut Vec<RemarkReport>) -> Self {
        let scores = || {
            let people = cameras.iter().flat_map(|it| it.frames.values().flatten());
            people.flatten().flatten().map(|it| it.score)
        };
        let largest = scores().fold(0.0, f64::max);
        if largest <= OVERSHOOT {
            return Self::default();
        }
        let above = scores().filter(|score| *score > OVERSHOOT).count();
        let share = above as f64 / scores().count().max(1) as f64;
        let (by, kind, text) = if share < EXCEPTIONS {
            (
                1.0,
                RemarkKind::Assumed,
                format!("{above} scores are above 1, the largest {largest}: they were taken for 1"),
            )
        } else if (LEAST_PERCENT..=100.0).contains(&largest) {
            (
                100.0,
                RemarkKind::Assumed,
                format!("scores go up to {largest}: they were taken for percent"),
            )
        } else {
            (
                largest,
                RemarkKind::Doubtful,
                format!(
                    "scores go up to {largest}, on a scale that is not known: they were divided by that, and what is \
                     certain and what is not may differ from what the network meant"
                ),
            )
        };
        remarks.push(RemarkReport::of_all(kind, text));
        Self(by)
    }

    /// A score of the file on our scale.
    pub fn applied(self, score: f64) -> f64 {
        (score / self.0).clamp(0.0, 1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::person::Candidate;

    /// The scale of one camera's scores, and what is said of it.
    fn scale(scores: &[f64]) -> (ScoreScale, String) {
        let person = |score: &f64| {
            let mut person = [None; 17];
            person[0] = Some(Candidate {
                x_px: 1.0,
                y_px: 1.0,
                score: *score,
            });
            person
        };
        let camera = CameraFrames {
            name: "a".to_owned(),
            size_px: [2, 2],
            down: [0.0, 1.0],
            source: "a".to_owned(),
            frames: [(0, scores.iter().map(person).collect())].into(),
        };
        let mut remarks = Vec::new();
        let scale = ScoreScale::of(&[camera], &mut remarks);
        (
            scale,
            remarks
                .first()
                .map_or_else(String::new, |it| it.text.clone()),
        )
    }

    #[test]
    fn probabilities_stay_and_a_small_overshoot_is_cut() {
        let (scale, said) = scale(&[0.5, 1.05]);
        assert_eq!(said, "");
        assert!(scale.applied(0.5).to_bits() == 0.5f64.to_bits());
        assert!(scale.applied(1.05).to_bits() == 1.0f64.to_bits());
    }

    #[test]
    fn percent_and_unknown_scales_are_divided_and_said() {
        let (percent, said) = scale(&[98.0, 12.0]);
        assert!(said.contains("percent"), "{said}");
        assert!((percent.applied(98.0) - 0.98).abs() < 1e-12);
        let (unknown, said) = scale(&[8.0, 4.0]);
        assert!(said.contains("not known"), "{said}");
        assert!((unknown.applied(4.0) - 0.5).abs() < 1e-12);
    }

    #[test]
    fn few_exceptions_do_not_make_a_scale() {
        let mut scores = vec![0.8; 300];
        scores.push(3.0);
        let (exceptions, said) = scale(&scores);
        assert!(said.contains("1 scores are above 1"), "{said}");
        assert!(exceptions.applied(0.8).to_bits() == 0.8f64.to_bits());
    }
}
