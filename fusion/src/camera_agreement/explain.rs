//! What would make a camera agree: the likely causes, weighed by how much each leaves of the cost.

pub(super) mod displaced;
mod keypoint_order;

use self::displaced::displaced;
use self::keypoint_order::{KeypointOrder, keypoint_order, shown_order};
use super::judge::{Judge, rounded};
use super::lens::LensPoints;
use super::pairs::{CameraRays, PictureChange};
use super::refit::{Refit, refit};
use super::report::{Disagreement, DisagreementCause};

/// What a cause leaves of the cost that it explains.
const EXPLAINS: f64 = 0.6;
/// What it may leave when no other leaves nearly as little: networks err on heads that hang down.
const EXPLAINS_IN_PART: f64 = 0.8;
/// From which change of the focal length on it is called that, as a share.
const OTHER_FOCAL_LENGTH: f64 = 0.03;
/// An order of keypoints that was looked for explains a little of anything.
const ORDER_HANDICAP: f64 = 1.3;
/// A fit of four numbers explains a little of anything.
const REFIT_HANDICAP: f64 = 1.3;
/// From which change on, and with what left of the distance, that is told of a camera which agrees well enough otherwise: on
/// real cameras that are right, 0.03 and 0.47 were seen.
const CERTAIN_FOCAL_LENGTH: f64 = 0.06;
const CERTAIN_REFIT: f64 = 0.42;
/// What a focal length is changed by at most, as a factor: pictures of half the size, or twice. And those beyond which a change
/// must leave as little as one that is certain: who shows somebody else seems zoomed, and fits a little better so.
const ZOOMS: std::ops::RangeInclusive<f64> = 0.45..=2.25;
const NEAR_ZOOMS: std::ops::RangeInclusive<f64> = 0.8..=1.25;
/// From which turn on, radians, that is told of such a camera: where all is right, a network that sees each person from one
/// side only made 0.9 degrees of its own errors, and left 0.54 of the distance.
const CERTAIN_TURN_RAD: f64 = 0.0175;
/// A turn about where the camera looks moves only what is far from the middle of its picture, and leaves the more. From so
/// much on, radians, with so much left.
const CERTAIN_ROLL_RAD: f64 = 0.06;
const CERTAIN_ROLL: f64 = 0.72;
/// What its sightings may cost then, as a factor of what they do as it is calibrated: two windows of right data cost 4.6 and 6 times
/// as much.
const CERTAIN_SIGHTINGS: f64 = 1.5;
/// What another order of keypoints must leave to be told of such a camera.
const CERTAIN_ORDER: f64 = 0.5;
/// How much less than what any other leaves.
const STANDS_OUT: f64 = 0.9;
/// Turns larger than this are no camera that was pushed, radians.
const MOST_TURNED_RAD: f64 = 0.35;

/// What a cause leaves of the cost, the cameras that it is about, and the cause.
type Weighed = (f64, Vec<usize>, DisagreementCause);

