//! The clock of exported files, and a person's poses on it: other rates, gaps kept or filled.
//!
//! Positions are in ticks of the run, as real numbers. At a higher rate poses in between are interpolated: positions
//! linearly, rotations spherically. At a lower one what the new rate cannot show is filtered out first, by a sinc under
//! a Hann window over three periods of the new rate to each side; towards the edge of what is there the window narrows.
//! Gaps are filled first, tick by tick, so that nothing jumps at their edges.

use std::collections::VecDeque;
use std::f64::consts::PI;
use std::str::FromStr;

use crate::run::Sample;
use crate::skeleton::RestPose;

/// Half the filter's width, in periods of the new rate.
const LOBES: f64 = 3.0;
/// Positions nearer than this are the same, ticks.
const SAME: f64 = 1e-6;

/// What becomes of ticks at which a person has no pose, between two that have one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Gaps {
    /// Nothing is invented: there is nothing, or where a format cannot say so the last pose is held.
    #[default]
    Keep,
    /// They are interpolated.
    Fill,
    /// They are interpolated, and marked as such where the format has a place for it.
    Mark,
}

impl Gaps {
    /// Every choice with its name on the command line.
    pub const ALL: [(&'static str, Self); 3] = [
        ("keep", Self::Keep),
        ("fill", Self::Fill),
        ("mark", Self::Mark),
    ];
}

impl FromStr for Gaps {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        crate::choice::named(name, &Self::ALL)
    }
}

/// The frames of an export.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Clock {
    /// Ticks per second of the run.
    pub run_hz: f64,
    /// Frames per second.
    pub rate_hz: f64,
    /// The run's first tick: time 0.
    pub zero: i64,
    /// The tick of the first frame.
    pub first: i64,
    /// The tick before which the last frame lies.
    pub end: i64,
}

impl Clock {
    /// Number of frames.
    pub fn n_frames(&self) -> u64 {
        if self.end <= self.first {
            return 0;
        }
        let ticks = (self.end - 1 - self.first) as f64;
        (ticks * self.rate_hz / self.run_hz + SAME).floor() as u64 + 1
    }

    /// Number of ticks of the run that the frames are made of.
    pub fn n_ticks(&self) -> u64 {
        u64::try_from(self.end - self.first).unwrap_or(0)
    }

    /// Where frame `index` lies, ticks.
    pub fn position(&self, index: u64) -> f64 {
        self.first as f64 + index as f64 * self.run_hz / self.rate_hz
    }

    /// Time of frame `index` since the run's first tick, seconds.
    pub fn seconds(&self, index: u64) -> f64 {
        (self.first - self.zero) as f64 / self.run_hz + index as f64 / self.rate_hz
    }

    /// Half the width of the filter, ticks; 0 where none is needed.
    fn half_width(&self) -> f64 {
        if self.rate_hz < self.run_hz * (1.0 - SAME) {
            LOBES * self.run_hz / self.rate_hz
        } else {
            0.0
        }
    }
}

/// Where the pose of a frame comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Origin {
    /// From poses of the run at or next to it.
    Seen,
    /// From the poses before and after a gap.
    Filled,
}

/// One frame of one person.
#[derive(Debug, Clone)]
pub struct Frame {
    /// Its number, from 0.
    pub index: u64,
    /// Where it lies, ticks of the run.
    pub position: f64,
    /// Its time since the run's first tick, seconds.
    pub time_s: f64,
    /// The pose, where there is one.
    pub pose: Option<(Sample, Origin)>,
}

/// Turns a person's poses, tick by tick, into frames.
#[derive(Debug)]
pub struct Resampler {
    clock: Clock,
    gaps: Gaps,
    longest_gap_s: f64,
    rest: RestPose,
    samples: VecDeque<(i64, Sample, Origin)>,
    next: u64,
    n_frames: u64,
}

impl Resampler {
    /// One that has seen nothing. Gaps that last longer than `longest_gap_s` from pose to pose, seconds, stay gaps.
    pub fn new(clock: Clock, gaps: Gaps, longest_gap_s: f64, rest: RestPose) -> Self {
        Self {
            clock,
            gaps,
            longest_gap_s,
            rest,
            samples: VecDeque::new(),
            next: 0,
            n_frames: clock.n_frames(),
        }
    }

    /// Takes the pose of a later tick, and hands out the frames that nothing later can change.
    ///
    /// # Errors
    /// Those of `each`.
    pub fn push<E>(
        &mut self,
        tick: i64,
        sample: Sample,
        mut each: impl FnMut(Frame) -> Result<(), E>,
    ) -> Result<(), E> {
        if let Some((last, before, _)) = self.samples.back().cloned() {
            let apart = tick - last;
            let is_filled = self.is_filled(apart);
            for missing in (last + 1..tick).take_while(|_| is_filled) {
                let share = (missing - last) as f64 / apart as f64;
                let weighted = [(1.0 - share, &before), (share, &sample)];
                let centre = if share > 0.5 { &sample } else { &before };
                let filled = Sample::mean(&weighted, centre, self.rest).unseen();
                self.take_in(missing, filled, Origin::Filled, &mut each)?;
            }
        }
        self.take_in(tick, sample, Origin::Seen, &mut each)
    }

