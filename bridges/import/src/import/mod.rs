//! Entry point: imports a folder of another program into a folder with a venue, completely or not
//! at all.

mod calibration;
mod cameras;
mod sources;

use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::{Path, PathBuf};

use farfield_calibration::formats::{Remark, RemarkKind};
use farfield_proto::calibration::Calibration;
use farfield_proto::keypoints::{COCO17, COCO23};
use farfield_proto::toml_file::{FileError, Place, TomlFile};
use farfield_proto::venue::Venue;
use toml::{Table, Value};

use crate::assemble::{Assembled, CameraFrames, assemble, people_per_frame, write_lines};
use crate::error::ImportError;
use crate::files::{self, NewFolder};
use crate::formats::{Format, ParseOptions};
use crate::keypoints::{Mapping, Model};
use crate::report::{CameraReport, Report};

use self::calibration::FoundCalibration;
use self::sources::Source;

/// Files that an import writes, relative to its folder.
const VENUE: &str = "venue.toml";
const CALIBRATION: &str = "calibration.toml";
const KEYPOINTS: &str = "keypoints";
/// Name of the default output folder, inside the imported folder.
const FOLDER: &str = "farfield";
/// Pose2Sim's settings file, and the number of levels above a trial that may hold one: participant
/// and session.
const SETTINGS: &str = "Config.toml";
const LEVELS_OF_SETTINGS: usize = 2;

/// Options of an import. Everything but the folder may be left to the files.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ImportRequest {
    /// Folder of the other program.
    pub folder: PathBuf,
    /// Files of the calibration; if empty, the folder is searched.
    pub calibration: Vec<PathBuf>,
    /// Frames per second.
    pub rate_hz: Option<f64>,
    /// Format of the keypoint files.
    pub format: Option<Format>,
    /// Keypoint model.
    pub model: Option<Model>,
    /// Camera names of the calibration, each with the file or folder of its keypoints; if empty,
    /// the folder is searched.
    pub cameras: Vec<(String, PathBuf)>,
    /// Output folder; `None` for `farfield` inside the imported folder.
    pub out: Option<PathBuf>,
}

/// Imports a folder.
///
/// # Errors
/// [`ImportError`] that names the file, or what is missing and how to give it. Nothing is left
/// behind.
pub fn import(request: &ImportRequest) -> Result<Report, ImportError> {
    if !files::is_folder(&request.folder) {
        let text = format!("{}: expected a folder", request.folder.display());
        return Err(ImportError::refused(text));
    }
    let out = request
        .out
        .clone()
        .unwrap_or_else(|| request.folder.join(FOLDER));
    // Fail before reading for hours.
    drop(NewFolder::create(&out)?);
    let settings = settings(&request.folder)?;
    let rate_hz = rate_hz(request, settings)?;
    let files = files::list(&request.folder)?;
    let mut remarks = Vec::new();
    let calibration = calibration::find(request, &files, &mut remarks)?;
    let options = ParseOptions {
        format: request.format,
        model: request.model,
        model_hint: settings.model,
    };
    remarks.extend(calibration.remarks());
    let (sources, unsynchronised) = if request.cameras.is_empty() {
        let names = calibration.imported.cameras.iter();
        let names: Vec<&str> = names.map(|it| it.name.as_str()).collect();
        sources::found(&request.folder, &files, options, &names, &mut remarks)?
    } else {
        (sources::named(&request.cameras, options)?, BTreeSet::new())
    };
    for Source { parsed, .. } in &sources {
        let notes = parsed.notes.iter();
        remarks.extend(notes.map(|note| Remark::of_all(RemarkKind::Assumed, note)));
        let warnings = parsed.warnings.iter();
        remarks.extend(warnings.map(|warning| Remark::of_all(RemarkKind::Doubtful, warning)));
    }
    let mappings: Vec<Mapping> = sources
        .iter()
        .filter_map(|it| it.parsed.mapping.clone())
        .collect();
    let format = sources
        .first()
        .map_or(Format::OpenPose, |it| it.parsed.format);
    let left = &unsynchronised;
    let mut cameras = cameras::matched(sources, left, &calibration.imported, &mut remarks)?;
    let assembled = assemble(&mut cameras).map_err(ImportError::Refused)?;
    remarks.extend(assembled.remarks.iter().cloned());
    let folder = Folder {
        name: key_chunk(&name_of(&request.folder)),
        rate_hz,
        calibration: calibration.text_of(&cameras)?,
        files: keypoint_files(&cameras)?,
        cameras,
        assembled,
    };
    folder.write(&out)?;
    let mut seen = BTreeSet::new();
    remarks.retain(|it| seen.insert(it.clone()));
    Ok(report(
        format,
        &calibration,
        &folder,
        &out,
        &mappings,
        remarks,
    ))
}

/// Reads Pose2Sim's settings in a folder.
fn settings(folder: &Path) -> Result<Settings, ImportError> {
    let path = folder.join(SETTINGS);
    if files::is_file(&path) {
        return Ok(Settings::parse(&files::read_text(&path)?, &path)?);
    }
    Ok(Settings::default())
}

