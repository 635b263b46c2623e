//! `lab live-pixels`: a venue of videos at its real rate, with real networks, compared with the same venue in lock-step.
//!
//! All nodes are processes of this machine. A live run loses against lock-step by time only: ticks that an edge skipped, late
//! views, people found later.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::fs::File;
use std::io::{BufRead as _, BufReader};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context as _, anyhow, ensure};
use farfield::output;
use farfield_fusion::export::summary::Summary;
use farfield_node::process::NodeError;
use farfield_proto::tick::Tick;
use farfield_score::lines::{LinesRole, PoseLines, TruthExtent};
use farfield_score::points::{PointSet, ScoredBody};
use farfield_score::score;
use farfield_sim::embedded;

/// The stage from the capture of a tick to its poses, in summaries.
const CAPTURE_TO_POSE: &str = "fusion/capture_to_pose";
/// Longest time until people are found, on a loaded machine, too.
const FOUND_WITHIN_S: f64 = 10.0;
/// Least share of later ticks with poses.
const LEAST_WITH_POSES: f64 = 0.9;
/// Largest error above that in lock-step plus [`sampling_mm`] of the ticks that a slow machine skips, millimetres.
const MOST_WORSE_MM: f64 = 30.0;

/// Arguments of `lab live-pixels`.
#[derive(Debug, clap::Args)]
pub(super) struct LivePixelsArgs {
    /// Scene to render into videos.
    #[arg(long, value_name = "FILE", default_value = "sim/scenes/small.toml")]
    scene: PathBuf,
    /// Venue of recorded images to use instead; it has no truth.
    #[arg(long, value_name = "FILE", conflicts_with = "scene")]
    venue: Option<PathBuf>,
    /// Duration, seconds.
    #[arg(long, value_name = "S", default_value_t = 20.0)]
    seconds: f64,
    /// Fail if people are not found, or if the error is much larger than in lock-step.
    #[arg(long)]
    check: bool,
}

/// A venue to run, and its truth if there is one.
struct PixelVenue {
    program: PathBuf,
    path: PathBuf,
    truth: Option<PathBuf>,
    ticks: Range<Tick>,
    rate_hz: f64,
}

/// Results of a run.
#[derive(Debug, Default)]
struct Outcome {
    /// Ticks of the run.
    ticks: u64,
    /// The first tick with a pose, relative to the run, and the number of ticks with poses.
    first: Option<u64>,
    with_poses: u64,
    /// Ticks with a pose of two views or more.
    seen: BTreeSet<Tick>,
    /// Poses by the number of views.
    views: BTreeMap<u64, u64>,
    mpjpe_mm: Option<f64>,
    /// Part of the error due to skipped ticks, millimetres.
    sampling_mm: Option<f64>,
    /// P50 and P99 from capture to pose, milliseconds; live only.
    delay_ms: Option<[f64; 2]>,
    /// Ticks that edges missed, late messages, missing sets.
    lost: [u64; 3],
}

/// Runs the venue live and in lock-step, and prints the results.
///
/// # Errors
/// The venue is refused, or a run fails; with `--check`, people are not found or tracked much worse live.
pub(super) fn live_pixels(args: &LivePixelsArgs) -> Result<(), NodeError> {
    let scratch = tempfile::tempdir().map_err(NodeError::failed)?;
    let venue = prepare(args, scratch.path()).map_err(NodeError::Refused)?;
    let outcome = |live| venue.run(live, scratch.path());
    let lock_step = outcome(false).map_err(NodeError::Failed)?;
    let live = outcome(true).map_err(NodeError::Failed)?;
    let text = format!(
        "{HEAD}\n{:>10} {lock_step}\n{:>10} {live}\n",
        "lock-step", "live"
    );
    output::print(&text).map_err(NodeError::Failed)?;
    match live.failure(&lock_step, venue.rate_hz) {
        Some(failure) if args.check => Err(NodeError::Failed(anyhow!("{failure}"))),
        _ => Ok(()),
    }
}

