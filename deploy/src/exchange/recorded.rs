//! Reads the poses of a recording in the form of a run.

use std::fs::{self, File};
use std::io::{BufReader, BufWriter, Write as _};
use std::path::{Path, PathBuf};

use anyhow::{Context as _, anyhow};
use farfield_fusion::export::Layout;
use farfield_fusion::export::line::PoseLine;
use farfield_fusion::pipeline::Pipeline;
use farfield_fusion::recording::published::{Published, PublishedTicks, published};
use farfield_fusion_node::{pose_layout, recorded_venue, without_end};
use farfield_node::process::say;
use farfield_proto::camera::CameraModel;
use farfield_proto::id::SessionId;
use farfield_proto::message::PoseSet;
use farfield_proto::tick::Tick;
use farfield_proto::venue::Venue;
use tempfile::TempDir;

use super::place::{POSES, SUMMARY};

/// A recording after its first reading.
pub(crate) struct RecordedRun {
    path: PathBuf,
    venue: Venue,
    layout: Layout,
    ticks: PublishedTicks,
}

impl RecordedRun {
    /// Reads the recording at `path`. If fusion was restarted in it, the session with the most ticks is used and
    /// reported.
    ///
    /// # Errors
    /// When it is no Farfield recording, or has no poses.
    pub(crate) fn open(path: &Path) -> anyhow::Result<Self> {
        let shown = path.display();
        let Published {
            attached,
            sessions,
            end,
        } = read(path, &mut |_| ())?;
        if !end.whole {
            let notice = without_end(path, [end.read_bytes, end.file_bytes]);
            say(format_args!("{shown}: {notice}"));
        }
        let ticks = sessions.first().copied();
        let ticks = ticks.ok_or_else(|| anyhow!("{shown}: found no poses in the recording"))?;
        if sessions.len() > 1 {
            let [Tick(first), Tick(last)] = ticks.span;
            say(format_args!(
                "{shown}: fusion was restarted during the recording: the longest of its {} sessions is used, ticks {first} to {last}",
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

    /// The session of fusion whose poses are used.
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

    /// Passes every tick to `visit`, in order.
    ///
    /// # Errors
    /// When the file can no longer be read.
    pub(crate) fn poses(&self, visit: &mut dyn FnMut(&PoseSet)) -> anyhow::Result<()> {
        let PublishedTicks { session, span, .. } = self.ticks;
        read(&self.path, &mut |poses| {
            // A recording in progress may have grown since it was opened.
            if poses.session == session && poses.tick <= span[1] {
                visit(&poses);
            }
        })?;
        Ok(())
    }

    /// Writes them in the form of a run, to a temporary folder inside `parent`, which is created if needed.
    ///
    /// # Errors
    /// When the recording cannot be read, or the files cannot be written.
    pub(super) fn as_run(&self, parent: &Path) -> anyhow::Result<TempDir> {
        fs::create_dir_all(parent).with_context(|| format!("creating {}", parent.display()))?;
        let folder = tempfile::Builder::new()
            .prefix(".farfield-recorded-")
            .tempdir_in(parent);
        let folder =
            folder.with_context(|| format!("creating a folder in {}", parent.display()))?;
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
