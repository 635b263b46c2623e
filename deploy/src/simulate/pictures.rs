//! Rendered cameras as videos, or as folders of pictures.

use std::io::{Read as _, Write as _};
use std::path::Path;
use std::process::{Child, ChildStdin, Command, Stdio};

use anyhow::{Context as _, bail};
use farfield_edge::source::{FrameContent, FrameSource as _};
use farfield_node::process::Ending;
use farfield_proto::plain_text::one_line;
use farfield_proto::venue::SimulatedContent;
use image::RgbImage;
use image::codecs::jpeg::JpegEncoder;

use super::RecordingPlan;
use super::kind::RecordingKind;
use super::progress::PictureProgress;
use super::work::{Interrupt, each_camera};

/// Quality of JPEG pictures, percent: what it loses is below the noise of the simulated sensor.
const JPEG_QUALITY: u8 = 95;

/// Writes one recording per camera into `folder`.
pub(super) fn write(
    plan: &RecordingPlan,
    folder: &Path,
    interrupt: &Interrupt,
) -> anyhow::Result<Ending> {
    let n = plan.scene.cameras().len();
    let n_ticks = (plan.ticks.end - plan.ticks.start).unsigned_abs();
    let progress = PictureProgress::new(n_ticks * n as u64);
    each_camera(n, interrupt, |camera| {
        let name = plan.scene.cameras()[camera].name();
        let path = folder.join(plan.kind.path(name));
        let parent = path.parent().context("a recording lies in a folder")?;
        std::fs::create_dir_all(parent).with_context(|| format!("making {}", parent.display()))?;
        let mut writer = PictureWriter::open(plan, camera, &path)?;
        let mut frames = plan.frames(camera, SimulatedContent::Pixels)?;
        let mut number = 0;
        while let Some(frame) = frames.next_frame()? {
            if interrupt.is_asked() {
                return Ok(Ending::Interrupted);
            }
            let FrameContent::Image(picture) = frame.content else {
                bail!("a camera of pictures has given something else");
            };
            writer
                .write(&picture.into_rgb(), number)
                .with_context(|| format!("writing {}", path.display()))?;
            progress.one();
            number += 1;
        }
        writer
            .finish()
            .with_context(|| format!("writing {}", path.display()))?;
        Ok(Ending::Done)
    })
}

enum PictureWriter {
    Video(VideoEncoder),
    /// The folder of the pictures.
    Images(std::path::PathBuf),
}

impl PictureWriter {
    fn open(plan: &RecordingPlan, camera: usize, path: &Path) -> anyhow::Result<Self> {
        if plan.kind == RecordingKind::Videos {
            let size_px = plan.scene.cameras()[camera].size_px();
            return VideoEncoder::start(path, size_px, plan.scene.rate_hz()).map(Self::Video);
        }
        Ok(Self::Images(
            path.parent().map(Path::to_owned).unwrap_or_default(),
        ))
    }

    fn write(&mut self, picture: &RgbImage, number: u64) -> anyhow::Result<()> {
        match self {
            Self::Video(encoder) => encoder.write(picture),
            Self::Images(folder) => {
                let mut bytes = Vec::new();
                JpegEncoder::new_with_quality(&mut bytes, JPEG_QUALITY).encode_image(picture)?;
                std::fs::write(folder.join(format!("{number:06}.jpg")), bytes)?;
                Ok(())
            }
        }
    }

    fn finish(self) -> anyhow::Result<()> {
        match self {
            Self::Video(encoder) => encoder.finish(),
            Self::Images(_) => Ok(()),
        }
    }
}

/// An ffmpeg that makes a video of raw pictures.
struct VideoEncoder {
    child: Child,
    /// `None` once all is written.
    pictures: Option<ChildStdin>,
}

impl VideoEncoder {
    fn start(path: &Path, [width, height]: [u32; 2], rate_hz: f64) -> anyhow::Result<Self> {
        let mut command = Command::new("ffmpeg");
        command.args(["-hide_banner", "-loglevel", "error", "-nostats"]);
        command.args(["-f", "rawvideo", "-pix_fmt", "rgb24"]);
        command.args(["-s", &format!("{width}x{height}")]);
        command.args(["-r", &rate_hz.to_string(), "-i", "-"]);
        // Full colour resolution also allows odd sizes; the preset keeps the encoder cheaper than
        // the renderer.
        command.args(["-c:v", "libx264", "-preset", "veryfast", "-crf", "16"]);
        command.args(["-pix_fmt", "yuv444p", "-f", "mp4"]);
        command.arg(path);
        command
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .stderr(Stdio::piped());
        let mut child = command.spawn().context("starting ffmpeg")?;
        let pictures = child.stdin.take();
        Ok(Self { child, pictures })
    }

    fn write(&mut self, picture: &RgbImage) -> anyhow::Result<()> {
        let Some(pictures) = &mut self.pictures else {
            return Ok(());
        };
        match pictures.write_all(picture.as_raw()) {
            Ok(()) => Ok(()),
            // It has left, and says why.
            Err(error) => bail!("{error}{}", self.words()),
        }
    }

    fn finish(mut self) -> anyhow::Result<()> {
        drop(self.pictures.take());
        let words = self.words();
        let status = self.child.wait().context("waiting for ffmpeg")?;
        anyhow::ensure!(status.success(), "ffmpeg has failed{words}");
        Ok(())
    }

    /// What it has to say; it has closed its end by then.
    fn words(&mut self) -> String {
        drop(self.pictures.take());
        let mut words = String::new();
        if let Some(stderr) = &mut self.child.stderr {
            // What cannot be read is not said.
            drop(stderr.read_to_string(&mut words));
        }
        let words = words.trim();
        if words.is_empty() {
            String::new()
        } else {
            format!("; ffmpeg: {}", one_line(words))
        }
    }
}

impl Drop for VideoEncoder {
    fn drop(&mut self) {
        // After a clean end both say that there is no such process.
        drop(self.child.kill());
        drop(self.child.wait());
    }
}
