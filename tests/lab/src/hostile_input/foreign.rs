//! What calibrations and exports are made of: files of other programs, and what a run has left.

use std::path::Path;

use farfield_calibration::formats::{Format, ImportOptions, TextFile, export, import};
use farfield_calibration::points::{parse, parse_multicamselfcal};
use farfield_export::run::{PoseLine, RunFacts};

use super::{read_or_refused, size, text};

/// Calibrations of other programs of any content: read or refused; what was read is written in every format, or refused.
pub(super) fn foreign_calibration_text(bytes: &[u8]) -> String {
    let file = TextFile {
        path: "calibration".into(),
        text: text(bytes).to_owned(),
    };
    let imported = import(&[file], &ImportOptions::default());
    let mut became = read_or_refused(&imported);
    if let Ok(imported) = imported {
        let cameras = size(imported.cameras.len());
        became.extend([
            ", ",
            imported.format.name(),
            ": ",
            &cameras.to_string(),
            " ",
        ]);
        for format in Format::ALL {
            let written = export(&imported.cameras, format);
            became.push(if written.is_ok() { '+' } else { '-' });
        }
    }
    became
}

/// What a camera saw of a point, of any content: read in the order of the frames, or refused.
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

/// A run's summary, and below it its poses, of any content: read or refused.
pub(super) fn run_text(bytes: &[u8]) -> String {
    let text = text(bytes);
    let (summary, poses) = text.split_once('\n').unwrap_or((text, ""));
    let mut became = read_or_refused(&RunFacts::parse(summary, Path::new("summary.json")));
    for (number, line) in poses.lines().enumerate() {
        let path = Path::new("poses.jsonl");
        let head = PoseLine::parse_head(line, path, number + 1);
        let whole = PoseLine::parse(line, path, number + 1);
        assert!(
            head.is_ok() || whole.is_err(),
            "a line without a head is no pose"
        );
        became.extend(["; ", &read_or_refused(&whole)]);
    }
    became
}
