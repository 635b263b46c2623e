//! `lab real`: real recordings, in one table. Where no truth is known, poses are compared with the peaks of a view that was
//! withheld, next to plain weighted triangulation of the same views.

mod moments;
mod shelf;

use std::fmt;
use std::fs::{self, File};
use std::io::Write as _;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, anyhow, ensure};
use farfield::output;
use farfield_node::process::NodeError;
use farfield_proto::id::PersonId;
use farfield_proto::order_statistics::percentile;
use farfield_proto::patch::CompressionLevel;
use farfield_proto::tick::Tick;

use self::shelf::ShelfScore;
use super::recordings_folder;
use crate::leave_one_out::{Residual, ViewsRun};

/// The treadmill, below the folder of recordings.
const TREADMILL: &str = "data/pose2sim/single/venue.toml";
/// Ticks for which a moment is shown.
const STILL_TICKS: i64 = 30;

/// Largest median and 90th percentile, percent of a person's height: a tenth above what was reached.
const MOMENTS_AT_MOST: [f64; 2] = [2.9, 9.1];
const TREADMILL_AT_MOST: [f64; 2] = [3.4, 6.5];

/// Arguments of `lab real`. The recordings are below `$FARFIELD_DATA`, else ../shared.
#[derive(Debug, clap::Args)]
pub(super) struct RealArgs {
    /// Only these recordings.
    #[arg(long, value_name = "NAME", num_args = 1..)]
    only: Vec<Recording>,
    /// Write each comparison as a line of a CSV file per trial.
    #[arg(long, value_name = "DIR")]
    csv: Option<PathBuf>,
    /// Compare the levels of compression instead: bytes and distances.
    #[arg(long, conflicts_with_all = ["csv", "check"])]
    levels: bool,
    /// Fail if a figure is more than a tenth above what was reached when this check was written.
    #[arg(long)]
    check: bool,
}

/// What can be run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Recording {
    Moments,
    Treadmill,
    Shelf,
}

/// A comparison with a withheld view.
struct Comparison {
    withheld: usize,
    residual: Residual,
}

/// All comparisons of one trial.
struct Trial {
    name: String,
    comparisons: Vec<Comparison>,
    /// People at the end, by withheld view.
    people: Vec<usize>,
    /// People in views at ticks, and the bytes of their maps.
    sent: [usize; 2],
}

/// Median, mean and 90th percentile of distances, percent of a person's height.
#[derive(Clone, Copy)]
struct Distances {
    median: f64,
    mean: f64,
    p90: f64,
}

/// Runs the trials, and prints the table.
///
/// # Errors
/// A recording is missing or a run fails; with `--check`, a figure is out of bounds.
pub(super) fn real(args: &RealArgs) -> Result<(), NodeError> {
    let root = recordings_folder();
    for needed in ["data", "models"] {
        if !root.join(needed).is_dir() {
            return Err(NodeError::Refused(anyhow!(
                "found no folder `{needed}` in {}: set FARFIELD_DATA to the folder that holds data and models",
                root.display()
            )));
        }
    }
    if args.levels {
        return compare_levels(args, &root).map_err(NodeError::Failed);
    }
    compare(args, &root).map_err(NodeError::Failed)
}

/// Prints bytes against distances, by level of compression.
fn compare_levels(args: &RealArgs, root: &Path) -> anyhow::Result<()> {
    output::print(
        "bytes of a person in a view at a tick, and distance from the peaks of a withheld view, % of a person's height\n",
    )?;
    output::print("          trial  level   bytes  median /  mean /   P90\n")?;
    for level in CompressionLevel::all() {
        let mut trials = Vec::new();
        if args.wants(Recording::Moments) {
            trials.push(moments_trial(root, level, |_| Ok(()))?);
        }
        if args.wants(Recording::Treadmill) {
            trials.push(treadmill_trial(&root.join(TREADMILL), level)?);
        }
        for trial in trials {
            let [ours, _] = trial.distances().context("no person was found")?;
            let [people, bytes] = trial.sent;
            output::print(&format!(
                "{:>15} {:>6} {:>7.0}  {ours}\n",
                trial.name,
                level.number(),
                bytes as f64 / people.max(1) as f64
            ))?;
        }
    }
    Ok(())
}

