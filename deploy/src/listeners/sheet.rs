//! The sheet of the calibration that a run uses, for the page. It is read once at the start and compared with the
//! calibration.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, ensure};
use farfield_page::{CalibrationSheet, ShownCalibration};
use farfield_proto::venue::Venue;

use crate::sheet_fingerprint;

/// Largest sheet, bytes; a sheet of 64 cameras and a football field has a tenth of that.
const MAX_SHEET_BYTES: u64 = 8 << 20;
/// First bytes of a sheet.
const HTML: &[u8] = b"<!doctype html>";

/// The calibration of `venue` as the page shows it. A recording contains its calibration; its sheet may be next to it,
/// or in the folder of its venue.
pub(super) fn of_venue(venue: &Venue) -> ShownCalibration {
    let path = &venue.calibration_path;
    let recording = path.parent().filter(|folder| folder.is_file());
    let candidates: Vec<PathBuf> = match recording.and_then(Path::parent) {
        None => vec![path.with_extension("html")],
        Some(folder) => ["calibration.html", "venue/calibration.html"]
            .map(|name| folder.join(name))
            .into(),
    };
    let mut sheets = Vec::new();
    let mut problems = Vec::new();
    for candidate in candidates.iter().filter(|it| it.exists()) {
        match read(candidate, venue) {
            Ok(sheet) => sheets.push(sheet),
            Err(problem) => problems.push(format!("{problem:#}")),
        }
    }
    // For a recording only a sheet with the right fingerprint counts: other sheets nearby may belong to anything.
    if recording.is_some() {
        sheets.retain(|sheet| sheet.is_of_this == Some(true));
    }
    sheets.sort_by_key(|sheet| sheet.is_of_this != Some(true));
    let sheet = sheets.into_iter().next();
    let file = path.file_name().unwrap_or_default();
    ShownCalibration {
        file: file.to_string_lossy().into_owned(),
        text: text(sheet.as_ref(), &problems, recording),
        fingerprint: venue.hashes.calibration.clone(),
        sheet,
    }
}

/// The same for a recording with a given sheet.
///
/// # Errors
/// When the sheet cannot be read, or belongs to another calibration.
pub(super) fn given(path: &Path, venue: &Venue) -> anyhow::Result<ShownCalibration> {
    let sheet = read(path, venue)?;
    ensure!(
        sheet.is_of_this != Some(false),
        "--sheet: {}: found the sheet of another calibration ({}), expected the sheet of the calibration in the recording ({})",
        path.display(),
        sheet.fingerprint.unwrap_or_default(),
        venue.hashes.calibration
    );
    Ok(ShownCalibration {
        text: text(Some(&sheet), &[], None),
        sheet: Some(sheet),
        ..of_venue(venue)
    })
}

fn read(path: &Path, venue: &Venue) -> anyhow::Result<CalibrationSheet> {
    let shown = || path.display().to_string();
    let about = fs::metadata(path).with_context(shown)?;
    ensure!(
        about.is_file() && about.len() <= MAX_SHEET_BYTES,
        "{}: found {} bytes, expected a sheet of at most {MAX_SHEET_BYTES}",
        shown(),
        about.len()
    );
    let html = fs::read(path).with_context(shown)?;
    ensure!(
        html.get(..HTML.len())
            .is_some_and(|head| head.eq_ignore_ascii_case(HTML)),
        "{}: found no HTML page, expected the sheet that `farfield calibrate` writes",
        shown()
    );
    let fingerprint = sheet_fingerprint::read(&html).map(str::to_owned);
    let file = path.file_name().unwrap_or_default();
    Ok(CalibrationSheet {
        is_of_this: fingerprint
            .as_ref()
            .map(|it| *it == venue.hashes.calibration),
        file: file.to_string_lossy().into_owned(),
        fingerprint,
        html: html.into(),
    })
}

