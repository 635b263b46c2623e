//! What the project carries with it: motion clips and scenes of its own making, so that the program
//! needs no other file.
//!
//! [`scene`] reads an embedded scene without touching a disk, [`with_clips`] one of the caller's; [`write_scene`] writes one with its clips into a
//! folder, for processes that read files.

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

/// Folder of the scenes, beside that of the clips.
const SCENE_FOLDER: &str = "scenes";

/// The scene `name` (as in its file name, without the ending), its clips taken from [`CLIPS`].
///
/// # Errors
/// [`FileError`] that names what there is, for a name that is not embedded.
pub fn scene(name: &str) -> Result<Scene, FileError> {
    let path = scene_path(name);
    with_clips(text_of(SCENES, name, &path)?, &path)
}

/// The scene that `text` describes, its clips taken from [`CLIPS`]; `path` is what errors name, and what paths
/// in it are relative to.
///
/// # Errors
/// [`FileError`] for a text that is no scene, or names a clip that is not embedded.
pub fn with_clips(text: &str, path: &Path) -> Result<Scene, FileError> {
    Scene::parse(text, path, &mut |clip| {
        Ok(Arc::new(Clip::parse(clip_text(clip)?, clip)?))
    })
}

/// Writes the scene `name` and the clips that it names below `folder`, and returns the path of the scene.
/// Files that are there are replaced.
///
/// # Errors
/// [`FileError`] for a name that is not embedded, and a folder or file that cannot be written.
pub fn write_scene(name: &str, folder: &Path) -> Result<PathBuf, FileError> {
    write_scene_with_clips(text_of(SCENES, name, &scene_path(name))?, name, folder)
}

/// The same for the scene that `text` describes, whose clips are embedded.
///
/// # Errors
/// [`FileError`] for a text that is no scene, or names a clip that is not embedded, and a folder or file that cannot be
/// written.
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

/// The clip that a path in a scene means.
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
