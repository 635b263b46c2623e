//! `farfield evaluate POSES TRUTH`: errors of a `poses.jsonl` against a `truth.jsonl`.
//!
//! Most errors are wrong input: a missing file, an unreadable line, a truth with nothing to compare. Only a failure to
//! print the result is not.

use std::fs::{self, File};
use std::io::{BufRead as _, BufReader, Read as _};
use std::ops::Range;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, anyhow, bail, ensure};
use farfield_fusion::recording::is_ours;
use farfield_node::process::{NodeError, say};
use farfield_proto::tick::{Tick, parse_range};
use farfield_score::lines::{LinesRole, PoseLines, TruthExtent};
use farfield_score::overlap::Overlap;
use farfield_score::plot::plot_of;
use farfield_score::points::PointSet;
use farfield_score::repeatability::{Repeatability, SessionAngles};
use farfield_score::table::side_by_side;
use farfield_score::truth_warnings::{TruthWarning, misread, truth_warnings};
use farfield_score::{Scores, score};

use crate::exchange::place::POSES;
use crate::exchange::target::{check_file, file_in};
use crate::output;

/// Longest line read to detect the kind of a file, bytes.
const LONGEST_LINE_BYTES: u64 = 64 << 10;

/// Arguments of `farfield evaluate`.
#[derive(Debug, Clone, clap::Args)]
pub(crate) struct EvaluateArgs {
    /// The poses, as `farfield run` writes them.
    ///
    /// Or the folder of the run. For a recording, first create a run with `farfield replay`.
    poses: PathBuf,
    /// The true poses, one line per tick and person.
    ///
    /// With the joints and keypoints that are known; or the folder of its `truth.jsonl`.
    truth: PathBuf,
    /// Further sessions (`--sessions`).
    #[arg(requires = "sessions", value_name = "POSES")]
    others: Vec<PathBuf>,
    /// Compare joint angles of results, not a truth.
    ///
    /// POSES TRUTH ... are results of one recording, of other calibrations, networks or viewpoints. Prints the standard
    /// deviation of each angle over them, degrees.
    #[arg(long, conflicts_with_all = ["beside", "points", "truth-extent", "ticks", "rate_hz", "plot"])]
    sessions: bool,
    /// Other poses to compare against the same truth.
    #[arg(long, value_name = "POSES")]
    beside: Option<PathBuf>,
    /// What to compare: joints, keypoints or shelf14.
    #[arg(long, default_value = "joints")]
    points: PointSet,
    /// Whether TRUTH contains all people.
    ///
    /// whole: people missing in it did not exist; partial: only some people are annotated, and poses of other people do
    /// not count as errors.
    #[arg(
        id = "truth-extent",
        long = "truth",
        default_value = "whole",
        value_name = "whole|partial"
    )]
    extent: TruthExtent,
    /// Only these ticks; B is excluded.
    #[arg(long, value_parser = parse_range, value_name = "A..B", allow_hyphen_values = true)]
    ticks: Option<Range<Tick>>,
    /// Ticks per second, for jitter and foot slide.
    ///
    /// Default: from summary.json next to POSES, else from venue.toml next to TRUTH; without any, both are left out.
    #[arg(long, value_name = "HZ")]
    rate_hz: Option<f64>,
    /// Print the scores or the error as JSON.
    #[arg(long)]
    pub(crate) json: bool,
    /// Draw the errors over time into this SVG file.
    #[arg(long, value_name = "FILE")]
    plot: Option<PathBuf>,
}

/// Scores the poses, and prints the result.
///
/// # Errors
/// When a file is missing or wrong, when the truth has nothing to compare, or when the result cannot be printed or
/// drawn.
pub(crate) fn evaluate(args: &EvaluateArgs) -> Result<(), NodeError> {
    if args.sessions {
        let found = repeatability_of(args).map_err(NodeError::Refused)?;
        return print_as(&found, args.json, Repeatability::to_string);
    }
    if let Some(rate) = args.rate_hz.filter(|&rate| !is_rate(rate)) {
        let problem = anyhow!("--rate-hz: found {rate}, expected a number above 0");
        return Err(NodeError::Refused(problem));
    }
    let args = &args.clone().with_files().map_err(NodeError::Refused)?;
    args.check_plot().map_err(NodeError::Refused)?;
    let (evaluation, plot) = scores_of(args).map_err(NodeError::Refused)?;
    if let Some(path) = &args.plot {
        std::fs::write(path, plot)
            .with_context(|| format!("writing {}", path.display()))
            .map_err(NodeError::Refused)?;
    }
    print_as(&evaluation, args.json, Evaluation::table)
}

