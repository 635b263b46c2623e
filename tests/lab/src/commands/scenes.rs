//! Scenes on the command line, and scenes as venues of maps for live studies.

use std::convert::Infallible;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::str::FromStr;

use anyhow::{Context as _, ensure};
use farfield_node::process::NodeError;
use farfield_sim::embedded;
use farfield_sim::scene::Scene;

/// The default scene: eight players on a court with four viewpoints.
const SCENE: &str = "futsal";

/// A venue made of a scene.
pub(super) struct MadeMaps {
    /// This program, which is the operator's command too.
    pub(super) program: PathBuf,
    /// The venue file.
    pub(super) venue: PathBuf,
    /// The truth of its ticks.
    pub(super) truth: PathBuf,
}

/// Writes the venue of `scene` (default: an embedded one) to `folder`, with `more` arguments of `farfield simulate` and
/// `parameters` at the end of its file.
///
/// # Errors
/// `farfield simulate` fails, or a file cannot be written.
pub(super) fn make_maps(
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
    let stderr = String::from_utf8_lossy(&simulated.stderr);
    ensure!(simulated.status.success(), "making the maps: {stderr}");
    let venue = made.join("venue.toml");
    let text = std::fs::read_to_string(&venue)?;
    std::fs::write(&venue, format!("{text}\n{parameters}"))?;
    Ok(MadeMaps {
        program,
        venue,
        truth: made.join("truth.jsonl"),
    })
}

/// A scene file, or the name of an embedded scene.
#[derive(Debug, Clone)]
pub(super) struct SceneArgument(String);

impl SceneArgument {
    /// The argument.
    pub(super) fn name(&self) -> &str {
        &self.0
    }

    /// Reads the scene.
    ///
    /// # Errors
    /// Contains the file and what is wrong with it, or the names of embedded scenes.
    pub(super) fn load(&self) -> Result<Scene, NodeError> {
        let path = Path::new(&self.0);
        let scene = if path.exists() {
            Scene::load(path)
        } else {
            embedded::scene(&self.0)
        };
        scene.map_err(NodeError::refused)
    }
}

impl FromStr for SceneArgument {
    type Err = Infallible;

    fn from_str(text: &str) -> Result<Self, Infallible> {
        Ok(Self(text.to_owned()))
    }
}
