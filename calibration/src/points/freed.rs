//! Cameras whose sights fit better when one number that was taken as given may move: the clock, or the focal length.

use std::collections::BTreeMap;

use rayon::prelude::*;

use super::chain::evenly;
use crate::adjustment::{Block, Limits, Path, Problem, adjust};
use crate::report::{Cause, Finding, finding};

/// Points that are compared, evenly spread: more change nothing and cost time.
const MOST_POINTS: usize = 1200;
/// Steps of each adjustment, and the decrease of the cost at which it ends.
const LIMITS: Limits = Limits {
    steps: 12,
    decrease: 1e-4,
};
/// Gain from which a clock, and a focal length, is a suspect. On Shelf right clocks gain 0.002 and one that is late by a frame
/// 0.13; right focal lengths, which postures pull at, gain 0.03 and one that is 5 % too long 0.06.
const CLOCK_GAIN: f64 = 0.02;
const FOCAL_GAIN: f64 = 0.045;
/// Most suspects: where more are off than that the cause is another one.
const MOST_SUSPECTS: usize = 3;

/// What of a camera was set free.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Freed {
    /// The time of its frames.
    Clock,
    /// Its focal length.
    Focal,
}

/// A camera that fits better with one number of it set free.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Suspect {
    /// Its index in the problem.
    pub(crate) camera: usize,
    pub(crate) freed: Freed,
    /// How late it is, in the unit of its clock; or its focal length over the given one.
    pub(crate) value: f64,
    /// The cost that goes, over what each camera costs on average.
    gain: f64,
}

/// What of a clock and a focal length is doubtful, and what is wrong.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Bars {
    /// How late, in the unit of the clocks.
    pub(crate) late: [f64; 2],
    /// Share by which the focal length is off.
    pub(crate) focal: [f64; 2],
}

/// How clocks are counted, for words.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct ClockUnit {
    /// Units per second, where that is known.
    pub(crate) hz: Option<f64>,
    /// Whether it is a frame.
    pub(crate) is_frame: bool,
}

/// The suspects of a `problem` that was adjusted, the worst first: each is set free before the next is looked for, so that a
/// camera that only makes up for another is none. Only where the path is a set of points.
pub(crate) fn suspects(problem: &Problem, bars: Bars) -> Vec<Suspect> {
    let mut suspects: Vec<Suspect> = Vec::new();
    let Some(mut current) = thinned(problem) else {
        return suspects;
    };
    adjust(&mut current, LIMITS);
    while suspects.len() < MOST_SUSPECTS {
        let before = current.cost();
        let each = (0..current.cameras.len()).flat_map(|i| [(i, Freed::Clock), (i, Freed::Focal)]);
        let is_new = |(camera, freed): &(usize, Freed)| {
            let mut known = suspects.iter();
            !known.any(|it| (it.camera, it.freed) == (*camera, *freed))
        };
        let tried: Vec<(usize, Freed)> = each.filter(is_new).collect();
        let tried: Vec<(Suspect, Problem)> = tried
            .into_par_iter()
            .filter_map(|(camera, freed)| set_free(&current, camera, freed, before))
            .collect();
        let suspicious = tried.into_iter().filter(|(it, _)| it.is_beyond(bars));
        let worst = suspicious.max_by(|(a, _), (b, _)| a.gain.total_cmp(&b.gain));
        let Some((worst, moved)) = worst else { break };
        suspects.push(worst);
        current = moved;
    }
    suspects
}

impl Suspect {
    fn is_beyond(&self, bars: Bars) -> bool {
        let [doubtful, _] = self.bars(bars);
        let least_gain = match self.freed {
            Freed::Clock => CLOCK_GAIN,
            Freed::Focal => FOCAL_GAIN,
        };
        self.off() > doubtful && self.gain > least_gain
    }

    /// How far it is from what was given.
    fn off(&self) -> f64 {
        match self.freed {
            Freed::Clock => self.value.abs(),
            Freed::Focal => (self.value - 1.0).abs(),
        }
    }

    fn bars(&self, bars: Bars) -> [f64; 2] {
        match self.freed {
            Freed::Clock => bars.late,
            Freed::Focal => bars.focal,
        }
    }

    /// What is said of it, of the camera `name`.
    pub(crate) fn finding(&self, name: &str, bars: Bars, unit: ClockUnit) -> Finding {
        let is_wrong = self.off() > self.bars(bars)[1];
        match self.freed {
            Freed::Clock => {
                let frames = format!("{:.1} frames", self.value.abs());
                let ms = unit
                    .hz
                    .map(|hz| format!("{:.0} ms", 1000.0 * self.value.abs() / hz));
                let by = match ms {
                    Some(ms) if unit.is_frame => format!("{ms} ({frames})"),
                    Some(ms) => ms,
                    None => frames,
                };
                let word = if self.value > 0.0 { "late" } else { "early" };
                finding(
                    name,
                    Cause::Clock,
                    is_wrong,
                    format!(
                        "its clock is {by} {word} against the others: with that taken out all that was seen fits better"
                    ),
                    "frames of one number, or of one time, that are of one moment",
                    "put its frame numbers or its offset right, or let clocks be found (--clocks unknown)",
                )
            }
            Freed::Focal => finding(
                name,
                Cause::Focal,
                is_wrong,
                format!(
                    "its focal length, left free, is {:.3} of the given one: with that all that was seen fits better",
                    self.value
                ),
                &format!("within {:.0} %", 100.0 * bars.focal[0]),
                "calibrate its lens again, at the zoom, focus and picture size that it has now",
            ),
        }
    }
}

/// `problem` with one number of a camera set free and adjusted, and what that came to.
fn set_free(
    problem: &Problem,
    camera: usize,
    freed: Freed,
    before: f64,
) -> Option<(Suspect, Problem)> {
    let mut moved = problem.clone();
    let own = moved.cameras.get_mut(camera)?;
    let free = own.free.with(match freed {
        Freed::Clock => Block::TimeOffset,
        Freed::Focal => Block::Focal,
    });
    if free.parameters().count() == own.free.parameters().count() {
        // What was asked to move has moved already.
        return None;
    }
    own.free = free;
    adjust(&mut moved, LIMITS);
    let own = moved.cameras.get(camera)?;
    let value = match freed {
        // What was taken earlier than its number says is late.
        Freed::Clock => own.start.pivot_s - own.state.pivot_s,
        Freed::Focal => own.state.intrinsics.fx_px / own.start.intrinsics.fx_px,
    };
    let count = moved.cameras.len().max(1) as f64;
    let suspect = Suspect {
        camera,
        freed,
        value,
        gain: (before - moved.cost()) / (before / count).max(f64::MIN_POSITIVE),
    };
    Some((suspect, moved))
}

/// The same with fewer points; `None` along a curve.
fn thinned(problem: &Problem) -> Option<Problem> {
    let Path::Points(points) = &problem.path else {
        return None;
    };
    let all: Vec<usize> = (0..points.len()).collect();
    let kept = evenly(&all, MOST_POINTS);
    let index_of: BTreeMap<usize, usize> = kept.iter().copied().zip(0..).collect();
    let observations = problem.observations.iter().filter_map(|it| {
        let mut observation = *it;
        observation.point = *index_of.get(&it.point)?;
        Some(observation)
    });
    let kept = kept.iter().filter_map(|i| points.get(*i).copied());
    Some(Problem {
        path: Path::Points(kept.collect()),
        observations: observations.collect(),
        ..problem.clone()
    })
}
