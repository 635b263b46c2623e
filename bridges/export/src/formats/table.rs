//! CSV: wide, one row per frame and one column per number, one person per file; and tidy, one row
//! per point or angle, all people in one file.
//!
//! Metres, z up, unless a preset is given; columns contain their unit. Angles are degrees, the
//! root's translations metres in `OpenSim`'s ground, as in our MOT files. Wide tables have a row
//! for every frame, blank if the person is absent; tidy tables omit it. `origin` states whether the
//! pose was seen, filled, or is absent. An angle that comes from a prior is blank in wide tables.
//! Tidy tables contain it with `observed` false, as they do joints that no keypoint determines.

use std::io::{self, Write};

use farfield_fusion::body::skeleton::ANGLE_NAMES;
use farfield_fusion::body::skeleton::angles::is_translation;
use farfield_proto::message::PersonState;
use farfield_proto::printed::fixed;

use super::{Point, determined, names, points};
use crate::axes::{Axes, Unit};
use crate::run::Sample;
use crate::subject::Subject;
use crate::timeline::{Frame, Origin};

/// Decimals of angles, degrees.
const ANGLE_DECIMALS: usize = 4;
/// Decimals of the root's translations, metres.
const METRE_DECIMALS: usize = 5;

/// Number format of one export.
#[derive(Debug, Clone, Copy)]
pub(super) struct Style {
    pub(super) axes: Axes,
}

impl Style {
    pub(super) fn for_subject(subject: &Subject<'_>) -> Self {
        Self {
            axes: subject.options.preset.map_or(Axes::WORLD, Axes::of_points),
        }
    }

    /// Rounded to a hundredth of a millimetre.
    fn length(self, value: f64) -> String {
        let decimals = match self.axes.unit {
            Unit::Metre => 5,
            Unit::Centimetre => 3,
            Unit::Millimetre => 2,
        };
        fixed(value, decimals)
    }

    fn place(self, point: &Point) -> [String; 3] {
        let at: [f64; 3] = self.axes.point(&point.at_m).into();
        at.map(|v| self.length(v))
    }

    fn sigma(self, point: &Point) -> String {
        let sigma = point
            .sigma_m
            .map(|sigma_m| self.length(sigma_m * self.axes.unit.per_metre()));
        sigma.unwrap_or_default()
    }
}

pub(super) fn origin(frame: &Frame) -> &'static str {
    match &frame.pose {
        None => "absent",
        Some((_, Origin::Seen)) => "seen",
        Some((_, Origin::Filled)) => "filled",
    }
}

pub(super) const fn state(state: PersonState) -> &'static str {
    match state {
        PersonState::Tentative => "tentative",
        PersonState::Tracked => "tracked",
        PersonState::Coasting => "coasting",
    }
}

/// One reported angle of a row.
struct AngleCell {
    name: &'static str,
    /// Degrees or metres.
    value: String,
    /// Whether it is a translation.
    is_length: bool,
    is_observed: bool,
}

fn angles(sample: &Sample) -> impl Iterator<Item = AngleCell> {
    ANGLE_NAMES.iter().enumerate().map(|(i, name)| {
        let (value, is_length) = (sample.angles[i], is_translation(i));
        AngleCell {
            name,
            value: if is_length {
                fixed(value, METRE_DECIMALS)
            } else {
                fixed(value.to_degrees(), ANGLE_DECIMALS)
            },
            is_length,
            is_observed: !sample.is_unobserved(i),
        }
    })
}

/// The first two columns of every row.
fn when(frame: &Frame) -> [String; 2] {
    [fixed(frame.time_s, 6), fixed(frame.position, 3)]
}

/// Writes one person, one column per number.
#[derive(Debug)]
pub struct WideWriter<'a, W: Write> {
    out: csv::Writer<W>,
    subject: Subject<'a>,
    style: Style,
    n_columns: usize,
}

impl<'a, W: Write> WideWriter<'a, W> {
    /// Writes the names of the columns.
    ///
    /// # Errors
    /// Errors of `out`.
    pub fn new(out: W, subject: Subject<'a>) -> io::Result<Self> {
        let style = Style::for_subject(&subject);
        let unit = style.axes.unit.symbol();
        let mut columns = vec!["time_s".to_owned(), "tick".to_owned()];
        columns.extend(["origin", "state", "views"].map(str::to_owned));
        for name in names(subject.keypoints) {
            columns.extend(["x", "y", "z", "sigma"].map(|what| format!("{name}_{what}_{unit}")));
        }
        columns.extend(ANGLE_NAMES.iter().enumerate().map(|(i, name)| {
            let unit = if is_translation(i) { "m" } else { "deg" };
            format!("{name}_{unit}")
        }));
        let mut out = csv::Writer::from_writer(out);
        out.write_record(&columns)?;
        Ok(Self {
            out,
            subject,
            style,
            n_columns: columns.len(),
        })
    }