/// Text for the operator.
fn text(sheet: Option<&CalibrationSheet>, problems: &[String], recording: Option<&Path>) -> String {
    match sheet {
        Some(sheet) => match sheet.is_of_this {
            Some(true) => "The sheet belongs to the calibration in use.".to_owned(),
            Some(false) => "The sheet belongs to ANOTHER calibration: the file was changed or replaced after the sheet was made. `farfield \
                calibrate` writes both together; do not judge this run by this sheet."
                .to_owned(),
            None => "The sheet has no fingerprint, so it may belong to another calibration: it was made by an older Farfield, or by hand."
                .to_owned(),
        },
        None if !problems.is_empty() => format!("The sheet cannot be shown: {}", problems.join("; ")),
        None if recording.is_some() => "No sheet of the calibration in this recording was found: expected calibration.html next to it \
            or in its folder venue. Set another path with `farfield view RECORDING --sheet FILE`."
            .to_owned(),
        None => "There is no sheet next to the calibration. `farfield calibrate points`, `people` or `all` writes one with each \
            calibration; calibrations of other programs have none."
            .to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The sample venue with `path` as its calibration.
    fn venue(path: &Path) -> Venue {
        let sample = Path::new(env!("CARGO_MANIFEST_DIR")).join("venue.sample.toml");
        let mut venue = farfield_node::files::load_venue(&sample).unwrap();
        venue.calibration_path = path.to_owned();
        venue
    }

    fn sheet_of(fingerprint: &str) -> String {
        format!(
            "<!doctype html><meta name=\"farfield-calibration\" content=\"{fingerprint}\"><h1>It passes</h1>"
        )
    }

    #[test]
    fn the_sheet_of_the_venue_is_compared_with_its_calibration() {
        let folder = tempfile::tempdir().unwrap();
        let venue = venue(&folder.path().join("hall.toml"));
        let shown = of_venue(&venue);
        assert_eq!((shown.file.as_str(), &shown.sheet), ("hall.toml", &None));
        assert!(shown.text.contains("farfield calibrate"), "{}", shown.text);
        let hash = &venue.hashes.calibration;
        for (html, is_of_this) in [
            (sheet_of(hash), Some(true)),
            (sheet_of("0123456789abcdef"), Some(false)),
            ("<!DOCTYPE html><h1>old</h1>".to_owned(), None),
        ] {
            fs::write(folder.path().join("hall.html"), html).unwrap();
            let shown = of_venue(&venue);
            assert_eq!(shown.sheet.unwrap().is_of_this, is_of_this);
            let is_warned = shown.text.contains("ANOTHER");
            assert_eq!(is_warned, is_of_this == Some(false), "{}", shown.text);
        }
        fs::write(folder.path().join("hall.html"), "no page").unwrap();
        let shown = of_venue(&venue);
        assert_eq!(shown.sheet, None);
        assert!(shown.text.contains("hall.html: "), "{}", shown.text);
    }

    #[test]
    fn a_recording_takes_only_the_sheet_of_its_calibration() {
        let folder = tempfile::tempdir().unwrap();
        let recording = folder.path().join("hall.mcap");
        fs::write(&recording, "a recording").unwrap();
        let venue = venue(&recording.join("calibration.toml"));
        fs::write(
            folder.path().join("calibration.html"),
            sheet_of("0123456789abcdef"),
        )
        .unwrap();
        let shown = of_venue(&venue);
        assert_eq!(shown.sheet, None);
        assert!(shown.text.contains("--sheet FILE"), "{}", shown.text);
        fs::create_dir(folder.path().join("venue")).unwrap();
        let right = folder.path().join("venue/calibration.html");
        fs::write(&right, sheet_of(&venue.hashes.calibration)).unwrap();
        assert_eq!(of_venue(&venue).sheet.unwrap().is_of_this, Some(true));
        assert!(given(&right, &venue).unwrap().sheet.is_some());
        let wrong = given(&folder.path().join("calibration.html"), &venue);
        let error = wrong.unwrap_err().to_string();
        assert!(error.contains(&venue.hashes.calibration), "{error}");
    }
}
