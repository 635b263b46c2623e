//! What pages are told of the calibration: its sheet, where there is one, and whether it is of it.

use std::sync::Arc;

use serde::Serialize;

use crate::protocol::text::json;

/// The calibration of a venue, as pages show it.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct ShownCalibration {
    /// What its file is called.
    pub file: String,
    /// By which venues know it: 16 hexadecimal digits.
    pub fingerprint: String,
    /// What the operator is told: whether there is a sheet, and what to do where there is none.
    pub text: String,
    /// Its sheet.
    pub sheet: Option<CalibrationSheet>,
}

/// The sheet of a calibration: an HTML page that needs nothing but itself, without scripts.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CalibrationSheet {
    /// What its file is called.
    pub file: String,
    /// The calibration that it says it is of.
    pub fingerprint: Option<String>,
    /// Whether that is the one in use; `None`: it does not say.
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

/// The answer of `/api/calibration`; the sheet is at `/calibration/KEY`.
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
