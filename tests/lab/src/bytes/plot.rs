//! Bytes against errors as SVG: x is bytes (logarithmic), y is millimetres, ours is a line.

use farfield_score::plot::{Layer, Plot, PlotAxis};

use super::run::{Curve, PackingRow};

/// Range of bytes in the plot.
const RANGE_BYTES: [f64; 2] = [20.0, 300_000.0];
/// Points with an error above this factor of the least do not set the scale.
const SHOWN: f64 = 2.5;
/// Colours of other codecs, after that of ours.
const OTHER_COLOURS: usize = 7;

/// The curve of one scene or recording as an SVG document.
pub fn svg(curve: &Curve) -> String {
    let errors = curve.rows.iter().map(|row| row.errors.mpjpe_mm);
    let least = errors.clone().fold(f64::INFINITY, f64::min);
    let most = errors
        .filter(|&mm| mm <= SHOWN * least)
        .fold(least, f64::max);
    let margin = (0.1 * (most - least)).max(0.5);
    let range_mm = [(least - margin).max(0.0), most + margin];
    let at = |row: &PackingRow| {
        let bytes = row.map_bytes.clamp(RANGE_BYTES[0], RANGE_BYTES[1]);
        (bytes, row.errors.mpjpe_mm.clamp(range_mm[0], range_mm[1]))
    };
    let ours = curve.rows.iter().filter(|row| row.ours).map(at).collect();
    let line = Layer {
        name: "ours".to_owned(),
        lines: vec![ours],
        ..Layer::default()
    };
    let points = curve.rows.iter().enumerate().map(|(i, row)| Layer {
        name: format!("{} {:.0} B", row.name, row.map_bytes),
        colour: if row.ours { 0 } else { 1 + i % OTHER_COLOURS },
        points: vec![at(row)],
        ..Layer::default()
    });
    let title = format!(
        "{}, {}: mean error over bytes per person, view and tick",
        curve.place, curve.input
    );
    let plot = Plot {
        title: &title,
        size_px: [1000, 560],
        x: PlotAxis {
            description: "bytes",
            range: RANGE_BYTES,
            is_logarithmic: true,
            label: |bytes| format!("{bytes:.0} B"),
        },
        y: PlotAxis {
            description: "mm",
            range: range_mm,
            is_logarithmic: false,
            label: |mm| format!("{mm:.1}"),
        },
        layers: std::iter::once(line).chain(points).collect(),
        note: "",
    };
    plot.svg()
}
