//! The value of a delay: the smoothed output against the live one, over a scene and during cuts.

use std::fmt;

use farfield_proto::tick::Tick;
use farfield_score::MeanScore;
use farfield_score::lines::PoseLines;

use super::run::SceneRun;
use crate::conditions::Cuts;

/// Scores of one output of a run.
#[derive(Debug, Clone, PartialEq)]
pub struct OutputScore {
    /// Means over the people.
    pub mean: MeanScore,
    /// Mean and largest error at the ticks of the cuts, metres; `None` without any.
    pub in_cuts_m: Option<(f64, f64)>,
}

impl OutputScore {
    /// Scores `poses`, an output of `run` with the given `cuts`.
    pub fn measure(run: &SceneRun, poses: &PoseLines, cuts: Option<Cuts>) -> Self {
        let first_ticks = run.first_ticks();
        let in_cut = |tick: Tick| cuts.is_some_and(|cuts| cuts.contains(tick));
        Self {
            mean: run.score_since(poses, &first_ticks).mean,
            in_cuts_m: run.errors_at(poses, &first_ticks, in_cut),
        }
    }
}

impl fmt::Display for OutputScore {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let number = |value: Option<f64>| value.unwrap_or(f64::NAN);
        let (mean_m, most_m) = self.in_cuts_m.unwrap_or((f64::NAN, f64::NAN));
        write!(
            f,
            "{:7.2} {:7.2} {:7.0} {:6.1} {:5.0} {:8.1} {:7.1}",
            number(self.mean.mpjpe_mm),
            number(self.mean.mpjpe_sites_mm),
            number(self.mean.jitter_m_s3),
            number(self.mean.foot_slide_mm_s),
            self.mean.gaps,
            1000.0 * mean_m,
            1000.0 * most_m,
        )
    }
}

/// Two head lines for lines of [`OutputScore`].
pub const HEAD: [&str; 2] = [
    "  MPJPE   sites  jitter  slide  gaps  in cuts   worst",
    "     mm      mm   m/s^3   mm/s             mm      mm",
];

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::suite::run::SceneRunPlan;
    use crate::suite::run::parameters;
    use farfield_sim::embedded;
    use farfield_sim::simulated::in_memory::Input;

    /// Six ticks of every second: less than the delay of 200 ms.
    const CUTS: Cuts = Cuts {
        every: 60,
        lasts: 6,
        late: None,
    };

    fn plan(delay_ms: f64) -> SceneRunPlan {
        SceneRunPlan {
            cuts: Some(CUTS),
            ..SceneRunPlan::with(parameters(&format!("smoothing.delay_ms = {delay_ms:?}")).unwrap())
        }
    }

    fn run(scene: &str, seconds: f64, plans: [SceneRunPlan; 3]) -> [SceneRun; 3] {
        let scene = embedded::scene(scene).unwrap().shortened(seconds);
        SceneRun::make_all(&Arc::new(scene), &Input::Maps, plans).unwrap()
    }

    #[test]
    fn a_delay_and_two_passes_improve_poses() {
        let two_passes = SceneRunPlan {
            two_passes: true,
            ..plan(0.0)
        };
        let [live, delayed, passes] = run("futsal", 3.0, [plan(0.0), plan(200.0), two_passes]);
        assert!(live.smoothed.ticks().next().is_none(), "there is no delay");
        for smoothed in [&delayed, &passes] {
            assert_eq!(live.causal, smoothed.causal, "live poses do not change");
            let [ours, late] = [&smoothed.causal, &smoothed.smoothed]
                .map(|poses| OutputScore::measure(smoothed, poses, Some(CUTS)));
            assert!(late.mean.mpjpe_mm < ours.mean.mpjpe_mm, "{ours}\n{late}");
            assert!(
                2.0 * late.mean.jitter_m_s3.unwrap() < ours.mean.jitter_m_s3.unwrap(),
                "{ours}\n{late}"
            );
            let [(in_cuts_m, worst_m), (late_m, late_worst_m)] =
                [ours, late].map(|score| score.in_cuts_m.unwrap());
            assert!(late_m < 0.75 * in_cuts_m && late_worst_m < worst_m);
        }
        let first = |run: &SceneRun| run.smoothed.ticks().next();
        assert_eq!(
            first(&passes),
            passes.finished.ticks().next(),
            "initiations too"
        );
        let all = |poses: &PoseLines| poses.ticks().count();
        assert_eq!(all(&passes.smoothed), all(&passes.finished));
    }

    #[test]
    fn a_delay_that_is_longer_than_the_run_is_two_passes() {
        let two_passes = SceneRunPlan {
            two_passes: true,
            ..plan(0.0)
        };
        let [long, whole, again] = run("one", 1.5, [plan(2000.0), two_passes.clone(), two_passes]);
        assert_eq!(long.smoothed, whole.smoothed);
        assert_eq!(whole.smoothed, again.smoothed);
    }

    #[test]
    fn late_messages_improve_the_smoothed_output_only() {
        let late_by = |ticks| SceneRunPlan {
            cuts: Some(Cuts {
                late: Some(ticks),
                ..CUTS
            }),
            ..plan(200.0)
        };
        let plans = [plan(200.0), late_by(8), late_by(20)];
        let [never, late, too_late] = run("cross", 3.0, plans);
        assert_eq!(never.causal, late.causal);
        assert_eq!(
            never.smoothed, too_late.smoothed,
            "its tick has left the delay"
        );
        let [without_m, with_m] = [&never, &late].map(|run| {
            let score = OutputScore::measure(run, &run.smoothed, Some(CUTS));
            score.in_cuts_m.unwrap().0
        });
        // 20.1 and 21.0 mm; 20.3 and 21.7 when unmeasured joints disturbed the filter.
        assert!(with_m < 0.97 * without_m, "{with_m} {without_m} m");
        assert!(with_m < 0.0203, "{with_m} m");
    }
}
