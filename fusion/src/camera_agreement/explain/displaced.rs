//! What of a camera alone is another than was calibrated: where it stands and looks, or its lens.
//!
//! Each change is fitted to one half of the keypoints and weighed by what it leaves of the distances of the other half: what a
//! network errs on some of them explains nothing of the others, and a change of more numbers has no advantage of them.

use super::super::judge::Judge;
use super::super::lens::LensPoints;
use super::super::refit::resection::{Change, Changed, Observed};
use super::super::report::{Disagreement, DisagreementCause};
use super::MOST_TURNED_RAD;

/// Keypoints that a camera must show to be fitted.
const MIN_OBSERVED: usize = 120;
/// What a change may leave of the median distance to be told of a camera that agrees well enough otherwise. Of right cameras
/// 0.87 and more was left on the Shelf, 0.97 on the sample.
const CERTAIN: f64 = 0.72;
/// What the change of most numbers leaves of cameras that are not worth more fits.
const WORTH_FITTING: f64 = 0.88;
/// By how much less than it is the distance must be, metres: no calibration is true to the last millimetre.
const LEAST_GAIN_M: f64 = 0.01;
/// What each number more counts: of two changes that explain alike the one with fewer is told.
const PER_NUMBER: f64 = 0.01;
/// Least and most way of a camera that was moved, metres.
const LEAST_MOVED_M: f64 = 0.02;
const MOST_MOVED_M: f64 = 0.6;
/// Least turn that is told, degrees: across a wide field the tenths of a tick by which cameras run freely look like two tenths.
const LEAST_TURNED_DEG: f64 = 0.5;
/// Least change of a focal length, as a share, and least and most one of a k1.
const LEAST_ZOOM: f64 = 0.01;
const LEAST_K1: f64 = 0.05;
const MOST_K1: f64 = 0.75;
/// Of so many cameras that are compared one may be displaced: where more are, it is not each for itself.
const ONE_IN: usize = 3;
/// With so many of the surest it is tried which others are displaced, too.
const TRIED_FIRST: usize = 3;

/// The cause that explains best what a camera shows beside the others that are `right`, and what it leaves of the median distance;
/// `None` where none does.
pub(super) fn displaced(
    points: &LensPoints<'_>,
    camera: usize,
    right: &[usize],
) -> Option<(f64, DisagreementCause)> {
    let observed = &points.observed(camera, right)[..];
    let least_gain_m = LEAST_GAIN_M + points.blur_m();
    if observed.len() < MIN_OBSERVED {
        return None;
    }
    let before_m = Changed::none().median_m(observed)?;
    let is_worth_it =
        |after_m: f64| after_m < WORTH_FITTING * before_m && before_m - after_m >= least_gain_m;
    let fullest = Changed::fitted(observed, Change::Moved)?.median_m(observed)?;
    let lens = || {
        let bent = Changed::fitted(observed, Change::Distortion)?;
        bent.median_m(observed)
    };
    if !is_worth_it(fullest) && !lens().is_some_and(is_worth_it) {
        return None;
    }
    let weighed = Change::ALL.into_iter().filter_map(|change| {
        let cause = cause(change, &Changed::fitted(observed, change)?)?;
        let ratio = ratio_across_halves(observed, change)?;
        let numbers = change.numbers().len() as f64;
        Some((ratio * (1.0 + PER_NUMBER * numbers), (ratio, cause)))
    });
    let (_, best) = weighed.min_by(|a, b| a.0.total_cmp(&b.0))?;
    let is_told = match best.1 {
        DisagreementCause::Turned { degrees } => degrees >= LEAST_TURNED_DEG,
        _ => true,
    };
    (is_told && before_m * (1.0 - best.0) >= least_gain_m).then_some(best)
}

/// What a change that was fitted to one half of the keypoints leaves of the other, both ways.
fn ratio_across_halves(observed: &[Observed], change: Change) -> Option<f64> {
    let (odd, even): (Vec<Observed>, Vec<Observed>) =
        observed.iter().partition(|one| one.keypoint % 2 == 1);
    let (mut before_m, mut after_m) = (0.0, 0.0);
    for (fitted, other) in [(&odd, &even), (&even, &odd)] {
        before_m += Changed::none().median_m(other)?;
        after_m += Changed::fitted(fitted, change)?.median_m(other)?;
    }
    Some(after_m / before_m.max(f64::MIN_POSITIVE))
}

