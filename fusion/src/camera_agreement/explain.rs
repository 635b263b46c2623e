//! What would make one camera agree with the others: candidate causes, each with the share of the cost that it leaves.

pub(super) mod displaced;
mod keypoint_order;
pub(super) mod resection;

use self::displaced::displaced;
use self::keypoint_order::{KeypointOrder, keypoint_order};
use super::judge::{Findings, Group, Judge};
use super::pairs::{CameraRays, PictureChange};
use super::report::DisagreementCause;

/// Largest share of the cost that a cause may leave.
const MAX_COST_RATIO: f64 = 0.6;
/// The same for another order of keypoints in a camera that agrees.
const MAX_ORDER_COST_RATIO: f64 = 0.5;
/// An order of keypoints is the best of very many, so it explains a little of anything. Its cost is multiplied by this.
const ORDER_HANDICAP: f64 = 1.3;

/// A cause, the cameras that it is about, and the share of the cost that it leaves.
struct Candidate {
    cost_ratio: f64,
    cameras: Vec<usize>,
    cause: DisagreementCause,
}

impl Candidate {
    fn alone(camera: usize, cause: DisagreementCause, cost_ratio: f64) -> Self {
        Self {
            cost_ratio,
            cameras: vec![camera],
            cause,
        }
    }
}

impl Judge<'_> {
    /// The cause that makes `camera` agree best, and the cameras that it is about. The camera is in `group`, and not
    /// taken for right. `None` if no cause explains enough.
    pub(super) fn explain(
        &self,
        camera: usize,
        group: &Group,
        findings: &Findings,
    ) -> Option<(Vec<usize>, DisagreementCause)> {
        let others = group.references(camera);
        let calibrated = self.cost_against(camera, &self.as_it_is[camera], &others)?;
        let mut candidates: Vec<Candidate> = Vec::new();
        for (change, cause) in [
            (PictureChange::Mirrored, DisagreementCause::Mirrored),
            (PictureChange::HalfTurned, DisagreementCause::HalfTurned),
        ] {
            let rays = self.rays(camera, camera, change);
            if let Some(cost) = self.cost_against(camera, &rays, &others) {
                candidates.push(Candidate::alone(camera, cause, cost / calibrated));
            }
        }
        let not_right = group.outside.iter().copied();
        for other in not_right.filter(|&other| other != camera) {
            let is_free = !findings.is_explained(other);
            candidates.extend(self.with_calibration_of(camera, other, &others, is_free));
        }
        if let Some((ticks, ratio)) = self.lateness(camera) {
            let cause = DisagreementCause::Late { ticks };
            candidates.push(Candidate::alone(camera, cause, ratio));
        }
        if let Some((ratio, cause)) = self.in_another_order(camera, &others, calibrated) {
            candidates.push(Candidate::alone(camera, cause, ratio));
        }
        if let Some((ratio, change)) = self.picture_of_one(camera, &others, calibrated) {
            let cause = DisagreementCause::OtherPicture { change };
            candidates.push(Candidate::alone(camera, cause, ratio));
        }
        let points = self.points.as_ref().filter(|_| !self.may_be_late(camera));
        let displaced = points.and_then(|points| displaced(points, camera, &group.right));
        let displaced = displaced.filter(|it| it.is_gain);
        candidates.extend(displaced.map(|it| Candidate::alone(camera, it.cause, it.ratio)));
        let best = candidates
            .into_iter()
            .min_by(|a, b| a.cost_ratio.total_cmp(&b.cost_ratio))?;
        (best.cost_ratio < MAX_COST_RATIO).then_some((best.cameras, best.cause))
    }

    /// The calibration of the `other` camera, which may also have that of `camera` in exchange if it `is_free`.
    fn with_calibration_of(
        &self,
        camera: usize,
        other: usize,
        references: &[usize],
        is_free: bool,
    ) -> Option<Candidate> {
        // With the calibration of the other camera, lines of sight begin at that camera.
        let apart_from = |of: usize| -> Vec<usize> {
            let thirds = references.iter().copied();
            let thirds = thirds.filter(|&third| third != other && self.are_apart(other, third));
            thirds.filter(|&third| self.are_apart(of, third)).collect()
        };
        let exchanged = |own: usize, calibrated: usize, thirds: &[usize]| {
            let before = self.cost_against(own, &self.as_it_is[own], thirds)?;
            let rays = self.rays(own, calibrated, PictureChange::AsItIs);
            Some((before, self.cost_against(own, &rays, thirds)?))
        };
        let (before, after) = exchanged(camera, other, &apart_from(other))?;
        let cameras = vec![camera, other];
        let of_other = exchanged(other, camera, &apart_from(camera)).filter(|_| is_free);
        if let Some((other_before, other_after)) = of_other
            && other_after < MAX_COST_RATIO * other_before
        {
            return Some(Candidate {
                cost_ratio: (after + other_after) / (before + other_before),
                cameras,
                cause: DisagreementCause::Swapped,
            });
        }
        Some(Candidate {
            cost_ratio: after / before,
            cameras,
            cause: DisagreementCause::OtherCalibration,
        })
    }

    /// Another order of the keypoints of `camera`, and the share that it leaves of the `calibrated` cost.
    fn in_another_order(
        &self,
        camera: usize,
        others: &[usize],
        calibrated: f64,
    ) -> Option<(f64, DisagreementCause)> {
        let own = &self.as_it_is[camera];
        let elsewhere = others
            .iter()
            .filter(|&&other| self.are_apart(camera, other));
        let elsewhere: Vec<&CameraRays> = elsewhere.map(|&other| &self.as_it_is[other]).collect();
        let order = keypoint_order(own, &elsewhere, self.partners)?;
        let cost = self.cost_against(camera, &own.reordered(&order.places), others)?;
        let KeypointOrder { moved, sides, .. } = order;
        let cause = DisagreementCause::KeypointOrder { moved, sides };
        Some((ORDER_HANDICAP * cost / calibrated, cause))
    }

    /// Cameras with another order of keypoints that agree, because lines of sight pass near each other.
    pub(super) fn find_orders(&self, findings: &mut Findings) {
        loop {
            let right = findings.unexplained();
            let orders = right.iter().filter_map(|&camera| {
                let calibrated = self.cost_against(camera, &self.as_it_is[camera], &right)?;
                let (ratio, cause) = self.in_another_order(camera, &right, calibrated)?;
                (ratio < MAX_ORDER_COST_RATIO).then_some((ratio, camera, cause))
            });
            let Some((_, camera, cause)) = orders.min_by(|a, b| a.0.total_cmp(&b.0)) else {
                return;
            };
            findings.add(self, &[camera], cause);
        }
    }
}
