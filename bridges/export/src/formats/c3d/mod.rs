//! C3D, the format of biomechanics: joints and keypoints as points, one person per file. Joints
//! that the keypoints do not determine are omitted, as in our TRC files.
//!
//! Millimetres, z up, unless a preset is given; floating-point data in Intel byte order. The first
//! frame has the number 1 and is the first exported tick; `FARFIELD:START_SECONDS` is its time
//! since the run's first tick. Frame numbers in the header end at 65535; beyond it
//! `TRIAL:ACTUAL_START_FIELD` and `ACTUAL_END_FIELD` apply. A missing point has the residual -1.
//! Otherwise the residual is the standard deviation, or 0 for filled points, and the camera mask
//! has as many bits as views took part (up to seven). A residual is a byte times the absolute value
//! of `POINT:SCALE`, in units of length. The scale is one millimetre in the file's unit; it is
//! negative, which marks floating-point data, and does not scale them. The byte of a seen point is
//! 1 to 255: 0 would mark it as filled, and 1 is also used for unknown deviations.
//!
//! Source: "The C3D File Format, A Technical User Guide", Motion Lab Systems 2021.

mod parameters;

use std::io::{self, Write};

use self::parameters::Parameters;
use super::{Point, determined, names, points};
use crate::axes::{Axes, Orientation, Unit};
use crate::subject::Subject;
use crate::target_names::{c3d_labels, c3d_text};
use crate::timeline::{Frame, Origin};

const DEFAULT_AXES: Axes = Axes {
    unit: Unit::Millimetre,
    orientation: Orientation::ZUp,
};
/// Size of a block, bytes.
const BLOCK: usize = 512;
/// Maximum number of points; readers support at most 255 labels.
const MOST_POINTS: usize = 255;
/// First block of the parameters, from 1.
const PARAMETER_START: u8 = 2;
/// Identifies a C3D file.
const KEY: u8 = 0x50;
/// Marks event labels of four letters; there are no events.
const LABELS_OF_FOUR: u16 = 12_345;
/// Range of the residual of a seen point, millimetres.
const LEAST_RESIDUAL_MM: f64 = 1.0;
const MOST_RESIDUAL_MM: f64 = 255.0;
/// Maximum number of cameras per point.
const MOST_CAMERAS: u32 = 7;

/// Writes one person.
#[derive(Debug)]
pub struct C3dWriter<'a, W> {
    out: W,
    subject: Subject<'a>,
    axes: Axes,
    /// Which points are in the file.
    is_marker: Vec<bool>,
    bytes: usize,
}

impl<'a, W: Write> C3dWriter<'a, W> {
    /// Writes the header and the parameters.
    ///
    /// # Errors
    /// Errors of `out`; more points or frames than the format supports.
    pub fn new(mut out: W, subject: Subject<'a>) -> io::Result<Self> {
        let axes = subject.options.preset.map_or(DEFAULT_AXES, Axes::of_points);
        let is_marker = determined(subject.keypoints);
        let labels = names(subject.keypoints).into_iter().zip(&is_marker);
        let labels = labels.filter_map(|(name, is_marker)| is_marker.then_some(name));
        let labels = c3d_labels(labels.collect());
        if labels.len() > MOST_POINTS {
            return Err(refused(format!(
                "{} points, a C3D file has room for {MOST_POINTS}",
                labels.len()
            )));
        }
        let n_frames = u32::try_from(subject.clock.n_frames())
            .map_err(|_| refused("more frames than a C3D file can count"))?;
        // The parameters contain the number of blocks, which does not change their size.
        let blocks = parameters_of(&subject, &labels, axes, n_frames, 0)?.len() / BLOCK;
        let data_start = u16::from(PARAMETER_START) + blocks as u16;
        let parameters = parameters_of(&subject, &labels, axes, n_frames, data_start)?;
        out.write_all(&head(
            labels.len() as u16,
            n_frames,
            data_start,
            scale(axes.unit),
            subject.clock.rate_hz,
        ))?;
        out.write_all(&parameters)?;
        Ok(Self {
            out,
            subject,
            axes,
            is_marker,
            bytes: 0,
        })
    }

    /// Writes a frame.
    ///
    /// # Errors
    /// Errors of the writer.
    pub fn frame(&mut self, frame: &Frame) -> io::Result<()> {
        let found = frame.pose.as_ref().map(|(sample, origin)| {
            let all = points(sample, self.subject.options.rest, self.subject.keypoints);
            (all, *origin, sample.views)
        });
        let mut bytes = Vec::with_capacity(16 * self.is_marker.len());
        let markers = self.is_marker.iter().enumerate();
        for (k, _) in markers.filter(|(_, is_marker)| **is_marker) {
            let (point, origin, views) = match &found {
                Some((all, origin, views)) => (all.get(k).copied().flatten(), *origin, *views),
                None => (None, Origin::Seen, 0),
            };
            for v in self.numbers(point.filter(Point::is_known), origin, views) {
                bytes.extend(v.to_le_bytes());
            }
        }
        self.bytes += bytes.len();
        self.out.write_all(&bytes)
    }

