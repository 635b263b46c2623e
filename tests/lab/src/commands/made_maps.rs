//! A scene as a venue of maps made beforehand, for studies that run live.

use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context as _, ensure};
use farfield_sim::embedded;

/// The scene of a study where none is named: eight players on a court with four viewpoints.
const SCENE: &str = "futsal";

/// A venue made of a scene.
pub(super) struct MadeMaps {
    /// The operator's command: this program.
    pub(super) program: PathBuf,
    /// The venue file.
    pub(super) venue: PathBuf,
    /// The truth of its ticks.
    pub(super) truth: PathBuf,
}

/// Makes the venue of `scene` (the embedded one where none is named) in `folder`, with `more` arguments
/// of `farfield simulate` and `parameters` at the end of its file.
///
/// # Errors
/// What `farfield simulate` says, and a file that cannot be written.
pub(super) fn make(
    scene: Option<&Path>,
    folder: &Path,
    more: &[&str],
    parameters: &str,
) -> anyhow::Result<MadeMaps> {
    let program = std::env::current_exe().context("finding this program's own file")?;
    let scene = match scene {
        Some(scene) => scene.to_owned(),
        None => embedded::write_scene(SCENE, folder)?,
    };
    let made = folder.join("venue");
    let simulated = Command::new(&program)
        .arg("simulate")
        .arg(&scene)
        .args(["--as", "maps", "--out"])
        .arg(&made)
        .args(more)
        .output()
        .context("making the maps")?;
    let said = String::from_utf8_lossy(&simulated.stderr);
    ensure!(simulated.status.success(), "making the maps: {said}");
    let venue = made.join("venue.toml");
    let text = std::fs::read_to_string(&venue)?;
    std::fs::write(&venue, format!("{text}\n{parameters}"))?;
    Ok(MadeMaps {
        program,
        venue,
        truth: made.join("truth.jsonl"),
    })
}
