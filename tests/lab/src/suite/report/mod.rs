//! The figures of one scene, ours with and without range of motion and the baseline on the same maps, and the overview of all
//! scenes.

pub mod bars;
pub mod limits;

use std::collections::BTreeMap;
use std::fmt;
use std::sync::Arc;

use farfield_proto::tick::Tick;
use farfield_score::lines::PoseLines;
use farfield_score::plot::plot_of;
use farfield_score::points::PointSet;
use farfield_score::{Scores, table};
use farfield_sim::scene::Scene;
use farfield_sim::scene::range_of_motion::range_of_motion_excess;
use farfield_sim::simulated::in_memory::Input;
use serde::Serialize;

use crate::conditions::Cuts;
use crate::suite::baseline::butterworth::ZeroPhase;
use crate::suite::baseline::outliers::Thresholds;
use crate::suite::baseline::{CUTOFFS_HZ, Trajectory};
use crate::suite::people::People;
use crate::suite::people::id_changes::IdChange;
use crate::suite::people::presence::meetings;
use crate::suite::people::recovery::{Recovery, RecoverySummary, slowest_s};
use crate::suite::run::{SceneRun, SceneRunPlan};

/// Number of losses above which they are summarised.
const MANY: usize = 12;
/// Width of the names in front of a row.
const NAME_WIDTH: usize = 17;

/// The best result of a user of Pose2Sim.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Baseline {
    /// The best of the cutoffs, hertz.
    pub cutoff_hz: f64,
    /// Its figures.
    pub scores: Scores,
}

impl Baseline {
    /// The baseline of a run that kept its peaks, with the cutoff of least MPJPE.
    pub fn best(run: &SceneRun) -> Self {
        let raw: Vec<(u32, Trajectory)> = run
            .scene
            .people()
            .iter()
            .filter_map(|who| {
                let mut there = run.truth.ticks().filter(|&tick| {
                    let people = run.truth.people_at(tick);
                    people.is_some_and(|people| people.contains_key(&who.number))
                });
                let first = there.next()?;
                let last = there.last().unwrap_or(first);
                let trajectory = Trajectory::triangulated(
                    first..=last,
                    run.keypoints.len(),
                    &run.views_of(who.number),
                    &run.pixel_from_world,
                    &Thresholds::default(),
                );
                Some((who.number, trajectory))
            })
            .collect();
        let rate_hz = run.scene.rate_hz();
        let at_cutoff = |cutoff_hz: f64| {
            let filter = ZeroPhase::new(cutoff_hz, rate_hz);
            let mut people = People::new();
            for (actor, trajectory) in &raw {
                let filtered = trajectory.filtered(&filter);
                for tick in run.truth.ticks() {
                    if let Some(body) = filtered.body(tick, &run.keypoints) {
                        people.entry(tick).or_default().insert(*actor, body);
                    }
                }
            }
            let poses = PoseLines::from_people(PointSet::Joints, people);
            Self {
                cutoff_hz,
                scores: run.score(&poses),
            }
        };
        let [first, others @ ..] = CUTOFFS_HZ;
        let mpjpe = |b: &Self| b.scores.mean.mpjpe_mm.unwrap_or(f64::INFINITY);
        others
            .into_iter()
            .fold(at_cutoff(first), |best, cutoff_hz| {
                let other = at_cutoff(cutoff_hz);
                if mpjpe(&other) < mpjpe(&best) {
                    other
                } else {
                    best
                }
            })
    }
}

