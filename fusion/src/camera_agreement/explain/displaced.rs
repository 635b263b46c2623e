//! What changed in one camera since it was calibrated: its position and direction, or its lens.
//!
//! Each change is fitted to one half of the keypoints and judged by the distances of the other half. So errors of a
//! network on some keypoints explain nothing of the others, and a change with more parameters has no advantage.

use super::super::judge::{Findings, Judge};
use super::super::lens::LensPoints;
use super::super::lens::focal_lengths::{FocalLengths, focal_lengths};
use super::super::pairs::PictureChange;
use super::super::report::DisagreementCause;
use super::resection::{Change, Changed, Observed};

/// Fewest keypoints of a camera for a fit.
const MIN_OBSERVED: usize = 120;
/// Largest share of the median distance that a change may leave, if the camera agrees. For valid cameras 0.87 and more
/// was left on the Shelf, and 0.97 on the sample.
const MAX_MEDIAN_RATIO: f64 = 0.72;
/// The same for the cost of all distances, and the smallest median shift of keypoints, metres, with which it counts.
/// For valid cameras of the Shelf, the sample and five simulated scenes 0.98 and more was left; for a camera that was
/// moved by 0.05 m or turned by a degree, 0.7 to 0.9.
const MAX_COST_RATIO: f64 = 0.9;
const MIN_SHIFT_M: f64 = 0.03;
/// If the changes with most parameters leave more of the cost than this, no other change is fitted.
const MAX_FULL_FIT_RATIO: f64 = 0.95;
/// Smallest distance that costs one half, metres.
const MIN_HALF_COST_M: f64 = 0.004;
/// Smallest decrease of the median distance, metres: no calibration is exact to the millimetre.
const MIN_GAIN_M: f64 = 0.01;
/// Penalty for each parameter of a change: if two changes explain the same, the one with fewer parameters is reported.
const PARAMETER_PENALTY: f64 = 0.01;
/// Smallest and largest distance by which a camera was moved, metres.
const MIN_MOVED_M: f64 = 0.02;
const MAX_MOVED_M: f64 = 0.6;
/// Largest turn of a camera that was pushed, radians.
const MAX_TURNED_RAD: f64 = 0.35;
/// Smallest turn that is reported, degrees. Free-running cameras differ by tenths of a tick, which looks like 0.2
/// degrees across a wide field.
const MIN_TURNED_DEG: f64 = 0.5;
/// Smallest change of a focal length, as a share, and smallest and largest change of k1.
const MIN_ZOOM: f64 = 0.01;
const MIN_K1: f64 = 0.05;
const MAX_K1: f64 = 0.75;
/// One of so many cameras may be displaced: if more are, they are not displaced one by one.
const CAMERAS_PER_DISPLACED: usize = 3;

/// A change of a camera that explains what it shows relative to the others.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Displacement {
    pub(super) cause: DisagreementCause,
    /// The changed camera.
    changed: Changed,
    /// Share of the median distance that it leaves.
    pub(super) ratio: f64,
    /// Share of the cost of all distances that it leaves.
    cost_ratio: f64,
    /// Whether the distance decreases enough to compare it with other causes.
    pub(super) is_gain: bool,
    /// Whether it shifts keypoints far enough.
    is_shifted: bool,
}

impl Displacement {
    /// Whether it is reported for a camera that agrees.
    fn is_certain(&self) -> bool {
        let by_median = self.is_gain && self.ratio < MAX_MEDIAN_RATIO;
        by_median || self.is_shifted && self.cost_ratio < MAX_COST_RATIO
    }
}

/// The change that best explains what a camera shows relative to the `right` others; `None` if no change does.
pub(super) fn displaced(
    points: &LensPoints,
    camera: usize,
    right: &[usize],
) -> Option<Displacement> {
    let observed = &points.observed(camera, right)[..];
    if observed.len() < MIN_OBSERVED {
        return None;
    }
    let calibrated = Changed::none();
    let fullest = [Change::Moved, Change::Distortion].map(|change| {
        let fitted = Changed::fitted(observed, change)?;
        Some((fitted, fitted.median_m(observed)?))
    });
    let fullest = || fullest.iter().flatten();
    let half_m = fullest().map(|(_, m)| *m).fold(f64::INFINITY, f64::min);
    let half_m = half_m.max(MIN_HALF_COST_M);
    let least = fullest().map(|(fitted, _)| fitted.mean_cost(observed, half_m));
    let least = least.fold(f64::INFINITY, f64::min);
    if least >= MAX_FULL_FIT_RATIO * calibrated.mean_cost(observed, half_m) {
        return None;
    }
    let before_m = calibrated.median_m(observed)?;
    let changes = if points.has_moved() {
        &Change::ALL[..]
    } else {
        &Change::IN_PLACE[..]
    };
    let weighed = changes.iter().filter_map(|&change| {
        let fitted = Changed::fitted(observed, change)?;
        let [ratio, cost_ratio] = ratios_across_halves(observed, change, half_m)?;
        let n_parameters = change.parameters().len() as f64;
        let displacement = Displacement {
            cause: cause(change, &fitted)?,
            changed: fitted,
            ratio,
            cost_ratio,
            is_gain: before_m * (1.0 - ratio) >= MIN_GAIN_M + points.blur_m(),
            is_shifted: fitted.shift_m(observed)? >= MIN_SHIFT_M + points.blur_m(),
        };
        Some((
            cost_ratio * (1.0 + PARAMETER_PENALTY * n_parameters),
            displacement,
        ))
    });
    weighed.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, it)| it)
}

