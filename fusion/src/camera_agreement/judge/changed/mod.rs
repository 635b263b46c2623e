//! Cameras that are right in one half of the time and not in the other: knocked, zoomed or refocused while people were
//! followed.
//!
//! All of the time together is what such a camera fits worse than others, and no cause alone explains it. So each half is
//! judged by itself, and what is told of the one, and of nobody in the other, began or ended meanwhile.

#[cfg(test)]
mod tests;

use farfield_proto::tick::Tick;

use super::super::AgreementCameras;
use super::super::report::{AgreementReport, Disagreement, DisagreementCause};
use super::super::samples::Samples;
use super::Judge;
use super::before::JudgedBefore;

/// Least length of a half, seconds, and the detection passes in it: of less than that a report tells more than is there.
const LEAST_S: f64 = 4.0;
const LEAST_PASSES: usize = 6;

/// Puts into `report`, of all the time, what began or ended in it, in the place of what is told of the same cameras.
pub(in crate::camera_agreement) fn tell_of_changes(
    cameras: &AgreementCameras,
    samples: &Samples,
    report: &mut AgreementReport,
) {
    // What comes over a camera meanwhile may look like these, all the time together.
    let may_be_in_part = |d: &Disagreement| {
        let is_alike = matches!(
            d.cause,
            DisagreementCause::Distortion { .. } | DisagreementCause::LateInPart { .. }
        );
        may_begin(d) || is_alike
    };
    if !report.disagreements.iter().all(may_be_in_part) {
        return;
    }
    let Some([first, second]) = halves(cameras, samples) else {
        return;
    };
    let judged = |half: &Samples| Judge::new(cameras, half, &mut JudgedBefore::default()).report();
    let by_half = [judged(&first), judged(&second)];
    let (wrong, half, is_second) = match by_half {
        [first_half, second_half] if first_half.disagreements.is_empty() => {
            (second_half, second, true)
        }
        [first_half, second_half] if second_half.disagreements.is_empty() => {
            (first_half, first, false)
        }
        _ => return,
    };
    let told = &wrong.disagreements;
    let is_known = |d: &Disagreement| told.iter().any(|of_half| of_half.cameras == d.cameras);
    let is_explained = report.disagreements.iter().all(is_known);
    if told.is_empty() || !told.iter().all(may_begin) || !is_explained {
        return;
    }
    let Some(ticks) = span(&half) else {
        return;
    };
    report.disagreements = told.iter().map(|d| d.in_part(ticks, is_second)).collect();
    for name in told.iter().flat_map(|d| &d.cameras) {
        if let Some(own) = wrong.cameras.get(name) {
            report.cameras.insert(name.clone(), *own);
        }
        if let Some(own) = wrong.details.get(name) {
            report.details.insert(name.clone(), *own);
        }
    }
}

/// Whether it may come over one camera while it shows people.
fn may_begin(told: &Disagreement) -> bool {
    let [_] = &told.cameras[..] else {
        return false;
    };
    matches!(
        told.cause,
        DisagreementCause::Turned { .. }
            | DisagreementCause::Moved { .. }
            | DisagreementCause::FocalLength { .. }
            | DisagreementCause::HalfTurned
            | DisagreementCause::Mirrored
            | DisagreementCause::Unexplained
    )
}

/// What is kept of each half of the time, where both tell enough.
fn halves(cameras: &AgreementCameras, samples: &Samples) -> Option<[Samples; 2]> {
    let [from, to] = span(samples)?;
    let length = (to - from) / 2;
    if (length as f64) < LEAST_S * cameras.rate_hz {
        return None;
    }
    let middle = from + length;
    let halves = [
        samples.between(from, middle),
        samples.between(middle, to + 1),
    ];
    let is_long = |half: &Samples| half.passes.len() >= LEAST_PASSES;
    halves.iter().all(is_long).then_some(halves)
}

/// The first and the last tick of the detection passes that are kept.
fn span(samples: &Samples) -> Option<[Tick; 2]> {
    let passes = &samples.passes;
    Some([passes.front()?.tick, passes.back()?.tick])
}

impl Disagreement {
    /// The same as it is told of these ticks, the second half of the time or the first.
    fn in_part(&self, [from, to]: [Tick; 2], is_second: bool) -> Self {
        let found = &self.found;
        let (found, remedy) = if is_second {
            (
                format!("from about tick {from} on, and not before, {found}"),
                "fasten it, lock its zoom, focus and stabilisation, and calibrate it again; of this run leave it out from \
                 there on (`run --ticks`, or a venue file without it)",
            )
        } else {
            (
                format!("up to about tick {to}, and not after, {found}"),
                "fasten it, lock its zoom, focus and stabilisation; of this run leave it out up to there (`run --ticks`, or \
                 a venue file without it)",
            )
        };
        Self {
            cameras: self.cameras.clone(),
            cause: self.cause,
            part_ticks: Some([from.0, to.0]),
            found,
            remedy: remedy.to_owned(),
        }
    }
}