/// Prints `found` as a table, or as JSON.
fn print_as<T: serde::Serialize>(
    found: &T,
    json: bool,
    table: impl Fn(&T) -> String,
) -> Result<(), NodeError> {
    let text = if json {
        serde_json::to_string_pretty(found).map_err(NodeError::failed)?
    } else {
        table(found)
    };
    output::print(&format!("{text}\n")).map_err(NodeError::Failed)
}

fn repeatability_of(args: &EvaluateArgs) -> anyhow::Result<Repeatability> {
    let paths = [&args.poses, &args.truth].into_iter().chain(&args.others);
    let sessions = paths.map(|path| {
        let path = file_in(path, POSES)?;
        let file = File::open(&path).with_context(|| path.display().to_string())?;
        Ok(SessionAngles::read(BufReader::new(file), &path)?)
    });
    let sessions: Vec<SessionAngles> = sessions.collect::<anyhow::Result<_>>()?;
    Repeatability::of(&sessions).map_err(anyhow::Error::msg)
}

impl EvaluateArgs {
    /// Replaces folders by the files in them.
    fn with_files(self) -> anyhow::Result<Self> {
        Ok(Self {
            poses: file_in(&self.poses, POSES)?,
            truth: file_in(&self.truth, "truth.jsonl")?,
            beside: self.beside.map(|path| file_in(&path, POSES)).transpose()?,
            ..self
        })
    }

    /// Refuses to overwrite one of the inputs.
    fn check_plot(&self) -> anyhow::Result<()> {
        let place = |path: &Path| fs::canonicalize(path).ok();
        let Some(plot) = &self.plot else {
            return Ok(());
        };
        check_file("--plot", plot)?;
        let mut inputs = [&self.poses, &self.truth].into_iter().chain(&self.beside);
        let same = inputs.find(|it| place(it).is_some() && place(it) == place(plot));
        ensure!(
            same.is_none(),
            "--plot {}: this is one of the files that are compared",
            plot.display()
        );
        Ok(())
    }
}

/// The scores and their plot.
fn scores_of(args: &EvaluateArgs) -> anyhow::Result<(Evaluation, String)> {
    let truth = read(&args.truth, LinesRole::Truth, args)?;
    if truth.is_empty() {
        match &args.ticks {
            Some(ticks) => {
                bail!(
                    "{}: no person in ticks {}..{}",
                    args.truth.display(),
                    ticks.start,
                    ticks.end
                )
            }
            None => bail!(
                "{}: no line, expected one per tick and person",
                args.truth.display()
            ),
        }
    }
    let unknown = unknown_names(&truth, &args.truth);
    ensure!(
        truth.has_points(),
        "{}: none of the compared points is known for any person{}",
        args.truth.display(),
        appended(unknown.as_deref())
    );
    for warning in input_warning(args).iter().chain(&unknown) {
        say(format_args!("warning: {warning}"));
    }
    let poses = overlapping_poses(&truth, &args.poses, args)?;
    let rate_hz = rate_hz(args);
    let scored = |poses: &PoseLines, path: &Path| {
        let scores = score(poses, &truth, args.extent, rate_hz);
        let doubts = truth_warnings(poses, &truth, &scores);
        for doubt in &doubts {
            let shown = shown_with_truth(path, args);
            say(format_args!("warning: {shown}: {}", doubt.message));
        }
        Scored { scores, doubts }
    };
    let of_poses = scored(&poses, &args.poses);
    let beside = args.beside.as_ref().map(|path| {
        let poses = overlapping_poses(&truth, path, args)?;
        Ok::<_, anyhow::Error>(scored(&poses, path))
    });
    let title = format!("{}: mean error", args.poses.display());
    // Without a rate, time is counted in ticks.
    let plot = plot_of(&title, &poses, &truth, rate_hz.unwrap_or(1.0));
    let evaluation = Evaluation {
        scored: of_poses,
        beside: beside.transpose()?,
    };
    Ok((evaluation, plot))
}

/// A warning if the inputs seem to be swapped or are the same file; the scores would look good.
fn input_warning(args: &EvaluateArgs) -> Option<String> {
    let (poses, truth) = (args.poses.display(), args.truth.display());
    let same = |a: &Path, b: &Path| Some(fs::canonicalize(a).ok()? == fs::canonicalize(b).ok()?);
    if same(&args.poses, &args.truth) == Some(true) {
        return Some(format!("{poses} is scored against itself"));
    }
    let is_of_run = |path: &Path| {
        // A pipe can be read only once.
        let is_file = std::fs::metadata(path).ok()?.is_file();
        let file = is_file.then(|| File::open(path).ok())??;
        let mut line = String::new();
        BufReader::new(file.take(LONGEST_LINE_BYTES))
            .read_line(&mut line)
            .ok()?;
        let line: serde_json::Value = serde_json::from_str(&line).ok()?;
        // Only lines of a run have these fields.
        Some(line.get("state").is_some() && line.get("views").is_some())
    };
    (is_of_run(&args.truth)? && !is_of_run(&args.poses)?).then(|| {
        format!(
            "{truth} seems to contain the poses of a run and {poses} does not: expected POSES, then TRUTH"
        )
    })
}