/// The figures of one scene.
#[derive(Debug, Clone, Serialize)]
pub struct SceneReport {
    /// Its name.
    pub scene: String,
    /// `maps` or `pixels`.
    pub input: &'static str,
    /// Number of people.
    pub people: usize,
    /// Number of ticks.
    pub ticks: i64,
    /// Ticks per second.
    pub rate_hz: f64,
    /// Share of moments at which the truth is outside the clinical range of motion, percent.
    pub outside_range_of_motion: f64,
    /// Per actor, the ticks from when it counts until a live observer receives it. `None`: never.
    pub found_after_ticks: BTreeMap<u32, Option<i64>>,
    /// Scores of the final files, with range of motion. Here and below all ticks at which an actor counts are scored, also those
    /// before its first pose.
    pub with_range_of_motion: Scores,
    /// Scores of the final files, without range of motion.
    pub without_range_of_motion: Scores,
    /// Triangulation and a filter that uses the future, on the maps of the run with range of motion.
    pub baseline: Baseline,
    /// Scores of live poses, with range of motion.
    pub live: Scores,
    /// Number of times that two people come near each other and part, in the truth.
    pub meetings: u64,
    /// Gaps of live poses, with range of motion, that nothing excuses.
    pub gaps_to_answer_for: u64,
    /// Whether all links were cut in periods.
    pub cut: bool,
    /// Recoveries of people after losses by the scene or the links, live.
    pub recoveries: Vec<Recovery>,
    /// Changes of ids.
    pub id_changes: Vec<IdChange>,
    /// Mean bytes of all patches of a tick.
    pub patch_bytes_per_tick: f64,
    /// Live poses, with range of motion.
    #[serde(skip)]
    causal: PoseLines,
    #[serde(skip)]
    truth: PoseLines,
}

impl SceneReport {
    /// Runs `scene` with and without range of motion, with all links cut at `cuts`, and scores it.
    ///
    /// # Errors
    /// See [`SceneRun::make`].
    pub fn make(
        name: &str,
        scene: &Arc<Scene>,
        cuts: Option<Cuts>,
        input: &Input,
    ) -> anyhow::Result<Self> {
        let mut free = SceneRunPlan {
            cuts,
            ..SceneRunPlan::default()
        };
        let bounded = SceneRunPlan {
            keep_peaks: true,
            ..free.clone()
        };
        free.parameters.range_of_motion.enabled = false;
        let [bounded, free] = SceneRun::make_all(scene, input, [bounded, free])?;
        let first_ticks = bounded.first_ticks();
        let (samples, outside) = range_of_motion_excess(scene).total();
        let n_ticks = scene.ticks().end - scene.ticks().start;
        let after = |(&actor, &since): (&u32, &Tick)| {
            let after = first_ticks.get(&actor).map(|&tick| tick - since);
            (actor, after)
        };
        let live = bounded.score(&bounded.causal);
        let gaps = bounded.unexcused_gaps(&live);
        Ok(Self {
            scene: name.to_owned(),
            input: match input {
                Input::Maps => "maps",
                Input::Pixels { .. } => "pixels",
            },
            people: bounded.since.len(),
            ticks: n_ticks,
            rate_hz: scene.rate_hz(),
            outside_range_of_motion: 100.0 * outside as f64 / samples.max(1) as f64,
            found_after_ticks: bounded.since.iter().map(after).collect(),
            with_range_of_motion: bounded.score(&bounded.finished),
            without_range_of_motion: free.score(&free.finished),
            baseline: Baseline::best(&bounded),
            live,
            meetings: meetings(scene),
            gaps_to_answer_for: gaps.len() as u64,
            cut: cuts.is_some(),
            recoveries: Recovery::all(scene, cuts, &bounded.causal, &bounded.truth),
            id_changes: bounded.id_changes(&bounded.finished),
            patch_bytes_per_tick: bounded.traffic.map_bytes as f64 / n_ticks.max(1) as f64,
            causal: bounded.causal,
            truth: bounded.truth,
        })
    }

    /// The error of each actor over time, as an SVG document.
    pub fn plot(&self) -> String {
        let title = format!("{}: mean joint error, live, {}", self.scene, self.input);
        plot_of(&title, &self.causal, &self.truth, self.rate_hz)
    }

    fn baseline_name(&self) -> String {
        format!("DLT+BW {} Hz", self.baseline.cutoff_hz)
    }
}