fn prepare(args: &LivePixelsArgs, folder: &Path) -> anyhow::Result<PixelVenue> {
    let program = std::env::current_exe().context("finding this program's own file")?;
    let (path, truth) = if let Some(venue) = &args.venue {
        (venue.clone(), None)
    } else {
        let made = rendered(&program, args, folder)?;
        (made.join("venue.toml"), Some(made.join("truth.jsonl")))
    };
    let loaded = farfield_node::files::load_venue(&path)?;
    let first = loaded.first_tick;
    Ok(PixelVenue {
        program,
        path,
        truth,
        ticks: first..first + (args.seconds * loaded.rate_hz).round() as i64,
        rate_hz: loaded.rate_hz,
    })
}

/// Renders the scene into the videos of a venue with a detector; returns its folder.
fn rendered(program: &Path, args: &LivePixelsArgs, folder: &Path) -> anyhow::Result<PathBuf> {
    let scene = farfield_sim::scene::Scene::load(&args.scene)?;
    let detector = folder.join(embedded::write_detector(folder)?);
    let made = folder.join("venue");
    let ticks = format!("0..{}", (args.seconds * scene.rate_hz()).round());
    let mut simulate = Command::new(program);
    simulate
        .arg("simulate")
        .arg(&args.scene)
        .arg("--detector")
        .arg(detector);
    simulate
        .args(["--as", "videos", "--ticks", &ticks, "--out"])
        .arg(&made);
    finish(simulate, "rendering the scene")?;
    Ok(made)
}

fn finish(mut command: Command, what: &str) -> anyhow::Result<()> {
    let done = command.output().with_context(|| what.to_owned())?;
    let stderr = String::from_utf8_lossy(&done.stderr);
    ensure!(done.status.success(), "{what}: {stderr}");
    Ok(())
}

impl PixelVenue {
    fn run(&self, live: bool, folder: &Path) -> anyhow::Result<Outcome> {
        let name = if live { "live" } else { "lock-step" };
        let out = folder.join(name);
        let mut run = Command::new(&self.program);
        let ticks = format!("{}..{}", self.ticks.start, self.ticks.end);
        run.arg("run")
            .arg(&self.path)
            .args(["--ticks", &ticks, "--out"])
            .arg(&out);
        if live {
            run.arg("--live");
        }
        finish(run, &format!("running {name}"))?;
        let summary = std::fs::read_to_string(out.join("summary.json"))?;
        let summary: Summary = serde_json::from_str(&summary)?;
        let mut outcome = Outcome::from_summary(&summary);
        let poses = out.join("poses.jsonl");
        outcome.count_poses(&poses, &self.ticks)?;
        if let Some(truth) = &self.truth {
            let read = |path: &Path, role| -> anyhow::Result<PoseLines> {
                let file = BufReader::new(File::open(path)?);
                Ok(PoseLines::read(
                    file,
                    path,
                    role,
                    PointSet::Joints,
                    Some(&self.ticks),
                )?)
            };
            let (poses, truth) = (
                read(&poses, LinesRole::Poses)?,
                read(truth, LinesRole::Truth)?,
            );
            let scores = score(&poses, &truth, TruthExtent::Whole, Some(self.rate_hz));
            outcome.mpjpe_mm = scores.mean.mpjpe_mm;
            let cost_mm = sampling_mm(&truth, &outcome.seen, poses.ticks());
            outcome.sampling_mm = Some(cost_mm);
        }
        Ok(outcome)
    }
}

impl Outcome {
    fn from_summary(summary: &Summary) -> Self {
        let delay = summary.timing.stages.get(CAPTURE_TO_POSE);
        let missed = summary.timing.missed_ticks.values().sum();
        Self {
            ticks: summary.ticks.done,
            delay_ms: delay.map(|it| [it.p50_us / 1e3, it.p99_us / 1e3]),
            lost: [missed, summary.drops.late, summary.drops.missing],
            ..Self::default()
        }
    }

