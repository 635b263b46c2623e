//! The clock of exported files, and the resampling of a person's poses to it, with gaps kept or
//! filled.
//!
//! Positions are in ticks of the run, as real numbers. At a higher rate poses are interpolated:
//! positions linearly, rotations spherically. At a lower rate they are low-pass filtered first, by
//! a sinc under a Hann window over three periods of the new rate to each side; towards the ends of
//! the data the window narrows. Gaps are filled first, tick by tick, so that nothing jumps at their
//! edges.

use std::collections::VecDeque;
use std::f64::consts::PI;
use std::str::FromStr;

use crate::run::Sample;
use crate::skeleton::RestPose;

/// Half the filter's width, in periods of the new rate.
const LOBES: f64 = 3.0;
/// Positions closer than this are equal, ticks.
const SAME: f64 = 1e-6;

/// Treatment of ticks without a pose between two ticks with one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Gaps {
    /// Keep the gap; formats that cannot represent it hold the last pose.
    #[default]
    Keep,
    /// Interpolate.
    Fill,
    /// Interpolate, and mark the frames if the format allows it.
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
        crate::options::named(name, &Self::ALL)
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
    /// The tick after the last frame.
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

    /// Number of ticks of the run that the frames cover.
    pub fn n_ticks(&self) -> u64 {
        u64::try_from(self.end - self.first).unwrap_or(0)
    }

    /// Position of frame `index`, ticks.
    pub fn position(&self, index: u64) -> f64 {
        self.first as f64 + index as f64 * self.run_hz / self.rate_hz
    }

    /// Time of frame `index` since the run's first tick, seconds.
    pub fn seconds(&self, index: u64) -> f64 {
        (self.first - self.zero) as f64 / self.run_hz + index as f64 / self.rate_hz
    }

    /// Half the width of the filter, ticks; 0 if none is needed.
    fn half_width(&self) -> f64 {
        if self.rate_hz < self.run_hz * (1.0 - SAME) {
            LOBES * self.run_hz / self.rate_hz
        } else {
            0.0
        }
    }
}

/// Origin of a frame's pose.
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
    /// Its position, ticks of the run.
    pub position: f64,
    /// Its time since the run's first tick, seconds.
    pub time_s: f64,
    /// The pose, if any.
    pub pose: Option<(Sample, Origin)>,
}

/// Converts a person's poses, tick by tick, to frames.
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
    /// A resampler without poses. Gaps longer than `longest_gap_s` from pose to pose, seconds, are
    /// not filled.
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

    /// Adds the pose of a later tick, and emits the frames that are final.
    ///
    /// # Errors
    /// Errors of `each`.
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

    /// Emits the frames that no pose of `tick` or later can change, if there are no more poses
    /// before `tick`.
    ///
    /// # Errors
    /// Errors of `each`.
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

    /// Whether a gap between poses that are `apart` ticks apart is filled.
    fn is_filled(&self, apart: i64) -> bool {
        self.gaps != Gaps::Keep && (apart as f64 - SAME) / self.clock.run_hz <= self.longest_gap_s
    }

    /// Emits the remaining frames.
    ///
    /// # Errors
    /// Errors of `each`.
    pub fn finish<E>(mut self, mut each: impl FnMut(Frame) -> Result<(), E>) -> Result<(), E> {
        while self.next < self.n_frames {
            each(self.take())?;
        }
        Ok(())
    }

    /// Emits the next frame from the current data.
    pub(crate) fn take(&mut self) -> Frame {
        let index = self.next;
        let position = self.clock.position(index);
        self.next += 1;
        let pose = self.pose_at(position);
        let oldest = position - self.clock.half_width() - 1.0;
        // A gap is filled from the last pose before the next frame, so it is kept.
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
        // Gaps to be filled are already filled.
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

    /// The filtered pose at `position`; `None` if no filter is needed or one side has too little
    /// data. Sample `i` is the last one before it.
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
        // Symmetric, since otherwise uniform motion would be shifted to the side with more data.
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