    /// Fills the last block.
    ///
    /// # Errors
    /// Errors of the writer.
    pub fn finish(mut self) -> io::Result<()> {
        let missing = self.bytes.next_multiple_of(BLOCK) - self.bytes;
        self.out.write_all(&vec![0; missing])
    }

    /// Position, and cameras with residual, of a point.
    fn numbers(&self, point: Option<Point>, origin: Origin, views: u32) -> [f32; 4] {
        let Some(point) = point else {
            return [0.0, 0.0, 0.0, -1.0];
        };
        let [x, y, z]: [f64; 3] = self.axes.point(&point.at_m).into();
        let cameras_and_residual = match origin {
            Origin::Filled => 0.0,
            Origin::Seen => {
                let cameras = (1_u32 << views.min(MOST_CAMERAS)) - 1;
                let sigma_mm = 1000.0 * point.sigma_m.unwrap_or(0.0);
                let residual_mm = sigma_mm.round().clamp(LEAST_RESIDUAL_MM, MOST_RESIDUAL_MM);
                f64::from(cameras * 256) + residual_mm
            }
        };
        [x, y, z, cameras_and_residual].map(|v| v as f32)
    }
}

/// A millimetre in `unit`, the step of residuals; negative, which marks floating-point data.
fn scale(unit: Unit) -> f32 {
    (-unit.per_metre() / 1000.0) as f32
}

/// The first block.
fn head(n_points: u16, n_frames: u32, data_start: u16, scale: f32, rate_hz: f64) -> Vec<u8> {
    let mut words = [0_u16; BLOCK / 2];
    words[0] = u16::from_le_bytes([PARAMETER_START, KEY]);
    words[1] = n_points;
    words[3] = 1;
    words[4] = u16::try_from(n_frames).unwrap_or(u16::MAX);
    (words[6], words[7]) = halves(scale.to_bits());
    words[8] = data_start;
    // One analogue sample per frame of zero channels; readers compare it with ANALOG:RATE.
    words[9] = 1;
    (words[10], words[11]) = halves((rate_hz as f32).to_bits());
    words[149] = LABELS_OF_FOUR;
    words.iter().flat_map(|word| word.to_le_bytes()).collect()
}

/// The lower and the upper half.
const fn halves(word: u32) -> (u16, u16) {
    (word as u16, (word >> 16) as u16)
}

fn parameters_of(
    subject: &Subject<'_>,
    labels: &[String],
    axes: Axes,
    n_frames: u32,
    data_start: u16,
) -> io::Result<Vec<u8>> {
    let up = match axes.orientation {
        Orientation::ZUp | Orientation::LeftZUp => "+Z",
        Orientation::YUp | Orientation::LeftYUp => "+Y",
    };
    let clock = subject.clock;
    let field = |frame: u32| {
        let (low, high) = halves(frame);
        [low, high]
    };
    let own = |text: &str| [text.to_owned()];
    let mut p = Parameters::default();
    p.group("POINT");
    p.integer("USED", labels.len() as u16)?;
    p.float("SCALE", scale(axes.unit))?;
    p.float("RATE", clock.rate_hz as f32)?;
    p.integer("DATA_START", data_start)?;
    // An integer ends at 65535; beyond it readers use TRIAL's fields, or read to the end.
    p.integer("FRAMES", u16::try_from(n_frames).unwrap_or(u16::MAX))?;
    p.texts("LABELS", labels)?;
    p.texts("DESCRIPTIONS", labels)?;
    p.text("UNITS", axes.unit.symbol())?;
    p.text("X_SCREEN", "+X")?;
    p.text("Y_SCREEN", up)?;
    p.group("ANALOG");
    p.integer("USED", 0)?;
    p.float("GEN_SCALE", 1.0)?;
    p.float("RATE", clock.rate_hz as f32)?;
    p.group("FORCE_PLATFORM");
    p.integer("USED", 0)?;
    p.group("TRIAL");
    p.list("ACTUAL_START_FIELD", &field(1))?;
    p.list("ACTUAL_END_FIELD", &field(n_frames))?;
    p.float("CAMERA_RATE", clock.rate_hz as f32)?;
    p.group("SUBJECTS");
    p.integer("USED", 1)?;
    p.integer("IS_STATIC", 0)?;
    p.texts("NAMES", &own(c3d_text(subject.name)))?;
    p.texts("LABEL_PREFIXES", &own(""))?;
    p.group("MANUFACTURER");
    p.text("COMPANY", "Farfield")?;
    p.text("SOFTWARE", "farfield export")?;
    p.group("FARFIELD");
    p.float("START_SECONDS", clock.seconds(0) as f32)?;
    p.into_blocks()
}

/// An error for content that the format does not support.
fn refused(problem: impl Into<String>) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidInput, problem.into())
}

#[cfg(test)]
mod tests;
