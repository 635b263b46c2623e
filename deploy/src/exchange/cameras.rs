//! The cameras that an export shows.

use std::fs;
use std::path::Path;

use anyhow::{Context as _, ensure};
use farfield_node::files::load_venue;
use farfield_proto::camera::CameraModel;
use serde::Deserialize;

/// The venue that a demo or a simulation leaves in its folder.
const VENUE: &str = "venue/venue.toml";

/// What a summary says of the venue's files.
#[derive(Debug, Deserialize)]
struct Hashes {
    calibration_hash: Option<String>,
}

/// The cameras of the run with this `summary`, where its venue is `given` or lies in its folder.
///
/// # Errors
/// When the venue or the summary cannot be read, or the venue that is given is of another calibration.
pub(super) fn of_run(given: Option<&Path>, summary: &Path) -> anyhow::Result<Vec<CameraModel>> {
    // Smoothed poses lie deeper in the folder of their run.
    let beside = summary.parent().unwrap_or(Path::new(".")).join(VENUE);
    let Some(path) = given.or(beside.is_file().then_some(&*beside)) else {
        return Ok(Vec::new());
    };
    let venue = load_venue(path)?;
    let reading = || format!("reading {}", summary.display());
    let text = fs::read_to_string(summary).with_context(reading)?;
    let said: Hashes = serde_json::from_str(&text).with_context(reading)?;
    let is_same = said
        .calibration_hash
        .is_none_or(|of| of == venue.hashes.calibration);
    ensure!(
        is_same || given.is_none(),
        "--venue: {}: found another calibration than that of the run, expected the venue as it was",
        path.display()
    );
    let cameras = venue.cameras.into_iter().filter(|_| is_same);
    Ok(cameras.map(|camera| camera.model).collect())
}
