//! The map of the field: accuracy of a point, and number of cameras that see it.

use std::collections::BTreeSet;
use std::fmt::Write as _;

use farfield_calibration::points::PointCalibration;
use farfield_calibration::report::{FieldCell, FieldReport};

use super::plan::{Plan, seen_from_above};

/// From dark to light, in an order that is clear to colour-blind people and in a grey print (cividis, Nuñez et al.
/// 2018).
const COLOURS: [&str; 7] = [
    "#00224e", "#35456c", "#5b636f", "#7d7c78", "#a59c74", "#cfbb5c", "#fee838",
];
/// Stripes for cells that too few cameras see. Defined once per page; an element with `display:none` would draw
/// nothing.
pub(super) const STRIPES: &str = "<svg aria-hidden=\"true\" style=\"position:absolute;width:0;height:0\"><defs><pattern id=\"stripes\" width=\"6\" height=\"6\" patternUnits=\"userSpaceOnUse\" \
    patternTransform=\"rotate(45)\"><rect width=\"6\" height=\"6\" fill=\"#fff\"/><rect width=\"2.5\" height=\"6\" fill=\"#b3261e\"/>\
    </pattern></defs></svg>\n";
/// Upper ends of the classes of the map, millimetres.
const CLASSES_MM: [f64; 25] = [
    0.2, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 12.0, 15.0, 20.0, 25.0, 30.0, 40.0,
    50.0, 75.0, 100.0, 150.0, 200.0, 300.0, 500.0, 1000.0,
];

/// Overlap of neighbouring squares, pixels of the page. Numbers are rounded, so without it the background would show
/// between squares.
const OVERLAP_PX: f64 = 0.3;

/// Explanation of the maps.
const MEANING: &str = "A joint has about the error of the map if the network is accurate to one pixel, and up to three times as much \
    if it is accurate to three. If that is too much, move a camera nearer, give it a longer lens, or add a camera whose direction crosses \
    that of the others; or calibrate better if the uncertainty of the cameras is the larger part. In striped areas nothing can be \
    measured: turn a camera there, or exclude that part.";

/// Upper ends of the classes that a field needs; the last class has none.
struct Classes(Vec<f64>);

impl Classes {
    fn new(field: &FieldReport) -> Self {
        let least_mm = 1000.0 * field.sigma_m(0.0).unwrap_or(0.0);
        let most_mm = 1000.0 * field.sigma_m(0.98).unwrap_or(0.0);
        let first = CLASSES_MM.iter().position(|end| least_mm <= *end);
        let needed = CLASSES_MM.iter().skip(first.unwrap_or(0));
        let mut ends: Vec<f64> = Vec::new();
        for end in needed {
            ends.push(*end);
            if most_mm <= *end {
                break;
            }
        }
        // If there are more than colours, every other one is removed, but not the last.
        while ends.len() >= COLOURS.len() {
            let count = ends.len();
            let mut number = 0;
            ends.retain(|_| {
                number += 1;
                (count - number).is_multiple_of(2)
            });
        }
        Self(ends)
    }

    fn class(&self, sigma_m: f64) -> usize {
        let ends = self.0.iter();
        let is_above = |end: &f64| 1000.0 * sigma_m <= *end;
        ends.clone().position(is_above).unwrap_or(self.0.len())
    }

    /// Classes are spread over all colours, so a map of two classes is dark and light.
    fn colour(&self, class: usize) -> &'static str {
        let most = self.0.len().max(1);
        let index = class * (COLOURS.len() - 1) / most;
        COLOURS[index.min(COLOURS.len() - 1)]
    }

    fn words(&self, class: usize) -> String {
        match (self.0.get(class), self.0.last()) {
            (Some(end), _) => format!("up to {end} mm"),
            (None, Some(last)) => format!("above {last} mm"),
            (None, None) => String::new(),
        }
    }
}

