//! Everybody at one moment after the other, from one reading of the poses: for formats whose files go on in time.
//!
//! A person's frames are known late where a gap may still be filled, or a filter looks ahead. So each has a queue, of at
//! most the longest gap and the filter's width; a moment is handed out when everybody's frame of it is known.

mod file;

use std::collections::{BTreeMap, VecDeque};

pub(crate) use file::write_mcap;

use crate::error::ExportError;
use crate::run::Sample;
use crate::timeline::{Clock, Frame, Resampler};

/// Puts the frames of several persons side by side.
#[derive(Debug)]
pub(crate) struct Together {
    people: BTreeMap<u32, Track>,
    n_frames: u64,
    next: u64,
    /// The tick up to which all poses have come.
    now: Option<i64>,
}

#[derive(Debug)]
struct Track {
    resampler: Resampler,
    waiting: VecDeque<Frame>,
}

impl Together {
    /// For these persons, whose frames are all those of `clock`.
    pub(crate) fn new(
        persons: impl IntoIterator<Item = u32>,
        clock: Clock,
        resampler: impl Fn(Clock) -> Resampler,
    ) -> Self {
        let track = |person| {
            let track = Track {
                resampler: resampler(clock),
                waiting: VecDeque::new(),
            };
            (person, track)
        };
        Self {
            people: persons.into_iter().map(track).collect(),
            n_frames: clock.n_frames(),
            next: 0,
            now: None,
        }
    }

    /// Takes a pose; ticks go up, persons of a tick come in any order. Hands out the moments that nothing later can change.
    ///
    /// # Errors
    /// Those of `each`.
    pub(crate) fn push(
        &mut self,
        tick: i64,
        person: u32,
        sample: Sample,
        mut each: impl FnMut(&[(u32, Frame)]) -> Result<(), ExportError>,
    ) -> Result<(), ExportError> {
        if self.now.replace(tick) != Some(tick) {
            for track in self.people.values_mut() {
                let waiting = &mut track.waiting;
                track.resampler.pass(tick, |frame| {
                    waiting.push_back(frame);
                    Ok::<(), ExportError>(())
                })?;
            }
        }
        if let Some(track) = self.people.get_mut(&person) {
            let waiting = &mut track.waiting;
            track.resampler.push(tick, sample, |frame| {
                waiting.push_back(frame);
                Ok::<(), ExportError>(())
            })?;
        }
        self.hand_out(&mut each)
    }

    /// Hands out the moments that are left.
    ///
    /// # Errors
    /// Those of `each`.
    pub(crate) fn finish(
        mut self,
        mut each: impl FnMut(&[(u32, Frame)]) -> Result<(), ExportError>,
    ) -> Result<(), ExportError> {
        // One frame of everybody at a time: what is left may be an hour in which nobody is there.
        while self.next < self.n_frames {
            for track in self.people.values_mut() {
                if track.waiting.is_empty() {
                    track.waiting.push_back(track.resampler.take());
                }
            }
            self.hand_out(&mut each)?;
        }
        Ok(())
    }

    fn hand_out(
        &mut self,
        each: &mut impl FnMut(&[(u32, Frame)]) -> Result<(), ExportError>,
    ) -> Result<(), ExportError> {
        while self.next < self.n_frames && self.people.values().all(|it| !it.waiting.is_empty()) {
            let people = self.people.iter_mut();
            let moment: Vec<(u32, Frame)> = people
                .filter_map(|(person, track)| Some((*person, track.waiting.pop_front()?)))
                .collect();
            self.next += 1;
            each(&moment)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture::{RUN_HZ, sample_at};
    use crate::skeleton::RestPose;
    use crate::timeline::Gaps;

    /// Who is there at every moment, and how many moments waited at most, of two persons: 2 is away in ticks 20 to 39.
    fn moments(gaps: Gaps, rate_hz: f64, longest_gap_s: f64) -> (Vec<Vec<u32>>, i64) {
        let clock = Clock {
            run_hz: RUN_HZ,
            rate_hz,
            zero: 0,
            first: 0,
            end: 60,
        };
        let resampler = |clock| Resampler::new(clock, gaps, longest_gap_s, RestPose::TPose);
        let mut together = Together::new([1, 2], clock, resampler);
        let (mut found, mut latest) = (Vec::new(), 0);
        for tick in 0..60 {
            for person in [1, 2] {
                if person == 1 || !(20..40).contains(&tick) {
                    let sample = sample_at(tick as f64 / RUN_HZ);
                    let mut each = |moment: &[(u32, Frame)]| {
                        let there = moment.iter().filter(|(_, frame)| frame.pose.is_some());
                        found.push(there.map(|(person, _)| *person).collect());
                        latest = latest.max(tick - moment[0].1.position.floor() as i64);
                        Ok(())
                    };
                    together.push(tick, person, sample, &mut each).unwrap();
                }
            }
        }
        let last = together.finish(|moment| {
            let there = moment.iter().filter(|(_, frame)| frame.pose.is_some());
            found.push(there.map(|(person, _)| *person).collect());
            Ok(())
        });
        last.unwrap();
        (found, latest)
    }

    #[test]
    fn who_is_away_keeps_nobody_waiting() {
        let (found, latest) = moments(Gaps::Keep, RUN_HZ, 1.0);
        let expected: Vec<Vec<u32>> = (0..60)
            .map(|tick| {
                if (20..40).contains(&tick) {
                    vec![1]
                } else {
                    vec![1, 2]
                }
            })
            .collect();
        assert_eq!(found, expected);
        assert!(latest <= 2, "{latest} ticks");
    }

    #[test]
    fn a_gap_that_may_be_filled_is_waited_for_and_no_longer() {
        let (found, _) = moments(Gaps::Fill, RUN_HZ, 1.0);
        assert_eq!(found, vec![vec![1, 2]; 60]);
        let (found, latest) = moments(Gaps::Fill, RUN_HZ, 0.1);
        assert_eq!(found.iter().filter(|there| there.len() == 1).count(), 20);
        assert!(latest <= 8, "{latest} ticks");
    }

    #[test]
    fn a_filter_that_looks_ahead_sees_the_same_as_person_by_person() {
        let (found, latest) = moments(Gaps::Keep, 20.0, 1.0);
        let expected: Vec<Vec<u32>> = (0..20)
            .map(|frame| {
                if (20..40).contains(&(3 * frame)) {
                    vec![1]
                } else {
                    vec![1, 2]
                }
            })
            .collect();
        assert_eq!(found, expected);
        assert!(latest <= 11, "{latest} ticks");
    }
}
