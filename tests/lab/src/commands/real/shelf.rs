//! The Shelf against its hand-made truth, actors 1 to 3.

use std::fmt;
use std::fs::File;
use std::io::BufReader;
use std::path::Path;
use std::process::Command;

use anyhow::{Context as _, ensure};
use farfield_score::lines::{LinesRole, PoseLines, TruthExtent};
use farfield_score::points::PointSet;
use farfield_score::{ActorScore, score};

/// Least mean-end and both-ends PCP, percent: what was reached, less a tenth of what is missing to 100.
const LEAST: [[f64; 2]; 2] = [[97.4, 95.5], [97.1, 96.2]];

/// The actors of the literature.
const ACTORS: [u32; 3] = [1, 2, 3];

/// PCP with mean ends and with both ends, percent, and mean distance.
struct PartsScore {
    name: &'static str,
    mean_end: f64,
    both_ends: f64,
    mpjpe_mm: f64,
}

/// Scores with all limbs, and with the 8 of the arms and legs.
pub(super) struct ShelfScore(Vec<PartsScore>);

impl ShelfScore {
    /// Runs the venue in `folder` and scores it.
    ///
    /// # Errors
    /// The run fails, or a file cannot be read.
    pub(super) fn measure(folder: &Path) -> anyhow::Result<Self> {
        let scratch = tempfile::tempdir()?;
        let out = scratch.path().join("out");
        let mut run = Command::new(std::env::current_exe()?);
        run.arg("run")
            .arg(folder.join("venue.toml"))
            .arg("--out")
            .arg(&out);
        let done = run.output().context("running the Shelf")?;
        let stderr = String::from_utf8_lossy(&done.stderr);
        ensure!(done.status.success(), "the Shelf: {stderr}");
        let of = |name, points| -> anyhow::Result<PartsScore> {
            let read = |path: &Path, role| -> anyhow::Result<PoseLines> {
                let file = BufReader::new(File::open(path)?);
                Ok(PoseLines::read(file, path, role, points, None)?)
            };
            let poses = read(&out.join("poses.jsonl"), LinesRole::Poses)?;
            let truth = read(&folder.join("truth.jsonl"), LinesRole::Truth)?;
            let scores = score(&poses, &truth, TruthExtent::Partial, None);
            let mean = |figure: fn(&ActorScore) -> Option<f64>| {
                let of = ACTORS.map(|actor| scores.actors.get(&actor).and_then(figure));
                of.into_iter().map(Option::unwrap_or_default).sum::<f64>() / ACTORS.len() as f64
            };
            Ok(PartsScore {
                name,
                mean_end: mean(|it| it.pcp_mean_end),
                both_ends: mean(|it| it.pcp_both_ends),
                mpjpe_mm: mean(|it| it.mpjpe_mm),
            })
        };
        Ok(Self(vec![
            of("shelf14", PointSet::Shelf14)?,
            of("8 limbs", PointSet::Keypoints)?,
        ]))
    }

    /// What is wrong if a score is too low.
    pub(super) fn failure(&self) -> Option<String> {
        let low = self
            .0
            .iter()
            .zip(LEAST)
            .find(|(it, [mean_end, both_ends])| {
                it.mean_end < *mean_end || it.both_ends < *both_ends
            });
        low.map(|(it, [mean_end, both_ends])| {
            format!("Shelf, {it}: at least {mean_end} and {both_ends} are expected")
        })
    }
}

impl fmt::Display for PartsScore {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            name,
            mean_end,
            both_ends,
            mpjpe_mm,
        } = self;
        write!(
            f,
            "{name}: PCP mean-end {mean_end:.2}, both-ends {both_ends:.2} %, {mpjpe_mm:.1} mm"
        )
    }
}

impl fmt::Display for ShelfScore {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0
            .iter()
            .try_for_each(|it| writeln!(f, "Shelf, actors 1 to 3, {it}"))
    }
}
