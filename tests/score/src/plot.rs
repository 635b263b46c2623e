//! The error of each actor over time, drawn as SVG text.
//!
//! One panel, one line per series, time along, millimetres up. The scale ends where 99.5 % of the
//! values lie, so that a moment of confusion does not flatten the rest; what is above runs along the
//! upper edge. A gap breaks the line and is marked on the lower edge.

use std::fmt::Write as _;

use super::errors_over_time;
use super::lines::Recording;

/// One line of the plot.
#[derive(Debug, Clone, PartialEq)]
pub struct Series {
    /// What the legend calls it.
    pub name: String,
    /// Seconds, rising, and millimetres; `None` is a gap.
    pub points: Vec<(f64, Option<f64>)>,
}

/// Size of the picture, pixels.
const SIZE: [f64; 2] = [1200.0, 420.0];
/// Left, right, upper and lower edge of the panel, pixels.
const PANEL: [f64; 4] = [64.0, 1040.0, 40.0, 370.0];
/// The scale reaches at least this far, millimetres: half of what still is a success.
const LEAST_TOP_MM: f64 = 75.0;
/// Share of the values that the scale shows.
const SHOWN: f64 = 0.995;
/// Colours that are told apart by most eyes (Okabe and Ito 2008).
const COLOURS: [&str; 8] = [
    "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000", "#b8a800",
];

/// Where values land on the panel.
struct Scale {
    from_s: f64,
    until_s: f64,
    top_mm: f64,
}

impl Scale {
    fn of(series: &[Series]) -> Self {
        let all = || series.iter().flat_map(|s| &s.points);
        let times = || all().map(|(t, _)| *t);
        let from_s = times().fold(f64::INFINITY, f64::min);
        let until_s = times().fold(f64::NEG_INFINITY, f64::max);
        let mut errors: Vec<f64> = all()
            .filter_map(|(_, e)| *e)
            .filter(|e| e.is_finite())
            .collect();
        errors.sort_by(f64::total_cmp);
        let shown = (SHOWN * errors.len() as f64) as usize;
        let high = errors.get(shown.min(errors.len().saturating_sub(1)));
        let top_mm = 1.1 * high.copied().unwrap_or(0.0).max(LEAST_TOP_MM);
        if until_s > from_s {
            Self {
                from_s,
                until_s,
                top_mm,
            }
        } else {
            let from_s = if from_s.is_finite() { from_s } else { 0.0 };
            Self {
                from_s,
                until_s: from_s + 1.0,
                top_mm,
            }
        }
    }

    fn x(&self, time_s: f64) -> f64 {
        let [left, right, ..] = PANEL;
        left + (right - left) * (time_s - self.from_s) / (self.until_s - self.from_s)
    }

    fn y(&self, error_mm: f64) -> f64 {
        let [.., upper, lower] = PANEL;
        lower - (lower - upper) * (error_mm / self.top_mm).clamp(0.0, 1.0)
    }
}

/// Draws the error of each actor of `truth` over time, as an SVG document.
pub fn plot_of(title: &str, poses: &Recording, truth: &Recording, rate_hz: f64) -> String {
    let errors = errors_over_time(poses, truth);
    let series: Vec<Series> = errors
        .into_iter()
        .map(|(actor, errors)| Series {
            name: format!("actor {actor}"),
            points: errors
                .into_iter()
                .map(|(tick, error_m)| (tick.seconds(rate_hz), error_m.map(|m| 1000.0 * m)))
                .collect(),
        })
        .collect();
    svg(title, &series)
}

/// Draws `series` under `title`: a whole SVG document.
pub fn svg(title: &str, series: &[Series]) -> String {
    let scale = Scale::of(series);
    let [width, height] = SIZE;
    let mut text = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" \
         viewBox=\"0 0 {width} {height}\" font-family=\"sans-serif\" font-size=\"13\">\n\
         <rect width=\"{width}\" height=\"{height}\" fill=\"white\"/>\n"
    );
    label(&mut text, [PANEL[0], 24.0], "start", title);
    axes(&mut text, &scale);
    for (series, colour) in series.iter().zip(COLOURS.iter().cycle()) {
        curve(&mut text, series, &scale, colour);
    }
    for (index, (series, colour)) in series.iter().zip(COLOURS.iter().cycle()).enumerate() {
        let (x, y) = (PANEL[1] + 14.0, PANEL[2] + 10.0 + 20.0 * index as f64);
        element(
            &mut text,
            format_args!(
                "<line x1=\"{x}\" y1=\"{y}\" x2=\"{}\" y2=\"{y}\" stroke=\"{colour}\" stroke-width=\"3\"/>",
                x + 18.0
            ),
        );
        label(&mut text, [x + 24.0, y + 4.0], "start", &series.name);
    }
    let below = PANEL[2] + 14.0 + 20.0 * series.len() as f64;
    label(
        &mut text,
        [PANEL[1] + 14.0, below],
        "start",
        "dots: no pose",
    );
    text.push_str("</svg>\n");
    text
}

