//! `--overlay`: the skeletons of single ticks over the picture of every camera.

use std::path::Path;

use super::check::RunPlan;
use crate::overlay::{draw_poses, overlay};

/// Draws every tick that the plan asks for, with the poses that the run has recorded.
pub(super) fn draw(plan: &RunPlan, out: &Path) -> anyhow::Result<()> {
    let of = (&plan.venue, &plan.overlay[..], &*out.join("poses.jsonl"));
    draw_poses(of, out, |camera, tick, persons| {
        overlay(&plan.sources, &plan.venue, camera, tick, persons)
    })
}