/// The map of the field, if available.
pub(super) fn field(page: &mut String, found: &PointCalibration) {
    let Some(field) = &found.report.field else {
        page.push_str(
            "<h2>The field</h2>\n<p>There is no map of it: the scale, the floor, or the accuracy of the cameras is \
             unknown.</p>\n",
        );
        return;
    };
    let half_m = 0.5 * field.step_m;
    let corners = field.cells.iter().flat_map(|cell| {
        let [x, y, _] = cell.position_m;
        [[x - half_m, y - half_m], [x + half_m, y + half_m]]
    });
    let cameras = found.cameras.iter().map(|camera| seen_from_above(camera).0);
    let Some(plan) = Plan::new(corners.chain(cameras)) else {
        return;
    };
    // Writing to a string does not fail.
    writeln!(
        page,
        "<h2>The field</h2>\n<p>{}</p>\n<p>{MEANING}</p>",
        in_words(field)
    )
    .ok();
    page.push_str("<div class=\"pair\">\n<figure>");
    let classes = Classes::new(field);
    plan.begin(page, "accuracy of a point");
    for cell in &field.cells {
        let colour = cell.sigma_m.map(|it| classes.colour(classes.class(it)));
        square(page, &plan, field, cell, colour);
    }
    plan.court(page, field.court.as_ref());
    plan.end(page, &found.cameras);
    page.push_str("<figcaption>Standard deviation of a point: ");
    for class in 0..=classes.0.len() {
        swatch(page, Some(classes.colour(class)), &classes.words(class));
    }
    swatch(page, None, "unknown: fewer than two cameras");
    page.push_str("</figcaption></figure>\n<figure>");
    plan.begin(page, "number of cameras that see each place");
    for cell in &field.cells {
        square(page, &plan, field, cell, by_count(cell.cameras));
    }
    plan.court(page, field.court.as_ref());
    plan.end(page, &found.cameras);
    page.push_str("<figcaption>Cameras that see it: ");
    swatch(page, None, "0 or 1");
    let counts = field.cells.iter().map(|it| it.cameras.min(MOST_COUNTED));
    let counts: BTreeSet<usize> = counts.filter(|count| *count >= 2).collect();
    for count in counts {
        let more = if count == MOST_COUNTED {
            " or more"
        } else {
            ""
        };
        swatch(page, by_count(count), &format!("{count}{more}"));
    }
    page.push_str("</figcaption></figure>\n</div>\n");
}

/// From this number of cameras on, the colour is the same.
const MOST_COUNTED: usize = 8;

/// More is darker; `None` below two.
fn by_count(cameras: usize) -> Option<&'static str> {
    (cameras >= 2).then(|| COLOURS[MOST_COUNTED - cameras.min(MOST_COUNTED)])
}

/// A sentence on the whole field.
pub(in crate::calibrate) fn in_words(field: &FieldReport) -> String {
    let two = (100.0 * field.share_seen_by(2)).floor();
    let of = match &field.court {
        Some(court) => format!(
            "the {} court and of the area around it where people were",
            court.name
        ),
        None => "the area with people or marks (other areas are unknown)".to_owned(),
    };
    let seen = format!("{two:.0} % of {of} is seen by two cameras or more");
    let sigma_mm = |share: f64| field.sigma_m(share).map(|it| 1000.0 * it);
    match sigma_mm(0.5).zip(sigma_mm(0.95)) {
        Some((middle, most)) => format!(
            "A point with an error of {} px in each camera has a standard deviation of {middle:.1} mm or less in half of the field and of {most:.1} mm or \
             less in 95 % of it, {:.1} m above the floor; {seen}.",
            field.sight_sigma_px, field.height_m
        ),
        None => format!("{seen}."),
    }
}

fn square(
    page: &mut String,
    plan: &Plan,
    field: &FieldReport,
    cell: &FieldCell,
    colour: Option<&str>,
) {
    let [x, y, _] = cell.position_m;
    let half_m = 0.5 * field.step_m;
    let [left, top] = plan.px([x - half_m, y + half_m]);
    let side = field.step_m * plan.scale() + OVERLAP_PX;
    let sigma = cell.sigma_m.map_or_else(
        || "unknown".to_owned(),
        |sigma_m| format!("{:.1} mm", 1000.0 * sigma_m),
    );
    writeln!(
        page,
        "<rect x=\"{left:.1}\" y=\"{top:.1}\" width=\"{side:.1}\" height=\"{side:.1}\" fill=\"{}\" shape-rendering=\"crispEdges\">\
         <title>({x:.2}, {y:.2}) m: {sigma}, {} cameras</title></rect>",
        colour.unwrap_or("url(#stripes)"),
        cell.cameras
    )
    .ok();
}