/// Options that match Pose2Sim's settings in the two levels above a folder. Those settings are only
/// suggested, never applied.
fn settings_above(folder: &Path) -> Option<String> {
    let full = files::full(folder).ok()?;
    let mut above = full.ancestors().skip(1).take(LEVELS_OF_SETTINGS);
    above.find_map(|level| {
        let settings = settings(level).ok()?;
        let rate = settings
            .rate_hz
            .map(|rate_hz| format!("`--rate {rate_hz}`"));
        let model = settings
            .model
            .map(|model| format!("`--keypoints {}`", model.name()));
        let options: Vec<String> = rate.into_iter().chain(model).collect();
        let path = level.join(SETTINGS);
        (!options.is_empty())
            .then(|| format!("{} corresponds to {}", path.display(), options.join(" ")))
    })
}

fn rate_hz(request: &ImportRequest, settings: Settings) -> Result<f64, ImportError> {
    let rate_hz = request.rate_hz.or(settings.rate_hz).ok_or_else(|| {
        let above = settings_above(&request.folder);
        let above = above.map_or_else(String::new, |it| format!("; {it}, but lies outside the folder and is not used by default"));
        ImportError::refused(format!(
            "the files do not give the frames per second, and neither does a `frame_rate` in a Config.toml of the folder: \
             set it with `--rate HZ`{above}"
        ))
    })?;
    if rate_hz.is_finite() && rate_hz > 0.0 {
        Ok(rate_hz)
    } else {
        let text = format!("`--rate`: found {rate_hz}, expected frames per second");
        Err(ImportError::refused(text))
    }
}

/// Name of a folder.
fn name_of(folder: &Path) -> String {
    let full = files::full(folder).unwrap_or_else(|_| folder.to_owned());
    full.file_name()
        .unwrap_or_default()
        .to_string_lossy()
        .into_owned()
}

/// Path of the keypoint file of every camera, relative to the venue file.
fn keypoint_files(cameras: &[CameraFrames]) -> Result<Vec<String>, ImportError> {
    let mut seen = BTreeSet::new();
    cameras
        .iter()
        .map(|camera| {
            let file = format!("{KEYPOINTS}/{}.jsonl", key_chunk(&camera.name));
            // Some file systems ignore case.
            if seen.insert(file.to_lowercase()) {
                Ok(file)
            } else {
                Err(ImportError::refused(format!(
                    "two cameras would be written to `{file}`, expected names that differ in more than punctuation and case"
                )))
            }
        })
        .collect()
}

/// Everything that is written.
struct Folder {
    name: String,
    rate_hz: f64,
    calibration: String,
    cameras: Vec<CameraFrames>,
    /// Path of the keypoint file of each camera.
    files: Vec<String>,
    assembled: Assembled,
}

impl Folder {
    /// Writes the folder after checking that a run can read it.
    fn write(&self, out: &Path) -> Result<(), ImportError> {
        let cameras: Vec<VenueCamera<'_>> = self
            .cameras
            .iter()
            .zip(&self.files)
            .map(|(camera, file)| VenueCamera {
                name: &camera.name,
                keypoints: file,
            })
            .collect();
        let with_feet = self.assembled.keypoints.len() > COCO17.len();
        let venue = venue_text(&self.name, self.rate_hz, with_feet, &cameras);
        let unusable = |error: FileError| {
            ImportError::refused(format!("the imported venue would be unusable: {error}"))
        };
        let calibration = Calibration::parse(&self.calibration, Path::new(CALIBRATION));
        let calibration = calibration.map_err(unusable)?;
        Venue::parse(&venue, Path::new(VENUE), calibration).map_err(unusable)?;
        let folder = NewFolder::create(out)?;
        folder.write(Path::new(VENUE), |file| file.write_all(venue.as_bytes()))?;
        folder.write(Path::new(CALIBRATION), |file| {
            file.write_all(self.calibration.as_bytes())
        })?;
        let Assembled {
            ticks,
            keypoints,
            scales,
            ..
        } = &self.assembled;
        for ((camera, file), scale) in self.cameras.iter().zip(&self.files).zip(scales) {
            folder.write(Path::new(file), |out| {
                write_lines(&camera.frames, ticks, keypoints.len(), *scale, out)
            })?;
        }
        folder.finish()
    }
}

