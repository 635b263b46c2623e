//! Reads keypoint files of any length; frames are thinned so that they fit into memory.

use std::fs::File;
use std::io::{BufRead as _, BufReader, Read as _};
use std::path::Path;

use anyhow::{Context as _, ensure};
use farfield_calibration::people::{
    DetectedFrame, Detection, FrameLines, MOST_KEYPOINTS, Thinning,
};
use farfield_node::process::say;
use farfield_proto::keypoints::COCO17;

use super::seen::{SeenArgs, SeenCamera};

/// Longest line to read, bytes: a thousand people.
const MAX_LINE_BYTES: u64 = 4 << 20;
/// Limit for thinning a camera's frames again: each time half of them remain.
const MOST_COARSENINGS: usize = 64;

/// The frames that remain after thinning.
#[derive(Default)]
pub(super) struct RemainingFrames {
    keypoints: usize,
    /// Numbers of the first and the last frame.
    span: Option<[f64; 2]>,
}

impl RemainingFrames {
    /// Counts frames, each with its number and its bodies, in the order of their numbers.
    pub(super) fn count<'a>(frames: impl Iterator<Item = (f64, &'a [Detection])>) -> Self {
        frames.fold(Self::default(), |left, (number, bodies)| {
            left.and(&Self {
                keypoints: keypoints_of(bodies),
                span: Some([number, number]),
            })
        })
    }

    /// The sum with other frames.
    pub(super) fn and(&self, other: &Self) -> Self {
        let span = match (self.span, other.span) {
            (Some([first, last]), Some([a, b])) => Some([first.min(a), last.max(b)]),
            (one, other) => one.or(other),
        };
        Self {
            keypoints: self.keypoints + other.keypoints,
            span,
        }
    }
}

/// Number of keypoint slots in `bodies`; empty slots take memory, too.
pub(super) fn keypoints_of(bodies: &[Detection]) -> usize {
    bodies.iter().map(|it| it.keypoints.len()).sum()
}

/// Thins frames with `keypoints` until at most `most` keypoints remain, and returns their number. `retain` removes
/// frames and counts the rest.
///
/// # Errors
/// When too many keypoints belong to one moment.
pub(super) fn thin_to(
    most: usize,
    keypoints: usize,
    thinning: &mut Thinning,
    mut retain: impl FnMut(&Thinning) -> RemainingFrames,
) -> anyhow::Result<usize> {
    if keypoints <= most {
        return Ok(keypoints);
    }
    let mut left = retain(thinning);
    for _ in 0..MOST_COARSENINGS {
        let Some([first, last]) = left.span.filter(|_| left.keypoints > most) else {
            break;
        };
        thinning.coarsen(first, last);
        left = retain(thinning);
    }
    ensure!(
        left.keypoints <= most,
        "found {} keypoints in a few seconds, expected {most} or fewer, enough for a field of people",
        left.keypoints
    );
    Ok(left.keypoints)
}

/// Reads the files of all cameras and thins them to the same times.
pub(super) struct ThinFiles<'a> {
    cameras: &'a SeenArgs,
    /// Limit for the keypoints of one camera.
    most: usize,
    thinned: Vec<(String, Thinning, usize)>,
}

impl<'a> ThinFiles<'a> {
    pub(super) fn new(cameras: &'a SeenArgs, count: usize) -> Self {
        Self {
            cameras,
            most: MOST_KEYPOINTS / count.max(1),
            thinned: Vec::new(),
        }
    }

