//! The pose files of a run: finished ticks in, complete files at the end.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::Context as _;
use farfield_fusion::body::skeleton::RangeOfMotion;
use farfield_fusion::export::Layout;
use farfield_fusion::export::disk_policy::DiskPolicy;
use farfield_fusion::export::pose_files::{PoseFiles, Presence, Written};
use farfield_fusion::export::refusal::{Refusal, WriteError};
use farfield_fusion::export::run_clock::RunEnd;
use farfield_fusion::export::salvage::SMOOTH;
use farfield_fusion::export::summary::{PersonSummary, PosesSummary};
use farfield_fusion::export::unfinished::create_folder_on;
use farfield_proto::keypoints::KeypointSet;
use farfield_proto::message::PoseSet;
use farfield_proto::venue::Venue;

use super::pose_queue::FinalPoses;

/// Writes poses as they become final.
pub(crate) struct Exporter {
    folder: PathBuf,
    layout: Layout,
    rate_hz: f64,
    end: RunEnd,
    disk: Arc<dyn DiskPolicy>,
    files: PoseFiles,
    /// The files of the fixed-lag smoother, if it has poses.
    smooth: Option<PoseFiles>,
}

/// The result of the export.
#[derive(Debug, Default)]
pub(crate) struct Exported {
    /// The people of the run.
    pub(crate) people: Vec<Presence>,
    /// Ticks that the files lack, and refused files that were continued in others; `None` if there are none.
    pub(crate) poses: Option<PosesSummary>,
}

impl Exported {
    /// The missing poses, if any.
    pub(crate) fn missing(&self) -> Option<&PosesSummary> {
        self.poses.as_ref().filter(|poses| !poses.is_whole())
    }

    /// The people for `summary.json`.
    pub(crate) fn people_of_summary(&self) -> Vec<PersonSummary> {
        self.people.iter().copied().map(Into::into).collect()
    }
}

impl Exporter {
    /// Creates the files in `folder`, which must exist; `disk` decides what to do without room.
    pub(crate) fn create(
        folder: &Path,
        venue: &Venue,
        keypoints: &KeypointSet,
        end: RunEnd,
        disk: Arc<dyn DiskPolicy>,
    ) -> anyhow::Result<Self> {
        let layout = layout(venue, keypoints);
        let (own, rate_hz) = (Arc::clone(&disk), venue.rate_hz);
        let files = PoseFiles::create(folder, layout.clone(), rate_hz, end, own);
        Ok(Self {
            folder: folder.to_owned(),
            layout,
            rate_hz,
            end,
            disk,
            files: files.context("starting the files of the poses")?,
            smooth: None,
        })
    }

    /// Writes a final tick. Ticks must ascend; smoothed ones have their own folder.
    pub(crate) fn write(&mut self, poses: &FinalPoses) -> anyhow::Result<()> {
        match poses {
            FinalPoses::Live(poses) => checked(self.files.write(poses), "writing the poses"),
            FinalPoses::Smoothed(poses) => self.write_smoothed(poses),
        }
    }

    fn write_smoothed(&mut self, poses: &PoseSet) -> anyhow::Result<()> {
        let files = if let Some(files) = &mut self.smooth {
            files
        } else {
            let folder = self.folder.join(SMOOTH);
            while let Err(error) = create_folder_on(&folder, &*self.disk) {
                if !self.disk.wait(&folder, &error) {
                    return Err(error).with_context(|| format!("making {}", folder.display()));
                }
            }
            let (layout, disk) = (self.layout.clone(), Arc::clone(&self.disk));
            let files = PoseFiles::create(folder, layout, self.rate_hz, self.end, disk)?;
            let files = files.counting_from(self.files.first());
            self.smooth.insert(files)
        };
        checked(files.write(poses), "writing the smoothed poses")
    }

    /// Syncs the lines.
    pub(crate) fn sync_lines(&mut self) -> anyhow::Result<()> {
        let all = [Some(&mut self.files), self.smooth.as_mut()];
        let mut all = all.into_iter().flatten();
        all.try_for_each(|files| checked(files.sync_lines(), "writing the poses"))
    }

    /// Syncs the files of persons.
    pub(crate) fn sync_persons(&mut self) -> anyhow::Result<()> {
        let all = [Some(&mut self.files), self.smooth.as_mut()];
        let mut all = all.into_iter().flatten();
        all.try_for_each(|files| checked(files.sync_persons(), "writing the poses"))
    }

    /// Completes all files and gives them their final names.
    pub(crate) fn finish(self) -> Exported {
        let smooth = self.smooth.map(PoseFiles::finish).unwrap_or_default();
        let Written {
            people,
            unwritten_ticks,
            failure,
            refusals,
        } = self.files.finish();
        let failure = failure.or(smooth.failure);
        let in_smooth = |refusal: Refusal| Refusal {
            file: format!("{SMOOTH}/{}", refusal.file),
            ..refusal
        };
        let refused = refusals.into_iter();
        let poses = PosesSummary {
            unwritten_ticks,
            unwritten_smoothed_ticks: smooth.unwritten_ticks,
            failure: failure.map(|error| error.to_string()),
            refused: refused
                .chain(smooth.refusals.into_iter().map(in_smooth))
                .collect(),
        };
        Exported {
            people,
            poses: (poses != PosesSummary::default()).then_some(poses),
        }
    }
}

/// Converts an error. The files also store their failure, and report it at the end.
fn checked(written: Result<(), &WriteError>, doing: &'static str) -> anyhow::Result<()> {
    written.map_err(|error| anyhow::anyhow!("{doing}: {error}"))
}

/// The layout of the poses of `venue`: the names of their numbers.
pub fn layout(venue: &Venue, keypoints: &KeypointSet) -> Layout {
    let parameters = &venue.parameters.range_of_motion;
    let range = RangeOfMotion::new(parameters.factor);
    Layout::of(keypoints, parameters.enabled.then_some(&range))
}
