//! Whether all cameras were calibrated in one world: with one origin, and one scale along x and y.
//!
//! ```text
//!   t_v = (q, -q, 0) (c_v - m)     one axis is too short: q is half of the logarithm of what lengths along y are beside those
//!                                  along x; c_v: where a viewpoint stands, m: the middle of all
//!   t_v = d/2 or -d/2              two origins that are d apart
//! ```
//!
//! Lines of sight tell the ratio of the two scales alone. Which of them is wrong is told by feet: with the other one mended all is
//! larger or smaller, and feet are above the floor or under it.
//!
//! Any two cameras agree with each other then, or nearly so, and only three do not. So all viewpoints are let move (`places`), and
//! where that makes lines of sight meet it is asked whether one of the two moves them as well.

mod people;
mod places;
#[cfg(test)]
mod tests;

use std::collections::BTreeSet;

use nalgebra::Vector3;

use self::places::{Fit, Places};
use super::super::forget_who_disagrees;
use super::super::report::{AgreementReport, DisagreementCause, FloorAxis};
use super::super::standing::ankles::ANKLE_M;
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
/// How far from the floor feet of right cameras may be, metres (up to 0.08 on the Shelf and on a treadmill), and how much farther
/// they must be with the other axis mended, so that no axis that is right is told.
const ON_FLOOR_M: f64 = 0.1;
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

    /// Which of two axes has a wrong scale, by where feet are with the one and with the other mended; `None` where that is not told.
    fn wrong_axis(&self, places: &Places, x_over_y: f64) -> Option<FloorAxis> {
        let above_m =
            |factors| Some(places.ankles_m(factors)? - ANKLE_M - self.venue.field.floor_m);
        told_by_feet(
            above_m([1.0 / x_over_y, 1.0, 1.0])?,
            above_m([1.0, x_over_y, 1.0])?,
        )
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
            let axis = self.wrong_axis(&places, x_over_y);
            let x_over_y = (100.0 * x_over_y).round() / 100.0;
            return Some((Vec::new(), DisagreementCause::AxisScale { x_over_y, axis }));
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

/// The one of which feet are on the floor once it is mended, by how high they are then and once the other is, metres.
fn told_by_feet(along_x_m: f64, along_y_m: f64) -> Option<FloorAxis> {
    let stand = |own_m: f64, other_m: f64| {
        own_m.abs() <= ON_FLOOR_M && other_m.abs() >= own_m.abs() + ON_FLOOR_M
    };
    if stand(along_x_m, along_y_m) {
        Some(FloorAxis::X)
    } else if stand(along_y_m, along_x_m) {
        Some(FloorAxis::Y)
    } else {
        None
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
