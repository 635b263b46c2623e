//! Whether a camera is late, and by how much: by crops, tick by tick, else by sightings and poses.

use super::{Findings, Judge, rounded};
use crate::camera_agreement::report::DisagreementCause;
use crate::camera_agreement::samples::LEAST_BURSTS_S;
use crate::camera_agreement::time_shift::LATE_TICKS;

/// Smallest lateness that is reported from sightings, ticks and seconds: they have no time within a tick, and only some
/// poses are stored.
const MIN_POSE_LATE_TICKS: f64 = 1.2;
const MIN_POSE_LATE_S: f64 = 0.05;
/// Largest share of the cost that a shift of few ticks may leave.
const MAX_COST_RATIO: f64 = 0.96;
/// From this shift on, ticks, there are so many candidates that one of them explains something by chance.
const MIN_FAR_TICKS: f64 = 8.0;
/// Largest share of the cost that such a shift may leave.
const MAX_FAR_COST_RATIO: f64 = 0.7;

impl Judge<'_> {
    /// By how many ticks `camera` is late, if that is sure and large enough to report.
    pub(super) fn late(&self, camera: usize) -> Option<f64> {
        self.lateness(camera).map(|(ticks, _)| ticks)
    }

    /// The same with the share of the cost that it leaves: by crops, else by sightings and poses.
    pub(in crate::camera_agreement) fn lateness(&self, camera: usize) -> Option<(f64, f64)> {
        let of_crops = || {
            let shift = self.shifts[camera]?;
            let ratio = shift.cost_after / shift.cost_before;
            let is_sure = is_sure_shift(shift.late_ticks, ratio);
            let is_reported = shift.late_ticks.abs() >= LATE_TICKS && is_sure;
            let ticks = self.known_late(camera).filter(|_| is_reported)?;
            Some((ticks, ratio))
        };
        let of_poses = || {
            let shift = self.pose_shifts[camera]?;
            let ticks = rounded(shift.late_ticks);
            let least = MIN_POSE_LATE_TICKS.max(MIN_POSE_LATE_S * self.rate_hz);
            // For few ticks, crops are better than sightings if they are known.
            let is_known = ticks.abs() < MIN_FAR_TICKS && self.known_late(camera).is_some();
            let is_sure = shift.is_steady && is_sure_shift(ticks, shift.ratio);
            let is_reported = ticks.abs() >= least && !is_known && is_sure;
            is_reported.then_some((ticks, shift.ratio))
        };
        of_crops()
            .or_else(|| self.late_with_others(camera))
            .or_else(of_poses)
    }

    /// For how many seconds crops of `camera` show a person.
    fn shown_s(&self, camera: usize) -> f64 {
        let ticks = self.bursts.iter().map(|burst| burst.n_shown(camera));
        ticks.sum::<usize>() as f64 / self.rate_hz
    }

    /// Lateness and share of the cost of a camera in a group that is late by the same time.
    fn late_with_others(&self, camera: usize) -> Option<(f64, f64)> {
        let group = self.late_group.as_ref()?;
        let ticks = rounded(group.late_ticks);
        group
            .cameras
            .contains(&camera)
            .then_some((ticks, group.ratio))
    }

    /// Cameras that are late in a part of the time.
    pub(super) fn find_jumps(&self, findings: &mut Findings) {
        for camera in findings.unexplained() {
            if let Some(jump) = self.jumps[camera] {
                let [before_ticks, after_ticks] = jump.late_ticks.map(rounded);
                let cause = DisagreementCause::LateInPart {
                    before_ticks,
                    after_ticks,
                    since_tick: jump.at.0,
                };
                findings.add(self, &[camera], cause);
            }
        }
    }

    /// Cameras that drift or are late. A camera that was compared with a wrong one seems a little late, so it must be
    /// clearly late if anything else is found.
    pub(super) fn find_late(&self, findings: &mut Findings) {
        let unexplained = findings.unexplained();
        let is_all = unexplained.len() == self.cameras.len();
        for camera in unexplained {
            let drift = self.drifts[camera].filter(|drift| drift.is_significant);
            let drift = drift.map(|drift| DisagreementCause::Drifts {
                ticks_per_minute: drift.ticks_per_minute,
            });
            let late = self.late(camera);
            let late = late.filter(|_| is_all || self.is_clearly_late(camera));
            let cause = drift.or(late.map(|ticks| DisagreementCause::Late { ticks }));
            if let Some(cause) = cause {
                findings.add(self, &[camera], cause);
            }
        }
    }

    /// Whether lateness explains most of the cost of `camera`.
    pub(in crate::camera_agreement) fn is_clearly_late(&self, camera: usize) -> bool {
        self.lateness(camera)
            .is_some_and(|(_, ratio)| ratio < MAX_FAR_COST_RATIO)
    }

    /// Whether `camera` may be late, so that it does not show where people are.
    pub(in crate::camera_agreement) fn may_be_late(&self, camera: usize) -> bool {
        self.is_clearly_late(camera) || self.drifts[camera].is_some()
    }

    /// By how many ticks `camera` is late, to a hundredth; `None` if people moved or were shown too little.
    pub(super) fn known_late(&self, camera: usize) -> Option<f64> {
        let shift = self.shifts[camera].filter(|shift| shift.is_sharp)?;
        if self.shown_s(camera) < LEAST_BURSTS_S {
            return None;
        }
        Some((100.0 * shift.late_ticks).round() / 100.0)
    }
}

/// Whether a shift in time leaves so small a `ratio` of the cost that it is not by chance.
fn is_sure_shift(ticks: f64, ratio: f64) -> bool {
    let is_far = ticks.abs() >= MIN_FAR_TICKS;
    ratio
        < if is_far {
            MAX_FAR_COST_RATIO
        } else {
            MAX_COST_RATIO
        }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera_agreement::fixture::Hall;
    use crate::camera_agreement::judge::before::JudgedBefore;

    #[test]
    fn crops_of_less_than_the_least_time_report_no_lateness() {
        let samples = Hall::default().samples();
        let mut before = JudgedBefore::default();
        let mut judge = Judge::new(&samples.cameras, &samples.samples, &mut before);
        assert!(judge.known_late(1).is_some());
        judge.bursts.truncate(1);
        judge.rate_hz = judge.bursts[0].n_shown(1) as f64 / 0.7;
        assert_eq!(judge.known_late(1), None);
    }
}