    fn count_poses(&mut self, path: &Path, ticks: &Range<Tick>) -> anyhow::Result<()> {
        let mut last = None;
        for line in BufReader::new(File::open(path)?).lines() {
            let pose: serde_json::Value = serde_json::from_str(&line?)?;
            let tick = pose["tick"].as_i64().context("a pose without `tick`")?;
            if let Some(views) = pose["views"].as_u64() {
                *self.views.entry(views).or_default() += 1;
                if views >= 2 {
                    self.seen.insert(Tick(tick));
                }
            }
            if last != Some(tick) {
                self.with_poses += 1;
                self.first
                    .get_or_insert((Tick(tick) - ticks.start).unsigned_abs());
            }
            last = Some(tick);
        }
        Ok(())
    }

    /// The first result of this live run that is out of bounds.
    fn failure(&self, lock_step: &Self, rate_hz: f64) -> Option<String> {
        let Some(first) = self.first else {
            return Some("no people were found live".to_owned());
        };
        let after_s = first as f64 / rate_hz;
        let share = self.with_poses as f64 / self.ticks.saturating_sub(first).max(1) as f64;
        let worse_mm = self
            .mpjpe_mm
            .zip(lock_step.mpjpe_mm)
            .map_or(0.0, |(a, b)| a - b - self.sampling_mm.unwrap_or(0.0));
        if after_s > FOUND_WITHIN_S {
            Some(format!(
                "the first pose came {after_s:.1} s after the first tick"
            ))
        } else if share < LEAST_WITH_POSES {
            Some(format!(
                "{:.0} % of the ticks after the first pose have one",
                100.0 * share
            ))
        } else if worse_mm > MOST_WORSE_MM {
            Some(format!(
                "the error is {worse_mm:.0} mm larger than in lock-step, without the error due to skipped ticks"
            ))
        } else {
            None
        }
    }
}

const HEAD: &str = "            ticks  first  with poses  2, 3, 4 views   P50, P99 ms  mm, of ticks left out  missed, late, missing";

impl fmt::Display for Outcome {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let poses = self.views.values().sum::<u64>().max(1) as f64;
        let [two, three, four] =
            [2, 3, 4].map(|n| 100.0 * self.views.get(&n).copied().unwrap_or(0) as f64 / poses);
        let known = |it: Option<f64>| it.map_or("-".to_owned(), |it| format!("{it:.0}"));
        let first = self.first.map_or("-".to_owned(), |first| first.to_string());
        let [p50, p99] = [0, 1].map(|i| known(self.delay_ms.map(|it| it[i])));
        let [missed, late, missing] = self.lost;
        write!(
            f,
            "{:>6} {first:>6} {:>11}  {two:3.0} {three:3.0} {four:3.0} %  {p50:>7} {p99:>6} {:>4} {:>17}  {missed}, {late}, {missing}",
            self.ticks,
            self.with_poses,
            known(self.mpjpe_mm),
            known(self.sampling_mm)
        )
    }
}

/// Mean error at `ticks` of a predictor that knows the truth at the `seen` ticks and extrapolates with the velocity between
/// the last two, millimetres. No tracker does much better from the same ticks.
pub(super) fn sampling_mm(
    truth: &PoseLines,
    seen: &BTreeSet<Tick>,
    ticks: impl Iterator<Item = Tick>,
) -> f64 {
    let (mut sum_m, mut n) = (0.0, 0.0);
    for tick in ticks {
        let mut newest_first = seen.range(..=tick).rev();
        let (Some(last), Some(before)) = (newest_first.next(), newest_first.next()) else {
            continue;
        };
        let share = (tick - *last) as f64 / (*last - *before) as f64;
        let [Some(now), Some(last), Some(before)] =
            [tick, *last, *before].map(|tick| truth.people_at(tick))
        else {
            continue;
        };
        for (person, body) in now {
            let expected = last.get(person).zip(before.get(person));
            let expected = expected.map(|(last, before)| moved_on(last, before, share));
            if let Some(distance_m) = expected.and_then(|it| it.mean_distance_m(body)) {
                sum_m += distance_m;
                n += 1.0;
            }
        }
    }
    1e3 * sum_m / f64::max(n, 1.0)
}