/// The moments with each view withheld in turn, as one trial; `each` gets those of single moments.
fn moments_trial(
    root: &Path,
    level: CompressionLevel,
    each: impl Fn(&Trial) -> anyhow::Result<()>,
) -> anyhow::Result<Trial> {
    let mut all = Trial::new("moments");
    for moment in moments::moments_in(&root.join("data/panoptic"))? {
        let trial = moment_trial(&moment, &root.join("models"), level)?;
        each(&trial)?;
        all.comparisons.extend(trial.comparisons);
        all.sent = [0, 1].map(|i| all.sent[i] + trial.sent[i]);
    }
    Ok(all)
}

fn compare(args: &RealArgs, root: &Path) -> anyhow::Result<()> {
    let exact = CompressionLevel::LOSSLESS;
    let mut failures = Vec::new();
    output::print(&format!("{HEAD}\n"))?;
    if args.wants(Recording::Moments) {
        let trial = moments_trial(root, exact, |moment| moment.report(args))?;
        trial.report(args)?;
        failures.extend(trial.failure(&MOMENTS_AT_MOST));
    }
    if args.wants(Recording::Treadmill) {
        let trial = treadmill_trial(&root.join(TREADMILL), exact)?;
        trial.report(args)?;
        failures.extend(trial.failure(&TREADMILL_AT_MOST));
    }
    if args.wants(Recording::Shelf) {
        let score = ShelfScore::measure(&root.join("data/shelf"))?;
        output::print(&score.to_string())?;
        failures.extend(score.failure());
    }
    let failed = failures.join("; ");
    ensure!(!args.check || failures.is_empty(), "{failed}");
    Ok(())
}

/// A moment with each view withheld in turn. The last tick is compared.
fn moment_trial(moment: &Path, models: &Path, level: CompressionLevel) -> anyhow::Result<Trial> {
    let folder = tempfile::tempdir()?;
    let venue = moments::write_venue(moment, models, folder.path())?;
    let n_views = farfield_node::files::load_venue(&venue)?.viewpoints.len();
    let mut trial = Trial::new(&moment.file_name().unwrap_or_default().to_string_lossy());
    for view in 0..n_views {
        let run = ViewsRun::without(&venue, view, Some(STILL_TICKS), level)?;
        let last = Tick(STILL_TICKS - 1);
        trial.people.push(run.people_at(last));
        trial.add(view, &run, |tick, _| tick == last);
    }
    Ok(trial)
}

/// The man on the treadmill with each view withheld in turn, at all ticks.
fn treadmill_trial(venue: &Path, level: CompressionLevel) -> anyhow::Result<Trial> {
    let n_views = farfield_node::files::load_venue(venue)?.viewpoints.len();
    let mut trial = Trial::new("treadmill");
    for view in 0..n_views {
        let run = ViewsRun::without(venue, view, None, level)?;
        let man = run.most_seen().context("no person on the treadmill")?;
        trial.add(view, &run, |_, person| person == man);
    }
    Ok(trial)
}

impl RealArgs {
    fn wants(&self, name: Recording) -> bool {
        self.only.is_empty() || self.only.contains(&name)
    }
}

impl Trial {
    fn new(name: &str) -> Self {
        Self {
            name: name.to_owned(),
            comparisons: Vec::new(),
            people: Vec::new(),
            sent: [0; 2],
        }
    }

    /// Adds a run without the view `withheld`, of the chosen ticks and people.
    fn add(&mut self, withheld: usize, run: &ViewsRun, of: impl Fn(Tick, PersonId) -> bool) {
        let residuals = run.residuals(run.withheld_view(), of).into_iter();
        let comparisons = residuals.map(|residual| Comparison { withheld, residual });
        self.comparisons.extend(comparisons);
        self.sent = [0, 1].map(|i| self.sent[i] + run.sent()[i]);
    }

    /// Our distances and those of triangulation.
    fn distances(&self) -> Option<[Distances; 2]> {
        let residuals = self.comparisons.iter().map(|it| it.residual);
        let ours = residuals.clone().map(|r| 100.0 * r.ours_px / r.height_px);
        let theirs = residuals.filter_map(|r| Some(100.0 * r.triangulated_px? / r.height_px));
        Some([
            Distances::of(ours.collect())?,
            Distances::of(theirs.collect())?,
        ])
    }

