//! The calibration of an import: the one given by the user, otherwise the only one in the folder.

use std::path::{Path, PathBuf};

use farfield_calibration::formats::{
    Format, ImportOptions, Imported, Remark, RemarkKind, TextFile, export, import,
};
use farfield_proto::calibration::{Calibration, FORMATS_READ};
use farfield_proto::camera::CameraModel;

use crate::assemble::CameraFrames;
use crate::calibrations::{self, Choice};
use crate::error::ImportError;
use crate::files;

use super::ImportRequest;

/// Levels above the folder that are searched for calibrations to suggest. Caliscope's lies three
/// levels above the points of one tracker.
const LEVELS_ABOVE: usize = 3;
/// Cameras closer than this (radians and metres) are equal; far below the precision of any
/// calibration.
const SAME_CAMERA: f64 = 1e-9;

/// What was found, and read.
#[derive(Debug)]
pub(super) struct FoundCalibration {
    pub(super) files: Vec<PathBuf>,
    pub(super) imported: Imported,
    texts: Vec<TextFile>,
}

/// Finds and reads the calibration; others that were found go to `remarks`.
pub(super) fn find(
    request: &ImportRequest,
    listed: &[PathBuf],
    remarks: &mut Vec<Remark>,
) -> Result<FoundCalibration, ImportError> {
    let within = calibrations::among(listed);
    if !request.calibration.is_empty() {
        let read = read(request.calibration.clone())?;
        let others = within.whole.iter().filter(|it| !is_named(it, request));
        remarks.extend(others.map(|it| not_taken(&it.compared_with(&read.imported))));
        return Ok(read);
    }
    match within.choice() {
        Choice::One(one, others) => {
            remarks.extend(others.iter().map(|it| not_taken(it)));
            Ok(FoundCalibration {
                files: one.paths(),
                imported: one.imported,
                texts: one.candidate.files,
            })
        }
        Choice::Several(all) => Err(ImportError::refused(format!(
            "found several calibrations that differ: {all}. Name the right one with `--calibration FILE`"
        ))),
        Choice::None(unusable) => Err(none(request, &unusable)?),
    }
}

/// The error if there is none: lists unusable files, and calibrations outside the folder that the
/// user may choose.
fn none(request: &ImportRequest, unusable: &[String]) -> Result<ImportError, ImportError> {
    let mut text = format!("no calibration is in {}", request.folder.display());
    let full = files::full(&request.folder)?;
    let outside: Vec<PathBuf> = full
        .ancestors()
        .skip(1)
        .take(LEVELS_ABOVE)
        .flat_map(|level| around(level, &full))
        .collect();
    let outside = calibrations::among(&outside).whole;
    let outside: Vec<String> = outside
        .iter()
        .map(calibrations::FoundCalibration::shown)
        .collect();
    if !outside.is_empty() {
        let outside = outside.join("; ");
        text += ", and none outside it is used unless you name it. Found there: ";
        text += &outside;
    }
    if !unusable.is_empty() {
        text += ". Not usable: ";
        text += &unusable.join("; ");
    }
    Ok(ImportError::refused(format!(
        "{text}. Name the calibration with `--calibration FILE`; these formats are read: {FORMATS_READ}"
    )))
}

/// Files of a level above the folder `within`, and of its calibration folders.
fn around(level: &Path, within: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    // Unreadable folders are skipped.
    for path in files::entries(level).unwrap_or_default() {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let is_calibrations = name.to_lowercase().contains("calib") && path != within;
        if is_calibrations && files::is_folder(&path) {
            found.extend(files::entries(&path).unwrap_or_default());
        } else {
            found.push(path);
        }
    }
    found.sort();
    found
}

/// Whether the user named this calibration, by any path to its files.
fn is_named(found: &calibrations::FoundCalibration, request: &ImportRequest) -> bool {
    let full = |path: &PathBuf| files::full(path).ok();
    let named: Vec<_> = request.calibration.iter().filter_map(full).collect();
    let paths = found.paths();
    paths
        .iter()
        .filter_map(full)
        .any(|path| named.contains(&path))
}

fn not_taken(what: &str) -> Remark {
    Remark::of_all(RemarkKind::Assumed, format!("found and not taken: {what}"))
}

fn read(paths: Vec<PathBuf>) -> Result<FoundCalibration, ImportError> {
    let texts = paths.iter().map(|path| files::read_calibration(path));
    let texts: Vec<TextFile> = texts.collect::<Result<_, _>>()?;
    let imported = import(&texts, &ImportOptions::default())?;
    Ok(FoundCalibration {
        files: paths,
        imported,
        texts,
    })
}

impl FoundCalibration {
    /// Remarks of the conversion.
    pub(super) fn remarks(&self) -> Vec<Remark> {
        let remarks = self.imported.remarks.iter();
        remarks
            .map(|remark| Remark {
                text: format!("calibration: {}", remark.text),
                ..remark.clone()
            })
            .collect()
    }

    /// The text of our calibration file for these cameras.
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
        Ok(self.unchanged_text(&text).unwrap_or(text))
    }

    /// Returns the original text if it describes the same cameras as `written`. Converting a
    /// rotation to a matrix and back changes its last bit, and in crowded scenes that is enough to
    /// change poses.
    fn unchanged_text(&self, written: &str) -> Option<String> {
        let [only] = self.texts.as_slice() else {
            return None;
        };
        let cameras = |text: &str| Some(Calibration::parse(text, &only.path).ok()?.cameras);
        let (ours, theirs) = (cameras(&only.text)?, cameras(written)?);
        let names_are_same = ours.keys().eq(theirs.keys());
        let are_same = names_are_same
            && ours
                .values()
                .zip(theirs.values())
                .all(|(a, b)| is_same(a, b));
        are_same.then(|| only.text.clone())
    }
}

fn is_same(a: &CameraModel, b: &CameraModel) -> bool {
    let poses = [a, b].map(|camera| camera.camera_from_world().isometry());
    let turned_rad = poses[0].rotation.angle_to(&poses[1].rotation);
    let apart_m = (poses[0].translation.vector - poses[1].translation.vector).norm();
    a.size_px() == b.size_px()
        && a.intrinsics() == b.intrinsics()
        && a.lens() == b.lens()
        && turned_rad < SAME_CAMERA
        && apart_m < SAME_CAMERA
}
