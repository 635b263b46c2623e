//! The files of a run: finished ticks in, whole files at the end.

use std::path::{Path, PathBuf};

use anyhow::Context as _;
use farfield_proto::keypoints::KeypointSet;
use farfield_proto::message::PoseSet;
use farfield_proto::venue::Venue;

use crate::body::skeleton::{ANGLE_NAMES, Joint, RangeOfMotion};
use crate::export::pose_files::{PoseFiles, Presence};
use crate::export::{AngleColumn, AngleUnit, Layout};

/// The folder of the smoothed poses in that of the run's.
const SMOOTH: &str = "smooth";

/// Writes poses as they become final.
pub(in crate::node) struct Exporter {
    folder: PathBuf,
    layout: Layout,
    rate_hz: f64,
    files: PoseFiles,
    /// Those of the fixed-lag smoother, once there are some.
    smooth: Option<PoseFiles>,
}

impl Exporter {
    /// Starts the files in `folder`, which must exist.
    pub(in crate::node) fn create(
        folder: &Path,
        venue: &Venue,
        keypoints: &KeypointSet,
    ) -> anyhow::Result<Self> {
        let layout = layout(venue, keypoints);
        let files = PoseFiles::create(folder, layout.clone(), venue.rate_hz);
        Ok(Self {
            folder: folder.to_owned(),
            layout,
            rate_hz: venue.rate_hz,
            files: files.context("starting the files of the poses")?,
            smooth: None,
        })
    }

    /// Writes smoothed ticks, in order, into a folder of their own.
    pub(in crate::node) fn write_smoothed(&mut self, smoothed: &[PoseSet]) -> anyhow::Result<()> {
        if smoothed.is_empty() {
            return Ok(());
        }
        let files = if let Some(files) = &mut self.smooth {
            files
        } else {
            let folder = self.folder.join(SMOOTH);
            std::fs::create_dir_all(&folder)
                .with_context(|| format!("making {}", folder.display()))?;
            let files = PoseFiles::create(folder, self.layout.clone(), self.rate_hz)?;
            self.smooth.insert(files)
        };
        smoothed
            .iter()
            .try_for_each(|poses| files.write(poses))
            .context("writing the smoothed poses")
    }

    /// Writes ticks that will not change any more, in order.
    pub(in crate::node) fn write(&mut self, finished: &[PoseSet]) -> anyhow::Result<()> {
        finished
            .iter()
            .try_for_each(|poses| self.files.write(poses))
            .context("writing the poses")
    }

    /// Completes all files, and says who was there.
    pub(in crate::node) fn finish(self) -> anyhow::Result<Vec<Presence>> {
        if let Some(smooth) = self.smooth {
            smooth
                .finish()
                .context("finishing the files of the smoothed poses")?;
        }
        self.files
            .finish()
            .context("finishing the files of the poses")
    }
}

/// What the numbers of a pose of `venue` are called.
pub(in crate::node) fn layout(venue: &Venue, keypoints: &KeypointSet) -> Layout {
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
