//! `farfield evaluate POSES TRUTH`: how good a `poses.jsonl` is against a `truth.jsonl`.
//!
//! What can go wrong is mostly wrong input: a file that is not there, a line that cannot be read, a
//! truth with nothing to compare. That the result cannot be printed is not.

use std::fs::{self, File};
use std::io::BufReader;
use std::ops::Range;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail, ensure};
use farfield_fusion::node::NodeError;
use farfield_fusion::score::lines::{Recording, Role};
use farfield_fusion::score::points::PointSet;
use farfield_fusion::score::{Scores, score};
use farfield_proto::tick::{Tick, parse_range};

use crate::output;

/// What `farfield evaluate` is told.
#[derive(Debug, Clone, clap::Args)]
pub(crate) struct EvaluateArgs {
    /// The poses, as `farfield run` writes them.
    pub poses: PathBuf,
    /// The truth: one line per tick and person, with those joints and keypoints that are known.
    pub truth: PathBuf,
    /// Which points to compare: joints, keypoints or shelf14.
    #[arg(long, default_value = "joints")]
    pub points: PointSet,
    /// Only these ticks, A..B (B not among them).
    #[arg(long, value_parser = parse_range, value_name = "A..B", allow_hyphen_values = true)]
    pub ticks: Option<Range<Tick>>,
    /// Ticks per second, for jitter and foot slide. Default: that of the summary.json beside POSES,
    /// else that of the venue.toml beside TRUTH; without any the two are left out.
    #[arg(long, value_name = "HZ")]
    pub rate_hz: Option<f64>,
    /// Print JSON instead of a table.
    #[arg(long)]
    pub json: bool,
}

/// Scores the poses and prints the result.
///
/// # Errors
/// When a file is missing or wrong, when the truth holds nothing to compare, or when the result
/// cannot be printed.
pub(crate) fn evaluate(args: &EvaluateArgs) -> Result<(), NodeError> {
    let scores = scores_of(args).map_err(NodeError::Refused)?;
    let text = if args.json {
        serde_json::to_string_pretty(&scores).map_err(NodeError::failed)?
    } else {
        scores.to_string()
    };
    output::print(&format!("{text}\n")).map_err(NodeError::Failed)
}

fn scores_of(args: &EvaluateArgs) -> anyhow::Result<Scores> {
    let truth = read(&args.truth, Role::Truth, args)?;
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
    let poses = read(&args.poses, Role::Poses, args)?;
    Ok(score(&poses, &truth, rate_hz(args)?))
}

fn read(path: &Path, role: Role, args: &EvaluateArgs) -> anyhow::Result<Recording> {
    let file = File::open(path).with_context(|| format!("opening {}", path.display()))?;
    let reader = BufReader::new(file);
    Ok(Recording::read(
        reader,
        path,
        role,
        args.points,
        args.ticks.as_ref(),
    )?)
}

/// The rate that was asked for, or the one that a file beside the lines tells. A neighbour that
/// tells none, or is not there, is no error: it was not named.
fn rate_hz(args: &EvaluateArgs) -> anyhow::Result<Option<f64>> {
    if let Some(rate) = args.rate_hz {
        ensure!(
            is_rate(rate),
            "--rate-hz: found {rate}, expected a number above 0"
        );
        return Ok(Some(rate));
    }
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
    Ok(of_summary().or_else(of_venue).filter(|&rate| is_rate(rate)))
}

fn is_rate(rate_hz: f64) -> bool {
    rate_hz.is_finite() && rate_hz > 0.0
}

#[cfg(test)]
mod tests {
    use super::*;

    const LINE: &str = "{\"tick\": 5, \"person\": 1, \"joints\": {\"left_hip\": [0, 0, 1]}}\n";

    fn folder_with(truth: &str) -> (tempfile::TempDir, EvaluateArgs) {
        let folder = tempfile::tempdir().unwrap();
        let args = EvaluateArgs {
            poses: folder.path().join("poses.jsonl"),
            truth: folder.path().join("truth.jsonl"),
            points: PointSet::Joints,
            ticks: None,
            rate_hz: None,
            json: false,
        };
        fs::write(&args.poses, LINE).unwrap();
        fs::write(&args.truth, truth).unwrap();
        (folder, args)
    }

    fn refused(args: &EvaluateArgs) -> String {
        format!("{:#}", scores_of(args).unwrap_err())
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
    fn a_missing_file_is_named() {
        let (folder, args) = folder_with(LINE);
        fs::remove_file(&args.poses).unwrap();
        assert!(refused(&args).contains(&folder.path().join("poses.jsonl").display().to_string()));
    }

    #[test]
    fn the_rate_comes_from_the_caller_then_the_summary_then_the_venue() {
        let (folder, mut args) = folder_with(LINE);
        assert_eq!(rate_hz(&args).unwrap(), None);
        fs::write(folder.path().join("venue.toml"), "rate_hz = 25").unwrap();
        assert_eq!(rate_hz(&args).unwrap(), Some(25.0));
        fs::write(folder.path().join("summary.json"), "{\"rate_hz\": 60.0}").unwrap();
        assert_eq!(rate_hz(&args).unwrap(), Some(60.0));
        args.rate_hz = Some(50.0);
        assert_eq!(rate_hz(&args).unwrap(), Some(50.0));
        args.rate_hz = Some(0.0);
        assert!(rate_hz(&args).is_err());
    }
}