/// `last`, extrapolated by `share` of the step from `before`.
fn moved_on(last: &ScoredBody, before: &ScoredBody, share: f64) -> ScoredBody {
    let mut body = last.clone();
    for (point, before) in body.points_m.iter_mut().zip(&before.points_m) {
        *point = point.zip(*before).map(|(at, was)| at + (at - was) * share);
    }
    body
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use farfield_score::lines::LinesRole;
    use farfield_score::points::PointSet;

    use super::*;

    fn outcome(first: Option<u64>, with_poses: u64, mpjpe_mm: f64) -> Outcome {
        Outcome {
            ticks: 600,
            first,
            with_poses,
            mpjpe_mm: Some(mpjpe_mm),
            ..Outcome::default()
        }
    }

    #[test]
    fn a_live_run_that_finds_no_people_late_ones_or_tracks_badly_fails() {
        let lock_step = outcome(Some(0), 600, 30.0);
        let failure = |live: Outcome| live.failure(&lock_step, 30.0);
        assert_eq!(failure(outcome(Some(60), 540, 40.0)), None);
        assert!(
            failure(outcome(None, 0, 0.0))
                .unwrap()
                .contains("no people")
        );
        assert!(
            failure(outcome(Some(400), 200, 40.0))
                .unwrap()
                .contains("13.3 s")
        );
        assert!(
            failure(outcome(Some(60), 400, 40.0))
                .unwrap()
                .contains("74 %")
        );
        assert!(
            failure(outcome(Some(60), 540, 61.0))
                .unwrap()
                .contains("31 mm")
        );
        let mut slow = outcome(Some(60), 540, 75.0);
        slow.sampling_mm = Some(20.0);
        assert_eq!(failure(slow), None, "on a machine that leaves ticks out");
    }

    /// A person whose left shoulder has these x at ticks 0, 1, 2 ..., metres.
    fn truth(places_m: &[f64]) -> PoseLines {
        let line = |(tick, x_m): (usize, &f64)| {
            format!(
                "{{\"tick\": {tick}, \"person\": 1, \"joints\": {{\"left_shoulder\": [{x_m}, 0, 1]}}}}\n"
            )
        };
        let text: String = places_m.iter().enumerate().map(line).collect();
        let path = Path::new("truth.jsonl");
        let role = LinesRole::Truth;
        PoseLines::read(text.as_bytes(), path, role, PointSet::Joints, None).unwrap()
    }

    fn cost_mm(places_m: &[f64], seen: &[i64]) -> f64 {
        let seen = seen.iter().map(|tick| Tick(*tick)).collect();
        let ticks = (0..).map(Tick).take(places_m.len());
        sampling_mm(&truth(places_m), &seen, ticks)
    }

    #[test]
    fn every_tick_or_a_steady_walk_costs_nothing() {
        assert!(cost_mm(&[0.0, 0.1, 0.5, 0.2], &[0, 1, 2, 3]) < 1e-9);
        assert!(cost_mm(&[0.0, 0.1, 0.2, 0.3, 0.4], &[0, 2]) < 1e-9);
    }

    #[test]
    fn every_other_tick_costs_what_changes_between() {
        // The person moves 0.1 m per tick and stops at tick 2. The error is 0 at tick 2 and 100 mm at tick 3.
        assert!((cost_mm(&[0.0, 0.1, 0.2, 0.2], &[0, 2]) - 50.0).abs() < 1e-6);
    }
}
