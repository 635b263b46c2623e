//! The calibration of an import: the one that was named, else the only one in the folder, or above it.

use std::path::{Path, PathBuf};

use farfield_calibration::formats::{Format, ImportOptions, Imported, TextFile, export, import};
use farfield_proto::calibration::Calibration;
use farfield_proto::camera::CameraModel;

use crate::assemble::CameraFrames;
use crate::error::ImportError;
use crate::files;
use crate::folder;
use crate::report::RemarkReport;

use super::ImportRequest;

/// Levels above a folder that are looked at: Caliscope's is three above the points of one tracker.
const LEVELS_ABOVE: usize = 3;
/// Nearer than this two cameras are one: radians and metres, far below what any calibration knows.
const SAME_CAMERA: f64 = 1e-9;

/// What was found, and read.
#[derive(Debug)]
pub(super) struct FoundCalibration {
    pub(super) files: Vec<PathBuf>,
    pub(super) imported: Imported,
    texts: Vec<TextFile>,
}

/// Finds it and reads it.
pub(super) fn find(
    request: &ImportRequest,
    listed: &[PathBuf],
) -> Result<FoundCalibration, ImportError> {
    if !request.calibration.is_empty() {
        return read(request.calibration.clone());
    }
    let mut places = vec![listed.to_vec()];
    let full = files::full(&request.folder)?;
    // Pose2Sim and Caliscope keep it beside or above the recordings.
    for level in full.ancestors().skip(1).take(LEVELS_ABOVE) {
        places.push(around(level));
    }
    for place in &places {
        let found = readable(folder::calibrations(place));
        match chosen(found) {
            Ok(Some(files)) => return read(files),
            Ok(None) => {}
            Err(several) => {
                let names: Vec<String> = several
                    .iter()
                    .filter_map(|files| files.first())
                    .map(|it| it.display().to_string())
                    .collect();
                return Err(ImportError::refused(format!(
                    "found several calibrations: {}; name one with `--calibration FILE`",
                    names.join(", ")
                )));
            }
        }
    }
    Err(ImportError::refused(format!(
        "no calibration is in {} or beside it: name it with `--calibration FILE`; `farfield calibrate convert --help` lists \
         the formats",
        request.folder.display()
    )))
}

/// The files of a level above, and of its folders of calibrations. What cannot be read there is nobody's business.
fn around(level: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for path in files::entries(level).unwrap_or_default() {
        let name = path
            .file_name()
            .unwrap_or_default()
            .to_string_lossy()
            .to_lowercase();
        if files::is_file(&path) {
            found.push(path);
        } else if name.contains("calib") {
            found.extend(files::entries(&path).unwrap_or_default());
        }
    }
    found.sort();
    found
}

/// Those that are calibrations by their content, too. What cannot be read is none.
fn readable(groups: Vec<Vec<PathBuf>>) -> Vec<Vec<PathBuf>> {
    let is_one = |group: &Vec<PathBuf>| match group.as_slice() {
        [path] if folder::ending(path) == "toml" => {
            files::read_text(path).is_ok_and(|text| folder::is_toml_of_cameras(&text))
        }
        _ => true,
    };
    groups.into_iter().filter(is_one).collect()
}

/// The only one; else the only one in TOML, into which other tools convert; else Caliscope's own beside its copies.
fn chosen(mut found: Vec<Vec<PathBuf>>) -> Result<Option<Vec<PathBuf>>, Vec<Vec<PathBuf>>> {
    if found.len() > 1 {
        let is_caliscope = |group: &Vec<PathBuf>| {
            group
                .iter()
                .any(|path| path.file_name().is_some_and(|it| it == "camera_array.toml"))
        };
        let is_toml =
            |group: &Vec<PathBuf>| group.iter().all(|path| folder::ending(path) == "toml");
        let only = |is: &dyn Fn(&Vec<PathBuf>) -> bool| {
            let mut those = found.iter().filter(|it| is(it));
            match (those.next(), those.next()) {
                (Some(one), None) => Some(one.clone()),
                _ => None,
            }
        };
        return match only(&is_caliscope).or_else(|| only(&is_toml)) {
            Some(one) => Ok(Some(one)),
            None => Err(found),
        };
    }
    Ok(found.pop())
}

fn read(paths: Vec<PathBuf>) -> Result<FoundCalibration, ImportError> {
    let mut texts = Vec::new();
    for path in &paths {
        texts.push(TextFile {
            path: path.clone(),
            text: files::read_text(path)?,
        });
    }
    let imported = import(&texts, &ImportOptions::default())?;
    Ok(FoundCalibration {
        files: paths,
        imported,
        texts,
    })
}

impl FoundCalibration {
    /// What its conversion says.
    pub(super) fn remarks(&self) -> Vec<RemarkReport> {
        let remarks = self.imported.remarks.iter();
        remarks
            .map(|remark| RemarkReport {
                kind: remark.kind.name(),
                camera: remark.camera.clone(),
                text: format!("calibration: {}", remark.text),
            })
            .collect()
    }

    /// Our file, of these cameras.
    pub(super) fn text_of(&self, cameras: &[CameraFrames]) -> Result<String, ImportError> {
        let records: Vec<_> = self
            .imported
            .cameras
            .iter()
            .filter(|record| cameras.iter().any(|camera| camera.name == record.name))
            .cloned()
            .collect();
        let written = export(&records, Format::Farfield)
            .map_err(|error| ImportError::refused(error.to_string()))?;
        let text = written.into_iter().next().map(|file| file.text);
        let text =
            text.ok_or_else(|| ImportError::refused("no camera is left of the calibration"))?;
        Ok(self.as_it_is(&text).unwrap_or(text))
    }

    /// The file itself where it says of the same cameras what `written` does: turned into matrices and back, a rotation is
    /// another in its last bit, and where people are hard to tell apart that is enough for other poses than by hand.
    fn as_it_is(&self, written: &str) -> Option<String> {
        let [only] = self.texts.as_slice() else {
            return None;
        };
        let cameras = |text: &str| Some(Calibration::parse(text, &only.path).ok()?.cameras);
        let (ours, theirs) = (cameras(&only.text)?, cameras(written)?);
        let names_are_same = ours.keys().eq(theirs.keys());
        let are_same = names_are_same && ours.values().zip(theirs.values()).all(is_same);
        are_same.then(|| only.text.clone())
    }
}

fn is_same((a, b): (&CameraModel, &CameraModel)) -> bool {
    let poses = [a, b].map(|camera| camera.camera_from_world().isometry());
    let turned_rad = poses[0].rotation.angle_to(&poses[1].rotation);
    let apart_m = (poses[0].translation.vector - poses[1].translation.vector).norm();
    a.size_px() == b.size_px()
        && a.intrinsics() == b.intrinsics()
        && a.lens() == b.lens()
        && turned_rad < SAME_CAMERA
        && apart_m < SAME_CAMERA
}
