//! Finds and reads the keypoint sources of an import.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use farfield_calibration::formats::{Remark, RemarkKind};
use farfield_proto::toml_file::FileError;

use crate::error::ImportError;
use crate::files;
use crate::folder::{self, Candidates};
use crate::formats::{Format, ParseOptions, Parsed, Reading, max_bytes, recognised};
use crate::matching::named_by;

/// Bytes read to recognise the format of a table.
const HEAD: u64 = 1 << 16;

/// The parsed files of one source.
#[derive(Debug)]
pub(super) struct Source {
    /// Name that identifies its camera, if it holds only one.
    pub(super) name: String,
    /// Cameras that the user assigned to it, in its order.
    pub(super) cameras: Vec<String>,
    /// The file or folder, for reports.
    pub(super) from: PathBuf,
    pub(super) parsed: Parsed,
}

/// Reads the given files and folders. Each holds one camera, or several if it is given several
/// times.
pub(super) fn named(
    cameras: &[(String, PathBuf)],
    options: ParseOptions,
) -> Result<Vec<Source>, ImportError> {
    let mut places: Vec<(&PathBuf, Vec<String>)> = Vec::new();
    for (camera, path) in cameras {
        match places.iter_mut().find(|(known, _)| *known == path) {
            Some((_, cameras)) => cameras.push(camera.clone()),
            None => places.push((path, vec![camera.clone()])),
        }
    }
    let mut sources = Sources::new(options);
    for (path, cameras) in places {
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
                "{}: found no keypoints for camera `{}`, expected JSON or CSV files",
                path.display(),
                cameras.join("`, `")
            )));
        }
        let name = cameras.join(", ");
        sources.add(&paths, path, name, cameras, options.format)?;
    }
    Ok(sources.read)
}

/// Reads the sources of a folder. `cameras` are the names in the calibration. Also returns
/// Pose2Sim's keypoints of cameras that it has not synchronised.
pub(super) fn found(
    place: &Path,
    listed: &[PathBuf],
    options: ParseOptions,
    cameras: &[&str],
    remarks: &mut Vec<Remark>,
) -> Result<(Vec<Source>, BTreeSet<PathBuf>), ImportError> {
    let candidates = folder::candidates(listed, place);
    let mut sources = Sources::new(options);
    sources.fill(Trust::Content, &candidates)?;
    if let (true, Some(_)) = (sources.read.is_empty(), options.format) {
        // The reader of the requested format reports what is wrong.
        sources.fill(Trust::Request, &candidates)?;
    }
    let is_json = |source: &Source| folder::ending(&source.from) == "json";
    let has_such = sources.read.iter().any(is_json);
    let mut not_read = String::new();
    for (path, error) in sources.broken {
        // A camera's truncated file must not look like a camera without keypoints.
        if has_such || is_named_after_one(&path, place, cameras) {
            return Err(error.into());
        }
        not_read = format!("; not read: {error}");
        let text = format!("{error}: assumed not to be keypoints, and skipped");
        remarks.push(Remark::of_all(RemarkKind::Doubtful, text));
    }
    if sources.read.is_empty() {
        let names: Vec<&str> = Format::ALL.iter().map(|format| format.name()).collect();
        return Err(ImportError::refused(format!(
            "found no 2D keypoints in {}, expected one of {}; give their place with `--camera NAME=FOLDER`{not_read}",
            place.display(),
            names.join(", ")
        )));
    }
    Ok((sources.read, candidates.unsynchronised))
}

/// Whether a file, or its parent folder inside `place`, is named like one of `cameras`.
fn is_named_after_one(path: &Path, place: &Path, cameras: &[&str]) -> bool {
    let is_like = |name: String| {
        let stands_in = |camera: &&str| !named_by(&[&name], camera).is_empty();
        !named_by(cameras, &name).is_empty() || cameras.iter().any(stands_in)
    };
    let parent = path.parent().filter(|it| *it != place);
    is_like(folder::camera_name(path, false))
        || parent.is_some_and(|it| is_like(folder::camera_name(it, true)))
}

/// Why a file is read as keypoints.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Trust {
    /// Its content looks like keypoints.
    Content,
    /// The user gave the format.
    Request,
}

/// The sources of one import while they are read.
struct Sources {
    options: ParseOptions,
    read: Vec<Source>,
    /// JSON files that cannot be read; their format is unknown.
    broken: Vec<(PathBuf, FileError)>,
    /// Number of people read so far.
    n_people: usize,
}

impl Sources {
    fn new(options: ParseOptions) -> Self {
        Self {
            options,
            read: Vec::new(),
            broken: Vec::new(),
            n_people: 0,
        }
    }

