//! CSV tables: rows and cells with line numbers, and recognition of the format.

use std::path::Path;

use csv::{ReaderBuilder, StringRecord};
use farfield_proto::toml_file::FileError;

use super::Format;

/// Maximum number of cells in a row; `DeepLabCut` has three per keypoint and animal.
const MAX_CELLS: usize = 1 << 16;

/// A row and its line, from 1.
pub(super) struct Row {
    cells: StringRecord,
    pub(super) line: usize,
}

impl Row {
    /// The cells without surrounding space.
    pub(super) fn cells(&self) -> impl Iterator<Item = &str> {
        self.cells.iter()
    }

    pub(super) fn cell(&self, column: usize) -> &str {
        self.cells.get(column).unwrap_or("")
    }

    /// The number in a column; `None` if empty or NaN.
    ///
    /// # Errors
    /// If the cell is not a number.
    pub(super) fn number(&self, column: usize) -> Result<Option<f64>, String> {
        let cell = self.cell(column);
        if cell.is_empty() {
            return Ok(None);
        }
        match cell.parse::<f64>() {
            Ok(number) => Ok(number.is_finite().then_some(number)),
            Err(_) => Err(format!("found `{}`, expected a number", shown(cell))),
        }
    }

    /// The whole number in a column; `12.0` is accepted.
    ///
    /// # Errors
    /// If the cell is not a whole number.
    pub(super) fn whole(&self, column: usize, limit: i64) -> Result<i64, String> {
        let number = self.number(column)?;
        let whole = number.filter(|it| it.fract() == 0.0 && it.abs() <= limit as f64);
        whole.map(|it| it as i64).ok_or_else(|| {
            format!(
                "found `{}`, expected a whole number of at most {limit}",
                shown(self.cell(column))
            )
        })
    }

    pub(super) fn error(&self, path: &Path, problem: impl Into<String>) -> FileError {
        FileError::new(path, problem).at_line(self.line)
    }
}

/// The start of a cell, for error messages.
fn shown(cell: &str) -> String {
    const SHOWN_CHARS: usize = 40;
    cell.chars().take(SHOWN_CHARS).collect()
}

/// Iterates over the rows of a table.
pub(super) fn rows<'a>(
    text: &'a str,
    path: &'a Path,
) -> impl Iterator<Item = Result<Row, FileError>> + 'a {
    let reader = ReaderBuilder::new()
        .has_headers(false)
        .flexible(true)
        .trim(csv::Trim::All)
        .from_reader(text.as_bytes());
    reader.into_records().map(move |row| {
        let cells = row.map_err(|error| {
            let line = error.position().map(|at| at.line() as usize);
            let problem = FileError::new(path, format!("not CSV: {error}"));
            FileError { line, ..problem }
        })?;
        let line = cells.position().map_or(0, |at| at.line() as usize);
        if cells.len() > MAX_CELLS {
            let problem = format!("found {} cells, expected at most {MAX_CELLS}", cells.len());
            return Err(FileError::new(path, problem).at_line(line));
        }
        Ok(Row { cells, line })
    })
}

/// Index of the column with one of `names`, in order of preference.
pub(super) fn column(header: &Row, names: &[&str]) -> Option<usize> {
    names
        .iter()
        .find_map(|name| header.cells().position(|cell| cell == *name))
}

/// Recognises the format by the first row; `None` if unknown.
pub(super) fn recognised(text: &str) -> Option<Format> {
    let first = rows(text, Path::new("")).next()?.ok()?;
    let has = |name: &str| column(&first, &[name]).is_some();
    if first.cell(0) == "scorer" {
        return Some(Format::DeepLabCut);
    }
    if has("sync_index") && has("img_loc_x") && has("img_loc_y") {
        return Some(Format::Caliscope);
    }
    (has("frame_idx") && first.cells().any(|cell| cell.strip_suffix(".x").is_some()))
        .then_some(Format::Sleap)
}
