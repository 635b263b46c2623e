//! Plots as SVG documents, drawn with the crate `plotters`, and the plot of each actor's error over time.
//!
//! A plot is one panel with a legend to its right, one line per layer. Coordinates are whole pixels.
//!
//! The plot of errors has time along x, millimetres along y. The scale covers 99.5 % of the values, so that a short confusion
//! does not flatten the rest; larger values run along the upper edge. A gap breaks the line and is marked on the lower edge.

use farfield_proto::order_statistics::value_after;
use plotters::coord::ranged1d::{AsRangedCoord, ValueFormatter};
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::errors_over_time;
use super::lines::PoseLines;

/// Colours that most people can distinguish, also with colour blindness (Okabe and Ito 2008).
const COLOURS: [RGBColor; 8] = [
    RGBColor(0x00, 0x72, 0xb2),
    RGBColor(0xd5, 0x5e, 0x00),
    RGBColor(0x00, 0x9e, 0x73),
    RGBColor(0xcc, 0x79, 0xa7),
    RGBColor(0xe6, 0x9f, 0x00),
    RGBColor(0x56, 0xb4, 0xe9),
    RGBColor(0x00, 0x00, 0x00),
    RGBColor(0xb8, 0xa8, 0x00),
];
const GRID: RGBColor = RGBColor(0xdd, 0xdd, 0xdd);
/// Family and size of all texts except the title; `plotters` divides sizes by 1.24.
const FONT: (&str, u32) = ("sans-serif", 16);
const TITLE_FONT: (&str, u32) = ("sans-serif", 19);
/// Width of the legend, pixels.
const LEGEND_PX: u32 = 230;
/// Line spacing of the legend, pixels.
const LEGEND_LINE_PX: i32 = 20;

/// One axis of a plot.
pub struct PlotAxis<'a> {
    /// Description with unit.
    pub description: &'a str,
    /// Least and greatest value, in the axis's unit.
    pub range: [f64; 2],
    /// Whether the scale is logarithmic; the range must then be above 0.
    pub is_logarithmic: bool,
    /// Formats a value of the axis.
    pub label: fn(f64) -> String,
}

/// One colour of a plot, with its line in the legend.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Layer {
    /// Name in the legend.
    pub name: String,
    /// Index of the colour; after the eighth the first follows.
    pub colour: usize,
    /// Lines from point to point, in units of the axes.
    pub lines: Vec<Vec<(f64, f64)>>,
    /// Single points, in units of the axes.
    pub points: Vec<(f64, f64)>,
}

/// A plot that can be drawn.
pub struct Plot<'a> {
    /// Title above the panel.
    pub title: &'a str,
    /// Width and height, pixels.
    pub size_px: [u32; 2],
    /// The horizontal axis.
    pub x: PlotAxis<'a>,
    /// The vertical axis; it is always linear.
    pub y: PlotAxis<'a>,
    /// Layers from the lowest to the topmost.
    pub layers: Vec<Layer>,
    /// Text below the legend.
    pub note: &'a str,
}

