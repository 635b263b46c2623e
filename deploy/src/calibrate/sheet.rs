//! The sheet of a calibration: one HTML file that says whether it passes, which camera to climb to, and where they stand.
//! It needs nothing but itself.

use std::fmt::Write as _;
use std::path::Path;

use farfield_calibration::points::{FoundCamera, PointCalibration};

use super::judged::{JudgedCalibration, halves};

/// Side of the plan, pixels of the page, and its margin.
const PLAN_PX: f64 = 640.0;
const MARGIN_PX: f64 = 60.0;
/// Most points of the path that are drawn.
const MAX_DRAWN: usize = 4000;
/// How the page looks, in the light and in the dark.
const STYLE: &str = "body{font:16px/1.5 system-ui,sans-serif;margin:2rem auto;max-width:72rem;padding:0 1rem}\
    table{border-collapse:collapse;width:100%}th,td{text-align:right;padding:.3rem .6rem;border-bottom:1px solid #8884}\
    td{white-space:nowrap}th:first-child,td:first-child{text-align:left}.wide{overflow-x:auto}.pass{color:#0a7d4d}.fail{color:#c0392b}svg{width:100%;height:auto}\
    @media(prefers-color-scheme:dark){body{background:#14171a;color:#dde}.pass{color:#4cc38a}.fail{color:#ff7a6b}}";

/// The sheet of the calibration that is written to `path`.
pub(super) fn html(path: &Path, judged: &JudgedCalibration<'_>) -> String {
    let found = judged.found;
    let name = escaped(&path.display().to_string());
    let (class, verdict) = if judged.passes() {
        ("pass", "It passes.")
    } else {
        ("fail", "It does not pass.")
    };
    let mut page = format!(
        "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\"><title>Calibration {name}</title><style>{STYLE}</style>\n\
         <h1>Calibration {name}</h1>\n<p class=\"{class}\"><strong>{verdict}</strong></p>\n"
    );
    findings(&mut page, judged);
    table(&mut page, found);
    plan(&mut page, found);
    page
}

// Writing to a string does not fail.

fn findings(page: &mut String, judged: &JudgedCalibration<'_>) {
    let report = judged.found.report.findings.iter();
    let mut all: Vec<(bool, String)> = report.map(|it| (it.is_wrong, it.to_string())).collect();
    let refusals = judged.refusals.iter();
    all.extend(refusals.map(|it| (true, format!("a run refuses it: {it}"))));
    all.extend(judged.doubts.iter().map(|it| (false, it.clone())));
    if all.is_empty() {
        page.push_str("<p>Nothing speaks against it.</p>\n");
        return;
    }
    all.sort_by_key(|(is_wrong, _)| !is_wrong);
    page.push_str("<h2>What speaks against it</h2>\n<ul>\n");
    for (is_wrong, text) in all {
        let class = if is_wrong { "fail" } else { "warn" };
        writeln!(page, "<li class=\"{class}\">{}</li>", escaped(&text)).ok();
    }
    page.push_str("</ul>\n");
}

fn table(page: &mut String, found: &PointCalibration) {
    page.push_str(
        "<h2>Cameras</h2>\n<div class=\"wide\"><table><tr><th>camera</th><th>sights</th><th>used</th><th>off by</th><th>place, by noise alone</th>\
         <th>rotation, by noise alone</th><th>halves of the data</th><th>focal length</th><th>frame 0 at</th><th>rate</th></tr>\n",
    );
    for it in &found.report.cameras {
        writeln!(
            page,
            "<tr><td>{}</td><td>{}</td><td>{:.0} %</td><td>{:.2} px</td><td>{:.1} mm</td><td>{:.3}&deg;</td>\
             <td>{}</td><td>&times; {:.4}</td><td>{:.4} s</td><td>{:.4} Hz</td></tr>",
            escaped(&it.name),
            it.sights,
            100.0 * it.used_share,
            it.rms_px,
            1000.0 * it.position_sigma_m,
            it.rotation_sigma_deg,
            halves(it),
            it.focal_ratio,
            it.offset_s,
            it.rate_hz
        )
        .ok();
    }
    page.push_str("</table></div>\n");
    if let Some(rms_m) = found.report.anchors_rms_m {
        writeln!(
            page,
            "<p>Known places are {:.0} mm from where they were found.</p>",
            1000.0 * rms_m
        )
        .ok();
    }
}