    /// Writes a frame.
    ///
    /// # Errors
    /// Errors of the writer.
    pub fn frame(&mut self, frame: &Frame) -> io::Result<()> {
        let mut row: Vec<String> = when(frame).into();
        row.push(origin(frame).to_owned());
        if let Some((sample, _)) = &frame.pose {
            row.extend([state(sample.state).to_owned(), sample.views.to_string()]);
            for point in points(sample, self.subject.options.rest, self.subject.keypoints) {
                match point {
                    Some(point) => {
                        row.extend(self.style.place(&point));
                        row.push(self.style.sigma(&point));
                    }
                    None => row.extend([const { String::new() }; 4]),
                }
            }
            row.extend(angles(sample).map(|angle| {
                if angle.is_observed {
                    angle.value
                } else {
                    String::new()
                }
            }));
        }
        row.resize(self.n_columns, String::new());
        Ok(self.out.write_record(&row)?)
    }

    /// Flushes the output.
    ///
    /// # Errors
    /// Errors of the writer.
    pub fn finish(mut self) -> io::Result<()> {
        self.out.flush()
    }
}

/// Writes people one after the other, one row per point or angle.
#[derive(Debug)]
pub struct TidyWriter<W: Write> {
    out: csv::Writer<W>,
    has_head: bool,
}

impl<W: Write> TidyWriter<W> {
    /// A writer without any output yet.
    pub fn new(out: W) -> Self {
        Self {
            out: csv::Writer::from_writer(out),
            has_head: false,
        }
    }

    /// Writes a frame of a person, after the column names if it is the first.
    ///
    /// # Errors
    /// Errors of the writer.
    pub fn frame(
        &mut self,
        subject: &Subject<'_>,
        names: &[String],
        frame: &Frame,
    ) -> io::Result<()> {
        let style = Style::for_subject(subject);
        if !std::mem::replace(&mut self.has_head, true) {
            let unit = style.axes.unit.symbol();
            let places = ["x", "y", "z", "sigma"].map(|what| format!("{what}_{unit}"));
            let mut head = ["time_s", "tick", "person", "name", "kind", "item"]
                .map(str::to_owned)
                .to_vec();
            head.extend(places);
            head.extend(["angle_deg", "length_m", "observed", "origin"].map(str::to_owned));
            self.out.write_record(&head)?;
        }
        let Some((sample, _)) = &frame.pose else {
            return Ok(());
        };
        let mut first: Vec<String> = when(frame).into();
        first.extend([subject.id.to_string(), subject.name.to_owned()]);
        let mut write = |cells: [&str; 8], is_observed: bool| {
            let row = first
                .iter()
                .map(String::as_str)
                .chain(cells)
                .chain([if is_observed { "true" } else { "false" }, origin(frame)]);
            self.out.write_record(row)
        };
        let all = points(sample, subject.options.rest, subject.keypoints);
        let is_determined = determined(subject.keypoints);
        let n_joints = all.len() - subject.keypoints.len();
        for (k, ((name, point), is_determined)) in
            names.iter().zip(&all).zip(is_determined).enumerate()
        {
            let Some(point) = point else {
                continue;
            };
            let kind = if k < n_joints { "joint" } else { "keypoint" };
            let [x, y, z] = style.place(point);
            let sigma = style.sigma(point);
            write([kind, name, &x, &y, &z, &sigma, "", ""], is_determined)?;
        }
        for angle in angles(sample) {
            let value = angle.value.as_str();
            let (degrees, metres) = if angle.is_length {
                ("", value)
            } else {
                (value, "")
            };
            let cells = ["angle", angle.name, "", "", "", "", degrees, metres];
            write(cells, angle.is_observed)?;
        }
        Ok(())
    }

    /// Flushes the output.
    ///
    /// # Errors
    /// Errors of the writer.
    pub fn finish(mut self) -> io::Result<()> {
        self.out.flush()
    }
}

/// Names of the points of these keypoints in tables, joints first.
pub fn point_names(keypoints: &[String]) -> Vec<String> {
    names(keypoints)
}
