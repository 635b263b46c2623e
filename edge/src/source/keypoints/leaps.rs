//! Checks that the lines of a keypoint file are in time order. If they are sorted by file name (1,
//! 10, 100, 2), or alternate between two cameras, all people jump from line to line.
//!
//! If the files of all cameras have the same wrong order, no other check detects it: lines of sight
//! still intersect. In correct files at least one person of the previous frame stays in place or
//! continues its motion. The exception is a person who enters while the last one leaves.

use std::mem;

use farfield_proto::order_statistics::upper_median;
use nalgebra::Vector2;

use super::SURE;
use crate::source::{KeypointCandidate, KeypointFrame, LeapingFrames};

/// Largest deviation of a person from its previous motion between two frames, as a share of its
/// extent in the picture, and in pixels.
const CARRIED_SHARE: f64 = 0.1;
const CARRIED_PX: f64 = 8.0;
/// At lower rates the allowed share grows with the square of the rate ratio, because people turn or
/// stop between frames.
const CARRIED_HZ: f64 = 10.0;
/// Largest number of people compared per frame.
const MAX_PEOPLE: usize = 16;
/// Fewest keypoints that a person must have in both frames.
const MIN_COMMON: usize = 5;
/// Fewest leaps for a report, and their smallest share of the frames with people. The Shelf
/// recording, the sample and simulated scenes have none. A hundred pictures sorted by file name
/// leap in one of six frames.
const MIN_LEAPS: u64 = 5;
const MIN_LEAP_SHARE: f64 = 0.02;

type Person = Vec<Option<KeypointCandidate>>;

/// Counts frames at which all people leap.
#[derive(Debug)]
pub(super) struct LeapCounter {
    /// Largest deviation of a person, as a share of its extent.
    carried_share: f64,
    before: Vec<Person>,
    before_that: Vec<Person>,
    counted: LeapingFrames,
}

impl LeapCounter {
    /// An empty counter for a file with `rate_hz` lines per second.
    pub(super) fn new(rate_hz: f64) -> Self {
        let slower = (CARRIED_HZ / rate_hz).max(1.0);
        Self {
            carried_share: CARRIED_SHARE * slower * slower,
            before: Vec::new(),
            before_that: Vec::new(),
            counted: LeapingFrames::default(),
        }
    }

    /// Counts the next frame of a file.
    pub(super) fn add(&mut self, frame: &KeypointFrame) {
        let now = &frame.persons;
        if !now.is_empty() && !self.before.is_empty() {
            self.counted.frames += 1;
            let goes_on = |person: &Person| self.goes_on(person, now);
            self.counted.leaps += u64::from(!self.before.iter().any(goes_on));
        }
        mem::swap(&mut self.before_that, &mut self.before);
        self.before.clear();
        self.before.extend(now.iter().take(MAX_PEOPLE).cloned());
    }

    /// Whether a person of `now` is where `person` was, or where it would be with constant
    /// velocity.
    fn goes_on(&self, person: &Person, now: &[Person]) -> bool {
        let most_px = CARRIED_PX.max(self.carried_share * extent_px(person));
        let ways = self.before_that.iter();
        let came = ways
            .filter_map(|earlier| moved_px(earlier, person))
            .min_by(|a, b| a.norm().total_cmp(&b.norm()));
        now.iter().take(MAX_PEOPLE).any(|now| {
            // With too few common keypoints the motion is unknown.
            moved_px(person, now).is_none_or(|moved| {
                let is_near = |from: Vector2<f64>| (moved - from).norm() <= most_px;
                is_near(Vector2::zeros()) || came.is_some_and(is_near)
            })
        })
    }

    /// The counts, if they show a wrong order.
    pub(super) fn report(&self) -> Option<LeapingFrames> {
        let LeapingFrames { leaps, frames } = self.counted;
        let is_significant = leaps >= MIN_LEAPS && leaps as f64 >= MIN_LEAP_SHARE * frames as f64;
        is_significant.then_some(self.counted)
    }
}