fn report(
    format: Format,
    calibration: &FoundCalibration,
    folder: &Folder,
    out: &Path,
    mappings: &[Mapping],
    remarks: Vec<Remark>,
) -> Report {
    let ticks = &folder.assembled.ticks;
    let cameras = folder
        .cameras
        .iter()
        .zip(&folder.files)
        .map(|(camera, file)| {
            let (people_mean, people_max) = people_per_frame(&camera.frames);
            CameraReport {
                name: camera.name.clone(),
                source: camera.source.clone(),
                keypoints: out.join(file),
                frames: camera.frames.len(),
                first_frame: camera.frames.keys().next().copied().unwrap_or_default(),
                last_frame: camera
                    .frames
                    .keys()
                    .next_back()
                    .copied()
                    .unwrap_or_default(),
                missing_frames: ticks.end - ticks.start - camera.frames.len().cast_signed() as i64,
                people_mean,
                people_max,
            }
        });
    let names: BTreeSet<&str> = mappings.iter().map(|it| it.name.as_str()).collect();
    let missing: BTreeSet<&'static str> = mappings.iter().flat_map(Mapping::missing).collect();
    let left_out: BTreeSet<&String> = mappings.iter().flat_map(|it| &it.left_out).collect();
    Report {
        format: format.name(),
        calibration_format: calibration.imported.format.name(),
        calibration: calibration.files.clone(),
        venue: out.join(VENUE),
        rate_hz: folder.rate_hz,
        first_frame: ticks.start,
        frames: ticks.end - ticks.start,
        cameras: cameras.collect(),
        model: names.into_iter().collect::<Vec<_>>().join(", "),
        mapped: (0..COCO23.len())
            .filter(|&i| mappings.iter().all(|it| it.places[i].is_some()))
            .map(|i| COCO23[i])
            .collect(),
        missing: missing.iter().copied().collect(),
        left_out: left_out.into_iter().cloned().collect(),
        remarks,
    }
}

/// The settings; absent and `'auto'` values are `None`.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Settings {
    /// Frames per second, above 0.
    rate_hz: Option<f64>,
    /// The keypoint model of the files.
    model: Option<Model>,
}

impl Settings {
    /// Parses `Config.toml`; `path` is for error messages only.
    ///
    /// # Errors
    /// [`FileError`] if the text is not TOML, or the rate is neither a number above 0 nor a word.
    fn parse(text: &str, path: &Path) -> Result<Self, FileError> {
        let file = TomlFile::parse(text, path)?;
        let root: Table = file.read()?;
        let get = |table: &str, key: &str| root.get(table).and_then(|it| it.get(key));
        let rate_hz = match get("project", "frame_rate") {
            None | Some(Value::String(_)) => None,
            Some(value) => {
                let number = value.as_float().or(value.as_integer().map(|it| it as f64));
                let rate = number.filter(|it| it.is_finite() && *it > 0.0);
                Some(rate.ok_or_else(|| {
                    file.error(
                        &Place::field("project").key("frame_rate"),
                        format!("found {value}, expected frames per second or 'auto'"),
                    )
                })?)
            }
        };
        let model = get("pose", "pose_model").and_then(Value::as_str);
        Ok(Self {
            rate_hz,
            model: model.and_then(Model::from_name),
        })
    }
}

/// A camera of the venue.
struct VenueCamera<'a> {
    /// Name in the calibration.
    name: &'a str,
    /// Path of its keypoint file, relative to the venue file.
    keypoints: &'a str,
}

/// The venue file; every camera becomes a viewpoint.
fn venue_text(name: &str, rate_hz: f64, with_feet: bool, cameras: &[VenueCamera<'_>]) -> String {
    let mut text = String::from(
        "# A venue of keypoints, made by `farfield import`. All options: deploy/venue.sample.toml, `farfield parameters`.\n",
    );
    let mut fields = vec![
        (
            format!("name = {}", quoted(name)),
            "first part of every Zenoh key",
        ),
        (
            format!("rate_hz = {rate_hz:?}"),
            "ticks per second, the same for all cameras",
        ),
        (
            format!("calibration = {}", quoted(CALIBRATION)),
            "where the cameras stand: metres, z up",
        ),
    ];
    if with_feet {
        let field = "keypoints = \"coco23\"".to_owned();
        fields.push((field, "those of the files: COCO's 17, toes and heels"));
    }
    for (left, comment) in fields {
        // Writing to a string cannot fail.
        writeln!(text, "{left:<48} # {comment}").ok();
    }
    for camera in cameras {
        writeln!(
            text,
            "\n[[viewpoint]]\nname = {}\n[[viewpoint.camera]]\nname = {}\nsource = {{ kind = \"keypoints\", path = {} }}",
            quoted(&key_chunk(camera.name)),
            quoted(camera.name),
            quoted(camera.keypoints)
        )
        .ok();
    }
    text
}

/// Converts a name to a valid part of Zenoh keys and file names.
fn key_chunk(name: &str) -> String {
    let letter = |c: char| {
        if c.is_ascii_alphanumeric() || "-_.".contains(c) {
            c
        } else {
            '-'
        }
    };
    let name: String = name.chars().take(64).map(letter).collect();
    if name.trim_matches('.').is_empty() {
        "venue".to_owned()
    } else {
        name
    }
}

/// Quotes a text for TOML.
fn quoted(text: &str) -> String {
    Value::from(text).to_string()
}

#[cfg(test)]
mod calibration_tests;
#[cfg(test)]
mod tests;
#[cfg(test)]
mod traps;
