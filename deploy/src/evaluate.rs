//! `farfield evaluate POSES TRUTH`: how good a `poses.jsonl` is against a `truth.jsonl`.
//!
//! What can go wrong is mostly wrong input: a file that is not there, a line that cannot be read, a
//! truth with nothing to compare. That the result cannot be printed is not.

mod evaluation;

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
use farfield_score::score;
use farfield_score::truth_warnings::{misread, truth_warnings};

use self::evaluation::{Evaluation, Scored};
use crate::exchange::place::POSES;
use crate::exchange::target::{check_file, file_in};
use crate::output;

/// Longest line that is looked at to see what a file is, bytes.
const LONGEST_LINE_BYTES: u64 = 64 << 10;

/// What `farfield evaluate` is told.
#[derive(Debug, Clone, clap::Args)]
pub(crate) struct EvaluateArgs {
    /// The poses, as `farfield run` writes them.
    ///
    /// Or the folder of the run. Of a recording `farfield replay` makes one.
    poses: PathBuf,
    /// The truth, one line per tick and person.
    ///
    /// With those joints and keypoints that are known; or the folder of its `truth.jsonl`.
    truth: PathBuf,
    /// Other poses of the same truth, to stand beside.
    #[arg(long, value_name = "POSES")]
    beside: Option<PathBuf>,
    /// What to compare: joints, keypoints or shelf14.
    #[arg(long, default_value = "joints")]
    points: PointSet,
    /// Whether TRUTH holds everybody.
    ///
    /// whole: whoever is not in it was not there; partial: annotated in part, and poses of whom it does not hold are not
    /// held against anybody.
    #[arg(
        id = "truth-extent",
        long = "truth",
        default_value = "whole",
        value_name = "whole|partial"
    )]
    extent: TruthExtent,
    /// Only these ticks, B not among them.
    #[arg(long, value_parser = parse_range, value_name = "A..B", allow_hyphen_values = true)]
    ticks: Option<Range<Tick>>,
    /// Ticks per second, for jitter and foot slide.
    ///
    /// Default: that of the summary.json beside POSES, else that of the venue.toml beside TRUTH; without any the two are
    /// left out.
    #[arg(long, value_name = "HZ")]
    rate_hz: Option<f64>,
    /// Print the scores, or what went wrong, as JSON.
    #[arg(long)]
    pub(crate) json: bool,
    /// Draw the errors over time into this SVG file.
    #[arg(long, value_name = "FILE")]
    plot: Option<PathBuf>,
}

/// Scores the poses, and prints the result.
///
/// # Errors
/// When a file is missing or wrong, when the truth holds nothing to compare, or when the result cannot be
/// printed or drawn.
pub(crate) fn evaluate(args: &EvaluateArgs) -> Result<(), NodeError> {
    if let Some(rate) = args.rate_hz.filter(|&rate| !is_rate(rate)) {
        let problem = anyhow!("--rate-hz: found {rate}, expected a number above 0");
        return Err(NodeError::Refused(problem));
    }
    let args = &args.clone().of_files().map_err(NodeError::Refused)?;
    args.check_plot().map_err(NodeError::Refused)?;
    let (evaluation, plot) = scores_of(args).map_err(NodeError::Refused)?;
    if let Some(path) = &args.plot {
        std::fs::write(path, plot)
            .with_context(|| format!("writing {}", path.display()))
            .map_err(NodeError::Refused)?;
    }
    let text = if args.json {
        serde_json::to_string_pretty(&evaluation).map_err(NodeError::failed)?
    } else {
        evaluation.table()
    };
    output::print(&format!("{text}\n")).map_err(NodeError::Failed)
}

impl EvaluateArgs {
    /// The same, with the files that its folders stand for.
    fn of_files(self) -> anyhow::Result<Self> {
        Ok(Self {
            poses: file_in(&self.poses, POSES)?,
            truth: file_in(&self.truth, "truth.jsonl")?,
            beside: self.beside.map(|path| file_in(&path, POSES)).transpose()?,
            ..self
        })
    }

