
use std::fmt;

use crate::suite::people::recovery::slowest_s;
use crate::suite::report::SceneReport;

/// Column heads with their widths.
const COLUMNS: [(&str, usize); 14] = [
    ("people", 6),
    ("MPJPE mm", 8),
    ("gaps", 5),
    ("switches", 8),
    ("frag", 4),
    ("false births", 12),
    ("IDF1 %", 6),
    ("MOTA %", 6),
    ("born s", 6),
    ("worst s", 7),
    ("returns", 7),
    ("old id", 6),
    ("id kept", 7),
    ("back s", 6),
];

/// One line per scene.
pub struct Overview<'a>(pub &'a [SceneReport]);

impl fmt::Display for Overview<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let names = self.0.iter().map(|report| report.scene.len());
        let width = names.max().unwrap_or(0);
        write!(f, "{:>width$}", "scene")?;
        for (head, width) in COLUMNS {
            write!(f, "  {head:>width$}")?;
        }
        for report in self.0 {
            write!(f, "\n{:>width$}", report.scene)?;
            for (cell, (_, width)) in cells(report).into_iter().zip(COLUMNS) {
                write!(f, "  {cell:>width$}")?;
            }
        }
        write!(
            f,
            "\nborn: from when a person is in the field and in the images of two viewpoints (median, worst); \
             back: from the end of a loss until below 50 mm for good (worst)"
        )
    }
}

fn cells(report: &SceneReport) -> [String; COLUMNS.len()] {
    let scores = &report.with_range_of_motion;
    let (identity, lives) = (&scores.identity, &scores.lives);
    let some = |value: Option<f64>, digits: usize| {
        value.map_or_else(|| "-".to_owned(), |value| format!("{value:.digits$}"))
    };
    let gaps: u64 = scores.actors.values().map(|actor| actor.gaps).sum();
    let worst = match lives.never_born {
        0 => some(lives.time_to_birth_worst_s, 2),
        _ => "never".to_owned(),
    };
    let kept = report.recoveries.iter().filter(|r| r.same_id).count();
    let lost = match report.recoveries.len() {
        0 => "-".to_owned(),
        lost => format!("{kept}/{lost}"),
    };
    let returned = match lives.returns {
        0 => "-".to_owned(),
        _ => lives.returns_same_id.to_string(),
    };
    [
        report.people.to_string(),
        some(scores.mean.mpjpe_mm, 1),
        gaps.to_string(),
        identity.switches.to_string(),
        identity.fragmentations.to_string(),
        identity.false_births.to_string(),
        some(Some(identity.idf1), 1),
        some(Some(identity.mota), 1),
        some(lives.time_to_birth_median_s, 2),
        worst,
        lives.returns.to_string(),
        returned,
        lost,
        some(slowest_s(&report.recoveries), 2),
    ]
}