impl fmt::Display for SceneReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "[{}] {} people, {} ticks at {} Hz, {}; the truth is outside the clinical range of motion {:.1} % of the time",
            self.scene,
            self.people,
            self.ticks,
            self.rate_hz,
            self.input,
            self.outside_range_of_motion
        )?;
        let named = [
            ("with RoM", &self.with_range_of_motion),
            ("without", &self.without_range_of_motion),
            (&self.baseline_name(), &self.baseline.scores),
        ];
        writeln!(f, "{}", table::side_by_side(NAME_WIDTH, &named))?;
        writeln!(
            f,
            "{}",
            table::line(NAME_WIDTH, "live, with RoM", &self.live.mean.row())
        )?;
        writeln!(f, "{}", self.with_range_of_motion.identity_line())?;
        writeln!(f, "{}", self.with_range_of_motion.lives)?;
        if self.recoveries.len() > MANY {
            writeln!(f, "{}", RecoverySummary(&self.recoveries))?;
        } else {
            for recovery in &self.recoveries {
                writeln!(f, "{recovery}")?;
            }
        }
        for change in &self.id_changes {
            writeln!(f, "id: {change}")?;
        }
        let first_poses: Vec<String> = self
            .found_after_ticks
            .iter()
            .map(|(actor, after)| match after {
                Some(ticks) => format!("{actor} after {ticks} ticks"),
                None => format!("{actor} never"),
            })
            .collect();
        write!(
            f,
            "live after the first tick: {}; {} unexcused gaps; {} meetings; patches of {:.0} bytes a tick",
            first_poses.join(", "),
            self.gaps_to_answer_for,
            self.meetings,
            self.patch_bytes_per_tick
        )?;
        match &self.with_range_of_motion.calibration {
            Some(calibration) => write!(f, "\n{calibration}"),
            None => Ok(()),
        }
    }
}

/// Column heads with their widths.
const COLUMNS: [(&str, usize); 14] = [
    ("people", 6),
    ("MPJPE mm", 8),
    ("gaps", 5),
    ("switches", 8),
    ("frag", 4),
    ("false births", 12),
    ("IDF1 %", 6),
    ("MOTA %", 6),
    ("born s", 6),
    ("worst s", 7),
    ("returns", 7),
    ("old id", 6),
    ("id kept", 7),
    ("back s", 6),
];

/// One line per scene.
pub struct Overview<'a>(pub &'a [SceneReport]);

impl fmt::Display for Overview<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let names = self.0.iter().map(|report| report.scene.len());
        let width = names.max().unwrap_or(0);
        write!(f, "{:>width$}", "scene")?;
        for (head, width) in COLUMNS {
            write!(f, "  {head:>width$}")?;
        }
        for report in self.0 {
            write!(f, "\n{:>width$}", report.scene)?;
            for (cell, (_, width)) in cells(report).into_iter().zip(COLUMNS) {
                write!(f, "  {cell:>width$}")?;
            }
        }
        write!(
            f,
            "\nborn: from when a person is in the field and in the images of two viewpoints (median, worst); \
             back: from the end of a loss until below 50 mm for good (worst)"
        )
    }
}

fn cells(report: &SceneReport) -> [String; COLUMNS.len()] {
    let scores = &report.with_range_of_motion;
    let (identity, lives) = (&scores.identity, &scores.lives);
    let some = |value: Option<f64>, digits: usize| {
        value.map_or_else(|| "-".to_owned(), |value| format!("{value:.digits$}"))
    };
    let gaps: u64 = scores.actors.values().map(|actor| actor.gaps).sum();
    let worst = match lives.never_born {
        0 => some(lives.time_to_birth_worst_s, 2),
        _ => "never".to_owned(),
    };
    let kept = report.recoveries.iter().filter(|r| r.same_id).count();
    let lost = match report.recoveries.len() {
        0 => "-".to_owned(),
        lost => format!("{kept}/{lost}"),
    };
    let returned = match lives.returns {
        0 => "-".to_owned(),
        _ => lives.returns_same_id.to_string(),
    };
    [
        report.people.to_string(),
        some(scores.mean.mpjpe_mm, 1),
        gaps.to_string(),
        identity.switches.to_string(),
        identity.fragmentations.to_string(),
        identity.false_births.to_string(),
        some(Some(identity.idf1), 1),
        some(Some(identity.mota), 1),
        some(lives.time_to_birth_median_s, 2),
        worst,
        lives.returns.to_string(),
        returned,
        lost,
        some(slowest_s(&report.recoveries), 2),
    ]
}
