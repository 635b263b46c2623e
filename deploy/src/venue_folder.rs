//! Writes the files of the venue folder of a scene.

use std::fs;
use std::ops::Range;
use std::path::Path;

use anyhow::Context as _;
use farfield_fusion::export::unfinished::Unfinished;
use farfield_proto::tick::Tick;
use farfield_sim::embedded;
use farfield_sim::scene::Scene;
use farfield_sim::scene::write::{calibration_text, write_truth_at as write_lines};
use tempfile::TempDir;

/// The calibration's name in a venue folder.
pub(crate) const CALIBRATION: &str = "calibration.toml";

/// Writes a file and creates its folder.
///
/// # Errors
/// Names the file.
pub(crate) fn write(path: &Path, bytes: &[u8]) -> anyhow::Result<()> {
    let write = || {
        if let Some(folder) = path.parent() {
            fs::create_dir_all(folder)?;
        }
        fs::write(path, bytes)
    };
    write().with_context(|| format!("writing {}", path.display()))
}

/// Writes the calibration of the scene's cameras.
///
/// # Errors
/// Names the file.
pub(crate) fn write_calibration(scene: &Scene, folder: &Path) -> anyhow::Result<()> {
    write(
        &folder.join(CALIBRATION),
        calibration_text(scene.cameras()).as_bytes(),
    )
}

/// Writes the truth of `ticks`, one line per tick and person. The file gets its name when it is whole.
///
/// # Errors
/// Names the file.
pub(crate) fn write_truth(scene: &Scene, ticks: &Range<Tick>, path: &Path) -> anyhow::Result<()> {
    let ticks = (ticks.start.0..ticks.end.0).map(Tick);
    write_truth_at(scene, ticks.map(|tick| (tick, scene.time_s(tick))), path)
}

/// Like [`write_truth`], with the scene time of every tick, seconds.
///
/// # Errors
/// Names the file.
pub(crate) fn write_truth_at(
    scene: &Scene,
    moments: impl Iterator<Item = (Tick, f64)>,
    path: &Path,
) -> anyhow::Result<()> {
    let write = || {
        let mut file = Unfinished::create(path)?;
        write_lines(scene, moments, &mut file)?;
        file.finish()
    };
    write().with_context(|| format!("writing {}", path.display()))
}

/// Writes the embedded network and its card. Returns the card's path relative to `folder`.
///
/// # Errors
/// Names the file.
pub(crate) fn write_network(folder: &Path) -> anyhow::Result<String> {
    let card = embedded::write_network(&folder.join("models"))?;
    Ok(format!("models/{card}"))
}

/// Writes the embedded detector and its card. Returns the card's path relative to `folder`.
///
/// # Errors
/// Names the file.
pub(crate) fn write_detector(folder: &Path) -> anyhow::Result<String> {
    let card = embedded::write_detector(&folder.join("models"))?;
    Ok(format!("models/{card}"))
}

/// A temporary folder in the same parent as `out`; the parent is created.
///
/// # Errors
/// Names the folder that cannot be created.
pub(crate) fn temporary_sibling(out: &Path) -> anyhow::Result<TempDir> {
    let parent = match out.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    };
    fs::create_dir_all(parent).with_context(|| format!("making {}", parent.display()))?;
    tempfile::Builder::new()
        .prefix(".farfield-")
        .tempdir_in(parent)
        .with_context(|| format!("making a folder in {}", parent.display()))
}

/// Renames a folder to its final name. An empty folder of that name is replaced.
///
/// # Errors
/// When the name exists by then.
pub(crate) fn give_name(folder: TempDir, out: &Path) -> anyhow::Result<()> {
    let made = folder.keep();
    let renamed = open_to_all(&made).and_then(|()| fs::rename(&made, out));
    if renamed.is_err() {
        // The failure to rename is the one to report.
        drop(fs::remove_dir_all(&made));
    }
    renamed.with_context(|| format!("naming the finished folder {}", out.display()))
}

/// A temporary folder is private to its user; a finished one is readable like any other.
fn open_to_all(folder: &Path) -> std::io::Result<()> {
    use std::os::unix::fs::PermissionsExt as _;
    fs::set_permissions(folder, fs::Permissions::from_mode(0o755))
}
