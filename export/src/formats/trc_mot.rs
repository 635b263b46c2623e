//! TRC and MOT as a run writes them, of other stretches and rates: the same heads and rows, from `farfield_fusion`.
//!
//! Metres, y up, whatever the preset. Which joints are markers, and which angles are columns, is decided as in a run: by
//! what the keypoints determine.

use std::io::{self, Write};

use farfield_fusion::body::skeleton::RangeOfMotion;
use farfield_fusion::export::mot::{self, MotRows};
use farfield_fusion::export::{Layout, trc};
use farfield_proto::id::PersonId;
use farfield_proto::keypoints::KeypointSet;
use farfield_proto::message::PersonPose;
use farfield_proto::tick::Tick;
use nalgebra::Vector3;

use crate::run::Sample;
use crate::subject::Subject;
use crate::timeline::Frame;

/// What the numbers of a pose are called; ranges of motion are as they are unless a venue says otherwise.
fn layout_of(keypoints: &[String]) -> Layout {
    let set = KeypointSet::new(keypoints.to_vec());
    Layout::of(&set, Some(&RangeOfMotion::default()))
}

/// The pose as fusion publishes it.
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

/// A head with its number of rows.
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
    /// Writes the head; `file_name` is what the file calls itself.
    ///
    /// # Errors
    /// Those of `out`.
    pub fn new(mut out: W, subject: Subject<'a>, file_name: &str) -> io::Result<Self> {
        let layout = layout_of(subject.keypoints);
        let clock = subject.clock;
        let head = trc::header(&layout, file_name, clock.rate_hz, Tick(clock.first));
        let head = counted(trc::with_rows(&head, clock.n_frames()))?;
        out.write_all(head.as_bytes())?;
        Ok(Self {
            out,
            subject,
            layout,
        })
    }

    /// Writes a frame. Frames are numbered on from the first one's tick.
    ///
    /// # Errors
    /// Those of the writer.
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

/// Writes one person's angles.
#[derive(Debug)]
pub struct MotWriter<'a, W> {
    out: W,
    subject: Subject<'a>,
    layout: Layout,
    rows: MotRows,
}

impl<'a, W: Write> MotWriter<'a, W> {
    /// Writes the head of a file with `n_rows` frames that have a pose.
    ///
    /// # Errors
    /// Those of `out`.
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

    /// Writes a frame; one without a pose has no row.
    ///
    /// # Errors
    /// Those of the writer.
    pub fn frame(&mut self, frame: &Frame) -> io::Result<()> {
        let Some((sample, _)) = &frame.pose else {
            return Ok(());
        };
        let pose = pose_of(sample, &self.subject);
        let row = self.rows.row(&self.layout, frame.time_s, &pose);
        self.out.write_all(row.as_bytes())
    }
}