/// Median motion of the keypoints, pixels. It is robust to left and right sides that a network
/// exchanges.
fn moved_px(before: &Person, now: &Person) -> Option<Vector2<f64>> {
    let both = before.iter().zip(now);
    let sure = |of: &'_ Option<KeypointCandidate>| of.filter(|it| f64::from(it.score) >= SURE);
    let both = both.filter_map(|(a, b)| Some((sure(a)?, sure(b)?)));
    let moved = both.map(|(a, b)| b.position.vector_px() - a.position.vector_px());
    let moved: Vec<Vector2<f64>> = moved.collect();
    if moved.len() < MIN_COMMON {
        return None;
    }
    let along = |axis: usize| upper_median(moved.iter().map(|by| by[axis]).collect());
    Some(Vector2::new(along(0)?, along(1)?))
}

/// The longer side of the bounding box of the keypoints, pixels.
fn extent_px(person: &Person) -> f64 {
    let seen = person.iter().flatten().map(|it| it.position.vector_px());
    let corners = seen.fold(None, |corners, at| {
        let (least, most) = corners.unwrap_or((at, at));
        Some((least.inf(&at), most.sup(&at)))
    });
    corners.map_or(0.0, |(least, most)| (most - least).amax())
}

#[cfg(test)]
mod tests {
    use farfield_proto::frames::Pixel;

    use super::*;

    /// A person of 170 px at `x_px`.
    fn person(x_px: f64) -> Person {
        let seen = |k: usize| KeypointCandidate {
            position: Pixel::new(x_px + (k % 3) as f64, 300.0 - 10.0 * k as f64),
            score: 0.8,
        };
        (0..17).map(|k| Some(seen(k))).collect()
    }

    fn count(frames: impl IntoIterator<Item = Vec<Person>>) -> Option<LeapingFrames> {
        let mut counter = LeapCounter::new(30.0);
        for persons in frames {
            let peaks = Vec::new();
            counter.add(&KeypointFrame { persons, peaks });
        }
        counter.report()
    }

    /// Two walking people in picture `i`.
    fn walking(i: usize) -> Vec<Person> {
        vec![person(4.0 * i as f64), person(1500.0 - 5.0 * i as f64)]
    }

    #[test]
    fn lines_sorted_by_file_names_leap() {
        let mut names: Vec<String> = (0..120).map(|i: usize| i.to_string()).collect();
        names.sort();
        let numbers = names.iter().map(|name| name.parse().unwrap());
        let report = count(numbers.map(walking)).unwrap();
        assert_eq!(report.frames, 119);
        assert!((15..30).contains(&report.leaps), "{report:?}");
    }

    #[test]
    fn alternating_lines_of_two_cameras_leap_at_each_line() {
        let turns = (0..60).map(|i| match i % 2 {
            0 => vec![person(4.0 * f64::from(i))],
            _ => vec![person(900.0 - 4.0 * f64::from(i))],
        });
        let report = count(turns).unwrap();
        assert!(report.leaps > 40, "{report:?}");
    }

    #[test]
    fn ordinary_motion_is_no_leap() {
        assert_eq!(count((0..120).map(walking)), None);
        // Up to a third of their height per frame, and back.
        let there_and_back = |i: i32| vec![person(600.0 * (0.1 * f64::from(i)).sin())];
        assert_eq!(count((0..120).map(there_and_back)), None);
        // One person leaves as another enters, every thirty frames.
        let by_turns = |i: usize| vec![person(700.0 * (i / 30 % 2) as f64 + 3.0 * i as f64)];
        assert_eq!(count((0..140).map(by_turns)), None);
    }

    #[test]
    fn occasionally_swapped_sides_are_no_leap() {
        let from_in_front = |i: usize| {
            let mut seen = person(400.0);
            for (k, at) in seen.iter_mut().flatten().enumerate().skip(1) {
                let side = if k.is_multiple_of(2) == i.is_multiple_of(3) {
                    1.0
                } else {
                    -1.0
                };
                at.position = Pixel::new(400.0 + 30.0 * side, at.position.vector_px().y);
            }
            vec![seen]
        };
        assert_eq!(count((0..120).map(from_in_front)), None);
    }

    #[test]
    fn frames_separated_by_empty_ones_are_not_compared() {
        let apart = (0..60).flat_map(|i| [vec![person(300.0 * f64::from(i % 4))], Vec::new()]);
        assert_eq!(count(apart), None);
    }
}
