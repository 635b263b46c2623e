//! The project's own motion clips and scenes, embedded so that the program needs no other file.
//!
//! [`scene`] loads an embedded scene without disk access; [`with_clips`] loads the caller's scene.
//! [`write_scene`] writes a scene with its clips into a folder, for processes that read files.

mod network;

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use farfield_proto::toml_file::FileError;

pub use self::network::{write_detector, write_network};
pub use crate::embedded_files::{CLIPS, SCENES};
use crate::motion::Clip;
use crate::scene::Scene;
use crate::scene::file::SceneFile;

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

#[cfg(test)]
mod clip_tests;
#[cfg(test)]
mod scene_tests;
