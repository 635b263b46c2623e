//! Input of calibrations and exports: files of other programs, and the results of a run.

use std::path::Path;

use farfield_calibration::formats::{Format, ImportOptions, TextFile, export, import};
use farfield_calibration::points::{parse, parse_multicamselfcal};
use farfield_export::run::{PoseLine, RunFacts};

use super::{read_or_refused, size, text};

/// Calibrations of other programs of any content: read or refused; those that were read are exported in every format, or
/// refused.
pub(super) fn foreign_calibration_text(bytes: &[u8]) -> String {
    let file = TextFile {
        path: "calibration".into(),
        text: text(bytes).to_owned(),
    };
    let imported = import(&[file], &ImportOptions::default());
    let mut behaviour = read_or_refused(&imported);
    if let Ok(imported) = imported {
        let cameras = size(imported.cameras.len());
        behaviour.extend([
            ", ",
            imported.format.name(),
            ": ",
            &cameras.to_string(),
            " ",
        ]);
        for format in Format::ALL {
            let written = export(&imported.cameras, format);
            behaviour.push(if written.is_ok() { '+' } else { '-' });
        }
    }
    behaviour
}

/// A camera's observations of a point, of any content: read in the order of frames, or refused.
pub(super) fn point_sightings_text(bytes: &[u8]) -> String {
    let text = text(bytes);
    let sightings = parse(text, Path::new("seen.txt"));
    for pair in sightings.iter().flat_map(|all| all.windows(2)) {
        assert!(pair[0].frame < pair[1].frame, "frames come in order");
    }
    let (ids, points) = text.split_once("\n\n").unwrap_or((text, ""));
    let path = Path::new("points.dat");
    let table = parse_multicamselfcal((points, path), (ids, path));
    format!(
        "{}; {}",
        read_or_refused(&sightings),
        read_or_refused(&table)
    )
}

/// A run's summary and its poses, of any content: read or refused.
pub(super) fn run_text(bytes: &[u8]) -> String {
    let text = text(bytes);
    let (summary, poses) = text.split_once('\n').unwrap_or((text, ""));
    let mut behaviour = read_or_refused(&RunFacts::parse(summary, Path::new("summary.json")));
    for (number, line) in poses.lines().enumerate() {
        let path = Path::new("poses.jsonl");
        let head = PoseLine::parse_head(line, path, number + 1);
        let whole = PoseLine::parse(line, path, number + 1);
        assert!(
            head.is_ok() || whole.is_err(),
            "a line without a head is no pose"
        );
        behaviour.extend(["; ", &read_or_refused(&whole)]);
    }
    behaviour
}
