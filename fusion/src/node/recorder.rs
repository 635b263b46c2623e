//! The files of a run: finished ticks in, whole files at the end.

use std::path::Path;

use anyhow::Context as _;
use farfield_proto::keypoints::KeypointSet;
use farfield_proto::message::PoseSet;
use farfield_proto::venue::Venue;

use crate::export::pose_files::{PoseFiles, Presence};
use crate::export::{AngleColumn, AngleUnit, Layout};
use crate::skeleton::{ANGLE_NAMES, Joint, RangeOfMotion};

/// Writes poses as they become final.
pub(super) struct Recorder {
    files: PoseFiles,
}

impl Recorder {
    /// Starts the files in `folder`, which must exist.
    pub(super) fn create(
        folder: &Path,
        venue: &Venue,
        keypoints: &KeypointSet,
    ) -> anyhow::Result<Self> {
        let files = PoseFiles::create(folder, layout(venue, keypoints), venue.rate_hz);
        Ok(Self {
            files: files.context("starting the recording")?,
        })
    }

    /// Writes ticks that will not change any more, in order.
    pub(super) fn write(&mut self, finished: &[PoseSet]) -> anyhow::Result<()> {
        finished
            .iter()
            .try_for_each(|poses| self.files.write(poses))
            .context("recording")
    }

    /// Completes all files, and says who was there.
    pub(super) fn finish(self) -> anyhow::Result<Vec<Presence>> {
        self.files.finish().context("finishing the recording")
    }
}

fn layout(venue: &Venue, keypoints: &KeypointSet) -> Layout {
    let parameters = &venue.parameters.range_of_motion;
    let range = RangeOfMotion::new(parameters.factor);
    let angle = |(index, name): (usize, &&str)| {
        let mut column = AngleColumn::named(*name);
        if parameters.enabled && column.unit == AngleUnit::Radian {
            let (lo, hi) = range.reported_range(index);
            column.range_rad = (lo.is_finite() && hi.is_finite()).then_some([lo, hi]);
        }
        column
    };
    Layout {
        joints: Joint::ALL
            .iter()
            .map(|joint| joint.name().to_owned())
            .collect(),
        keypoints: keypoints.names().to_vec(),
        angles: ANGLE_NAMES.iter().enumerate().map(angle).collect(),
    }
}
