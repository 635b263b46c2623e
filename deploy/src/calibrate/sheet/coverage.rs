//! Shows which parts of each camera's image contain sights.

use std::fmt::Write as _;

use farfield_calibration::points::PointCalibration;
use farfield_calibration::report::{CameraReport, PictureEdge};

use super::escaped;

/// Side of a cell, pixels of the page.
const CELL_PX: f64 = 24.0;
/// Minimum of sights in a cell, with its colour: lighter means fewer.
const SHADES: [(usize, &str); 4] = [
    (300, "#00224e"),
    (100, "#35456c"),
    (30, "#7d7c78"),
    (1, "#cfbb5c"),
];

/// A small map per camera.
pub(super) fn coverage(page: &mut String, found: &PointCalibration) {
    page.push_str(
        "<h2>Coverage of the images</h2>\n<p>Sights that fit, by their position in each camera's image; darker means more, striped means \
         none.</p>\n<div class=\"pictures\">\n",
    );
    for (camera, report) in found.cameras.iter().zip(&found.report.cameras) {
        let [width, height] = camera.size_px.map(f64::from);
        let columns = report.coverage.cells.first().map_or(0, |row| row.len()) as f64;
        let rows = report.coverage.cells.len() as f64;
        let side = [CELL_PX, CELL_PX * (height / rows) / (width / columns)];
        // Writing to a string does not fail.
        writeln!(
            page,
            "<figure><svg viewBox=\"0 0 {:.1} {:.1}\" role=\"img\" aria-label=\"sights in the image of {}\">",
            columns * side[0],
            rows * side[1],
            escaped(&report.name)
        )
        .ok();
        for (row, cells) in report.coverage.cells.iter().enumerate() {
            for (column, count) in cells.iter().enumerate() {
                writeln!(
                    page,
                    "<rect x=\"{:.1}\" y=\"{:.1}\" width=\"{:.1}\" height=\"{:.1}\" fill=\"{}\" stroke=\"#888\">\
                     <title>{count} sights</title></rect>",
                    column as f64 * side[0],
                    row as f64 * side[1],
                    side[0],
                    side[1],
                    shade(*count)
                )
                .ok();
            }
        }
        writeln!(
            page,
            "</svg><figcaption>{}</figcaption></figure>",
            escaped(&in_words(report))
        )
        .ok();
    }
    page.push_str("</div>\n");
}

fn shade(count: usize) -> &'static str {
    let dense = SHADES.iter().find(|(least, _)| count >= *least);
    dense.map_or("url(#stripes)", |(_, colour)| colour)
}

fn in_words(report: &CameraReport) -> String {
    let share = format!(
        "{}: {:.0} % empty",
        report.name,
        100.0 * report.coverage.empty_share()
    );
    let edges = report.coverage.empty_edges();
    let edges: Vec<&str> = edges.into_iter().map(PictureEdge::name).collect();
    if edges.is_empty() {
        return share;
    }
    format!("{share}, none at the {} edge", edges.join(" edge, the "))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cell_without_a_sight_is_striped() {
        assert_eq!(shade(0), "url(#stripes)");
        assert!(
            [1, 29, 30, 100, 5000]
                .iter()
                .all(|it| shade(*it).starts_with('#'))
        );
    }
}