/// One colour of a legend and its meaning.
fn swatch(page: &mut String, colour: Option<&str>, words: &str) {
    write!(
        page,
        "<span style=\"white-space:nowrap\"><svg viewBox=\"0 0 14 14\" style=\"width:.9em;height:.9em;vertical-align:-.1em\">\
         <rect width=\"14\" height=\"14\" fill=\"{}\" stroke=\"#888\"/></svg> {words}</span> &ensp; ",
        colour.unwrap_or("url(#stripes)")
    )
    .ok();
}

#[cfg(test)]
mod tests {
    use farfield_proto::court::Court;

    use super::*;

    fn with(sigmas_mm: &[f64]) -> FieldReport {
        let cells = sigmas_mm.iter().map(|mm| FieldCell {
            position_m: [0.0; 3],
            cameras: 3,
            sigma_m: Some(mm / 1000.0),
        });
        FieldReport {
            court: None,
            step_m: 1.0,
            height_m: 1.0,
            sight_sigma_px: 1.0,
            cells: cells.collect(),
        }
    }

    #[test]
    fn classes_begin_and_end_where_the_field_does() {
        let classes = Classes::new(&with(&[2.5, 4.0, 9.0]));
        assert_eq!(classes.0, [3.0, 4.0, 5.0, 6.0, 8.0, 10.0]);
        assert_eq!(classes.words(classes.class(0.0045)), "up to 5 mm");
        assert_eq!(classes.words(classes.class(0.011)), "above 10 mm");
        assert_ne!(classes.colour(0), classes.colour(5));
    }

    #[test]
    fn a_wide_range_has_no_more_classes_than_colours() {
        for field in [with(&[0.1, 900.0]), with(&[5000.0]), with(&[])] {
            let classes = Classes::new(&field);
            assert!(classes.0.len() < COLOURS.len(), "{:?}", classes.0);
            let colours: BTreeSet<_> = (0..=classes.0.len()).map(|it| classes.colour(it)).collect();
            assert_eq!(colours.len(), classes.0.len() + 1);
        }
    }

    /// Symptom: a white line crossed the maps.
    #[test]
    fn no_gap_shows_between_squares() {
        let field = with(&[2.0]);
        let plan = Plan::new([[0.0, 0.0], [37.0, 11.0]]).unwrap();
        let ends_px = |x_m: f64| -> [f64; 2] {
            let (mut page, mut cell) = (String::new(), field.cells[0]);
            cell.position_m[0] = x_m;
            square(&mut page, &plan, &field, &cell, None);
            let number = |name: &str| -> f64 {
                let (_, rest) = page.split_once(&format!("{name}=\"")).unwrap();
                rest.split('"').next().unwrap().parse().unwrap()
            };
            let left = number(" x");
            [left, left + number("width")]
        };
        for x in 0..36 {
            let [_, right] = ends_px(f64::from(x));
            let [left, _] = ends_px(f64::from(x + 1));
            assert!(left <= right, "{x}: {left} {right}");
        }
    }

    #[test]
    fn the_field_is_described_in_one_sentence() {
        let text = in_words(&with(&[2.0, 4.0, 6.0]));
        assert!(
            text.contains("4.0 mm ") && text.contains("6.0 mm "),
            "{text}"
        );
        assert!(text.contains("100 % of the area"), "{text}");
        let court = Court::of("futsal", None).ok();
        let of_court = in_words(&FieldReport {
            court,
            ..with(&[2.0])
        });
        assert!(of_court.contains("100 % of the futsal court"), "{of_court}");
    }
}
