//! Keypoint files of any length, read so that what is kept of them fits into memory.

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

/// Longest line that is read, bytes: a thousand people.
const MAX_LINE_BYTES: u64 = 4 << 20;
/// Times that a camera's frames are thinned for one more frame: each takes half of what is left of them.
const MOST_COARSENINGS: usize = 64;

/// What is left of frames that are thinned.
#[derive(Default)]
pub(super) struct FramesLeft {
    keypoints: usize,
    /// Numbers of the first and the last.
    span: Option<[f64; 2]>,
}

impl FramesLeft {
    /// What there is of frames, each with its number and its bodies, in the order of their numbers.
    pub(super) fn of<'a>(frames: impl Iterator<Item = (f64, &'a [Detection])>) -> Self {
        frames.fold(Self::default(), |left, (number, bodies)| {
            left.and(&Self {
                keypoints: keypoints_of(bodies),
                span: Some([number, number]),
            })
        })
    }

    /// This and what is left of other frames.
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

/// Places for keypoints in `bodies`, which take room whether something was seen there or not.
pub(super) fn keypoints_of(bodies: &[Detection]) -> usize {
    bodies.iter().map(|it| it.keypoints.len()).sum()
}

/// Keeps less of frames that have `keypoints`, until no more than `most` are left; how many that are. `retain` leaves those
/// that are kept, and says what they are.
///
/// # Errors
/// When so many are of one moment that nothing helps.
pub(super) fn thin_to(
    most: usize,
    keypoints: usize,
    thinning: &mut Thinning,
    mut retain: impl FnMut(&Thinning) -> FramesLeft,
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
        "found {} keypoints in a few seconds, expected {most} or fewer: those of a field of people",
        left.keypoints
    );
    Ok(left.keypoints)
}

/// The files of all cameras, of which the same times are kept.
pub(super) struct ThinFiles<'a> {
    cameras: &'a SeenArgs,
    /// Keypoints that one camera may have.
    most: usize,
    kept: Vec<(String, Thinning, usize)>,
}

impl<'a> ThinFiles<'a> {
    pub(super) fn new(cameras: &'a SeenArgs, count: usize) -> Self {
        Self {
            cameras,
            most: MOST_KEYPOINTS / count.max(1),
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
            // A frame in which nobody is says nothing, and takes room.
            if frame.bodies.is_empty() {
                continue;
            }
            frame.bodies.shrink_to_fit();
            keypoints += keypoints_of(&frame.bodies);
            frames.push(frame);
            let retain = |thinning: &Thinning| {
                frames.retain(|it| thinning.keeps(it.frame));
                FramesLeft::of(frames.iter().map(|it| (it.frame, it.bodies.as_slice())))
            };
            keypoints = thin_to(self.most, keypoints, &mut thinning, retain).with_context(named)?;
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

#[cfg(test)]
mod tests {
    use super::*;
    use farfield_calibration::points::Timing;

    /// Frames that begin with `first`, in each a body of 64 keypoints.
    fn thinned(timing: Timing, numbers: &[f64], most: usize) -> anyhow::Result<Vec<f64>> {
        let body = [Detection {
            keypoints: vec![None; 64],
        }];
        let mut kept = numbers.to_vec();
        let mut thinning = Thinning::new(20.0, 0.0, timing);
        thinning.begin(numbers[0]);
        let retain = |thinning: &Thinning| {
            kept.retain(|it| thinning.keeps(*it));
            FramesLeft::of(kept.iter().map(|it| (*it, &body[..])))
        };
        let left = thin_to(most, 64 * numbers.len(), &mut thinning, retain)?;
        assert_eq!(left, 64 * kept.len());
        Ok(kept)
    }

    #[test]
    fn what_does_not_fit_is_thinned_by_keypoints_whatever_is_known_of_clocks() {
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
    fn more_people_in_a_moment_than_fit_are_refused() {
        let said = thinned(Timing::Clocks, &[0.0, 1.0, 2.0], 64).unwrap_err();
        assert!(said.to_string().contains("expected 64"), "{said}");
    }
}
