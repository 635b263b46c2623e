//! Whether all cameras were calibrated in one world: with one origin, and one scale along x and y.
//!
//! ```text
//!   t_v = (q, -q, 0) (c_v - m)     one axis is too short: q is half of the logarithm of what lengths along y are beside those
//!                                  along x; c_v: where a viewpoint stands, m: the middle of all
//!   t_v = d/2 or -d/2              two origins that are d apart
//! ```
//!
//! Any two cameras agree with each other then, or nearly so, and only three do not. So all viewpoints are let move (`places`), and
//! where that makes lines of sight meet it is asked whether one of the two moves them as well.

mod people;
mod places;
#[cfg(test)]
mod tests;

use std::collections::BTreeSet;

use nalgebra::Vector3;

use self::places::Fit;
use super::super::forget_who_disagrees;
use super::super::report::{AgreementReport, DisagreementCause};
use super::Judge;

/// What lines of sight cost at most of which nothing is asked, 0 to 1: of right cameras 0.15 to 0.27, where half of them are 0.1 m
/// aside 0.46 and more.
const AGREES: f64 = 0.3;
/// What moving all viewpoints may leave of the cost. On the sample, the Shelf and four simulated scenes it leaves 0.96 and more of
/// cameras that are right.
const EXPLAINS: f64 = 0.6;
/// How much more the one cause may leave, as a factor.
const AS_WELL: f64 = 1.15;
/// Least difference between the scales of x and y, as a share: what a tape measures wrong. Of right cameras 0.003 was seen.
const LEAST_AXIS: f64 = 0.02;
/// The most, as a logarithm: beyond that bodies are none, and cameras in a line tell nothing of the one axis.
const MOST_AXIS: f64 = 0.3;
/// Least distance of two origins, metres: of right cameras of the Shelf single viewpoints moved by 0.02.
const LEAST_APART_M: f64 = 0.06;
/// How far keypoints must be spread over the floor, metres: of who stays at one place networks err always alike, which looks as if
/// cameras stood elsewhere.
const SPREAD_M: f64 = 1.5;
/// Viewpoints of which each origin must have some: one alone was moved.
const MIN_OF_ORIGIN: usize = 2;

impl Judge<'_> {
    /// Says that cameras are of two worlds, in the place of what that looks like for single cameras; whether it is so.
    pub(in crate::camera_agreement) fn tell_of_worlds(&self, report: &mut AgreementReport) -> bool {
        if self.are_several_late(report) {
            return false;
        }
        let Some((cameras, cause)) = self.worlds() else {
            return false;
        };
        report
            .disagreements
            .retain(|told| told.cause.is_of_pictures());
        let told = self.disagreement(&cameras, cause);
        report.disagreements.insert(0, told);
        if cameras.is_empty() {
            forget_who_disagrees(report);
        } else {
            Self::set_verdicts(report);
        }
        true
    }

    /// Whether cameras of several viewpoints are late: where everybody goes one way they show all of them aside.
    pub(in crate::camera_agreement::judge) fn are_several_late(
        &self,
        report: &AgreementReport,
    ) -> bool {
        let is_of_time = |cause: &DisagreementCause| {
            matches!(
                cause,
                DisagreementCause::Late { .. }
                    | DisagreementCause::LateInPart { .. }
                    | DisagreementCause::Drifts { .. }
            )
        };
        let told = report.disagreements.iter();
        let late = told.filter(|told| is_of_time(&told.cause));
        let names: BTreeSet<&String> = late.flat_map(|told| &told.cameras).collect();
        let late = self.cameras.iter().filter(|it| names.contains(&it.name));
        let viewpoints: BTreeSet<_> = late.map(|camera| camera.viewpoint).collect();
        viewpoints.len() >= MIN_OF_ORIGIN
    }

    fn worlds(&self) -> Option<(Vec<usize>, DisagreementCause)> {
        let places = self.places().filter(|it| it.spread_m() >= SPREAD_M)?;
        let before = places.cost_as_calibrated();
        if before < AGREES {
            return None;
        }
        let free = places.fitted(&places.free());
        if free.cost >= EXPLAINS * before {
            return None;
        }
        let is_as_good = |fit: &Fit| fit.cost <= AS_WELL * free.cost;
        let axis = places.fitted(&[places.along_axes()]);
        let ratio = -2.0 * axis.amounts[0];
        let x_over_y = libm::exp(ratio);
        let is_axis = (x_over_y - 1.0).abs() >= LEAST_AXIS && ratio.abs() <= MOST_AXIS;
        if is_as_good(&axis) && is_axis {
            let x_over_y = (100.0 * x_over_y).round() / 100.0;
            return Some((Vec::new(), DisagreementCause::AxisScale { x_over_y }));
        }
        let fewer = fewer_of_two(&free.moved_m)?;
        let apart = places.fitted(&places.apart(&fewer));
        let apart_m = Vector3::from_iterator(apart.amounts.iter().copied()).norm();
        if !is_as_good(&apart) || apart_m < LEAST_APART_M {
            return None;
        }
        let cameras = 0..self.cameras.len();
        let is_of_fewer = |&camera: &usize| {
            let viewpoint = places.viewpoint_of(self.cameras[camera].viewpoint);
            viewpoint.is_some_and(|viewpoint| fewer[viewpoint])
        };
        let apart_m = (100.0 * apart_m).round() / 100.0;
        let cause = DisagreementCause::TwoOrigins { apart_m };
        Some((cameras.filter(is_of_fewer).collect(), cause))
    }
}

/// Of two groups of viewpoints that moved to two places which are those of the smaller, or of the one without the first; `None`
/// where there is no group of two.
fn fewer_of_two(moved_m: &[Vector3<f64>]) -> Option<Vec<bool>> {
    let n = moved_m.len();
    let pairs = (0..n).flat_map(|a| (a + 1..n).map(move |b| (a, b)));
    let apart = |&(a, b): &(usize, usize)| (moved_m[a] - moved_m[b]).norm();
    let (a, b) = pairs.max_by(|p, q| apart(p).total_cmp(&apart(q)))?;
    let is_near_b = |at: &Vector3<f64>| (at - moved_m[b]).norm() < (at - moved_m[a]).norm();
    let of_b: Vec<bool> = moved_m.iter().map(is_near_b).collect();
    let n_b = of_b.iter().filter(|it| **it).count();
    if n_b.min(n - n_b) < MIN_OF_ORIGIN {
        return None;
    }
    let is_b_told = 2 * n_b < n || 2 * n_b == n && !of_b[0];
    Some(of_b.into_iter().map(|it| it == is_b_told).collect())
}