    /// Prints the trial, and writes its CSV file if asked.
    fn report(&self, args: &RealArgs) -> anyhow::Result<()> {
        output::print(&format!("{self}\n"))?;
        let Some(folder) = &args.csv else {
            return Ok(());
        };
        fs::create_dir_all(folder)?;
        let mut file = File::create(folder.join(format!("{}.csv", self.name)))?;
        writeln!(
            file,
            "withheld,tick,person,keypoint,ours_px,triangulated_px,height_px"
        )?;
        for Comparison { withheld, residual } in &self.comparisons {
            let r = residual;
            let triangulated = r.triangulated_px.map(|px| format!("{px:.2}"));
            writeln!(
                file,
                "{withheld},{},{},{},{:.2},{},{:.1}",
                r.tick.0,
                r.person.0,
                r.keypoint,
                r.ours_px,
                triangulated.unwrap_or_default(),
                r.height_px
            )?;
        }
        Ok(())
    }

    /// What is wrong if median or 90th percentile exceed `at_most`.
    fn failure(&self, at_most: &[f64; 2]) -> Option<String> {
        let name = &self.name;
        let Some([ours, _]) = self.distances() else {
            return Some(format!("{name}: no person was found"));
        };
        let is_within = ours.median <= at_most[0] && ours.p90 <= at_most[1];
        (!is_within).then(|| {
            let [median, p90] = at_most;
            format!("{name}: {ours}, at most {median} and {p90} are allowed")
        })
    }
}

impl Distances {
    fn of(mut distances: Vec<f64>) -> Option<Self> {
        distances.sort_by(f64::total_cmp);
        let n = distances.len() as f64;
        let mean = distances.iter().sum::<f64>() / n;
        Some(Self {
            median: percentile(&distances, 0.5)?,
            mean,
            p90: percentile(&distances, 0.9)?,
        })
    }
}

const HEAD: &str =
    "distance from the peaks of a withheld view, % of a person's height: median / mean / P90
          trial      n                 ours        triangulation  ratios            people";

impl fmt::Display for Distances {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { median, mean, p90 } = self;
        write!(f, "{median:5.2} / {mean:5.2} / {p90:5.2}")
    }
}

impl fmt::Display for Trial {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { name, people, .. } = self;
        let n = self.comparisons.len();
        let Some([ours, theirs]) = self.distances() else {
            return write!(f, "{name:>15} no person was found");
        };
        let [median, mean, p90] = [
            ours.median / theirs.median,
            ours.mean / theirs.mean,
            ours.p90 / theirs.p90,
        ];
        let people: Vec<String> = people.iter().map(ToString::to_string).collect();
        write!(
            f,
            "{name:>15} {n:>6}  {ours}  {theirs}  {median:.2} {mean:.2} {p90:.2}  {}",
            people.join(" ")
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A trial with these distances of ours, pixels, in a person of 200 pixels.
    fn trial(ours_px: &[f64]) -> Trial {
        let residual = |ours_px: &f64| Residual {
            tick: Tick(0),
            person: PersonId(1),
            keypoint: "left_knee",
            ours_px: *ours_px,
            triangulated_px: Some(4.0),
            height_px: 200.0,
        };
        let mut trial = Trial::new("treadmill");
        let residuals = ours_px.iter().map(residual);
        let comparisons = residuals.map(|residual| Comparison {
            withheld: 0,
            residual,
        });
        trial.comparisons = comparisons.collect();
        trial
    }

    #[test]
    fn distances_are_in_percent_of_the_persons_height() {
        let [ours, theirs] = trial(&[2.0, 8.0, 4.0]).distances().unwrap();
        assert_eq!((ours.median, ours.p90, theirs.median), (2.0, 4.0, 2.0));
    }

    #[test]
    fn a_median_or_a_percentile_out_of_bounds_or_no_person_fails() {
        let fails = |ours_px: &[f64]| trial(ours_px).failure(&[2.0, 4.0]).is_some();
        assert!(!fails(&[2.0, 4.0, 8.0]));
        assert!(fails(&[5.0, 5.0, 5.0]), "the median");
        assert!(fails(&[2.0, 2.0, 9.0]), "the 90th percentile");
        assert!(fails(&[]), "no person");
    }
}