fn axes(text: &mut String, scale: &Scale) {
    let [left, right, upper, lower] = PANEL;
    let step_mm = nice_step(scale.top_mm, 6.0);
    for n in 0..=(scale.top_mm / step_mm) as u32 {
        let value = f64::from(n) * step_mm;
        let y = scale.y(value);
        element(
            text,
            format_args!(
                "<line x1=\"{left}\" y1=\"{y:.1}\" x2=\"{right}\" y2=\"{y:.1}\" stroke=\"#dddddd\"/>"
            ),
        );
        label(text, [left - 6.0, y + 4.0], "end", &value.to_string());
    }
    let step_s = nice_step(scale.until_s - scale.from_s, 10.0);
    let mut time_s = (scale.from_s / step_s).ceil() * step_s;
    while time_s <= scale.until_s + 1e-9 {
        let x = scale.x(time_s);
        element(
            text,
            format_args!(
                "<line x1=\"{x:.1}\" y1=\"{lower}\" x2=\"{x:.1}\" y2=\"{}\" stroke=\"#333333\"/>",
                lower + 5.0
            ),
        );
        let shown = (time_s * 1000.0).round() / 1000.0;
        label(text, [x, lower + 20.0], "middle", &shown.to_string());
        time_s += step_s;
    }
    element(
        text,
        format_args!(
            "<path d=\"M{left} {upper}V{lower}H{right}\" fill=\"none\" stroke=\"#333333\"/>"
        ),
    );
    let middle = f64::midpoint(left, right);
    label(text, [middle, lower + 40.0], "middle", "seconds");
    label(text, [left - 8.0, upper - 8.0], "end", "mm");
}

fn curve(text: &mut String, series: &Series, scale: &Scale, colour: &str) {
    let mut path = String::new();
    let mut pen_is_down = false;
    for &(time_s, error_mm) in &series.points {
        match error_mm.filter(|e| e.is_finite()) {
            Some(error_mm) => {
                let command = if pen_is_down { 'L' } else { 'M' };
                element_part(
                    &mut path,
                    format_args!("{command}{:.1} {:.1}", scale.x(time_s), scale.y(error_mm)),
                );
            }
            None => element(
                text,
                format_args!(
                    "<circle cx=\"{:.1}\" cy=\"{:.1}\" r=\"2.5\" fill=\"{colour}\"/>",
                    scale.x(time_s),
                    PANEL[3]
                ),
            ),
        }
        pen_is_down = error_mm.is_some();
    }
    element(
        text,
        format_args!("<path d=\"{path}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"1.2\"/>"),
    );
}

/// A round step that divides `range` into about `parts`.
fn nice_step(range: f64, parts: f64) -> f64 {
    let rough = (range / parts).max(f64::MIN_POSITIVE);
    let power = 10f64.powf(rough.log10().floor());
    let factor = [1.0, 2.0, 5.0].into_iter().find(|f| f * power >= rough);
    factor.unwrap_or(10.0) * power
}

fn label(text: &mut String, [x, y]: [f64; 2], anchor: &str, words: &str) {
    let words = words
        .replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;");
    element(
        text,
        format_args!(
            "<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\" fill=\"#222222\">{words}</text>"
        ),
    );
}

fn element(text: &mut String, element: std::fmt::Arguments<'_>) {
    element_part(text, element);
    text.push('\n');
}

fn element_part(text: &mut String, part: std::fmt::Arguments<'_>) {
    text.write_fmt(part)
        .expect("writing into a string cannot fail");
}

#[cfg(test)]
mod tests {
    use super::*;

    fn series(name: &str, values: &[Option<f64>]) -> Series {
        let points = values.iter().enumerate();
        Series {
            name: name.to_owned(),
            points: points.map(|(i, v)| (i as f64, *v)).collect(),
        }
    }

    #[test]
    fn each_actor_has_a_line_that_a_gap_breaks_and_marks() {
        let text = svg(
            "a < b",
            &[
                series("1", &[Some(10.0), Some(20.0), None, Some(30.0)]),
                series("2", &[Some(40.0); 4]),
            ],
        );
        assert_eq!(text.matches("<circle").count(), 1);
        let first = text
            .lines()
            .find(|l| l.contains("stroke-width=\"1.2\""))
            .unwrap();
        assert_eq!(
            (first.matches('M').count(), first.matches('L').count()),
            (2, 1)
        );
        assert!(text.contains("a &lt; b") && text.ends_with("</svg>\n"));
    }

    #[test]
    fn what_is_above_the_scale_runs_along_its_upper_edge() {
        let mut values = vec![Some(20.0); 999];
        values.push(Some(5000.0));
        let scale = Scale::of(&[series("1", &values)]);
        assert!(scale.top_mm < 100.0);
        assert!((scale.y(5000.0) - PANEL[2]).abs() < 1e-9);
    }

    #[test]
    fn nothing_to_draw_still_is_a_picture() {
        for empty in [vec![], vec![series("1", &[])], vec![series("1", &[None])]] {
            assert!(!svg("nobody", &empty).contains("NaN"));
        }
    }
}
