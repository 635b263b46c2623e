//! Kinds of recordings of simulated cameras.

use std::process::{Command, Stdio};

use anyhow::ensure;
use clap::ValueEnum;
use farfield_node::process::say;
use farfield_sim::simulated::quoted;

/// A kind of recording.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum RecordingKind {
    /// One MP4 file per camera; needs ffmpeg.
    Videos,
    /// One folder of JPEG images per camera.
    Images,
    /// One file of 2D keypoints per camera, with the scene's faults; needs no network.
    Keypoints,
    /// One file per camera of maps as a network would compute them, with the scene's faults. Playing them in real time
    /// is cheap; needs no network.
    Maps,
}

impl RecordingKind {
    /// The requested kind, or the best that this machine can write.
    ///
    /// # Errors
    /// When videos are requested and ffmpeg is not installed.
    pub(super) fn choose(requested: Option<Self>) -> anyhow::Result<Self> {
        match requested {
            Some(Self::Videos) => {
                ensure!(
                    has_ffmpeg(),
                    "`--as videos` needs the program `ffmpeg`, which is not installed: install it, \
                     or write images with `--as images`"
                );
                Ok(Self::Videos)
            }
            Some(kind) => Ok(kind),
            None if has_ffmpeg() => Ok(Self::Videos),
            None => {
                say(format_args!(
                    "ffmpeg is not installed: writing images instead of videos"
                ));
                Ok(Self::Images)
            }
        }
    }

    /// Name on the command line.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Videos => "videos",
            Self::Images => "images",
            Self::Keypoints => "keypoints",
            Self::Maps => "maps",
        }
    }

    /// Whether it has images, which need a network.
    pub(super) fn has_images(self) -> bool {
        matches!(self, Self::Videos | Self::Images)
    }

    /// Path of the recording of `camera`, relative to the venue's folder.
    pub(super) fn path(self, camera: &str) -> String {
        match self {
            Self::Videos => format!("videos/{camera}.mp4"),
            Self::Images => format!("images/{camera}/%06d.jpg"),
            Self::Keypoints => format!("keypoints/{camera}.jsonl"),
            Self::Maps => format!("maps/{camera}.maps"),
        }
    }

    /// The `source` of `camera` in the venue file.
    pub(super) fn source(self, camera: &str) -> String {
        let kind = match self {
            Self::Videos => "video",
            Self::Images => "images",
            Self::Keypoints => "keypoints",
            Self::Maps => "maps",
        };
        let path = quoted(&self.path(camera));
        format!("{{ kind = \"{kind}\", path = {path} }}")
    }
}

fn has_ffmpeg() -> bool {
    let started = Command::new("ffmpeg")
        .arg("-version")
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .status();
    started.is_ok_and(|status| status.success())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_kind_has_a_path_and_a_source() {
        assert_eq!(
            RecordingKind::Images.source("ne-1"),
            r#"{ kind = "images", path = "images/ne-1/%06d.jpg" }"#
        );
        assert_eq!(RecordingKind::Videos.path("ne-1"), "videos/ne-1.mp4");
        assert_eq!(RecordingKind::Keypoints.name(), "keypoints");
    }
}
