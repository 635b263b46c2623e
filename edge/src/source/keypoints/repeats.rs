//! Detects keypoint files with repeated frames: people were detected at a lower rate, and each
//! detection was written until the next one.
//!
//! Such people appear at an old position, which shifts them by centimetres, and no other check
//! detects it. A detector that processes every picture never returns equal numbers for all people.
//! A person who stands still in a file without noise also repeats, but only a repeated person leaps
//! at the next detection.

use crate::source::{KeypointFrame, RepeatedFrames};

/// Share of repeated frames from which they are reported. If 55 frames per second are written at
/// 60, the share is 1/12; complete recordings have none.
const MIN_REPEATED_SHARE: f64 = 0.08;
/// Fewest leaps after repeated frames; a recording that only stalls has fewer.
const MIN_LEAPS: u64 = 10;
/// Smallest leap, pixels. In a file of whole pixels a standing person moves by one pixel along both
/// axes.
const LEAP_PX: f64 = 1.5;

/// Counts frames that equal the previous one.
#[derive(Debug, Default)]
pub(super) struct RepeatCounter {
    before: KeypointFrame,
    /// Whether the previous frame was a repeated one.
    is_held: bool,
    counted: RepeatedFrames,
    leaps: u64,
}

impl RepeatCounter {
    /// Counts the next frame of a file.
    pub(super) fn add(&mut self, frame: KeypointFrame) {
        if frame.peaks.iter().all(Vec::is_empty) {
            // Frames without people are equal at every rate.
            self.before = KeypointFrame::default();
            self.is_held = false;
            return;
        }
        self.counted.frames += 1;
        if frame == self.before {
            self.counted.repeated += 1;
            self.is_held = true;
        } else {
            let has_leapt = self.is_held && farthest_px(&self.before, &frame) > LEAP_PX;
            self.leaps += u64::from(has_leapt);
            self.is_held = false;
        }
        self.before = frame;
    }

    /// The counts, if they show a wrong rate.
    pub(super) fn report(&self) -> Option<RepeatedFrames> {
        let is_significant =
            self.leaps >= MIN_LEAPS && self.counted.repeated_share() >= MIN_REPEATED_SHARE;
        is_significant.then_some(self.counted)
    }
}

/// Largest motion of a keypoint, pixels. Keypoints whose number of candidates changed are skipped,
/// because their matches are unknown.
fn farthest_px(before: &KeypointFrame, now: &KeypointFrame) -> f64 {
    let kinds = before.peaks.iter().zip(&now.peaks);
    kinds
        .filter(|(before, now)| before.len() == now.len())
        .flat_map(|(before, now)| before.iter().zip(now))
        .map(|(before, now)| (before.position.vector_px() - now.position.vector_px()).norm())
        .fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use farfield_proto::frames::Pixel;

    use super::*;
    use crate::source::KeypointCandidate;

    /// A frame with one person, at `x_px`.
    fn person(x_px: f64) -> KeypointFrame {
        let seen = |k: usize| KeypointCandidate {
            position: Pixel::new(x_px + k as f64, 300.0 - 10.0 * k as f64),
            score: 0.8,
        };
        KeypointFrame {
            persons: vec![(0..17).map(|k| Some(seen(k))).collect()],
            peaks: (0..17).map(|k| vec![seen(k)]).collect(),
        }
    }

    fn empty() -> KeypointFrame {
        KeypointFrame {
            persons: Vec::new(),
            peaks: vec![Vec::new(); 17],
        }
    }

    fn count(frames: impl IntoIterator<Item = KeypointFrame>) -> Option<RepeatedFrames> {
        let mut counter = RepeatCounter::default();
        for frame in frames {
            counter.add(frame);
        }
        counter.report()
    }

    /// A person who walks for 120 frames and is detected in `new` of every `of` frames.
    fn held(new: usize, of: usize) -> impl Iterator<Item = KeypointFrame> {
        (0..120).map(move |i| person(4.0 * (i * new / of) as f64))
    }

    #[test]
    fn repeated_frames_are_counted() {
        for (new, of, repeated) in [(1, 2, 60), (2, 5, 72), (4, 5, 24), (5, 6, 20), (11, 12, 10)] {
            let expected = RepeatedFrames {
                repeated,
                frames: 120,
            };
            assert_eq!(count(held(new, of)), Some(expected), "{new} of {of}");
        }
    }

    #[test]
    fn a_walking_person_is_new_in_every_frame() {
        assert_eq!(count(held(1, 1)), None);
    }

    #[test]
    fn standing_still_without_noise_is_no_repetition() {
        assert_eq!(count((0..120).map(|_| person(400.0))), None);
        // Walks and stops: a motion that starts from rest is no leap.
        let stops = |i: usize| {
            let phase = (i % 20) as f64;
            person(40.0 * (i / 20) as f64 + 0.4 * (phase - 10.0).max(0.0).powi(2))
        };
        assert_eq!(count((0..400).map(stops)), None);
        // In whole pixels, alternating between two positions.
        assert_eq!(count((0..120).map(|i| person(f64::from(i / 3 % 2)))), None);
    }

    #[test]
    fn occasional_stalls_are_no_lower_rate() {
        let thrice = |i: usize| person(4.0 * (i - (i % 40).saturating_sub(30)) as f64);
        assert_eq!(count((0..120).map(thrice)), None);
        let seldom = |i: usize| person(4.0 * (i - usize::from(i % 20 == 19)) as f64);
        assert_eq!(count((0..400).map(seldom)), None);
    }

    #[test]
    fn frames_without_people_are_not_counted() {
        let apart = held(1, 2).flat_map(|frame| [frame, empty()]);
        assert_eq!(count(apart), None);
        let after = held(1, 2).chain((0..400).map(|_| empty()));
        assert_eq!(count(after).map(|it| it.frames), Some(120));
    }
}
