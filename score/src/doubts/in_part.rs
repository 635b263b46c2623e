//! Whether a truth that no single reading mends counts other ticks in one half of the time than in the other: one of the two
//! files lost frames meanwhile, or counts at another rate.

use super::comparison::Comparison;
use super::misfit::{TicksApart, ticks_apart};
use crate::lines::PoseLines;

/// What is found, in a sentence; `None` where no half is mended by other ticks, or both by the same.
pub(super) fn in_part(poses: &PoseLines, truth: &PoseLines) -> Option<String> {
    let halves = Comparison::of(poses, truth)?.halves()?;
    let ends = halves.each_ref().map(Comparison::ends);
    let apart = halves.map(ticks_apart);
    let [before, after] = apart.map(|it| it.map_or(0, |it| it.ticks));
    if before == after {
        return None;
    }
    let told = ends.into_iter().zip(apart).filter_map(|(ends, apart)| {
        let ([from, to], TicksApart { ticks, rest_m }) = (ends?, apart?);
        let which = if ticks < 0 { "later" } else { "earlier" };
        let n = ticks.unsigned_abs();
        let s = if n == 1 { "" } else { "s" };
        Some(format!(
            "{n} tick{s} {which} at ticks {from} to {to} (put right, joints are {:.0} mm off there)",
            1000.0 * rest_m
        ))
    });
    let told: Vec<String> = told.collect();
    Some(format!(
        "against the poses the truth seems to be {}, and not all the time: one of the two lost frames meanwhile, or counts at another \
         rate",
        told.join(", and ")
    ))
}
