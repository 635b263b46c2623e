//! The project's own motion clips and scenes, embedded so that the program needs no other file.
//!
//! [`scene`] loads an embedded scene without disk access; [`with_clips`] loads the caller's scene.
//! [`write_scene`] writes a scene with its clips into a folder, for processes that read files.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use farfield_proto::toml_file::FileError;

use crate::motion::Clip;
use crate::scene::Scene;
use crate::scene::file::SceneFile;

/// The motion clips, BVH text by name.
pub const CLIPS: &[(&str, &str)] = &[
    ("walk", include_str!("../../clips/walk.bvh")),
    ("jog", include_str!("../../clips/jog.bvh")),
    ("run", include_str!("../../clips/run.bvh")),
    ("sprint", include_str!("../../clips/sprint.bvh")),
    ("idle", include_str!("../../clips/idle.bvh")),
    ("turn", include_str!("../../clips/turn.bvh")),
    ("wave", include_str!("../../clips/wave.bvh")),
    ("kick", include_str!("../../clips/kick.bvh")),
    ("jump", include_str!("../../clips/jump.bvh")),
    ("lift", include_str!("../../clips/lift.bvh")),
    ("punch", include_str!("../../clips/punch.bvh")),
    ("guard", include_str!("../../clips/guard.bvh")),
    ("cartwheel", include_str!("../../clips/cartwheel.bvh")),
];

/// The scenes, TOML text by name; the first line of each states its purpose.
pub const SCENES: &[(&str, &str)] = &[
    ("court", include_str!("../../scenes/court.toml")),
    ("one", include_str!("../../scenes/one.toml")),
    ("inverted", include_str!("../../scenes/inverted.toml")),
    ("facing", include_str!("../../scenes/facing.toml")),
    (
        "facing-inverted",
        include_str!("../../scenes/facing-inverted.toml"),
    ),
    ("five", include_str!("../../scenes/five.toml")),
    (
        "five-inverted",
        include_str!("../../scenes/five-inverted.toml"),
    ),
    ("futsal", include_str!("../../scenes/futsal.toml")),
    ("sprint", include_str!("../../scenes/sprint.toml")),
    ("enter", include_str!("../../scenes/enter.toml")),
    ("blocked", include_str!("../../scenes/blocked.toml")),
    ("cross", include_str!("../../scenes/cross.toml")),
    ("hug", include_str!("../../scenes/hug.toml")),
    ("scrum", include_str!("../../scenes/scrum.toml")),
    ("long-hug", include_str!("../../scenes/long-hug.toml")),
    (
        "side-by-side",
        include_str!("../../scenes/side-by-side.toml"),
    ),
    ("stage", include_str!("../../scenes/stage.toml")),
    ("legs", include_str!("../../scenes/legs.toml")),
    ("lost", include_str!("../../scenes/lost.toml")),
    ("return", include_str!("../../scenes/return.toml")),
    ("mirror", include_str!("../../scenes/mirror.toml")),
    ("poster", include_str!("../../scenes/poster.toml")),
];

/// Folder of the scenes, next to the folder of the clips.
const SCENE_FOLDER: &str = "scenes";

/// The scene `name` (its file name without extension), with clips from [`CLIPS`].
///
/// # Errors
/// [`FileError`] that lists the embedded scenes, for an unknown name.
pub fn scene(name: &str) -> Result<Scene, FileError> {
    let path = scene_path(name);
    with_clips(text_of(SCENES, name, &path)?, &path)
}

/// The scene in `text`, with clips from [`CLIPS`]. Paths in `text` are relative to `path`, which
/// errors also name.
///
/// # Errors
/// [`FileError`] for an invalid scene, or a clip that is not embedded.
pub fn with_clips(text: &str, path: &Path) -> Result<Scene, FileError> {
    Scene::parse(text, path, &mut |clip| {
        Ok(Arc::new(Clip::parse(clip_text(clip)?, clip)?))
    })
}

/// Writes the scene `name` and its clips below `folder`, and returns the path of the scene.
/// Replaces existing files.
///
/// # Errors
/// [`FileError`] for a name that is not embedded, and a folder or file that cannot be written.
pub fn write_scene(name: &str, folder: &Path) -> Result<PathBuf, FileError> {
    write_scene_with_clips(text_of(SCENES, name, &scene_path(name))?, name, folder)
}

/// As [`write_scene`], for the scene in `text`, whose clips are embedded.
///
/// # Errors
/// [`FileError`] for an invalid scene, a clip that is not embedded, and a folder or file that
/// cannot be written.
pub fn write_scene_with_clips(text: &str, name: &str, folder: &Path) -> Result<PathBuf, FileError> {
    let on_disk = folder.join(scene_path(name));
    for clip in SceneFile::parse(text, &on_disk)?.clips() {
        write(clip, clip_text(clip)?.as_bytes())?;
    }
    write(&on_disk, text.as_bytes())?;
    Ok(on_disk)
}

