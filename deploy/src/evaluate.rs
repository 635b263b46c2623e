//! `farfield evaluate POSES TRUTH`: how good a `poses.jsonl` is against a `truth.jsonl`.
//!
//! What can go wrong is mostly wrong input: a file that is not there, a line that cannot be read, a
//! truth with nothing to compare. That the result cannot be printed is not.

use std::fs::{self, File};
use std::io::{BufRead as _, BufReader, Read as _};
use std::ops::Range;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, anyhow, bail, ensure};
use farfield_node::process::{NodeError, say};
use farfield_proto::tick::{Tick, parse_range};
use farfield_score::lines::{LinesRole, PoseLines, TruthExtent};
use farfield_score::overlap::Overlap;
use farfield_score::plot::plot_of;
use farfield_score::points::PointSet;
use farfield_score::table::side_by_side;
use farfield_score::{Scores, score};

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
    /// Or the folder of the run.
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

/// What is printed as JSON: the scores, and what stands beside them.
#[derive(Debug, serde::Serialize)]
struct Evaluation {
    #[serde(flatten)]
    scores: Scores,
    #[serde(skip_serializing_if = "Option::is_none")]
    beside: Option<Scores>,
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

impl Evaluation {
    fn table(&self) -> String {
        let Some(beside) = &self.beside else {
            return self.scores.to_string();
        };
        let named = [("POSES", &self.scores), ("--beside", beside)];
        format!(
            "POSES: {}\n--beside: {}\n\n{}\nPOSES: {}\n--beside: {}\nPOSES: {}\n--beside: {}",
            self.scores.sentence(),
            beside.sentence(),
            side_by_side(15, &named),
            self.scores.identity_line(),
            beside.identity_line(),
            self.scores.lives,
            beside.lives
        )
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
    ensure!(
        truth.has_points(),
        "{}: none of the points that are compared is known of anybody",
        args.truth.display()
    );
    if let Some(doubt) = doubt(args) {
        say(format_args!("warning: {doubt}"));
    }
    let poses = poses_beside(&truth, &args.poses, args)?;
    let rate_hz = rate_hz(args);
    let beside = args.beside.as_ref().map(|path| {
        let poses = poses_beside(&truth, path, args)?;
        Ok::<_, anyhow::Error>(score(&poses, &truth, args.extent, rate_hz))
    });
    let title = format!("{}: mean error", args.poses.display());
    // Without a rate, time is counted in ticks.
    let plot = plot_of(&title, &poses, &truth, rate_hz.unwrap_or(1.0));
    let evaluation = Evaluation {
        scores: score(&poses, &truth, args.extent, rate_hz),
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

/// The poses of `path`, which must be of what `truth` is of.
fn poses_beside(truth: &PoseLines, path: &Path, args: &EvaluateArgs) -> anyhow::Result<PoseLines> {
    let poses = read(path, LinesRole::Poses, args)?;
    let overlap = Overlap::of(&poses, truth);
    let shown = || format!("{} and {}", path.display(), args.truth.display());
    if let Some(refusal) = overlap.refusal() {
        bail!("{}: {refusal}", shown());
    }
    if let Some(warning) = overlap.warning() {
        say(format_args!("warning: {}: {warning}", shown()));
    }
    Ok(poses)
}

fn read(path: &Path, role: LinesRole, args: &EvaluateArgs) -> anyhow::Result<PoseLines> {
    let file = File::open(path).with_context(|| format!("opening {}", path.display()))?;
    let reader = BufReader::new(file);
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
mod tests {
    use super::*;

    const LINE: &str = "{\"tick\": 5, \"person\": 1, \"joints\": {\"left_hip\": [0, 0, 1]}}\n";

    #[derive(clap::Parser)]
    struct EvaluateLine {
        #[command(flatten)]
        args: EvaluateArgs,
    }

    fn parsed(words: &[&str]) -> Result<EvaluateArgs, clap::Error> {
        let words = [&["evaluate"], words].concat();
        <EvaluateLine as clap::Parser>::try_parse_from(words).map(|line| line.args)
    }

    fn folder_with(truth: &str) -> (tempfile::TempDir, EvaluateArgs) {
        let folder = tempfile::tempdir().unwrap();
        let (poses, true_path) = (
            folder.path().join("poses.jsonl"),
            folder.path().join("truth.jsonl"),
        );
        fs::write(&poses, LINE).unwrap();
        fs::write(&true_path, truth).unwrap();
        let args = parsed(&[poses.to_str().unwrap(), true_path.to_str().unwrap()]).unwrap();
        (folder, args)
    }

    #[test]
    fn poses_and_a_truth_are_needed() {
        assert!(parsed(&[]).is_err());
        assert!(parsed(&["poses.jsonl"]).is_err());
        let args = parsed(&["poses.jsonl", "truth.jsonl", "--json"]).unwrap();
        assert_eq!(args.truth, Path::new("truth.jsonl"));
        assert!(args.json);
        assert_eq!(args.extent, TruthExtent::Whole);
        let partial = parsed(&["poses.jsonl", "truth.jsonl", "--truth", "partial"]).unwrap();
        assert_eq!(partial.extent, TruthExtent::Partial);
        let refused = parsed(&["p", "t", "--truth", "half"])
            .unwrap_err()
            .to_string();
        assert!(refused.contains("not one of whole, partial"), "{refused}");
    }

    #[test]
    fn other_poses_stand_beside_row_by_row() {
        let (folder, mut args) = folder_with(LINE);
        let other = folder.path().join("other.jsonl");
        fs::write(&other, LINE.replace("[0, 0, 1]", "[0, 0, 1.1]")).unwrap();
        args.beside = Some(other);
        let (evaluation, plot) = scores_of(&args).unwrap();
        let table = evaluation.table();
        assert!(
            table.contains("POSES") && table.contains("100.0"),
            "{table}"
        );
        let json = serde_json::to_value(&evaluation).unwrap();
        assert_eq!(json["actors"]["1"]["frames"], 1);
        assert_eq!(json["beside"]["actors"]["1"]["frames"], 1);
        assert!(plot.starts_with("<svg"));
    }

    fn refused(args: &EvaluateArgs) -> String {
        format!("{:#}", scores_of(args).err().unwrap())
    }

    #[test]
    fn a_truth_without_anything_to_compare_is_refused() {
        let (_folder, mut args) = folder_with("");
        assert!(refused(&args).ends_with("truth.jsonl: no line, expected one per tick and person"));
        fs::write(&args.truth, LINE.replace("left_hip", "spine")).unwrap();
        assert!(refused(&args).contains("none of the points"));
        fs::write(&args.truth, LINE).unwrap();
        args.ticks = Some(Tick(0)..Tick(5));
        assert!(refused(&args).ends_with("nobody is there in ticks 0..5"));
    }

    #[test]
    fn poses_of_another_run_are_refused() {
        let (_folder, args) = folder_with(&LINE.replace("\"tick\": 5", "\"tick\": 50"));
        let said = refused(&args);
        assert!(said.contains("the poses have ticks 5 to 5"), "{said}");
        assert!(said.contains("truth.jsonl: no tick in common"), "{said}");
    }

    #[test]
    fn who_swaps_poses_and_truth_or_names_one_twice_is_told() {
        let (_folder, mut args) = folder_with(LINE);
        assert_eq!(doubt(&args), None);
        let of_run = LINE.replace(
            "\"person\": 1",
            "\"person\": 1, \"state\": \"tracked\", \"views\": 4",
        );
        fs::write(&args.truth, of_run).unwrap();
        assert!(doubt(&args).unwrap().contains("expected POSES, then TRUTH"));
        args.truth.clone_from(&args.poses);
        assert!(doubt(&args).unwrap().contains("against itself"));
    }

    #[test]
    fn a_missing_file_is_named() {
        let (folder, args) = folder_with(LINE);
        fs::remove_file(&args.poses).unwrap();
        assert!(refused(&args).contains(&folder.path().join("poses.jsonl").display().to_string()));
    }

    #[test]
    fn the_rate_comes_from_the_caller_then_the_summary_then_the_venue() {
        let (folder, mut args) = folder_with(LINE);
        assert_eq!(rate_hz(&args), None);
        fs::write(folder.path().join("venue.toml"), "rate_hz = 25").unwrap();
        assert_eq!(rate_hz(&args), Some(25.0));
        fs::write(folder.path().join("summary.json"), "{\"rate_hz\": 60.0}").unwrap();
        assert_eq!(rate_hz(&args), Some(60.0));
        args.rate_hz = Some(50.0);
        assert_eq!(rate_hz(&args), Some(50.0));
        args.rate_hz = Some(0.0);
        assert!(evaluate(&args).is_err());
    }
}