/// Cameras and path from above.
fn plan(page: &mut String, found: &PointCalibration) {
    let step = found.path.len().div_ceil(MAX_DRAWN).max(1);
    let path: Vec<[f64; 2]> = found
        .path
        .iter()
        .step_by(step)
        .map(|it| [it.position_m[0], it.position_m[1]])
        .collect();
    let cameras: Vec<([f64; 2], [f64; 2], &str)> =
        found.cameras.iter().map(seen_from_above).collect();
    let all = path.iter().chain(cameras.iter().map(|(at, ..)| at));
    let all: Vec<&[f64; 2]> = all.filter(|at| at.iter().all(|v| v.is_finite())).collect();
    let bound = |axis: usize, pick: fn(f64, f64) -> f64, from: f64| {
        all.iter().map(|at| at[axis]).fold(from, pick)
    };
    let min_m = [0, 1].map(|axis| bound(axis, f64::min, f64::INFINITY));
    let max_m = [0, 1].map(|axis| bound(axis, f64::max, f64::NEG_INFINITY));
    let extent_m = (max_m[0] - min_m[0]).max(max_m[1] - min_m[1]);
    if !(extent_m.is_finite() && extent_m > 0.0) {
        return;
    }
    let scale = (PLAN_PX - 2.0 * MARGIN_PX) / extent_m;
    let px = |at: &[f64; 2]| {
        [
            MARGIN_PX + (at[0] - min_m[0]) * scale,
            PLAN_PX - MARGIN_PX - (at[1] - min_m[1]) * scale,
        ]
    };
    writeln!(
        page,
        "<h2>From above</h2>\n<svg viewBox=\"0 0 {PLAN_PX} {PLAN_PX}\" role=\"img\" aria-label=\"cameras and path from above\">"
    )
    .ok();
    for at in path.iter().filter(|at| at.iter().all(|v| v.is_finite())) {
        let [x, y] = px(at);
        writeln!(
            page,
            "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"1\" fill=\"#4c8bf5\"/>"
        )
        .ok();
    }
    for (at, ahead, name) in cameras
        .iter()
        .filter(|(at, ..)| at.iter().all(|v| v.is_finite()))
    {
        let [x, y] = px(at);
        let [to_x, to_y] = [x + 36.0 * ahead[0], y - 36.0 * ahead[1]];
        writeln!(
            page,
            "<line x1=\"{x:.1}\" y1=\"{y:.1}\" x2=\"{to_x:.1}\" y2=\"{to_y:.1}\" stroke=\"currentColor\"/>\
             <circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"5\" fill=\"#d9822b\"/>\
             <text x=\"{:.1}\" y=\"{:.1}\" font-size=\"13\" fill=\"currentColor\">{}</text>",
            x + 8.0,
            y - 8.0,
            escaped(name)
        )
        .ok();
    }
    let metres = nice_length_m(extent_m);
    let [from, to] = [MARGIN_PX, MARGIN_PX + metres * scale];
    writeln!(
        page,
        "<line x1=\"{from}\" y1=\"{y}\" x2=\"{to:.1}\" y2=\"{y}\" stroke=\"currentColor\" stroke-width=\"2\"/>\
         <text x=\"{from}\" y=\"{above}\" font-size=\"13\" fill=\"currentColor\">{metres} m</text>\n</svg>",
        y = PLAN_PX - 16.0,
        above = PLAN_PX - 22.0
    )
    .ok();
}

/// Where a camera stands and looks, from above, and its name.
fn seen_from_above(camera: &FoundCamera) -> ([f64; 2], [f64; 2], &str) {
    let at = camera.state.center_w;
    let ahead = camera.state.camera_from_world.inverse() * nalgebra::Vector3::z();
    ([at.x, at.y], [ahead.x, ahead.y], &camera.name)
}

/// A round length of about a quarter of the extent.
fn nice_length_m(extent_m: f64) -> f64 {
    let lengths = [0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0];
    let fits = lengths
        .into_iter()
        .rev()
        .find(|length| *length <= 0.4 * extent_m);
    fits.unwrap_or(0.1)
}

/// Whatever a camera is called is text.
fn escaped(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => escaped.push_str("&amp;"),
            '<' => escaped.push_str("&lt;"),
            '>' => escaped.push_str("&gt;"),
            '"' => escaped.push_str("&quot;"),
            c => escaped.push(c),
        }
    }
    escaped
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_text_whatever_they_are() {
        assert_eq!(escaped("<b>\"a\" & b"), "&lt;b&gt;&quot;a&quot; &amp; b");
    }

    #[test]
    fn the_scale_is_a_round_length_that_fits() {
        for (extent_m, length_m) in [(24.0, 5.0), (118.0, 20.0), (5.0, 2.0), (0.01, 0.1)] {
            assert!(
                (nice_length_m(extent_m) - length_m).abs() < 1e-12,
                "{extent_m}"
            );
        }
    }
}