/// Shares of the median distance and of the cost of all distances that a change leaves on one half of the keypoints if
/// it is fitted to the other half; both halves together.
fn ratios_across_halves(observed: &[Observed], change: Change, half_m: f64) -> Option<[f64; 2]> {
    let (odd, even): (Vec<Observed>, Vec<Observed>) =
        observed.iter().partition(|one| one.keypoint % 2 == 1);
    let (mut before, mut after) = ([0.0; 2], [0.0; 2]);
    for (fitted, other) in [(&odd, &even), (&even, &odd)] {
        let fitted = Changed::fitted(fitted, change)?;
        for (sum, camera) in [(&mut before, Changed::none()), (&mut after, fitted)] {
            sum[0] += camera.median_m(other)?;
            sum[1] += camera.mean_cost(other, half_m);
        }
    }
    Some([0, 1].map(|of| after[of] / before[of].max(f64::MIN_POSITIVE)))
}

/// The cause to report for a change; `None` if it is too small or too large.
fn cause(change: Change, changed: &Changed) -> Option<DisagreementCause> {
    let rounded = |digits: f64, value: f64| (value * digits).round() / digits;
    let degrees = rounded(10.0, changed.turned_rad().to_degrees());
    let is_turned = changed.turned_rad() <= MAX_TURNED_RAD;
    match change {
        Change::FocalLength => {
            let factor = rounded(1000.0, changed.focal_factor());
            ((factor - 1.0).abs() >= MIN_ZOOM).then_some(DisagreementCause::FocalLength { factor })
        }
        Change::Distortion => {
            let k1_over = rounded(100.0, changed.k1_over());
            (MIN_K1..=MAX_K1)
                .contains(&k1_over.abs())
                .then_some(DisagreementCause::Distortion { k1_over })
        }
        Change::Turned => (is_turned && degrees >= MIN_TURNED_DEG)
            .then_some(DisagreementCause::Turned { degrees }),
        Change::Moved => {
            let distance_m = rounded(100.0, changed.moved_m());
            (is_turned && (MIN_MOVED_M..=MAX_MOVED_M).contains(&distance_m)).then_some(
                DisagreementCause::Moved {
                    distance_m,
                    degrees,
                },
            )
        }
    }
}

impl Judge<'_> {
    /// Cameras that agree, but whose distances a change explains.
    ///
    /// The surest camera is taken first. It is left out of the search for the next one, because a displaced camera also
    /// displaces the places that it shares with others.
    pub(in crate::camera_agreement) fn find_displaced(&self, findings: &mut Findings) {
        let Some(points) = self.points_of_moving() else {
            return;
        };
        // If the focal lengths of all cameras are wrong, each camera seems displaced.
        let scaled = focal_lengths(points);
        if scaled.as_ref().is_some_and(FocalLengths::is_sure) {
            return;
        }
        // If all people walk in one direction, a late camera shows them all shifted.
        let mut left = findings.unexplained();
        left.retain(|&camera| !self.may_be_late(camera));
        let most = (left.len() / CAMERAS_PER_DISPLACED).max(1);
        let mut found: Vec<(usize, DisagreementCause)> = Vec::new();
        while let Some((camera, cause)) = self.surest(points, &left) {
            if found.len() == most {
                return;
            }
            found.push((camera, cause));
            left.retain(|of| *of != camera);
        }
        for (camera, cause) in found {
            findings.add(self, &[camera], cause);
        }
    }

    /// The camera of `left` that is most surely displaced relative to the others.
    fn surest(&self, points: &LensPoints, left: &[usize]) -> Option<(usize, DisagreementCause)> {
        let causes = left.iter().filter_map(|&camera| {
            let found = displaced(points, camera, left)?;
            let is_sure = found.is_certain() && self.fits_sightings(camera, &found.changed, left);
            is_sure.then_some((found.cost_ratio, camera, found.cause))
        });
        let surest = causes.min_by(|a, b| a.0.total_cmp(&b.0));
        surest.map(|(_, camera, cause)| (camera, cause))
    }

    /// Whether the sightings of the changed camera fit those of the others no worse than with its calibration. False if
    /// it has too few sightings in common with them, as in one second: crops of so little time err to one side.
    ///
    /// A crop is made for one person. If a camera sees that person badly, its crop may always show the same other
    /// person. Sightings do not have this error.
    fn fits_sightings(&self, camera: usize, changed: &Changed, others: &[usize]) -> bool {
        let lines = changed.lines(&self.lines[camera]);
        let rays = self.rays_through(camera, &lines, PictureChange::AsItIs);
        let rays = rays.through(|y| Some(changed.straightened(y)));
        let others: Vec<usize> = others.iter().copied().filter(|of| *of != camera).collect();
        let before = self.cost_against(camera, &self.as_it_is[camera], &others);
        let after = self.cost_against(camera, &rays, &others);
        before
            .zip(after)
            .is_some_and(|(before, after)| after <= before)
    }
}