/// What a camera that is changed so is called; `None` where none is.
fn cause(change: Change, changed: &Changed) -> Option<DisagreementCause> {
    let to = |digits: f64, value: f64| (value * digits).round() / digits;
    let degrees = to(10.0, changed.turned_rad().to_degrees());
    let is_turned = changed.turned_rad() <= MOST_TURNED_RAD;
    match change {
        Change::FocalLength => {
            let factor = to(1000.0, changed.focal_factor());
            ((factor - 1.0).abs() >= LEAST_ZOOM)
                .then_some(DisagreementCause::FocalLength { factor })
        }
        Change::Distortion => {
            let k1_over = to(100.0, changed.k1_over());
            (LEAST_K1..=MOST_K1)
                .contains(&k1_over.abs())
                .then_some(DisagreementCause::Distortion { k1_over })
        }
        Change::Turned => is_turned.then_some(DisagreementCause::Turned { degrees }),
        Change::Moved => {
            let distance_m = to(100.0, changed.moved_m());
            (is_turned && (LEAST_MOVED_M..=MOST_MOVED_M).contains(&distance_m)).then_some(
                DisagreementCause::Moved {
                    distance_m,
                    degrees,
                },
            )
        }
    }
}

/// Cameras that are displaced, each with its cause.
type Displaced = Vec<(usize, DisagreementCause)>;

impl Judge<'_> {
    /// Why one camera alone does not show what all others do.
    pub(in crate::camera_agreement) fn displaced_alone(
        &self,
        points: &LensPoints<'_>,
        camera: usize,
    ) -> Option<DisagreementCause> {
        let all: Vec<usize> = (0..self.lines.len()).collect();
        displaced(points, camera, &all).map(|(_, cause)| cause)
    }

    /// Cameras that agree well enough, and of which one change explains what they show beside the others.
    ///
    /// One that is displaced draws what the others say with it, most of all for the one opposite. So where several are found
    /// one after the other it is tried whether fewer are, begun with another.
    pub(in crate::camera_agreement) fn find_displaced(
        &self,
        points: &LensPoints<'_>,
        all: &mut Vec<Disagreement>,
        told: &mut [bool],
    ) {
        // Where everybody goes one way, who is late shows them all aside.
        let is_left = |camera: &usize| !told[*camera] && !self.may_be_late(*camera);
        let left: Vec<usize> = (0..told.len()).filter(is_left).collect();
        let first = surest(points, &left);
        let mut found = Displaced::new();
        for (index, &(_, camera, cause)) in first.iter().take(TRIED_FIRST).enumerate() {
            let others = one_by_one(points, &left, (camera, cause));
            if index == 0 || others.len() < found.len() {
                found = others;
            }
            if found.len() == 1 {
                break;
            }
        }
        if found.len() > (left.len() / ONE_IN).max(1) {
            return;
        }
        for (camera, cause) in found {
            told[camera] = true;
            all.push(self.disagreement(&[camera], cause));
        }
    }
}

/// Those of the cameras that are `left` which are displaced for certain against the others, the surest first.
fn surest(points: &LensPoints<'_>, left: &[usize]) -> Vec<(f64, usize, DisagreementCause)> {
    let causes = left.iter().filter_map(|&camera| {
        let (ratio, cause) = displaced(points, camera, left)?;
        (ratio < CERTAIN).then_some((ratio, camera, cause))
    });
    let mut causes: Vec<_> = causes.collect();
    causes.sort_by(|a, b| a.0.total_cmp(&b.0));
    causes
}

/// Begun with this camera, those that are displaced, each held to the cameras that are left after those before it.
fn one_by_one(
    points: &LensPoints<'_>,
    left: &[usize],
    first: (usize, DisagreementCause),
) -> Displaced {
    let mut left = left.to_vec();
    let most = left.len() / ONE_IN;
    let mut found = vec![first];
    left.retain(|of| *of != first.0);
    while found.len() <= most
        && let Some(&(_, camera, cause)) = surest(points, &left).first()
    {
        found.push((camera, cause));
        left.retain(|of| *of != camera);
    }
    found
}
