//! The sheet of a calibration: one self-contained HTML file with the verdict, the problems of each camera, and plans.

mod coverage;
mod field;
mod plan;

use std::fmt::Write as _;
use std::path::Path;

use farfield_calibration::points::PointCalibration;

pub(super) use field::in_words;

use field::STRIPES;

use super::results::{JudgedCalibration, NOT_DETERMINED, halves, people_in_words};
use crate::sheet_fingerprint;

/// Style of the page, for light and dark displays.
const STYLE: &str = "body{font:16px/1.5 system-ui,sans-serif;margin:2rem auto;max-width:72rem;padding:0 1rem}\
    table{border-collapse:collapse;width:100%}th,td{text-align:right;padding:.3rem .6rem;border-bottom:1px solid #8884}\
    td{white-space:nowrap}td.words{white-space:normal;min-width:15rem}th:first-child,td:first-child{text-align:left}.wide{overflow-x:auto}.pass{color:#0a7d4d}.warn{color:#8a5a00}.fail{color:#c0392b}svg{width:100%;height:auto}\
    .pair{display:grid;grid-template-columns:repeat(auto-fit,minmax(20rem,1fr));gap:1rem}figure{margin:0}.pictures{display:grid;\
    grid-template-columns:repeat(auto-fill,minmax(11rem,1fr));gap:1rem}figcaption{font-size:.9rem}\
    @media(prefers-color-scheme:dark){body{background:#14171a;color:#dde}.pass{color:#4cc38a}.warn{color:#e5b567}.fail{color:#ff7a6b}}";

/// Facts on the request for the sheet.
pub(super) struct SheetFacts<'a> {
    /// Origin of the scale, in sentences.
    pub(super) metres: &'a str,
    /// Whether cameras have separate clocks; otherwise times and rates of frames are unknown.
    pub(super) has_clocks: bool,
}

/// The sheet of the calibration that is written to `path`.
pub(super) fn html(path: &Path, judged: &JudgedCalibration<'_>, facts: &SheetFacts<'_>) -> String {
    let found = judged.found;
    let name = escaped(&path.display().to_string());
    let (class, verdict) = if judged.passes() {
        ("pass", "It passes.")
    } else {
        ("fail", "It does not pass.")
    };
    let mut page = format!(
        "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\"><meta name=\"viewport\" \
         content=\"width=device-width,initial-scale=1\">{}<title>Calibration {name}</title><style>{STYLE}</style>\n{STRIPES}\
         <h1>Calibration {name}</h1>\n<p class=\"{class}\"><strong>{verdict}</strong></p>\n",
        sheet_fingerprint::line(&judged.text)
    );
    findings(&mut page, judged);
    writeln!(page, "<p>{}</p>", escaped(facts.metres)).ok();
    table(&mut page, found, facts);
    field::field(&mut page, found);
    coverage::coverage(&mut page, found);
    plan::path(&mut page, found);
    page.push_str("</html>\n");
    page
}

// Writing to a string does not fail.

fn findings(page: &mut String, judged: &JudgedCalibration<'_>) {
    let report = judged.found.report.findings.iter();
    let mut all: Vec<(bool, String)> = report.map(|it| (it.is_wrong(), it.to_string())).collect();
    let refusals = judged.refusals.iter();
    all.extend(refusals.map(|it| (true, format!("a run refuses it: {it}"))));
    all.extend(judged.warnings.iter().map(|it| (false, it.clone())));
    if all.is_empty() {
        page.push_str("<p>No problems were found.</p>\n");
        return;
    }
    all.sort_by_key(|(is_wrong, _)| !is_wrong);
    page.push_str("<h2>Problems</h2>\n<ul>\n");
    for (is_wrong, text) in all {
        let class = if is_wrong { "fail" } else { "warn" };
        writeln!(page, "<li class=\"{class}\">{}</li>", escaped(&text)).ok();
    }
    page.push_str("</ul>\n");
}

fn table(page: &mut String, found: &PointCalibration, facts: &SheetFacts<'_>) {
    page.push_str(
        "<h2>Cameras</h2>\n<div class=\"wide\"><table><tr><th>camera</th><th>sights</th><th>used</th><th>error</th><th>position, by noise alone</th>\
         <th>rotation, by noise alone</th><th>halves of the data</th><th>focal length</th>",
    );
    if facts.has_clocks {
        page.push_str("<th>frame 0 at</th><th>rate</th>");
    }
    page.push_str("</tr>\n");
    for it in &found.report.cameras {
        let rotation = it.determined_rotation_deg();
        let rotation = rotation.map_or(NOT_DETERMINED.to_owned(), |deg| format!("{deg:.3}&deg;"));
        write!(
            page,
            "<tr><td>{}</td><td>{}</td><td>{:.0} %</td><td>{:.2} px</td><td>{:.1} mm</td><td>{}</td>\
             <td class=\"words\">{}</td><td>&times; {:.4}</td>",
            escaped(&it.name),
            it.sights,
            100.0 * it.used_share,
            it.rms_px,
            1000.0 * it.position_sigma_m,
            rotation,
            halves(it),
            it.focal_ratio
        )
        .ok();
        if facts.has_clocks {
            write!(
                page,
                "<td>{:.4} s</td><td>{:.4} Hz</td>",
                it.offset_s, it.rate_hz
            )
            .ok();
        }
        page.push_str("</tr>\n");
    }
    page.push_str("</table></div>\n");
    if let Some(people) = &found.report.people {
        writeln!(page, "<p>{}</p>", people_in_words(people)).ok();
    }
    if let Some(rms_m) = found.report.anchors_rms_m {
        writeln!(
            page,
            "<p>The known places have an error of {:.0} mm.</p>",
            1000.0 * rms_m
        )
        .ok();
    }
}

/// Escapes a text for HTML.
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
    use farfield_calibration::report::{CameraReport, PictureCoverage, Report};

    use super::*;

    /// Symptom: for cameras without separate clocks, whose frames have only numbers, it showed "-750.0000 s" and
    /// "1.0000 Hz".
    #[test]
    fn times_are_shown_only_for_cameras_with_separate_clocks() {
        let camera = CameraReport {
            name: "ne".to_owned(),
            sights: 900,
            used_share: 0.97,
            rms_px: 0.4,
            noise_px: 0.3,
            position_sigma_m: 0.002,
            rotation_sigma_deg: 0.01,
            focal_ratio: 1.0,
            offset_s: -750.0,
            rate_hz: 1.0,
            halves_m: 0.003,
            halves_deg: 0.02,
            halves_px: 0.2,
            halves_across_m: 0.004,
            coverage: PictureCoverage::default(),
        };
        let found = PointCalibration {
            cameras: Vec::new(),
            path: Vec::new(),
            report: Report {
                cameras: vec![camera],
                ..Report::default()
            },
        };
        let page_with = |has_clocks| {
            let mut page = String::new();
            let metres = "";
            table(&mut page, &found, &SheetFacts { metres, has_clocks });
            assert_eq!(page.matches("<th>").count(), page.matches("<td").count());
            page
        };
        let with = page_with(true);
        assert!(
            with.contains("<td>-750.0000 s</td><td>1.0000 Hz</td></tr>"),
            "{with}"
        );
        let without = page_with(false);
        assert!(
            !without.contains("Hz") && !without.contains("frame 0"),
            "{without}"
        );
    }

    #[test]
    fn names_are_escaped() {
        assert_eq!(escaped("<b>\"a\" & b"), "&lt;b&gt;&quot;a&quot; &amp; b");
    }
}