fn scene_path(name: &str) -> PathBuf {
    Path::new(SCENE_FOLDER).join(name).with_extension("toml")
}

/// The text of the clip that a path in a scene names.
fn clip_text(path: &Path) -> Result<&'static str, FileError> {
    let name = path.file_stem().unwrap_or_default().to_string_lossy();
    text_of(CLIPS, &name, path)
}

fn text_of(
    files: &'static [(&str, &str)],
    name: &str,
    path: &Path,
) -> Result<&'static str, FileError> {
    let found = files.iter().find(|(known, _)| *known == name);
    found.map(|(_, text)| *text).ok_or_else(|| {
        let names: Vec<&str> = files.iter().map(|(known, _)| *known).collect();
        let problem = format!(
            "found no embedded `{name}`, expected one of {}",
            names.join(", ")
        );
        FileError::new(path, problem)
    })
}

fn write(path: &Path, bytes: &[u8]) -> Result<(), FileError> {
    let unwritable = |e: std::io::Error| FileError::new(path, format!("cannot be written: {e}"));
    if let Some(folder) = path.parent() {
        fs::create_dir_all(folder).map_err(unwritable)?;
    }
    fs::write(path, bytes).map_err(unwritable)
}

/// Name of the network's card.
const CARD_NAME: &str = "farfield_hrnet.toml";
/// Name of the network's file in its card.
const ONNX_NAME: &str = "farfield_hrnet.onnx";
const CARD: &str = include_str!("../../network/farfield_hrnet.toml");
const ONNX: &[u8] = include_bytes!("../../network/farfield_hrnet.onnx");

/// Name of the detector's card.
const DETECTOR_CARD_NAME: &str = "farfield_detector.toml";
/// Name of the detector's file in its card.
const DETECTOR_ONNX_NAME: &str = "farfield_detector.onnx";
const DETECTOR_CARD: &str = include_str!("../../network/detector/farfield_detector.toml");
const DETECTOR_ONNX: &[u8] = include_bytes!("../../network/detector/farfield_detector.onnx");

/// Writes the network and its card into `folder`; returns the file name of the card.
///
/// # Errors
/// [`FileError`] for a folder or file that cannot be written.
pub fn write_network(folder: &Path) -> Result<&'static str, FileError> {
    write(&folder.join(ONNX_NAME), ONNX)?;
    write(&folder.join(CARD_NAME), CARD.as_bytes())?;
    Ok(CARD_NAME)
}

/// Writes the detector and its card into `folder`; returns the file name of the card.
///
/// # Errors
/// [`FileError`] for a folder or file that cannot be written.
pub fn write_detector(folder: &Path) -> Result<&'static str, FileError> {
    write(&folder.join(DETECTOR_ONNX_NAME), DETECTOR_ONNX)?;
    write(&folder.join(DETECTOR_CARD_NAME), DETECTOR_CARD.as_bytes())?;
    Ok(DETECTOR_CARD_NAME)
}

#[cfg(test)]
mod clip_tests;
#[cfg(test)]
mod scene_tests;

#[cfg(test)]
mod tests {
    use farfield_proto::model_card::{DetectorCard, HeatmapCard};

    use super::*;

    /// Largest size of a network in the repository, bytes.
    const MOST_BYTES: usize = 4 << 20;

    #[test]
    fn the_card_is_valid_and_names_the_network_file() {
        let card = HeatmapCard::parse(CARD, Path::new(CARD_NAME)).unwrap();
        assert_eq!(card.file, Path::new(ONNX_NAME));
        assert!(ONNX.len() <= MOST_BYTES, "{} bytes", ONNX.len());
        let folder = tempfile::tempdir().unwrap();
        let card = write_network(&folder.path().join("models")).unwrap();
        assert!(folder.path().join("models").join(card).is_file());
        assert!(folder.path().join("models").join(ONNX_NAME).is_file());
    }

    /// Largest size of the detector in the repository, bytes.
    const MOST_DETECTOR_BYTES: usize = 1 << 20;

    #[test]
    fn the_detectors_card_names_the_detector_file() {
        let card = DetectorCard::parse(DETECTOR_CARD, Path::new(DETECTOR_CARD_NAME)).unwrap();
        assert_eq!(card.file, Path::new(DETECTOR_ONNX_NAME));
        assert!(DETECTOR_ONNX.len() <= MOST_DETECTOR_BYTES);
        let folder = tempfile::tempdir().unwrap();
        let card = write_detector(folder.path()).unwrap();
        assert!(folder.path().join(card).is_file());
        assert!(folder.path().join(DETECTOR_ONNX_NAME).is_file());
    }
}
