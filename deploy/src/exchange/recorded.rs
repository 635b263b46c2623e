//! The poses of a recording, as those of a run.

use std::fs::{self, File};
use std::io::{BufReader, BufWriter, Write as _};
use std::path::{Path, PathBuf};

use anyhow::{Context as _, anyhow};
use farfield_fusion::export::Layout;
use farfield_fusion::export::line::PoseLine;
use farfield_fusion::node::{pose_layout, recorded_venue, without_end};
use farfield_fusion::pipeline::Pipeline;
use farfield_fusion::recording::published::{Published, PublishedTicks, published};
use farfield_node::process::say;
use farfield_proto::camera::CameraModel;
use farfield_proto::id::SessionId;
use farfield_proto::message::PoseSet;
use farfield_proto::tick::Tick;
use farfield_proto::venue::Venue;
use tempfile::TempDir;

use super::place::{POSES, SUMMARY};

/// A recording, read through once.
pub(crate) struct RecordedRun {
    path: PathBuf,
    venue: Venue,
    layout: Layout,
    ticks: PublishedTicks,
}

impl RecordedRun {
    /// Looks what is in the recording at `path`: of several lives of fusion the one with the most ticks, which is said.
    ///
    /// # Errors
    /// When it is no recording of ours, or holds no poses.
    pub(crate) fn open(path: &Path) -> anyhow::Result<Self> {
        let shown = path.display();
        let Published {
            attached,
            sessions,
            end,
        } = read(path, &mut |_| ())?;
        if !end.whole {
            let told = without_end(path, [end.read_bytes, end.file_bytes]);
            say(format_args!("{shown}: {told}"));
        }
        let ticks = sessions.first().copied();
        let ticks = ticks.ok_or_else(|| anyhow!("{shown}: there are no poses in the recording"))?;
        if sessions.len() > 1 {
            let [Tick(first), Tick(last)] = ticks.span;
            say(format_args!(
                "{shown}: fusion was restarted while it was recorded: of its {} lives the longest is taken, ticks {first} to {last}",
                sessions.len()
            ));
        }
        let (venue, card) = recorded_venue(path, &attached)?;
        let pipeline = Pipeline::new(&venue, card.as_ref(), SessionId(0));
        let layout = pose_layout(&venue, pipeline.keypoints());
        Ok(Self {
            path: path.to_owned(),
            venue,
            layout,
            ticks,
        })
    }

    /// The life of fusion whose poses are taken.
    pub(crate) fn session(&self) -> SessionId {
        self.ticks.session
    }

    /// Ticks per second.
    pub(super) fn rate_hz(&self) -> f64 {
        self.venue.rate_hz
    }

    /// The cameras of its venue.
    pub(super) fn cameras(&self) -> Vec<CameraModel> {
        let cameras = self.venue.cameras.iter();
        cameras.map(|camera| camera.model.clone()).collect()
    }

    /// Gives every tick to `visit`, in order.
    ///
    /// # Errors
    /// When the file cannot be read any more.
    pub(crate) fn poses(&self, visit: &mut dyn FnMut(&PoseSet)) -> anyhow::Result<()> {
        let PublishedTicks { session, span, .. } = self.ticks;
        read(&self.path, &mut |poses| {
            // A recording that goes on has more by now than when it was looked at.
            if poses.session == session && poses.tick <= span[1] {
                visit(&poses);
            }
        })?;
        Ok(())
    }

    /// Writes them as a run does, in a temporary folder inside of `beside` (made where it is not there).
    ///
    /// # Errors
    /// When the recording cannot be read, or the files not written.
    pub(super) fn as_run(&self, beside: &Path) -> anyhow::Result<TempDir> {
        fs::create_dir_all(beside).with_context(|| format!("making {}", beside.display()))?;
        let folder = tempfile::Builder::new()
            .prefix(".farfield-recorded-")
            .tempdir_in(beside);
        let folder = folder.with_context(|| format!("making a folder in {}", beside.display()))?;
        let path = folder.path().join(POSES);
        let writing = || format!("writing {}", path.display());
        let mut file = BufWriter::new(File::create_new(&path).with_context(writing)?);
        let mut failure = None;
        self.poses(&mut |poses| {
            if failure.is_none() {
                failure = self.write(poses, &mut file).err();
            }
        })?;
        let written = failure.map_or(Ok(()), Err).and_then(|()| file.flush());
        written.with_context(writing)?;
        let [Tick(first), Tick(last)] = self.ticks.span;
        let summary = serde_json::json!({
            "venue": self.venue.name,
            "rate_hz": self.venue.rate_hz,
            "ticks": { "first": first, "end": last.saturating_add(1), "done": self.ticks.n },
        });
        let path = folder.path().join(SUMMARY);
        let written = fs::write(&path, summary.to_string());
        written.with_context(|| format!("writing {}", path.display()))?;
        Ok(folder)
    }

    fn write(&self, poses: &PoseSet, file: &mut BufWriter<File>) -> std::io::Result<()> {
        let mut sorted: Vec<_> = poses.persons.iter().collect();
        sorted.sort_by_key(|pose| pose.person);
        sorted.into_iter().try_for_each(|pose| {
            let line = PoseLine {
                tick: poses.tick,
                pose,
                layout: &self.layout,
            };
            line.write_to(&mut *file)
        })
    }
}

fn read(path: &Path, visit: &mut dyn FnMut(PoseSet)) -> anyhow::Result<Published> {
    let shown = path.display();
    let file = File::open(path).with_context(|| format!("opening the recording {shown}"))?;
    let read = published(&mut BufReader::new(file), visit);
    read.map_err(|error| anyhow!("{shown}: {error}"))
}
