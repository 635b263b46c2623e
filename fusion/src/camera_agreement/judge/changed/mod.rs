//! Cameras that are right in one half of the time and not in the other: knocked, zoomed, refocused or exchanged while people were
//! followed.
//!
//! All of the time together is what such a camera fits worse than others, and no cause alone explains it. So each half is
//! judged by itself, and what is told of the one, and of nobody in the other, began or ended meanwhile.

#[cfg(test)]
mod tests;

use std::mem::discriminant;

use farfield_proto::message::agreement::AgreementVerdict;
use farfield_proto::tick::Tick;

use super::super::AgreementCameras;
use super::super::report::{AgreementReport, Disagreement, DisagreementCause};
use super::super::samples::Samples;
use super::Judge;
use super::before::JudgedBefore;

/// Least length of a half, seconds, and the detection passes in it, of which one comes every second: of less than that a report
/// may tell more than is there. Of right cameras of the Shelf, the sample and a dozen simulated scenes nothing was told of any
/// three, four or five passes in a row.
const LEAST_S: f64 = 4.0;
const LEAST_PASSES: usize = 5;

/// Puts into `report`, of all the time, what began or ended in it, in the place of what is told of the same cameras.
pub(in crate::camera_agreement) fn tell_of_changes(
    cameras: &AgreementCameras,
    samples: &Samples,
    report: &mut AgreementReport,
) {
    // What comes over a camera meanwhile may look like these, all the time together.
    let may_be_in_part = |d: &Disagreement| {
        let is_like_it = matches!(
            d.cause,
            DisagreementCause::Distortion { .. }
                | DisagreementCause::LateInPart { .. }
                | DisagreementCause::Unexplained
        );
        may_begin(d) || is_like_it
    };
    if !report.disagreements.iter().all(may_be_in_part) {
        return;
    }
    let Some([first, second]) = halves(cameras, samples) else {
        return;
    };
    let judged = |half: &Samples| Judge::new(cameras, half, &mut JudgedBefore::default()).report();
    let by_half = [judged(&first), judged(&second)];
    let (wrong, right, half, is_second) = match by_half {
        [right, wrong] if right.disagreements.is_empty() => (wrong, right, second, true),
        [wrong, right] if right.disagreements.is_empty() => (wrong, right, first, false),
        _ => return,
    };
    let [told] = &wrong.disagreements[..] else {
        return;
    };
    // Where the other half shows nobody to hold the camera to, or too little moves in it, it may be so there, too.
    let is_right = |name: &String| {
        let camera = right.cameras.get(name);
        camera.is_some_and(|camera| camera.verdict == AgreementVerdict::Agrees)
    };
    let is_other = |d: &Disagreement| {
        let is_alike = discriminant(&d.cause) == discriminant(&told.cause);
        let is_nothing = d.cause == DisagreementCause::Unexplained;
        let is_of_them = d.cameras.iter().all(|name| told.cameras.contains(name));
        is_of_them && (is_nothing || !is_alike)
    };
    let is_explained = report.disagreements.iter().all(is_other);
    if !may_begin(told) || !is_explained || !told.cameras.iter().all(is_right) {
        return;
    }
    let Some(ticks) = span(&half) else {
        return;
    };
    // What has a moment of its own needs no half.
    report.disagreements = vec![match told.cause {
        DisagreementCause::LateInPart { .. } => told.clone(),
        _ => told.in_part(ticks, is_second),
    }];
    for name in &told.cameras {
        if let Some(own) = wrong.cameras.get(name) {
            report.cameras.insert(name.clone(), *own);
        }
        if let Some(own) = wrong.details.get(name) {
            report.details.insert(name.clone(), *own);
        }
    }
}

/// Whether it may come over one camera while it shows people, or over two whose recordings were put together.
fn may_begin(told: &Disagreement) -> bool {
    match &told.cameras[..] {
        [_] => matches!(
            told.cause,
            DisagreementCause::Turned { .. }
                | DisagreementCause::Moved { .. }
                | DisagreementCause::FocalLength { .. }
                | DisagreementCause::HalfTurned
                | DisagreementCause::Mirrored
                | DisagreementCause::LateInPart { .. }
                | DisagreementCause::Unexplained
        ),
        [_, _] => told.cause == DisagreementCause::Swapped,
        _ => false,
    }
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
        let (half, other) = if is_second {
            ("second", "first")
        } else {
            ("first", "second")
        };
        Self {
            cameras: self.cameras.clone(),
            cause: self.cause,
            part_ticks: Some([from.0, to.0]),
            found: format!(
                "in the {half} half of what is judged (ticks {from} to {to}), and not in the {other}, {}",
                self.found
            ),
            remedy: if self.cause == DisagreementCause::Swapped {
                "their recordings are of the one up to some moment, and of the other from there on: put together each one's own \
                 pieces, or run the parts by themselves (`run --ticks`), one of them with the two sources exchanged"
            } else {
                "somebody touched it meanwhile, or its zoom, focus or stabilisation works by itself: fasten and lock these, and \
                 leave it out of that part (`run --ticks`, or a venue file without it)"
            }
            .to_owned(),
        }
    }
}