    /// Refuses to draw over what is compared.
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

/// The scores, and the plot of them.
fn scores_of(args: &EvaluateArgs) -> anyhow::Result<(Evaluation, String)> {
    let truth = read(&args.truth, LinesRole::Truth, args)?;
    if truth.is_empty() {
        match &args.ticks {
            Some(ticks) => {
                bail!(
                    "{}: nobody is there in ticks {}..{}",
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
        "{}: none of the points that are compared is known of anybody{}",
        args.truth.display(),
        after(unknown.as_deref())
    );
    for warning in doubt(args).iter().chain(&unknown) {
        say(format_args!("warning: {warning}"));
    }
    let poses = poses_beside(&truth, &args.poses, args)?;
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
        let poses = poses_beside(&truth, path, args)?;
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

/// What speaks against TRUTH being one, if anything does: whoever swaps the two, or names one twice, gets fine figures.
fn doubt(args: &EvaluateArgs) -> Option<String> {
    let (poses, truth) = (args.poses.display(), args.truth.display());
    let same = |a: &Path, b: &Path| Some(fs::canonicalize(a).ok()? == fs::canonicalize(b).ok()?);
    if same(&args.poses, &args.truth) == Some(true) {
        return Some(format!("{poses} is scored against itself"));
    }
    let is_of_run = |path: &Path| {
        // A pipe can be read once only.
        let is_file = std::fs::metadata(path).ok()?.is_file();
        let file = is_file.then(|| File::open(path).ok())??;
        let mut line = String::new();
        BufReader::new(file.take(LONGEST_LINE_BYTES))
            .read_line(&mut line)
            .ok()?;
        let line: serde_json::Value = serde_json::from_str(&line).ok()?;
        // Only a run knows these.
        Some(line.get("state").is_some() && line.get("views").is_some())
    };
    (is_of_run(&args.truth)? && !is_of_run(&args.poses)?).then(|| {
        format!(
            "{truth} looks like the poses of a run and {poses} does not: expected POSES, then TRUTH"
        )
    })
}

/// Which points of a file are compared with nothing, since nobody knows their names, if any are.
fn unknown_names(lines: &PoseLines, path: &Path) -> Option<String> {
    let unknown = lines.unknown();
    (!unknown.is_empty()).then(|| {
        format!(
            "{}: found {unknown}, names that nobody here knows: compared with nothing; expected the names that poses of a run \
             have, such as `left_hip`, `right_knee`",
            path.display()
        )
    })
}

/// What else there is to say, behind a refusal.
fn after(said: Option<&str>) -> String {
    said.map_or_else(String::new, |said| format!("; {said}"))
}

/// The poses of `path`, which must be of what `truth` is of.
fn poses_beside(truth: &PoseLines, path: &Path, args: &EvaluateArgs) -> anyhow::Result<PoseLines> {
    let poses = read(path, LinesRole::Poses, args)?;
    let overlap = Overlap::of(&poses, truth);
    let shown = || shown_with_truth(path, args);
    let unknown = unknown_names(&poses, path);
    if let Some(refusal) = overlap.refusal() {
        let misread = misread(&poses, truth, None).map(|warning| warning.message);
        let [misread, unknown] = [&misread, &unknown].map(|it| after(it.as_deref()));
        bail!("{}: {refusal}{misread}{unknown}", shown());
    }
    let doubted = overlap.warning().map(|it| format!("{}: {it}", shown()));
    for warning in doubted.iter().chain(&unknown) {
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
    // What cannot be read is told by who reads on.
    let is_recording = reader.fill_buf().is_ok_and(is_ours);
    ensure!(
        !is_recording,
        "{0}: found a recording, expected {1}: `farfield replay {0}` makes a run of it",
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

/// The rate that was asked for, or the one that a file beside the lines tells. A neighbour that
/// tells none, or is not there, is no error: it was not named.
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
    let told = || of_summary().or_else(of_venue).filter(|&rate| is_rate(rate));
    args.rate_hz.or_else(told)
}

fn is_rate(rate_hz: f64) -> bool {
    rate_hz.is_finite() && rate_hz > 0.0
}

#[cfg(test)]
mod tests;
