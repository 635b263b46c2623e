//! The sheet of the calibration that a run uses, for the page: found beside it, and held against it. Read once, at the start.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, ensure};
use farfield_page::{CalibrationSheet, ShownCalibration};
use farfield_proto::venue::Venue;

use crate::sheet_fingerprint;

/// Largest sheet, bytes: of 64 cameras and a football field it is a tenth of that.
const MAX_SHEET_BYTES: u64 = 8 << 20;
/// What a sheet begins with.
const HTML: &[u8] = b"<!doctype html>";

/// What the page says of the calibration of `venue`. A recording, whose calibration is in it, may have its sheet beside it, or in the
/// folder of its venue.
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
    // Of a recording only the sheet that says that it is of its calibration: what else lies there may be of anything.
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

/// The same of a recording whose sheet is said to be at `path`.
///
/// # Errors
/// When it cannot be read, or is of another calibration.
pub(super) fn given(path: &Path, venue: &Venue) -> anyhow::Result<ShownCalibration> {
    let sheet = read(path, venue)?;
    ensure!(
        sheet.is_of_this != Some(false),
        "--sheet: {}: found the sheet of another calibration ({}), expected one of that in the recording ({})",
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
    let fingerprint = sheet_fingerprint::of_sheet(&html).map(str::to_owned);
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

/// What the operator is told.
fn text(sheet: Option<&CalibrationSheet>, problems: &[String], recording: Option<&Path>) -> String {
    match sheet {
        Some(sheet) => match sheet.is_of_this {
            Some(true) => "The sheet is of the calibration that is used.".to_owned(),
            Some(false) => "The sheet is of ANOTHER calibration: the file was changed or replaced after the sheet was made. `farfield \
                calibrate` makes both together; do not judge this run by it."
                .to_owned(),
            None => "Whether the sheet is of the calibration that is used cannot be told: it was made by an older Farfield, or by hand."
                .to_owned(),
        },
        None if !problems.is_empty() => format!("The sheet cannot be shown: {}", problems.join("; ")),
        None if recording.is_some() => "No sheet of the calibration in this recording was found: looked for calibration.html beside it \
            and in its folder venue. `farfield view RECORDING --sheet FILE` says where it is."
            .to_owned(),
        None => "There is no sheet beside the calibration. `farfield calibrate points`, `people` or `all` writes one with each \
            calibration; one that came from elsewhere has none."
            .to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The venue of the sample, with its calibration called `path`.
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
    fn the_sheet_beside_the_calibration_is_held_against_it() {
        let folder = tempfile::tempdir().unwrap();
        let venue = venue(&folder.path().join("hall.toml"));
        let shown = of_venue(&venue);
        assert_eq!((shown.file.as_str(), &shown.sheet), ("hall.toml", &None));
        assert!(shown.text.contains("farfield calibrate"), "{}", shown.text);
        let hash = &venue.hashes.calibration;
        for (html, is_of_this, told) in [
            (sheet_of(hash), Some(true), "is used"),
            (sheet_of("0123456789abcdef"), Some(false), "ANOTHER"),
            (
                "<!DOCTYPE html><h1>old</h1>".to_owned(),
                None,
                "cannot be told",
            ),
        ] {
            fs::write(folder.path().join("hall.html"), html).unwrap();
            let shown = of_venue(&venue);
            assert_eq!(shown.sheet.unwrap().is_of_this, is_of_this);
            assert!(shown.text.contains(told), "{}", shown.text);
        }
        fs::write(folder.path().join("hall.html"), "no page").unwrap();
        let shown = of_venue(&venue);
        assert_eq!(shown.sheet, None);
        assert!(
            shown.text.contains("hall.html: found no HTML page"),
            "{}",
            shown.text
        );
    }

    #[test]
    fn beside_a_recording_only_the_sheet_of_its_calibration_is_taken() {
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
        assert!(
            wrong
                .unwrap_err()
                .to_string()
                .contains("of another calibration")
        );
    }
}