/// A warning on points with unknown names, which are not compared.
fn unknown_names(lines: &PoseLines, path: &Path) -> Option<String> {
    let unknown = lines.unknown();
    (!unknown.is_empty()).then(|| {
        format!(
            "{}: found {unknown}: unknown names, not compared; expected the names that poses of a run have, \
             such as `left_hip`, `right_knee`",
            path.display()
        )
    })
}

/// Appends a further problem to a message.
fn appended(message: Option<&str>) -> String {
    message.map_or_else(String::new, |message| format!("; {message}"))
}

/// The poses of `path`, which must overlap with `truth`.
fn overlapping_poses(
    truth: &PoseLines,
    path: &Path,
    args: &EvaluateArgs,
) -> anyhow::Result<PoseLines> {
    let poses = read(path, LinesRole::Poses, args)?;
    let overlap = Overlap::of(&poses, truth);
    let shown = || shown_with_truth(path, args);
    let unknown = unknown_names(&poses, path);
    if let Some(refusal) = overlap.refusal() {
        let misread = misread(&poses, truth, None).map(|warning| warning.message);
        let [misread, unknown] = [&misread, &unknown].map(|it| appended(it.as_deref()));
        bail!("{}: {refusal}{misread}{unknown}", shown());
    }
    let warning = overlap.warning().map(|it| format!("{}: {it}", shown()));
    for warning in warning.iter().chain(&unknown) {
        say(format_args!("warning: {warning}"));
    }
    Ok(poses)
}

fn shown_with_truth(path: &Path, args: &EvaluateArgs) -> String {
    format!("{} and {}", path.display(), args.truth.display())
}

fn read(path: &Path, role: LinesRole, args: &EvaluateArgs) -> anyhow::Result<PoseLines> {
    let file = File::open(path).with_context(|| format!("opening {}", path.display()))?;
    let mut reader = BufReader::new(file);
    // Read errors are reported by the reader below.
    let is_recording = reader.fill_buf().is_ok_and(is_ours);
    ensure!(
        !is_recording,
        "{0}: found a recording, expected {1}: `farfield replay {0}` creates a run from it",
        path.display(),
        match role {
            LinesRole::Poses => "the folder of a run, or its poses.jsonl",
            LinesRole::Truth => "the truth as lines of text, or the folder of its truth.jsonl",
        }
    );
    Ok(PoseLines::read(
        reader,
        path,
        role,
        args.points,
        args.ticks.as_ref(),
    )?)
}

/// The requested rate, or that of a neighbouring file. A neighbour that is missing or has no rate is no error.
fn rate_hz(args: &EvaluateArgs) -> Option<f64> {
    let of_summary = || {
        let text = fs::read_to_string(args.poses.with_file_name("summary.json")).ok()?;
        serde_json::from_str::<serde_json::Value>(&text)
            .ok()?
            .get("rate_hz")?
            .as_f64()
    };
    let of_venue = || {
        let text = fs::read_to_string(args.truth.with_file_name("venue.toml")).ok()?;
        let rate = text.parse::<toml::Table>().ok()?.remove("rate_hz")?;
        rate.as_float()
            .or_else(|| rate.as_integer().map(|rate| rate as f64))
    };
    let neighbour = || of_summary().or_else(of_venue).filter(|&rate| is_rate(rate));
    args.rate_hz.or_else(neighbour)
}

fn is_rate(rate_hz: f64) -> bool {
    rate_hz.is_finite() && rate_hz > 0.0
}

/// The scores, with those of other poses of `--beside`.
#[derive(Debug, serde::Serialize)]
struct Evaluation {
    #[serde(flatten)]
    scored: Scored,
    #[serde(skip_serializing_if = "Option::is_none")]
    beside: Option<Scored>,
}

/// The scores of some poses.
#[derive(Debug, serde::Serialize)]
struct Scored {
    #[serde(flatten)]
    scores: Scores,
    /// Signs that the truth does not fit the poses.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    doubts: Vec<TruthWarning>,
}

impl Evaluation {
    fn table(&self) -> String {
        let scores = &self.scored.scores;
        let Some(Scored { scores: beside, .. }) = &self.beside else {
            return scores.to_string();
        };
        let named = [("POSES", scores), ("--beside", beside)];
        format!(
            "POSES: {}\n--beside: {}\n\n{}\nPOSES: {}\n--beside: {}\nPOSES: {}\n--beside: {}",
            scores.sentence(),
            beside.sentence(),
            side_by_side(15, &named),
            scores.identity_line(),
            beside.identity_line(),
            scores.lives,
            beside.lives
        )
    }
}

#[cfg(test)]
mod tests;
