//! The keypoints of an import: which files are one source, and what they say.

use std::path::{Path, PathBuf};

use farfield_proto::toml_file::FileError;

use crate::error::ImportError;
use crate::files;
use crate::folder::{self, Candidates};
use crate::formats::{Format, MAX_FILE_BYTES, ParseOptions, Parsed, Reading, recognised};

/// So much of a table says whose it is, bytes.
const HEAD: u64 = 1 << 16;

/// The files of one source, read.
#[derive(Debug)]
pub(super) struct Source {
    /// What names its camera, where it is of one.
    pub(super) name: String,
    /// The camera that the user has said it is of.
    pub(super) camera: Option<String>,
    /// The file or folder, for reports.
    pub(super) from: PathBuf,
    pub(super) parsed: Parsed,
}

/// What is at the places that were named, each of one camera.
pub(super) fn named(
    cameras: &[(String, PathBuf)],
    options: ParseOptions,
) -> Result<Vec<Source>, ImportError> {
    let mut sources = Vec::new();
    for (camera, path) in cameras {
        let paths = if files::is_folder(path) {
            let mut paths = files::entries(path)?;
            paths.retain(|it| matches!(folder::ending(it).as_str(), "json" | "csv"));
            paths.sort();
            paths
        } else {
            vec![path.clone()]
        };
        if paths.is_empty() {
            return Err(ImportError::refused(format!(
                "{}: found no keypoints for camera `{camera}`, expected JSON or CSV files",
                path.display()
            )));
        }
        let parsed = read(&paths, path, options)?;
        sources.push(Source {
            name: camera.clone(),
            camera: Some(camera.clone()),
            from: path.clone(),
            parsed,
        });
    }
    Ok(sources)
}

/// What is in a folder.
pub(super) fn found(
    place: &Path,
    listed: &[PathBuf],
    options: ParseOptions,
) -> Result<Vec<Source>, ImportError> {
    let candidates = folder::candidates(listed, place);
    let mut sources = told_by(Trust::Content, &candidates, options)?;
    if let (true, Some(_)) = (sources.is_empty(), options.format) {
        // The reader of the format that was asked for says what is wrong.
        sources = told_by(Trust::Word, &candidates, options)?;
    }
    if sources.is_empty() {
        let names: Vec<&str> = Format::ALL.iter().map(|format| format.name()).collect();
        return Err(ImportError::refused(format!(
            "found no 2D keypoints in {}, expected one of {}; say where they are with `--camera NAME=FOLDER`",
            place.display(),
            names.join(", ")
        )));
    }
    Ok(sources)
}

/// Why a file is taken for keypoints.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Trust {
    /// It looks like them.
    Content,
    /// The user has said whose they are.
    Word,
}

/// What of `candidates` is keypoints.
fn told_by(
    trust: Trust,
    candidates: &Candidates,
    options: ParseOptions,
) -> Result<Vec<Source>, ImportError> {
    let mut sources = Vec::new();
    for (parent, paths) in &candidates.json {
        if let Some(paths) = a_file_per_frame(paths, trust, options)? {
            sources.push(source(&paths, parent, true, options)?);
            continue;
        }
        for path in paths {
            let bytes = files::read(path, MAX_FILE_BYTES)?;
            if is_one(&bytes, path, trust, options) {
                sources.push(source(std::slice::from_ref(path), path, false, options)?);
            }
        }
    }
    for path in &candidates.single {
        let head = files::head(path, HEAD)?;
        if is_one(&head, path, trust, options) {
            sources.push(source(std::slice::from_ref(path), path, false, options)?);
        }
    }
    Ok(sources)
}

/// Whether a file is of the format that was asked for, or of any.
fn is_one(bytes: &[u8], path: &Path, trust: Trust, options: ParseOptions) -> bool {
    if trust == Trust::Word {
        let ending = options.format.map(Format::ending);
        return ending == Some(folder::ending(path).as_str());
    }
    // Other programs keep settings in JSON; broken files of theirs are not ours to tell of.
    let found = recognised(bytes, path).ok().flatten();
    match options.format {
        Some(asked) => found == Some(asked),
        None => found.is_some(),
    }
}

/// The files of `paths` that are a frame each; `None` where they are not.
fn a_file_per_frame(
    paths: &[PathBuf],
    trust: Trust,
    options: ParseOptions,
) -> Result<Option<Vec<PathBuf>>, ImportError> {
    if trust == Trust::Word {
        let is_per_frame = options.format == Some(Format::OpenPose);
        return Ok(is_per_frame.then(|| paths.to_vec()));
    }
    let Some(first) = paths.first() else {
        return Ok(None);
    };
    let bytes = files::read(first, MAX_FILE_BYTES)?;
    let format = match recognised(&bytes, first) {
        Ok(format) => format,
        // In a folder of hundreds the broken one is of the same kind as the others.
        Err(error) if paths.len() > 1 => {
            let other = paths.get(1).map_or(first, |it| it);
            let bytes = files::read(other, MAX_FILE_BYTES)?;
            match recognised(&bytes, other) {
                Ok(Some(Format::OpenPose)) => return Err(error.into()),
                _ => None,
            }
        }
        Err(_) => None,
    };
    let of_one_frame = match format {
        Some(Format::OpenPose) => true,
        Some(Format::MmPose) => !has_frames(&bytes),
        _ => false,
    };
    let is_asked = options.format.is_none_or(|asked| Some(asked) == format);
    Ok((of_one_frame && is_asked).then(|| paths.to_vec()))
}

/// Whether a file of `MMPose` says its frames.
fn has_frames(bytes: &[u8]) -> bool {
    bytes
        .windows(b"\"frame_id\"".len())
        .any(|it| it == b"\"frame_id\"")
}

fn source(
    paths: &[PathBuf],
    from: &Path,
    is_folder: bool,
    options: ParseOptions,
) -> Result<Source, ImportError> {
    Ok(Source {
        name: folder::camera_name(from, is_folder),
        camera: None,
        from: from.to_owned(),
        parsed: read(paths, from, options)?,
    })
}

fn read(paths: &[PathBuf], from: &Path, options: ParseOptions) -> Result<Parsed, ImportError> {
    let mut reading = Reading::new(options);
    for path in paths {
        let bytes = files::read(path, MAX_FILE_BYTES)?;
        reading.read(&bytes, path)?;
    }
    let parsed = reading.finish();
    parsed.ok_or_else(|| FileError::new(from, "found no keypoints in it").into())
}
