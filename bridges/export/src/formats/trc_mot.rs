//! TRC and MOT as written by a run, for selected ticks and other rates: the same headers and rows,
//! from `farfield_fusion`.
//!
//! Metres, y up, independent of the preset. As in a run, the keypoints determine which joints are
//! markers and which angles are columns.

use std::io::{self, Write};

use farfield_fusion::body::skeleton::RangeOfMotion;
use farfield_fusion::export::mot::{self, MotRows};
use farfield_fusion::export::{KeypointColumn, Layout, trc};
use farfield_proto::id::PersonId;
use farfield_proto::keypoints::KeypointSet;
use farfield_proto::message::PersonPose;
use farfield_proto::tick::Tick;
use nalgebra::Vector3;

use crate::run::Sample;
use crate::subject::Subject;
use crate::timeline::Frame;

/// Names of the values of a pose, with all keypoints of the file; default ranges of motion.
fn layout_of(keypoints: &[String]) -> Layout {
    let set = KeypointSet::new(keypoints.to_vec());
    let names = keypoints.iter().cloned().enumerate();
    let keypoints = names.map(|(index, name)| KeypointColumn { index, name });
    Layout {
        keypoints: keypoints.collect(),
        ..Layout::of(&set, Some(&RangeOfMotion::default()))
    }
}

/// The pose as published by fusion.
fn pose_of(sample: &Sample, subject: &Subject<'_>) -> PersonPose {
    let single = |at_m: &Vector3<f64>| [at_m.x as f32, at_m.y as f32, at_m.z as f32];
    let sigma_m = sample.sigma_m.as_ref();
    let keypoints_m = sample.keypoints_m.iter();
    PersonPose {
        person: PersonId(subject.id),
        state: sample.state,
        joints_m: sample
            .joints_m(subject.options.rest)
            .iter()
            .map(single)
            .collect(),
        keypoints_m: keypoints_m
            .map(|at_m| at_m.as_ref().map_or([f32::NAN; 3], single))
            .collect(),
        sigma_m: sigma_m.map_or_else(Vec::new, |all| all.iter().map(|v| *v as f32).collect()),
        angles: sample.angles.iter().map(|v| *v as f32).collect(),
        unobserved: sample.unobserved,
        views: u16::try_from(sample.views).unwrap_or(u16::MAX),
    }
}

/// A header with its number of rows.
fn counted(head: Option<String>) -> io::Result<String> {
    let problem = "more rows than the head has room for";
    head.ok_or_else(|| io::Error::new(io::ErrorKind::InvalidInput, problem))
}

/// Writes one person's markers.
#[derive(Debug)]
pub struct TrcWriter<'a, W> {
    out: W,
    subject: Subject<'a>,
    layout: Layout,
}

impl<'a, W: Write> TrcWriter<'a, W> {
    /// Writes the header; `file_name` is the name inside the file.
    ///
    /// # Errors
    /// Errors of `out`.
    pub fn new(mut out: W, subject: Subject<'a>, file_name: &str) -> io::Result<Self> {
        let layout = layout_of(subject.keypoints);
        let clock = subject.clock;
        let original = trc::OriginalTicks {
            rate_hz: clock.run_hz,
            first: Tick(clock.first),
        };
        let head = trc::header(&layout, file_name, clock.rate_hz, original);
        let (n_rows, n_ticks) = (clock.n_frames(), clock.n_ticks());
        let head = counted(trc::with_rows_of_ticks(&head, n_rows, n_ticks))?;
        out.write_all(head.as_bytes())?;
        Ok(Self {
            out,
            subject,
            layout,
        })
    }

    /// Writes a frame. Frame numbers start at the first tick, and are ticks only at the run's rate.
    ///
    /// # Errors
    /// Errors of the writer.
    pub fn frame(&mut self, frame: &Frame) -> io::Result<()> {
        let number = Tick(self.subject.clock.first + frame.index.cast_signed());
        let pose = frame
            .pose
            .as_ref()
            .map(|(sample, _)| pose_of(sample, &self.subject));
        let row = trc::row(&self.layout, number, frame.time_s, pose.as_ref());
        self.out.write_all(row.as_bytes())
    }
}

/// Whether a frame has a row in MOT.
pub fn has_angles(frame: &Frame, subject: &Subject<'_>) -> bool {
    pose_with_angles(frame, subject).is_some()
}

fn pose_with_angles(frame: &Frame, subject: &Subject<'_>) -> Option<PersonPose> {
    let (sample, _) = frame.pose.as_ref()?;
    Some(pose_of(sample, subject)).filter(mot::has_row)
}

/// Writes one person's angles.
#[derive(Debug)]
pub struct MotWriter<'a, W> {
    out: W,
    subject: Subject<'a>,
    layout: Layout,
    rows: MotRows,
}

