//! Keypoint files of any length, read so that what is kept of them fits into memory.

use std::fs::File;
use std::io::{BufRead as _, BufReader, Read as _};
use std::path::Path;

use anyhow::{Context as _, ensure};
use farfield_calibration::people::{DetectedFrame, FrameLines, MOST_BODIES, Thinning};
use farfield_node::process::say;
use farfield_proto::keypoints::COCO17;

use super::seen::{SeenArgs, SeenCamera};

/// Longest line that is read, bytes: a thousand people.
const MAX_LINE_BYTES: u64 = 4 << 20;
/// Times that a camera's frames are thinned for one more frame: each takes half of what is left of them.
const MOST_COARSENINGS: usize = 64;

/// The files of all cameras, of which the same times are kept.
pub(super) struct ThinFiles<'a> {
    cameras: &'a SeenArgs,
    /// Bodies that one camera may have.
    most: usize,
    kept: Vec<(String, Thinning, usize)>,
}

impl<'a> ThinFiles<'a> {
    pub(super) fn new(cameras: &'a SeenArgs, count: usize) -> Self {
        Self {
            cameras,
            most: MOST_BODIES / count.max(1),
            kept: Vec::new(),
        }
    }

    /// The frames of the camera `name` that are kept.
    ///
    /// # Errors
    /// What cannot be read, with its line.
    pub(super) fn read(&mut self, name: &str, path: &Path) -> anyhow::Result<Vec<DetectedFrame>> {
        let cameras = self.cameras;
        let rate_hz = cameras.rate_of(name).with_context(|| {
            format!("no rate of camera `{name}`: give it by --rate-hz {name}=HZ, or that of all by --rate-hz HZ")
        })?;
        ensure!(
            rate_hz.is_finite() && rate_hz > 0.0,
            "--rate-hz: found {rate_hz} Hz of camera `{name}`, expected more than 0"
        );
        let offset_s = cameras.offset_of(name).unwrap_or(0.0);
        let mut thinning = Thinning::new(rate_hz, offset_s, cameras.timing());
        let named = || path.display().to_string();
        let mut file = BufReader::new(File::open(path).with_context(named)?);
        let mut lines = FrameLines::new(path, COCO17.len());
        let (mut frames, mut bodies, mut all): (Vec<DetectedFrame>, usize, usize) =
            (Vec::new(), 0, 0);
        let mut line = String::new();
        loop {
            line.clear();
            let mut rest = file.by_ref().take(MAX_LINE_BYTES);
            let bytes = rest.read_line(&mut line).with_context(named)? as u64;
            if bytes == 0 {
                break;
            }
            ensure!(
                bytes < MAX_LINE_BYTES,
                "{}: found a line of {MAX_LINE_BYTES} bytes or more, expected a frame on each line",
                path.display()
            );
            let Some(mut frame) = lines.next(&line)? else {
                continue;
            };
            if all == 0 {
                thinning.begin(frame.frame);
            }
            all += 1;
            if !thinning.keeps(frame.frame) {
                continue;
            }
            // A frame in which nobody is says nothing, and takes room.
            if frame.bodies.is_empty() {
                continue;
            }
            frame.bodies.shrink_to_fit();
            bodies += frame.bodies.len();
            frames.push(frame);
            for _ in 0..MOST_COARSENINGS {
                let (Some(first), Some(last)) = (frames.first(), frames.last()) else {
                    break;
                };
                if bodies <= self.most {
                    break;
                }
                thinning.coarsen(first.frame, last.frame);
                frames.retain(|it| thinning.keeps(it.frame));
                bodies = frames.iter().map(|it| it.bodies.len()).sum();
            }
            ensure!(
                bodies <= self.most,
                "{}: found more than {} bodies in a few seconds, expected those of a field of people",
                path.display(),
                self.most
            );
        }
        self.kept.push((name.to_owned(), thinning, all));
        Ok(frames)
    }

    /// Keeps of all cameras the times that the longest leaves, and says what was kept.
    pub(super) fn level(mut self, seen: &mut [SeenCamera<Vec<DetectedFrame>>]) {
        let each: Vec<Thinning> = self.kept.iter().map(|(_, thinning, _)| *thinning).collect();
        let mut said = None;
        for (name, thinning, all) in &mut self.kept {
            for other in &each {
                thinning.follow(other);
            }
            if let Some(camera) = seen.iter_mut().find(|it| it.name == *name) {
                camera.seen.retain(|it| thinning.keeps(it.frame));
                camera.seen.shrink_to_fit();
                let words = thinning.in_words();
                said = said.or_else(|| words.map(|it| (it, camera.seen.len(), *all)));
            }
        }
        if let Some((words, kept, all)) = said {
            say(format_args!(
                "keeping {words}: {kept} of {all} frames of a camera, so that all fit into memory"
            ));
        }
    }
}
