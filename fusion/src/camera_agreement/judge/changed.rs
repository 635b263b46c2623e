//! Cameras that agree in one half of the time only: knocked, zoomed, refocused or exchanged while people were tracked.
//!
//! No single cause explains the whole time of such a camera. So each half is judged separately. A disagreement in one
//! half and none in the other began or ended meanwhile.

use std::mem::discriminant;

use farfield_proto::message::agreement::AgreementVerdict;
use farfield_proto::tick::Tick;

use super::super::AgreementCameras;
use super::super::report::{AgreementReport, Disagreement, DisagreementCause};
use super::super::samples::Samples;
use super::Judge;
use super::before::JudgedBefore;

/// Shortest half, seconds, and fewest detection passes in it, of which there is one per second. Shorter halves may give
/// false reports. With valid cameras of the Shelf, the sample and a dozen simulated scenes, no three, four or five
/// passes in a row gave one.
const MIN_HALF_S: f64 = 4.0;
const MIN_HALF_PASSES: usize = 5;

/// Replaces the disagreements of `report` by one that began or ended meanwhile, if there is one of the same cameras.
pub(in crate::camera_agreement) fn report_part_of_time(
    cameras: &AgreementCameras,
    samples: &Samples,
    report: &mut AgreementReport,
) {
    // Over the whole time, a change of a camera can look like one of these causes.
    let may_be_in_part = |d: &Disagreement| {
        let is_similar = matches!(
            d.cause,
            DisagreementCause::Distortion { .. }
                | DisagreementCause::LateInPart { .. }
                | DisagreementCause::Unexplained
        );
        can_begin(d) || is_similar
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
    let [disagreement] = &wrong.disagreements[..] else {
        return;
    };
    // If the camera could not be compared in the other half, the cause may hold there, too.
    let is_right = |name: &String| {
        let camera = right.cameras.get(name);
        camera.is_some_and(|camera| camera.verdict == AgreementVerdict::Agrees)
    };
    let is_other = |d: &Disagreement| {
        let is_alike = discriminant(&d.cause) == discriminant(&disagreement.cause);
        let is_unexplained = d.cause == DisagreementCause::Unexplained;
        let is_of_them = d
            .cameras
            .iter()
            .all(|name| disagreement.cameras.contains(name));
        is_of_them && (is_unexplained || !is_alike)
    };
    let is_explained = report.disagreements.iter().all(is_other);
    if !can_begin(disagreement) || !is_explained || !disagreement.cameras.iter().all(is_right) {
        return;
    }
    let Some(ticks) = span(&half) else {
        return;
    };
    // `LateInPart` has its own tick.
    report.disagreements = vec![match disagreement.cause {
        DisagreementCause::LateInPart { .. } => disagreement.clone(),
        _ => disagreement.in_part(ticks, is_second),
    }];
    for name in &disagreement.cameras {
        if let Some(own) = wrong.cameras.get(name) {
            report.cameras.insert(name.clone(), *own);
        }
        if let Some(own) = wrong.details.get(name) {
            report.details.insert(name.clone(), *own);
        }
    }
}

/// Whether it can begin in one camera while it shows people, or in two cameras whose recordings were joined wrongly.
fn can_begin(disagreement: &Disagreement) -> bool {
    match &disagreement.cameras[..] {
        [_] => matches!(
            disagreement.cause,
            DisagreementCause::Turned { .. }
                | DisagreementCause::Moved { .. }
                | DisagreementCause::FocalLength { .. }
                | DisagreementCause::HalfTurned
                | DisagreementCause::Mirrored
                | DisagreementCause::LateInPart { .. }
                | DisagreementCause::Unexplained
        ),
        [_, _] => disagreement.cause == DisagreementCause::Swapped,
        _ => false,
    }
}

/// The samples of each half of the time; `None` if a half is too short.
fn halves(cameras: &AgreementCameras, samples: &Samples) -> Option<[Samples; 2]> {
    let [from, to] = span(samples)?;
    let length = (to - from) / 2;
    if (length as f64) < MIN_HALF_S * cameras.rate_hz {
        return None;
    }
    let middle = from + length;
    let halves = [
        samples.between(from, middle),
        samples.between(middle, to + 1),
    ];
    let is_long = |half: &Samples| half.passes.len() >= MIN_HALF_PASSES;
    halves.iter().all(is_long).then_some(halves)
}

/// The first and the last tick of the kept detection passes.
fn span(samples: &Samples) -> Option<[Tick; 2]> {
    let passes = &samples.passes;
    Some([passes.front()?.tick, passes.back()?.tick])
}

impl Disagreement {
    /// The same, limited to these ticks: the second half of the time, or the first.
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
                "in the {half} half of the judged time (ticks {from} to {to}), but not in the {other}, {}",
                self.found
            ),
            remedy: if self.cause == DisagreementCause::Swapped {
                "each recording changes from one camera to the other at some moment: join the pieces of each camera, or run the \
                 parts separately (`run --ticks`), one of them with the two sources exchanged"
            } else {
                "it was touched meanwhile, or its zoom, focus or stabilisation is automatic: fasten the camera, lock these, and \
                 leave it out of that part (`run --ticks`, or a venue file without it)"
            }
            .to_owned(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::fixture::{Hall, Mistake};
    use super::*;

    /// A hall with four bursts, ten seconds apart, whose second camera has this mistake.
    fn hall(mistake: Mistake) -> Hall {
        let mut hall = Hall::with(1, mistake);
        hall.bursts = 4;
        hall
    }

    fn turned(in_bursts: [usize; 2]) -> Mistake {
        Mistake {
            turned_deg: [0.0, 2.5, 0.0],
            in_bursts: Some(in_bursts),
            ..Mistake::default()
        }
    }

    #[test]
    fn a_camera_turned_meanwhile_is_named_with_its_half_of_the_time() {
        for (in_bursts, [from, to], half) in [
            ([2, 3], [1200, 1890], "second"),
            ([0, 1], [0, 690], "first"),
        ] {
            let report = hall(turned(in_bursts)).report();
            let [disagreement] = &report.disagreements[..] else {
                panic!("{:?}", report.disagreements);
            };
            assert_eq!(disagreement.cameras, ["cam1"]);
            assert!(
                matches!(disagreement.cause, DisagreementCause::Turned { degrees } if (1.5..3.5).contains(&degrees)),
                "{disagreement:?}"
            );
            assert_eq!(disagreement.part_ticks, Some([from, to]));
            let words = format!("in the {half} half of the judged time (ticks {from} to {to})");
            assert!(
                disagreement.found.starts_with(&words),
                "{}",
                disagreement.found
            );
            assert!(report.cameras["cam1"].distance_mm > report.cameras["cam0"].distance_mm);
        }
    }

    #[test]
    fn a_camera_zoomed_meanwhile_is_named_with_its_half_of_the_time() {
        let zoomed = Mistake {
            focal_factor: 1.08,
            in_bursts: Some([2, 3]),
            ..Mistake::default()
        };
        let report = hall(zoomed).report();
        let [disagreement] = &report.disagreements[..] else {
            panic!("{:?}", report.disagreements);
        };
        assert_eq!(disagreement.cameras, ["cam1"]);
        assert_eq!(disagreement.part_ticks, Some([1200, 1890]));
    }

    #[test]
    fn a_mistake_all_the_time_has_no_part() {
        let always = hall(turned([0, 3])).report();
        assert!(!always.disagreements.is_empty());
        assert!(always.disagreements.iter().all(|d| d.part_ticks.is_none()));
        assert_eq!(hall(Mistake::default()).report().disagreements, []);
    }

    #[test]
    fn five_passes_without_crops_suffice_for_a_part() {
        let zoomed = Mistake {
            focal_factor: 1.1,
            in_bursts: Some([2, 3]),
            ..Mistake::default()
        };
        for mistake in [turned([2, 3]), zoomed] {
            let mut short = hall(mistake).samples();
            short.samples.passes.truncate(13);
            short.samples.bursts.truncate(2);
            let report = short.report();
            let [disagreement] = &report.disagreements[..] else {
                panic!("{:?}", report.disagreements);
            };
            assert_eq!(disagreement.cameras, ["cam1"]);
            assert_eq!(
                disagreement.part_ticks,
                Some([1200, 1800]),
                "{disagreement:?}"
            );
        }
    }

    #[test]
    fn two_cameras_exchanged_meanwhile_are_named_with_their_half() {
        let shows = |of_camera| Mistake {
            of_camera: Some(of_camera),
            in_bursts: Some([2, 3]),
            ..Mistake::default()
        };
        let mut hall = hall(shows(2));
        hall.shows[2].1 = shows(1);
        let report = hall.report();
        let [disagreement] = &report.disagreements[..] else {
            panic!("{:?}", report.disagreements);
        };
        assert_eq!(disagreement.cause, DisagreementCause::Swapped);
        assert_eq!(disagreement.cameras, ["cam1", "cam2"]);
        assert_eq!(disagreement.part_ticks, Some([1200, 1890]));
        assert!(
            disagreement.remedy.contains("`run --ticks`"),
            "{}",
            disagreement.remedy
        );
    }

    #[test]
    fn few_passes_have_no_part() {
        let mut few = hall(turned([1, 1]));
        few.bursts = 2;
        let report = few.report();
        assert!(report.disagreements.iter().all(|d| d.part_ticks.is_none()));
    }
}
