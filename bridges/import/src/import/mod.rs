//! The one entry: a folder of another program in, a folder with a venue out, whole or not at all.

mod calibration;
mod cameras;
mod sources;

use std::collections::BTreeSet;
use std::io::Write as _;
use std::path::{Path, PathBuf};

use farfield_calibration::formats::{Remark, RemarkKind};
use farfield_proto::calibration::Calibration;
use farfield_proto::toml_file::FileError;
use farfield_proto::venue::Venue;

use crate::assemble::{Assembled, CameraFrames, assemble, people_per_frame, write_lines};
use crate::error::ImportError;
use crate::files::{self, NewFolder};
use crate::formats::{Format, ParseOptions};
use crate::keypoints::{Mapping, Model};
use crate::report::{CameraReport, Report};
use crate::settings::Settings;
use crate::venue_text::{VenueCamera, key_chunk, venue_text};

use self::calibration::FoundCalibration;
use self::sources::Source;

/// What an import makes, in its folder.
const VENUE: &str = "venue.toml";
const CALIBRATION: &str = "calibration.toml";
const KEYPOINTS: &str = "keypoints";
/// Where it goes, in the folder that is imported.
const FOLDER: &str = "farfield";
/// Pose2Sim's settings, and in how many levels above a trial it keeps those of a session and of a participant.
const SETTINGS: &str = "Config.toml";
const LEVELS_OF_SETTINGS: usize = 2;

/// What is asked for. All but the folder may be left to what the files say.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ImportRequest {
    /// The folder of the other program.
    pub folder: PathBuf,
    /// The files of the calibration; none: searched for in the folder.
    pub calibration: Vec<PathBuf>,
    /// Frames per second.
    pub rate_hz: Option<f64>,
    /// Whose keypoints they are.
    pub format: Option<Format>,
    /// Which keypoints they are.
    pub model: Option<Model>,
    /// Cameras by the calibration's names, each with the file or folder of its keypoints; none: looked for in the folder.
    pub cameras: Vec<(String, PathBuf)>,
    /// The folder that is made; `None`: `farfield` in the folder.
    pub out: Option<PathBuf>,
}

/// Imports a folder.
///
/// # Errors
/// [`ImportError`] saying which file, or what is missing and how to say it; nothing is left behind then.
pub fn import(request: &ImportRequest) -> Result<Report, ImportError> {
    if !files::is_folder(&request.folder) {
        let text = format!("{}: expected a folder", request.folder.display());
        return Err(ImportError::refused(text));
    }
    let out = request
        .out
        .clone()
        .unwrap_or_else(|| request.folder.join(FOLDER));
    // Before hours of reading.
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
        let doubts = parsed.doubts.iter();
        remarks.extend(doubts.map(|doubt| Remark::of_all(RemarkKind::Doubtful, doubt)));
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

/// What Pose2Sim's settings in a folder say.
fn settings(folder: &Path) -> Result<Settings, ImportError> {
    let path = folder.join(SETTINGS);
    if files::is_file(&path) {
        return Ok(Settings::parse(&files::read_text(&path)?, &path)?);
    }
    Ok(Settings::default())
}

/// Which options would say what Pose2Sim's settings in the two levels above a folder say: these are not taken unasked.
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
        (!options.is_empty()).then(|| format!("{} says {}", path.display(), options.join(" ")))
    })
}

fn rate_hz(request: &ImportRequest, settings: Settings) -> Result<f64, ImportError> {
    let rate_hz = request.rate_hz.or(settings.rate_hz).ok_or_else(|| {
        let above = settings_above(&request.folder);
        let above = above.map_or_else(String::new, |it| format!("; outside of it {it}, which is not taken unasked"));
        ImportError::refused(format!(
            "keypoints do not say how many frames per second they have, and no `frame_rate` in a Config.toml of the folder \
             does: say so with `--rate HZ`{above}"
        ))
    })?;
    if rate_hz.is_finite() && rate_hz > 0.0 {
        Ok(rate_hz)
    } else {
        let text = format!("`--rate`: found {rate_hz}, expected frames per second");
        Err(ImportError::refused(text))
    }
}

/// What a folder is called.
fn name_of(folder: &Path) -> String {
    let full = files::full(folder).unwrap_or_else(|_| folder.to_owned());
    full.file_name()
        .unwrap_or_default()
        .to_string_lossy()
        .into_owned()
}

/// The keypoint file of every camera, relative to the venue file.
fn keypoint_files(cameras: &[CameraFrames]) -> Result<Vec<String>, ImportError> {
    let mut seen = BTreeSet::new();
    cameras
        .iter()
        .map(|camera| {
            let file = format!("{KEYPOINTS}/{}.jsonl", key_chunk(&camera.name));
            // Some disks take capitals for small letters.
            if seen.insert(file.to_lowercase()) {
                Ok(file)
            } else {
                Err(ImportError::refused(format!(
                    "two cameras would be written to `{file}`, expected names that differ in more than signs and capitals"
                )))
            }
        })
        .collect()
}

/// All that is written.
struct Folder {
    name: String,
    rate_hz: f64,
    calibration: String,
    cameras: Vec<CameraFrames>,
    /// The keypoint file of each camera.
    files: Vec<String>,
    assembled: Assembled,
}

impl Folder {
    /// Writes it, when all of it is known to be one that a run can read.
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
        let venue = venue_text(&self.name, self.rate_hz, CALIBRATION, &cameras);
        let unusable = |error: FileError| {
            ImportError::refused(format!("no run can use what would be written: {error}"))
        };
        let calibration = Calibration::parse(&self.calibration, Path::new(CALIBRATION));
        let calibration = calibration.map_err(unusable)?;
        Venue::parse(&venue, Path::new(VENUE), calibration).map_err(unusable)?;
        let folder = NewFolder::create(out)?;
        folder.write(Path::new(VENUE), |file| file.write_all(venue.as_bytes()))?;
        folder.write(Path::new(CALIBRATION), |file| {
            file.write_all(self.calibration.as_bytes())
        })?;
        let Assembled { ticks, scales, .. } = &self.assembled;
        for ((camera, file), scale) in self.cameras.iter().zip(&self.files).zip(scales) {
            folder.write(Path::new(file), |out| {
                write_lines(&camera.frames, ticks, *scale, out)
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
        mapped: farfield_proto::keypoints::COCO17
            .into_iter()
            .filter(|name| !missing.contains(name))
            .collect(),
        missing: missing.iter().copied().collect(),
        left_out: left_out.into_iter().cloned().collect(),
        remarks,
    }
}

#[cfg(test)]
mod found_calibrations;
#[cfg(test)]
mod tests;
#[cfg(test)]
mod traps;
