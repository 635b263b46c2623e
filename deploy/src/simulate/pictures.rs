//! Rendered cameras as videos, or as folders of images.

use std::io::{IsTerminal as _, Read as _, Write as _, stderr};
use std::path::Path;
use std::process::{Child, ChildStdin, Command, Stdio};

use anyhow::{Context as _, bail};
use farfield_edge::source::{FrameContent, FrameSource as _};
use farfield_node::process::Ending;
use farfield_proto::plain_text::one_line;
use farfield_proto::venue::SimulatedContent;
use image::RgbImage;
use image::codecs::jpeg::JpegEncoder;
use indicatif::{ProgressBar, ProgressStyle};

use super::RecordingPlan;
use super::kind::RecordingKind;
use super::work::{Interrupt, each_camera};

/// Quality of JPEG images, percent: the loss is below the noise of the simulated sensor.
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
        let parent = path.parent().context("a recording is in a folder")?;
        std::fs::create_dir_all(parent)
            .with_context(|| format!("creating {}", parent.display()))?;
        let mut writer = PictureWriter::open(plan, camera, &path)?;
        let mut frames = plan.frames(camera, SimulatedContent::Pixels)?;
        let mut number = 0;
        while let Some(frame) = frames.next_frame()? {
            if interrupt.is_requested() {
                return Ok(Ending::Interrupted);
            }
            let FrameContent::Image(picture) = frame.content else {
                bail!("a simulated camera did not give images");
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
    /// The folder of the images.
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

/// An ffmpeg process that encodes raw images to a video.
struct VideoEncoder {
    child: Child,
    /// `None` after the last image.
    pictures: Option<ChildStdin>,
}

impl VideoEncoder {
    fn start(path: &Path, [width, height]: [u32; 2], rate_hz: f64) -> anyhow::Result<Self> {
        let mut command = Command::new("ffmpeg");
        command.args(["-hide_banner", "-loglevel", "error", "-nostats"]);
        command.args(["-f", "rawvideo", "-pix_fmt", "rgb24"]);
        command.args(["-s", &format!("{width}x{height}")]);
        command.args(["-r", &rate_hz.to_string(), "-i", "-"]);
        // Full colour resolution also allows odd sizes. The preset keeps the encoder faster than the renderer.
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
            // It has ended, and its error output has the reason.
            Err(error) => bail!("{error}{}", self.messages()),
        }
    }

    fn finish(mut self) -> anyhow::Result<()> {
        drop(self.pictures.take());
        let messages = self.messages();
        let status = self.child.wait().context("waiting for ffmpeg")?;
        anyhow::ensure!(status.success(), "ffmpeg has failed{messages}");
        Ok(())
    }

    /// Its error output; call it after its input is closed.
    fn messages(&mut self) -> String {
        drop(self.pictures.take());
        let mut messages = String::new();
        if let Some(stderr) = &mut self.child.stderr {
            // Unreadable output is ignored.
            drop(stderr.read_to_string(&mut messages));
        }
        let messages = messages.trim();
        if messages.is_empty() {
            String::new()
        } else {
            format!("; ffmpeg: {}", one_line(messages))
        }
    }
}

impl Drop for VideoEncoder {
    fn drop(&mut self) {
        // After a clean end both only report that the process does not exist.
        drop(self.child.kill());
        drop(self.child.wait());
    }
}

/// Counts the images of all cameras.
pub(super) struct PictureProgress {
    bar: ProgressBar,
}

impl PictureProgress {
    pub(super) fn new(pictures: u64) -> Self {
        let bar = if stderr().is_terminal() {
            ProgressBar::new(pictures)
        } else {
            ProgressBar::hidden()
        };
        if let Ok(style) = ProgressStyle::with_template("{bar:30} {pos}/{len} images {eta}") {
            bar.set_style(style);
        }
        Self { bar }
    }

    /// One more image is written.
    pub(super) fn one(&self) {
        self.bar.inc(1);
    }
}

impl Drop for PictureProgress {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}