impl<'a, W: Write> MotWriter<'a, W> {
    /// Writes the header of a file with `n_rows` frames that have angles.
    ///
    /// # Errors
    /// Errors of `out`.
    pub fn new(mut out: W, subject: Subject<'a>, n_rows: u64) -> io::Result<Self> {
        let layout = layout_of(subject.keypoints);
        let head = counted(mot::with_rows(&mot::header(&layout), n_rows))?;
        out.write_all(head.as_bytes())?;
        Ok(Self {
            out,
            subject,
            layout,
            rows: MotRows::default(),
        })
    }

    /// Writes a frame; a frame without a pose or without known angles has no row.
    ///
    /// # Errors
    /// Errors of the writer.
    pub fn frame(&mut self, frame: &Frame) -> io::Result<()> {
        let Some(pose) = pose_with_angles(frame, &self.subject) else {
            return Ok(());
        };
        let row = self.rows.row(&self.layout, frame.time_s, &pose);
        self.out.write_all(row.as_bytes())
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;
    use std::fs;

    use farfield_fusion::body::skeleton::ANGLE_NAMES;
    use farfield_proto::keypoints::KeypointSet;

    use crate::fixture::{json, line_at, summary_json};
    use crate::run::sample::wrapped;
    use crate::{Existing, ExportRequest, Format, Options, export};

    const N_TICKS: i64 = 120;
    /// Exceeds the rounding of angles and ranges, degrees.
    const ROUNDED_DEG: f64 = 1e-3;

    /// Model and motion of a person who turns on the spot three times while the right arm circles
    /// the pole of its angles.
    fn model_and_motion() -> [String; 2] {
        let place = |name: &str| ANGLE_NAMES.iter().position(|known| *known == name).unwrap();
        let mut poses = String::new();
        for tick in 0..N_TICKS {
            let mut line = line_at(1, tick);
            let turned_rad = 3.0 * TAU * tick as f64 / N_TICKS as f64;
            line.angles[place("pelvis_rotation")] = wrapped(turned_rad);
            line.angles[place("arm_flex_r")] = wrapped(turned_rad);
            line.angles[place("arm_add_r")] = -1.5;
            line.angles[place("arm_rot_r")] = wrapped(-turned_rad);
            let pelvis_m = line.joints_m[0];
            let keypoints = KeypointSet::coco17();
            let keypoints_m = keypoints
                .names()
                .iter()
                .map(|name| (name.clone(), pelvis_m));
            line.keypoints_m = keypoints_m.collect();
            poses += &json(&line);
        }
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        fs::write(path("poses.jsonl"), poses).unwrap();
        fs::write(path("summary.json"), summary_json(N_TICKS)).unwrap();
        let request = ExportRequest {
            poses: path("poses.jsonl"),
            summary: path("summary.json"),
            edits: None,
            subjects: Vec::new(),
            cameras: Vec::new(),
            out: path("out"),
            formats: vec![Format::Osim, Format::Mot],
            options: Options::default(),
            existing: Existing::Refuse,
        };
        let written = export(&request, |_| ()).unwrap();
        [0, 1].map(|i| fs::read_to_string(&written[i].path).unwrap())
    }

    /// The range of a coordinate in a model, degrees.
    fn range_deg(model: &str, coordinate: &str) -> [f64; 2] {
        let head = format!("<Coordinate name=\"{coordinate}\">");
        let (_, coordinate) = model.split_once(&head).unwrap();
        let (_, range) = coordinate.split_once("<range>").unwrap();
        let (range, _) = range.split_once("</range>").unwrap();
        let (low, high) = range.split_once(' ').unwrap();
        [low, high].map(|end| end.parse::<f64>().unwrap().to_degrees())
    }

    #[test]
    fn turns_are_unwrapped_and_arms_stay_in_the_model_range() {
        let [model, motion] = model_and_motion();
        let (_, table) = motion.split_once("endheader\n").unwrap();
        let rows: Vec<Vec<&str>> = table.lines().map(|it| it.split('\t').collect()).collect();
        assert_eq!(rows.len(), 1 + N_TICKS as usize);
        let column = |name: &str| -> Vec<f64> {
            let at = rows[0].iter().position(|known| *known == name).unwrap();
            let cells = rows.iter().skip(1).map(|row| row[at].parse().unwrap());
            cells.collect()
        };
        let turned = column("pelvis_rotation");
        let step_deg = 3.0 * 360.0 / N_TICKS as f64;
        for pair in turned.windows(2) {
            assert!(
                (pair[1] - pair[0] - step_deg).abs() < ROUNDED_DEG,
                "{pair:?}"
            );
        }
        for name in ["arm_flex_r", "arm_add_r", "arm_rot_r"] {
            let [low, high] = range_deg(&model, name);
            for value in column(name) {
                let inside = low - ROUNDED_DEG..=high + ROUNDED_DEG;
                assert!(inside.contains(&value), "{name}: {value}");
            }
        }
    }
}