    /// The remaining frames of the camera `name`.
    ///
    /// # Errors
    /// An unreadable file, with its line.
    pub(super) fn read(&mut self, name: &str, path: &Path) -> anyhow::Result<Vec<DetectedFrame>> {
        let cameras = self.cameras;
        let rate_hz = cameras.rate_of(name).with_context(|| {
            format!("no rate of camera `{name}`: set it with --rate-hz {name}=HZ, or that of all with --rate-hz HZ")
        })?;
        ensure!(
            rate_hz.is_finite() && rate_hz > 0.0,
            "--rate-hz: found {rate_hz} Hz for camera `{name}`, expected more than 0"
        );
        let offset_s = cameras.offset_of(name).unwrap_or(0.0);
        let mut thinning = Thinning::new(rate_hz, offset_s, cameras.timing());
        let named = || path.display().to_string();
        let mut file = BufReader::new(File::open(path).with_context(named)?);
        let mut lines = FrameLines::new(path, COCO17.len());
        let (mut frames, mut keypoints, mut all): (Vec<DetectedFrame>, usize, usize) =
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
            // A frame without people has no information, but takes memory.
            if frame.bodies.is_empty() {
                continue;
            }
            frame.bodies.shrink_to_fit();
            keypoints += keypoints_of(&frame.bodies);
            frames.push(frame);
            let retain = |thinning: &Thinning| {
                frames.retain(|it| thinning.keeps(it.frame));
                RemainingFrames::count(frames.iter().map(|it| (it.frame, it.bodies.as_slice())))
            };
            keypoints = thin_to(self.most, keypoints, &mut thinning, retain).with_context(named)?;
        }
        self.thinned.push((name.to_owned(), thinning, all));
        Ok(frames)
    }

    /// Thins all cameras to the times of the longest, and prints what remains.
    pub(super) fn level(mut self, seen: &mut [SeenCamera<Vec<DetectedFrame>>]) {
        let each: Vec<Thinning> = self
            .thinned
            .iter()
            .map(|(_, thinning, _)| *thinning)
            .collect();
        let mut remaining = None;
        for (name, thinning, all) in &mut self.thinned {
            for other in &each {
                thinning.follow(other);
            }
            if let Some(camera) = seen.iter_mut().find(|it| it.name == *name) {
                camera.seen.retain(|it| thinning.keeps(it.frame));
                camera.seen.shrink_to_fit();
                let words = thinning.in_words();
                remaining = remaining.or_else(|| words.map(|it| (it, camera.seen.len(), *all)));
            }
        }
        if let Some((words, kept, all)) = remaining {
            say(format_args!(
                "using {words}: {kept} of {all} frames of a camera, to fit into memory"
            ));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use farfield_calibration::points::Timing;

    /// Frames from number `first` on, each with a body of 64 keypoints.
    fn thinned(timing: Timing, numbers: &[f64], most: usize) -> anyhow::Result<Vec<f64>> {
        let body = [Detection {
            keypoints: vec![None; 64],
        }];
        let mut kept = numbers.to_vec();
        let mut thinning = Thinning::new(20.0, 0.0, timing);
        thinning.begin(numbers[0]);
        let retain = |thinning: &Thinning| {
            kept.retain(|it| thinning.keeps(*it));
            RemainingFrames::count(kept.iter().map(|it| (*it, &body[..])))
        };
        let left = thin_to(most, 64 * numbers.len(), &mut thinning, retain)?;
        assert_eq!(left, 64 * kept.len());
        Ok(kept)
    }

    #[test]
    fn too_many_keypoints_are_thinned_with_any_timing() {
        let numbers: Vec<f64> = (0..4000).map(|it| 900.0 + f64::from(it)).collect();
        for timing in [Timing::Synchronised, Timing::Clocks, Timing::Unknown] {
            assert_eq!(thinned(timing, &numbers, 64 * 4000).unwrap(), numbers);
            let kept = thinned(timing, &numbers, 64 * 700).unwrap();
            assert!((250..=700).contains(&kept.len()), "{}", kept.len());
        }
        assert_eq!(
            thinned(Timing::Unknown, &numbers, 64 * 700).unwrap().len(),
            500
        );
    }

    #[test]
    fn too_many_people_at_one_moment_are_refused() {
        let error = thinned(Timing::Clocks, &[0.0, 1.0, 2.0], 64).unwrap_err();
        assert!(error.to_string().contains("expected 64"), "{error}");
    }
}