    fn take_in<E>(
        &mut self,
        tick: i64,
        sample: Sample,
        origin: Origin,
        each: &mut impl FnMut(Frame) -> Result<(), E>,
    ) -> Result<(), E> {
        self.samples.push_back((tick, sample, origin));
        while self.next < self.n_frames
            && self.clock.position(self.next) + self.clock.half_width() <= tick as f64 + SAME
        {
            each(self.take())?;
        }
        Ok(())
    }

    /// Hands out the frames that no pose of `tick` or later can change, where none before it is to come any more.
    ///
    /// # Errors
    /// Those of `each`.
    pub fn pass<E>(
        &mut self,
        tick: i64,
        mut each: impl FnMut(Frame) -> Result<(), E>,
    ) -> Result<(), E> {
        if let Some(&(last, ..)) = self.samples.back()
            && (tick - last <= 1 || self.is_filled(tick - last))
        {
            return Ok(());
        }
        while self.next < self.n_frames && self.clock.position(self.next) < tick as f64 - SAME {
            each(self.take())?;
        }
        Ok(())
    }

    /// Whether a gap from a pose to one that is `apart` ticks later is filled.
    fn is_filled(&self, apart: i64) -> bool {
        self.gaps != Gaps::Keep && (apart as f64 - SAME) / self.clock.run_hz <= self.longest_gap_s
    }

    /// Hands out the frames that are left.
    ///
    /// # Errors
    /// Those of `each`.
    pub fn finish<E>(mut self, mut each: impl FnMut(Frame) -> Result<(), E>) -> Result<(), E> {
        while self.next < self.n_frames {
            each(self.take())?;
        }
        Ok(())
    }

    /// Hands out the next frame, of what is known by now.
    pub(crate) fn take(&mut self) -> Frame {
        let index = self.next;
        let position = self.clock.position(index);
        self.next += 1;
        let pose = self.pose_at(position);
        let oldest = position - self.clock.half_width() - 1.0;
        // The last before the next frame is what a gap is filled from.
        while self
            .samples
            .get(1)
            .is_some_and(|(tick, ..)| (*tick as f64) < oldest)
        {
            self.samples.pop_front();
        }
        Frame {
            index,
            position,
            time_s: self.clock.seconds(index),
            pose,
        }
    }

    fn pose_at(&self, position: f64) -> Option<(Sample, Origin)> {
        let after = self
            .samples
            .partition_point(|(tick, ..)| *tick as f64 <= position + SAME);
        let i = after.checked_sub(1)?;
        let (tick, before, origin) = self.samples.get(i)?;
        if let Some(filtered) = self.filtered(position, i) {
            return Some(filtered);
        }
        let share = position - *tick as f64;
        if share <= SAME {
            return Some((before.clone(), *origin));
        }
        // What was to be filled is there.
        let (_, next, later) = self
            .samples
            .get(after)
            .filter(|(later, ..)| later - tick == 1)?;
        let centre = if share > 0.5 { next } else { before };
        let mean = Sample::mean(&[(1.0 - share, before), (share, next)], centre, self.rest);
        Some(if *origin == Origin::Seen && *later == Origin::Seen {
            (mean, Origin::Seen)
        } else {
            (mean.unseen(), Origin::Filled)
        })
    }

    /// The pose at `position` without what the new rate cannot show; `None` where no filter is needed or too little lies
    /// on one of its sides. Sample `i` is the last before it.
    fn filtered(&self, position: f64, i: usize) -> Option<(Sample, Origin)> {
        let half = self.clock.half_width();
        if half <= 0.0 {
            return None;
        }
        let tick_of = |i: usize| self.samples[i].0;
        let (mut first, mut last) = (i, i);
        while first > 0
            && tick_of(first) - tick_of(first - 1) == 1
            && position - (tick_of(first - 1) as f64) < half
        {
            first -= 1;
        }
        while last + 1 < self.samples.len()
            && tick_of(last + 1) - tick_of(last) == 1
            && tick_of(last + 1) as f64 - position < half
        {
            last += 1;
        }
        // As far to one side as to the other: else what moves evenly would be drawn to the fuller side.
        let reach = (position - tick_of(first) as f64).min(tick_of(last) as f64 - position) + 1.0;
        let width = half.min(reach);
        if width <= 1.0 + SAME {
            return None;
        }
        let cutoff = self.clock.rate_hz / self.clock.run_hz;
        let weight = |tick: i64| {
            let t = tick as f64 - position;
            let hann = if t.abs() < width {
                0.5 + 0.5 * libm::cos(PI * t / width)
            } else {
                0.0
            };
            sinc(cutoff * t) * hann
        };
        let mut weighted: Vec<(f64, &Sample)> = (first..=last)
            .map(|k| (weight(tick_of(k)), &self.samples[k].1))
            .collect();
        let total: f64 = weighted.iter().map(|(w, _)| w).sum();
        for (w, _) in &mut weighted {
            *w /= total;
        }
        let next_is_nearer =
            i < last && tick_of(i + 1) as f64 - position < position - tick_of(i) as f64;
        let (_, centre, origin) = &self.samples[if next_is_nearer { i + 1 } else { i }];
        let mean = Sample::mean(&weighted, centre, self.rest);
        Some(match origin {
            Origin::Seen => (mean, Origin::Seen),
            Origin::Filled => (mean.unseen(), Origin::Filled),
        })
    }
}

fn sinc(x: f64) -> f64 {
    if x.abs() < 1e-9 {
        1.0
    } else {
        libm::sin(PI * x) / (PI * x)
    }
}

#[cfg(test)]
#[path = "timeline_tests.rs"]
mod tests;
