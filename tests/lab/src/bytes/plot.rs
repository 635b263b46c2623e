//! Bytes against errors as SVG: bytes along, in powers of ten; millimetres up, ours as a line.

use super::run::{Curve, Row};

/// Size of the picture, pixels.
const SIZE: [f64; 2] = [1000.0, 560.0];
/// Left, right, upper and lower edge of the panel, pixels.
const PANEL: [f64; 4] = [70.0, 760.0, 40.0, 510.0];
/// Bytes that the panel shows, as powers of ten: 20 to 300,000.
const DECADES: [f64; 2] = [1.3, 5.5];
/// How far above the best a point may be and still set the scale, times.
const SHOWN: f64 = 2.5;
/// Colours that are told apart by most eyes (Okabe and Ito 2008).
const COLOURS: [&str; 7] = [
    "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000", "#b8a800",
];
const OURS: &str = "#0072b2";

/// The curve of one place as an SVG document.
pub fn svg(curve: &Curve) -> String {
    let errors = curve.rows.iter().map(|row| row.errors.mpjpe_mm);
    let least = errors.clone().fold(f64::INFINITY, f64::min);
    let most = errors
        .filter(|&mm| mm <= SHOWN * least)
        .fold(least, f64::max);
    let margin = (0.1 * (most - least)).max(0.5);
    let (low, high) = ((least - margin).max(0.0), most + margin);
    let [left, right, upper, lower] = PANEL;
    let x = |bytes: f64| {
        let share = (bytes.max(1.0).log10() - DECADES[0]) / (DECADES[1] - DECADES[0]);
        left + share.clamp(0.0, 1.0) * (right - left)
    };
    let y = |mm: f64| lower - ((mm - low) / (high - low)).clamp(0.0, 1.0) * (lower - upper);
    let mut text = String::new();
    let mut put = |line: String| {
        text.push_str(&line);
        text.push('\n');
    };
    put(format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{}\" height=\"{}\" font-family=\"sans-serif\" font-size=\"12\">",
        SIZE[0], SIZE[1]
    ));
    put("<rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>".to_owned());
    put(format!(
        "<text x=\"{left}\" y=\"24\" font-size=\"15\">{}, {}: mean error over bytes per person, view and tick</text>",
        curve.place, curve.input
    ));
    for bytes in [30.0, 100.0, 300.0, 1e3, 1e4, 1e5] {
        let at = x(bytes);
        put(format!(
            "<path d=\"M{at:.1} {upper}V{lower}\" stroke=\"#ddd\"/>"
        ));
        put(format!(
            "<text x=\"{at:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{bytes:.0} B</text>",
            lower + 18.0
        ));
    }
    for step in 0..=5 {
        let mm = low + f64::from(step) / 5.0 * (high - low);
        put(format!(
            "<path d=\"M{left} {0:.1}H{right}\" stroke=\"#ddd\"/>",
            y(mm)
        ));
        put(format!(
            "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\">{mm:.1} mm</text>",
            left - 6.0,
            y(mm) + 4.0
        ));
    }
    let ours = curve.rows.iter().filter(|row| row.ours);
    let line: Vec<String> = ours
        .map(|row| format!("{:.1},{:.1}", x(row.map_bytes), y(row.errors.mpjpe_mm)))
        .collect();
    put(format!(
        "<polyline points=\"{}\" fill=\"none\" stroke=\"{OURS}\" stroke-width=\"2\"/>",
        line.join(" ")
    ));
    for (i, row) in curve.rows.iter().enumerate() {
        let (cx, cy) = (x(row.map_bytes), y(row.errors.mpjpe_mm));
        put(point(row, i, [cx, cy]));
    }
    put("</svg>".to_owned());
    text
}

/// The `i`-th row as a point at `at`, and its line in the legend.
fn point(row: &Row, i: usize, at: [f64; 2]) -> String {
    let [_, right, upper, _] = PANEL;
    let colour = if row.ours {
        OURS
    } else {
        COLOURS[i % COLOURS.len()]
    };
    let ([cx, cy], line) = (at, upper + 20.0 * i as f64);
    format!(
        "<circle cx=\"{cx:.1}\" cy=\"{cy:.1}\" r=\"4\" fill=\"{colour}\"/>\n\
         <circle cx=\"{:.1}\" cy=\"{line:.1}\" r=\"4\" fill=\"{colour}\"/>\n\
         <text x=\"{:.1}\" y=\"{:.1}\">{} {:.0} B</text>",
        right + 16.0,
        right + 26.0,
        line + 4.0,
        row.name,
        row.map_bytes
    )
}