impl Judge<'_> {
    /// What makes `camera` of a group, which is outside of those that are `right`, agree best, and which cameras it is
    /// about; `None` where nothing does.
    pub(super) fn explain(
        &self,
        camera: usize,
        (right, group, outside): (&[usize], &[usize], &[usize]),
        points: Option<&LensPoints<'_>>,
        told: &mut [bool],
    ) -> Option<(Vec<usize>, DisagreementCause)> {
        let others: Vec<usize> = if right.is_empty() {
            let others = group.iter().copied();
            others.filter(|&other| other != camera).collect()
        } else {
            right.to_vec()
        };
        let as_it_is = self.cost_against(camera, &self.as_it_is[camera], &others)?;
        let mut causes: Vec<Weighed> = Vec::new();
        for (change, cause) in [
            (PictureChange::Mirrored, DisagreementCause::Mirrored),
            (PictureChange::HalfTurned, DisagreementCause::HalfTurned),
        ] {
            let rays = self.rays(camera, camera, change);
            if let Some(cost) = self.cost_against(camera, &rays, &others) {
                causes.push((cost / as_it_is, vec![camera], cause));
            }
        }
        for other in group.iter().copied().filter(|&other| other != camera) {
            let apart: Vec<usize> = others.iter().copied().filter(|&o| o != other).collect();
            let may_be_swapped = outside.contains(&other) && !told[other];
            let roles = (right.contains(&other), may_be_swapped);
            causes.extend(self.with_calibration_of((camera, other), &apart, roles));
        }
        if let Some((ticks, ratio)) = self.lateness(camera) {
            causes.push((ratio, vec![camera], DisagreementCause::Late { ticks }));
        }
        causes.extend(self.in_another_order(camera, &others, || Some(as_it_is)));
        let of_picture = self.picture_of_one(camera, &others, as_it_is);
        causes.extend(of_picture.map(|(ratio, change)| {
            let cause = DisagreementCause::OtherPicture { change };
            (ratio, vec![camera], cause)
        }));
        let is_late = self.may_be_late(camera);
        let points = points.filter(|_| !is_late);
        let displaced = points.and_then(|points| displaced(points, camera, right));
        let fitted = displaced.filter(|it| it.is_gain);
        let fitted = fitted.map(|it| (it.ratio, vec![camera], it.cause));
        causes.extend(fitted.or_else(|| self.refitted(camera, right)));
        causes.sort_by(|a, b| a.0.total_cmp(&b.0));
        let second = causes.get(1).map_or(1.0, |(ratio, ..)| *ratio);
        let is_cause = |ratio: f64| {
            ratio < EXPLAINS || ratio < EXPLAINS_IN_PART && ratio < STANDS_OUT * second
        };
        let best = causes.into_iter().next();
        let best = best.filter(|(ratio, ..)| is_cause(*ratio));
        let certain = displaced
            .filter(|it| it.is_certain() && self.fits_sightings(camera, &it.changed, right));
        let certain = || certain.map(|it| (it.ratio, vec![camera], it.cause));
        let (_, cameras, cause) = best.or_else(certain)?;
        if cause == DisagreementCause::Swapped {
            for &camera in &cameras {
                told[camera] = true;
            }
        }
        Some((cameras, cause))
    }

    /// What the calibration of the `other` camera leaves of the cost of a camera against those `apart` from both; the
    /// other may be taken for right, or may be swapped with it.
    fn with_calibration_of(
        &self,
        (camera, other): (usize, usize),
        apart: &[usize],
        (is_right, may_be_swapped): (bool, bool),
    ) -> Option<Weighed> {
        // With the calibration of the other, lines of sight begin where that stands.
        let apart = apart.iter().copied();
        let apart: Vec<usize> = apart
            .filter(|&third| self.are_apart(other, third))
            .collect();
        let apart = &apart[..];
        let before = self.cost_against(camera, &self.as_it_is[camera], apart)?;
        let rays = self.rays(camera, other, PictureChange::AsItIs);
        let cost = self.cost_against(camera, &rays, apart)?;
        let cameras = vec![camera, other];
        let exchanged = self.rays(other, camera, PictureChange::AsItIs);
        let of_both = apart.iter().copied();
        let of_both: Vec<usize> = of_both
            .filter(|&third| self.are_apart(camera, third))
            .collect();
        let of_other = self.cost_against(other, &exchanged, &of_both);
        let other_before = self.cost_against(other, &self.as_it_is[other], &of_both);
        if let (true, Some(of_other), Some(other_before)) = (may_be_swapped, of_other, other_before)
            && of_other < EXPLAINS * other_before
        {
            let ratio = (cost + of_other) / (before + other_before);
            return Some((ratio, cameras, DisagreementCause::Swapped));
        }
        let cause = if !is_right {
            DisagreementCause::OtherCalibration
        } else if self.may_show_the_same(camera, other) {
            DisagreementCause::SamePictures
        } else {
            // A camera that is right has its own pictures: the other fits by chance.
            return None;
        };
        Some((cost / before, cameras, cause))
    }

    /// What another order of the keypoints leaves of the cost `as_it_is`, which is asked for where there is one.
    fn in_another_order(
        &self,
        camera: usize,
        others: &[usize],
        as_it_is: impl FnOnce() -> Option<f64>,
    ) -> Option<Weighed> {
        let own = &self.as_it_is[camera];
        let elsewhere = others
            .iter()
            .filter(|&&other| self.are_apart(camera, other));
        let elsewhere: Vec<&CameraRays> = elsewhere.map(|&other| &self.as_it_is[other]).collect();
        let order = keypoint_order(own, &elsewhere, self.partners)?;
        let cost = self.cost_against(camera, &own.reordered(&order.of), others)?;
        let cause = order_cause(&order);
        let ratio = ORDER_HANDICAP * cost / as_it_is()?;
        // Not in part: of people who seem to stand on their heads networks take left for right.
        (ratio < EXPLAINS).then(|| (ratio, vec![camera], cause))
    }

    /// What another focal length, or a small turn, leaves.
    fn refitted(&self, camera: usize, right: &[usize]) -> Option<Weighed> {
        let refit = refit(&self.bursts, &self.lines, (camera, right))?;
        let cause = if (refit.focal_factor - 1.0).abs() > OTHER_FOCAL_LENGTH {
            focal_length(&refit)
        } else {
            turned(&refit)
        };
        let is_far = !NEAR_ZOOMS.contains(&refit.focal_factor);
        if !ZOOMS.contains(&refit.focal_factor) || is_far && refit.ratio >= CERTAIN_REFIT {
            return None;
        }
        let is_small = refit.turned_rad() <= MOST_TURNED_RAD;
        is_small.then(|| (REFIT_HANDICAP * refit.ratio, vec![camera], cause))
    }

    /// What another focal length, or a small turn, explains of a camera that alone does not fit.
    pub(super) fn refitted_alone(&self, camera: usize) -> DisagreementCause {
        let all = 0..self.cameras.len();
        let others: Vec<usize> = all.filter(|&other| other != camera).collect();
        let refitted = self.refitted(camera, &others);
        let explained = refitted.filter(|(ratio, ..)| *ratio < EXPLAINS_IN_PART);
        explained.map_or(DisagreementCause::Unexplained, |(.., cause)| cause)
    }

    /// Cameras that agree well enough, as lines of sight pass near each other, and whose people are a little too large or
    /// too small for where the others see them, or beside it, or have left for right.
    pub(super) fn find_what_agrees_by_chance(
        &self,
        points: Option<&LensPoints<'_>>,
        all: &mut Vec<Disagreement>,
        told: &mut [bool],
    ) {
        loop {
            let left = |camera: &usize| !told[*camera];
            let right: Vec<usize> = (0..told.len()).filter(left).collect();
            let causes = right.iter().filter_map(|&camera| {
                let cause = self.certain_order(camera, &right);
                // Where somebody moved more is known.
                let refit = || {
                    self.certain_refit(camera, &right)
                        .filter(|_| points.is_none())
                };
                let (ratio, cause) = cause.or_else(refit)?;
                Some((ratio, camera, cause))
            });
            let Some((_, camera, cause)) = causes.min_by(|a, b| a.0.total_cmp(&b.0)) else {
                return;
            };
            told[camera] = true;
            all.push(self.disagreement(&[camera], cause));
        }
    }

    /// By the crops, where fusion has not undone it already: it takes a view's left for its right where that fits; else by
    /// the sightings.
    fn certain_order(&self, camera: usize, right: &[usize]) -> Option<(f64, DisagreementCause)> {
        let of = (camera, right);
        let shown = shown_order(&self.bursts, &self.lines, of, self.partners);
        let shown = shown.map(|(ratio, order)| (ratio, order_cause(&order)));
        let sighted = || {
            let as_it_is = || self.cost_against(camera, &self.as_it_is[camera], right);
            let (ratio, _, cause) = self.in_another_order(camera, right, as_it_is)?;
            Some((ratio, cause))
        };
        let is_certain = |(ratio, _): &(f64, DisagreementCause)| *ratio < CERTAIN_ORDER;
        shown
            .filter(is_certain)
            .or_else(|| sighted().filter(is_certain))
    }

    /// Another focal length, or a turn: two cameras whose lines of sight meet say nothing of one that was turned to the
    /// side, a third does.
    pub(super) fn certain_refit(
        &self,
        camera: usize,
        right: &[usize],
    ) -> Option<(f64, DisagreementCause)> {
        let refit = refit(&self.bursts, &self.lines, (camera, right))?;
        let scaled = (refit.focal_factor - 1.0).abs();
        let is_zoom = ZOOMS.contains(&refit.focal_factor);
        let is_scaled = is_zoom && refit.ratio < CERTAIN_REFIT && scaled >= CERTAIN_FOCAL_LENGTH;
        let is_aside = refit.ratio < CERTAIN_REFIT && refit.aside_rad >= CERTAIN_TURN_RAD;
        let is_rolled = refit.ratio < CERTAIN_ROLL && refit.rolled_rad >= CERTAIN_ROLL_RAD;
        // Where everybody goes one way, who is late shows them all aside.
        let is_turned = (is_aside || is_rolled) && !self.is_clearly_late(camera);
        let cause = if is_scaled {
            focal_length(&refit)
        } else if is_turned && scaled < OTHER_FOCAL_LENGTH {
            turned(&refit)
        } else {
            return None;
        };
        // Of a second or less crops show a few places, where networks err to one side.
        let is_met = || {
            let own = &self.as_it_is[camera];
            let rays = own.through(|shown| Some(refit.straightened(shown)));
            let ratio = self.sightings_cost(camera, &rays, right);
            ratio.is_some_and(|ratio| ratio < CERTAIN_SIGHTINGS)
        };
        let is_certain = refit.turned_rad() <= MOST_TURNED_RAD && is_met();
        is_certain.then_some((refit.ratio, cause))
    }
}

fn order_cause(order: &KeypointOrder) -> DisagreementCause {
    DisagreementCause::KeypointOrder {
        moved: order.moved,
        sides: order.sides,
    }
}

fn focal_length(refit: &Refit) -> DisagreementCause {
    DisagreementCause::FocalLength {
        factor: (1000.0 * refit.focal_factor).round() / 1000.0,
    }
}

fn turned(refit: &Refit) -> DisagreementCause {
    DisagreementCause::Turned {
        degrees: rounded(refit.turned_rad().to_degrees()),
    }
}