impl Plot<'_> {
    /// The plot as an SVG document.
    ///
    /// # Panics
    /// Never: `plotters` fails only if a file cannot be written, and this writes to a string.
    pub fn svg(&self) -> String {
        let mut text = String::new();
        let [from, until] = self.x.range;
        let drawn = if self.x.is_logarithmic {
            self.draw(&mut text, (from..until).log_scale())
        } else {
            self.draw(&mut text, from..until)
        };
        drawn.expect("drawing into a string cannot fail");
        text
    }

    fn draw<X>(
        &self,
        text: &mut String,
        x: X,
    ) -> Result<(), DrawingAreaErrorKind<<SVGBackend<'static> as DrawingBackend>::ErrorType>>
    where
        X: AsRangedCoord<Value = f64>,
        X::CoordDescType: ValueFormatter<f64>,
    {
        let [width, height] = self.size_px;
        let root = SVGBackend::with_string(text, (width, height)).into_drawing_area();
        root.fill(&WHITE)?;
        let inner = root.titled(self.title, TITLE_FONT)?;
        let (panel, legend) = inner.split_horizontally(width.saturating_sub(LEGEND_PX));
        let mut chart = ChartBuilder::on(&panel)
            .margin(10)
            .set_label_area_size(LabelAreaPosition::Left, 64)
            .set_label_area_size(LabelAreaPosition::Bottom, 44)
            .build_cartesian_2d(x, self.y.range[0]..self.y.range[1])?;
        chart
            .configure_mesh()
            .x_desc(self.x.description)
            .y_desc(self.y.description)
            .x_label_formatter(&|value| (self.x.label)(*value))
            .y_label_formatter(&|value| (self.y.label)(*value))
            .x_labels(10)
            .y_labels(6)
            .max_light_lines(0)
            .bold_line_style(GRID)
            .label_style(FONT)
            .axis_desc_style(FONT)
            .draw()?;
        for layer in &self.layers {
            let lines = layer.lines.iter().cloned();
            chart.draw_series(lines.map(|line| PathElement::new(line, layer.style())))?;
            let points = layer.points.iter();
            chart.draw_series(points.map(|&at| Circle::new(at, 3, layer.style().filled())))?;
        }
        self.draw_legend(&legend)?;
        root.present()
    }

    fn draw_legend<B: DrawingBackend>(
        &self,
        area: &DrawingArea<B, plotters::coord::Shift>,
    ) -> Result<(), DrawingAreaErrorKind<B::ErrorType>> {
        let font = TextStyle::from(FONT).pos(Pos::new(HPos::Left, VPos::Center));
        let mut y = LEGEND_LINE_PX;
        for layer in &self.layers {
            if !layer.lines.is_empty() {
                let line = vec![(4, y), (22, y)];
                area.draw(&PathElement::new(line, layer.style().stroke_width(3)))?;
            } else if !layer.points.is_empty() {
                area.draw(&Circle::new((13, y), 4, layer.style().filled()))?;
            }
            area.draw(&Text::new(layer.name.as_str(), (28, y), &font))?;
            y += LEGEND_LINE_PX;
        }
        area.draw(&Text::new(self.note, (4, y + 4), &font))
    }
}

impl Layer {
    fn style(&self) -> ShapeStyle {
        COLOURS[self.colour % COLOURS.len()].stroke_width(1)
    }
}

/// The errors of one actor.
#[derive(Debug, Clone, PartialEq)]
struct Series {
    name: String,
    /// Seconds, ascending, and millimetres; `None` is a gap.
    points: Vec<(f64, Option<f64>)>,
}

/// Least top of the error scale, millimetres: half of the success limit.
const MIN_TOP_MM: f64 = 75.0;
/// Share of the errors within the scale.
const SHOWN: f64 = 0.995;

/// The ranges of the axes.
struct Scale {
    time_s: [f64; 2],
    top_mm: f64,
}

impl Scale {
    fn from_series(series: &[Series]) -> Self {
        let all = || series.iter().flat_map(|s| &s.points);
        let times = || all().map(|(t, _)| *t);
        let from_s = times().fold(f64::INFINITY, f64::min);
        let until_s = times().fold(f64::NEG_INFINITY, f64::max);
        let mut errors: Vec<f64> = all()
            .filter_map(|(_, e)| *e)
            .filter(|e| e.is_finite())
            .collect();
        errors.sort_by(f64::total_cmp);
        let high = value_after(&errors, SHOWN).unwrap_or(0.0);
        let top_mm = 1.1 * high.max(MIN_TOP_MM);
        let time_s = if until_s > from_s {
            [from_s, until_s]
        } else {
            let from_s = if from_s.is_finite() { from_s } else { 0.0 };
            [from_s, from_s + 1.0]
        };
        Self { time_s, top_mm }
    }
}

/// Draws the error of each actor of `truth` over time, as an SVG document.
pub fn plot_of(title: &str, poses: &PoseLines, truth: &PoseLines, rate_hz: f64) -> String {
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
    errors_svg(title, &series)
}