    /// Reads those of `candidates` that are keypoints.
    fn fill(&mut self, trust: Trust, candidates: &Candidates) -> Result<(), ImportError> {
        for (parent, paths) in &candidates.json {
            if let Some(format) = self.per_frame_format(paths, trust)? {
                let name = folder::camera_name(parent, true);
                self.add(paths, parent, name, Vec::new(), Some(format))?;
                continue;
            }
            for path in paths {
                let bytes = files::read(path, max_bytes(path))?;
                self.add_if_one(&bytes, path, trust)?;
            }
        }
        for path in &candidates.single {
            let head = files::head(path, HEAD)?;
            self.add_if_one(&head, path, trust)?;
        }
        Ok(())
    }

    /// Reads a file if it has the requested format, or any format if none was requested.
    fn add_if_one(&mut self, bytes: &[u8], path: &Path, trust: Trust) -> Result<(), ImportError> {
        let requested = self.options.format;
        let is_one = if trust == Trust::Request {
            requested.map(Format::ending) == Some(folder::ending(path).as_str())
        } else {
            match recognised(bytes, path) {
                Ok(found) => {
                    found.is_some_and(|it| requested.is_none_or(|requested| requested == it))
                }
                Err(error) => {
                    self.broken.push((path.to_owned(), error));
                    false
                }
            }
        };
        if is_one {
            let name = folder::camera_name(path, false);
            self.add(&[path.to_owned()], path, name, Vec::new(), requested)?;
        }
        Ok(())
    }

    /// The format of `paths` if each file holds one frame.
    fn per_frame_format(
        &self,
        paths: &[PathBuf],
        trust: Trust,
    ) -> Result<Option<Format>, ImportError> {
        if trust == Trust::Request {
            return Ok(self.options.format.filter(|it| *it == Format::OpenPose));
        }
        let first = first_recognised(paths, self.options.format)?;
        Ok(first.and_then(|(format, bytes)| match format {
            Format::OpenPose => Some(format),
            Format::MmPose if !has_frames(&bytes) => Some(format),
            _ => None,
        }))
    }

    /// Reads the files of one source.
    fn add(
        &mut self,
        paths: &[PathBuf],
        from: &Path,
        name: String,
        cameras: Vec<String>,
        format: Option<Format>,
    ) -> Result<(), ImportError> {
        let options = ParseOptions {
            format,
            ..self.options
        };
        let parsed = read(paths, from, options, self.n_people)?;
        self.n_people += parsed.detections.n_people();
        self.read.push(Source {
            name,
            cameras,
            from: from.to_owned(),
            parsed,
        });
        Ok(())
    }
}

/// The first of `paths` with a recognised format; skips broken files, files of other programs, and
/// empty lists.
fn first_recognised(
    paths: &[PathBuf],
    requested: Option<Format>,
) -> Result<Option<(Format, Vec<u8>)>, ImportError> {
    for path in paths {
        let bytes = files::read(path, max_bytes(path))?;
        // Broken files among files of one frame each are reported when all are read.
        if let Ok(Some(format)) = recognised(&bytes, path)
            && requested.is_none_or(|requested| requested == format)
        {
            return Ok(Some((format, bytes)));
        }
    }
    Ok(None)
}

/// Whether an `MMPose` file contains frame numbers.
fn has_frames(bytes: &[u8]) -> bool {
    bytes
        .windows(b"\"frame_id\"".len())
        .any(|it| it == b"\"frame_id\"")
}

fn read(
    paths: &[PathBuf],
    from: &Path,
    mut options: ParseOptions,
    n_people: usize,
) -> Result<Parsed, ImportError> {
    let are_many = paths.len() > 1;
    if are_many && options.format.is_none() {
        options.format = first_recognised(paths, None)?.map(|(format, _)| format);
    }
    let mut reading = Reading::after(options, n_people);
    let mut strays = Vec::new();
    for path in paths {
        let bytes = files::read(path, max_bytes(path))?;
        match reading.read(&bytes, path) {
            Ok(()) => {}
            Err(_) if are_many && options.format.is_some() && is_stray(&bytes, path) => {
                strays.push(path);
            }
            Err(error) => return Err(error.into()),
        }
    }
    let parsed = reading.finish().filter(|_| strays.len() < paths.len());
    let mut parsed = parsed.ok_or_else(|| FileError::new(from, "found no keypoints in it"))?;
    for path in strays {
        let text = format!("{}: no keypoints, skipped", path.display());
        parsed.warnings.insert(text);
    }
    Ok(parsed)
}

/// Whether a file is valid JSON of no known format and without a frame number in its name, such as
/// settings.
fn is_stray(bytes: &[u8], path: &Path) -> bool {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let is_json = matches!(bytes.trim_ascii_start().first(), Some(b'{' | b'['));
    is_json && folder::frame_of_name(&name).is_none() && matches!(recognised(bytes, path), Ok(None))
}
