//! The score of a demo against its truth: what `farfield evaluate` prints.

use std::fs::File;
use std::io::BufReader;
use std::ops::Range;
use std::path::Path;

use anyhow::Context as _;
use farfield_proto::tick::Tick;
use farfield_score::lines::{LinesRole, PoseLines, TruthExtent};
use farfield_score::points::PointSet;
use farfield_score::score;

/// The table of the score, to joints.
pub(super) fn table(
    poses: &Path,
    truth: &Path,
    ticks: &Range<Tick>,
    rate_hz: f64,
) -> anyhow::Result<String> {
    let poses = read(poses, LinesRole::Poses, ticks)?;
    let truth = read(truth, LinesRole::Truth, ticks)?;
    if truth.is_empty() {
        return Ok("nobody was there to score against\n".to_owned());
    }
    let scores = score(&poses, &truth, TruthExtent::Whole, Some(rate_hz));
    Ok(format!("{scores}\n"))
}

fn read(path: &Path, role: LinesRole, ticks: &Range<Tick>) -> anyhow::Result<PoseLines> {
    let file = File::open(path).with_context(|| format!("opening {}", path.display()))?;
    let reader = BufReader::new(file);
    Ok(PoseLines::read(
        reader,
        path,
        role,
        PointSet::Joints,
        Some(ticks),
    )?)
}
