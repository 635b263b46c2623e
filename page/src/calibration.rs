//! What pages show of the calibration: its sheet, if there is one, and whether the sheet belongs to
//! it.

use std::sync::Arc;

use serde::Serialize;

use crate::protocol::text::json;

/// The calibration of a venue as pages show it.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct ShownCalibration {
    /// Name of its file.
    pub file: String,
    /// Its fingerprint in venues: 16 hexadecimal digits.
    pub fingerprint: String,
    /// Text for the operator: whether there is a sheet, and how to create one.
    pub text: String,
    /// Its sheet.
    pub sheet: Option<CalibrationSheet>,
}

/// The sheet of a calibration: a self-contained HTML page without scripts.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CalibrationSheet {
    /// Name of its file.
    pub file: String,
    /// Fingerprint of the calibration that it states.
    pub fingerprint: Option<String>,
    /// Whether that is the calibration in use; `None` if it states none.
    pub is_of_this: Option<bool>,
    /// The page.
    pub html: Arc<[u8]>,
}

#[derive(Serialize)]
struct CalibrationDocument<'a> {
    file: &'a str,
    fingerprint: &'a str,
    text: &'a str,
    sheet: Option<SheetDocument<'a>>,
}

#[derive(Serialize)]
struct SheetDocument<'a> {
    file: &'a str,
    fingerprint: Option<&'a str>,
    is_of_this: Option<bool>,
    path: String,
}

/// The response of `/api/calibration`; the sheet is at `/calibration/KEY`.
pub(crate) fn document(shown: &ShownCalibration, key: &str) -> String {
    let sheet = shown.sheet.as_ref().map(|sheet| SheetDocument {
        file: &sheet.file,
        fingerprint: sheet.fingerprint.as_deref(),
        is_of_this: sheet.is_of_this,
        path: format!("/calibration/{key}"),
    });
    json(&CalibrationDocument {
        file: &shown.file,
        fingerprint: &shown.fingerprint,
        text: &shown.text,
        sheet,
    })
}
