//! Detects cameras whose sights fit better if a given number may change: the clock or the focal length.

use std::collections::BTreeMap;

use rayon::prelude::*;

use super::chain::evenly;
use crate::adjustment::{Block, Limits, Path, Problem, adjust};
use crate::report::{Cause, Finding, finding};

/// Most points that are compared, evenly spaced: more take time and change nothing.
const MOST_POINTS: usize = 1200;
/// Limits of each adjustment: steps, and the relative decrease of the cost at which it ends.
const LIMITS: Limits = Limits {
    steps: 12,
    decrease: 1e-4,
};
/// Least gain of a suspect clock. On Shelf correct clocks gain 0.002, and one that is late by a frame 0.13.
const CLOCK_GAIN: f64 = 0.02;
/// Least gain of a suspect focal length. On Shelf correct ones gain 0.03 due to postures, and one that is 5 % too long 0.06.
const FOCAL_GAIN: f64 = 0.045;
/// Most suspects: if more are off, there is another cause.
const MOST_SUSPECTS: usize = 3;

/// The parameter of a camera that is adjusted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Freed {
    /// The time of its frames.
    Clock,
    /// Its focal length.
    Focal,
}

/// A camera that fits better with one more parameter adjusted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Suspect {
    /// Its index in the problem.
    pub(crate) camera: usize,
    pub(crate) freed: Freed,
    /// Its delay in the unit of its clock; or its focal length relative to the given one.
    pub(crate) value: f64,
    /// The decrease of the cost, relative to the average cost of a camera.
    gain: f64,
}

/// Limits for clocks and focal lengths above which there is a warning, and an error.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Bars {
    /// Delay in the unit of the clocks.
    pub(crate) late: [f64; 2],
    /// Relative error of the focal length.
    pub(crate) focal: [f64; 2],
}

/// The unit of clocks, for messages.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct ClockUnit {
    /// Units per second, if known.
    pub(crate) hz: Option<f64>,
    /// Whether the unit is a frame.
    pub(crate) is_frame: bool,
}

/// The suspects of an adjusted `problem`, the worst first. Each suspect stays free while the next is searched, so that a camera
/// that only compensates for another is not a suspect. Only for a path that is a set of points.
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

    /// Its deviation from the given value.
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

    /// The finding about it, for the camera `name`.
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
                        "its clock is {by} {word} relative to the others: all sights fit better without that"
                    ),
                    "frames of one number, or of one time, that belong to one moment",
                    "correct its frame numbers or its offset, or let clocks be estimated (--clocks unknown)",
                )
            }
            Freed::Focal => finding(
                name,
                Cause::Focal,
                is_wrong,
                format!(
                    "its focal length, left free, is {:.3} of the given one: all sights fit better with that",
                    self.value
                ),
                &format!("within {:.0} %", 100.0 * bars.focal[0]),
                "calibrate its lens again, at the zoom, focus and picture size that it has now",
            ),
        }
    }
}

/// Adjusts one more parameter of a camera, and returns the suspect with the adjusted problem.
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
        // The parameter is already free.
        return None;
    }
    own.free = free;
    adjust(&mut moved, LIMITS);
    let own = moved.cameras.get(camera)?;
    let value = match freed {
        // A frame taken earlier than its number states belongs to a late clock.
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

/// The problem with fewer points; `None` along a curve.
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