fn errors_svg(title: &str, series: &[Series]) -> String {
    let scale = Scale::from_series(series);
    let layers = series.iter().enumerate();
    let plot = Plot {
        title,
        size_px: [1200, 420],
        x: PlotAxis {
            description: "seconds",
            range: scale.time_s,
            is_logarithmic: false,
            label: |s| ((s * 1000.0).round() / 1000.0).to_string(),
        },
        y: PlotAxis {
            description: "mm",
            range: [0.0, scale.top_mm],
            is_logarithmic: false,
            label: |mm| mm.round().to_string(),
        },
        layers: layers
            .map(|(i, series)| layer(series, i, scale.top_mm))
            .collect(),
        note: "dots: no pose",
    };
    plot.svg()
}

/// The lines of a series between its gaps, and the gaps as points.
fn layer(series: &Series, colour: usize, top_mm: f64) -> Layer {
    let is_there = |point: &(f64, Option<f64>)| point.1.is_some_and(f64::is_finite);
    let stretches = series.points.split(|point| !is_there(point));
    let shown = |&(time_s, error_mm): &(f64, Option<f64>)| {
        error_mm.map(|mm| (time_s, mm.clamp(0.0, top_mm)))
    };
    let gaps = series.points.iter().filter(|point| point.1.is_none());
    Layer {
        name: series.name.clone(),
        colour,
        lines: stretches
            .filter(|stretch| !stretch.is_empty())
            .map(|stretch| stretch.iter().filter_map(shown).collect())
            .collect(),
        points: gaps.map(|&(time_s, _)| (time_s, 0.0)).collect(),
    }
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
    fn a_gap_breaks_the_line_of_an_actor_and_is_marked() {
        let text = errors_svg(
            "a < b",
            &[
                series("1", &[Some(10.0), Some(20.0), None, Some(30.0)]),
                series("2", &[Some(40.0); 4]),
            ],
        );
        assert_eq!(text.matches("<circle").count(), 1);
        let lines_of = |colour: &str| {
            let lines = text.lines();
            let lines = lines.filter(|l| l.starts_with("<polyline") && l.contains(colour));
            // The thicker line in the legend does not count.
            lines.filter(|l| l.contains("stroke-width=\"1\"")).count()
        };
        assert_eq!((lines_of("#0072B2"), lines_of("#D55E00")), (2, 1));
        assert!(text.contains("a &lt; b") && text.ends_with("</svg>\n"));
    }

    #[test]
    fn values_above_the_scale_run_along_its_upper_edge() {
        let mut values = vec![Some(20.0); 999];
        values.push(Some(5000.0));
        let series = series("1", &values);
        let scale = Scale::from_series(std::slice::from_ref(&series));
        assert!(scale.top_mm < 100.0);
        let layer = layer(&series, 0, scale.top_mm);
        assert_eq!(layer.lines[0].last(), Some(&(999.0, scale.top_mm)));
    }

    #[test]
    fn a_plot_without_data_is_valid() {
        for empty in [vec![], vec![series("1", &[])], vec![series("1", &[None])]] {
            let text = errors_svg("empty", &empty);
            assert!(text.contains("seconds") && !text.contains("NaN"));
        }
    }

    #[test]
    fn equal_ratios_have_equal_distances_on_a_logarithmic_axis() {
        let axis = |range, is_logarithmic| PlotAxis {
            description: "",
            range,
            is_logarithmic,
            label: |value| value.to_string(),
        };
        let plot = Plot {
            title: "",
            size_px: [800, 300],
            x: axis([1.0, 10_000.0], true),
            y: axis([0.0, 1.0], false),
            layers: vec![Layer {
                points: [10.0, 100.0, 1000.0].map(|x| (x, 0.5)).into(),
                ..Layer::default()
            }],
            note: "",
        };
        let text = plot.svg();
        let circles = text.lines().filter(|l| l.contains("r=\"3\""));
        let places: Vec<f64> = circles
            .filter_map(|l| l.split("cx=\"").nth(1)?.split('"').next()?.parse().ok())
            .collect();
        let [a, b, c] = places[..] else {
            panic!("three points, not {places:?}");
        };
        assert!(
            b - a > 50.0 && ((c - b) - (b - a)).abs() <= 1.0,
            "{places:?}"
        );
    }
}
