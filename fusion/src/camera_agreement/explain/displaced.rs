//! What of a camera alone is another than was calibrated: where it stands and looks, or its lens.
//!
//! Each change is fitted to one half of the keypoints and weighed by what it leaves of the distances of the other half: what a
//! network errs on some of them explains nothing of the others, and a change of more numbers has no advantage of them.

use super::super::judge::{Findings, Judge};
use super::super::lens::LensPoints;
use super::super::lens::focal_lengths::{FocalLengths, focal_lengths};
use super::super::pairs::PictureChange;
use super::super::report::DisagreementCause;
use super::resection::{Change, Changed, Observed};

/// Keypoints that a camera must show to be fitted.
const MIN_OBSERVED: usize = 120;
/// What a change may leave of the median distance to be told of a camera that agrees well enough otherwise. Of right cameras
/// 0.87 and more was left on the Shelf, 0.97 on the sample.
const CERTAIN: f64 = 0.72;
/// The same of the cost of what all keypoints are off, where the change moves them by so much in the median, metres. Of right
/// cameras of the Shelf, the sample and five simulated scenes 0.98 and more was left; of a camera that was moved by 0.05 m or
/// turned by a degree 0.7 to 0.9.
const CERTAIN_COST: f64 = 0.9;
const LEAST_ASIDE_M: f64 = 0.03;
/// What the changes of most numbers leave of the cost of cameras that are not worth more fits.
const WORTH_FITTING: f64 = 0.95;
/// Least distance of which half costs a half, metres.
const LEAST_HALF_M: f64 = 0.004;
/// By how much less than it is the distance must be, metres: no calibration is true to the last millimetre.
const LEAST_GAIN_M: f64 = 0.01;
/// What each number more counts: of two changes that explain alike the one with fewer is told.
const PER_NUMBER: f64 = 0.01;
/// Least and most way of a camera that was moved, metres.
const LEAST_MOVED_M: f64 = 0.02;
const MOST_MOVED_M: f64 = 0.6;
/// Turns larger than this are no camera that was pushed, radians.
const MOST_TURNED_RAD: f64 = 0.35;
/// Least turn that is told, degrees: across a wide field the tenths of a tick by which cameras run freely look like two tenths.
const LEAST_TURNED_DEG: f64 = 0.5;
/// Least change of a focal length, as a share, and least and most one of a k1.
const LEAST_ZOOM: f64 = 0.01;
const LEAST_K1: f64 = 0.05;
const MOST_K1: f64 = 0.75;
/// Of so many cameras that are compared one may be displaced: where more are, it is not each for itself.
const ONE_IN: usize = 3;

/// What explains what a camera shows beside the others.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Displacement {
    pub(super) cause: DisagreementCause,
    /// The camera as it is then.
    changed: Changed,
    /// What it leaves of the median distance.
    pub(super) ratio: f64,
    /// What it leaves of the cost of all distances.
    cost_ratio: f64,
    /// Whether the distance is less by enough to be weighed against other causes.
    pub(super) is_gain: bool,
    /// Whether keypoints are aside by enough.
    is_aside: bool,
}

impl Displacement {
    /// Whether it is told of a camera that agrees well enough otherwise, or of one that nothing else explains.
    fn is_certain(&self) -> bool {
        let by_median = self.is_gain && self.ratio < CERTAIN;
        by_median || self.is_aside && self.cost_ratio < CERTAIN_COST
    }
}

/// What explains best what a camera shows beside the others that are `right`; `None` where nothing does.
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
    let half_m = half_m.max(LEAST_HALF_M);
    let least = fullest().map(|(fitted, _)| fitted.mean_cost(observed, half_m));
    let least = least.fold(f64::INFINITY, f64::min);
    if least >= WORTH_FITTING * calibrated.mean_cost(observed, half_m) {
        return None;
    }
    let before_m = calibrated.median_m(observed)?;
    let weighed = Change::ALL.into_iter().filter_map(|change| {
        let fitted = Changed::fitted(observed, change)?;
        let [ratio, cost_ratio] = ratios_across_halves(observed, (change, half_m))?;
        let numbers = change.numbers().len() as f64;
        let displacement = Displacement {
            cause: cause(change, &fitted)?,
            changed: fitted,
            ratio,
            cost_ratio,
            is_gain: before_m * (1.0 - ratio) >= LEAST_GAIN_M + points.blur_m(),
            is_aside: fitted.aside_m(observed)? >= LEAST_ASIDE_M + points.blur_m(),
        };
        Some((cost_ratio * (1.0 + PER_NUMBER * numbers), displacement))
    });
    weighed.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, it)| it)
}

/// What a change that was fitted to one half of the keypoints leaves of the other, both ways: of the median distance, and of the
/// cost of all.
fn ratios_across_halves(
    observed: &[Observed],
    (change, half_m): (Change, f64),
) -> Option<[f64; 2]> {
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
        Change::Turned => (is_turned && degrees >= LEAST_TURNED_DEG)
            .then_some(DisagreementCause::Turned { degrees }),
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

impl Judge<'_> {
    /// Cameras that agree well enough, and of which one change explains what they show relative to the others.
    ///
    /// The surest is taken first. It is left out before the next is looked for, because a displaced camera draws what the
    /// others say with it.
    pub(in crate::camera_agreement) fn find_displaced(&self, findings: &mut Findings) {
        let Some(points) = self.points_of_moving() else {
            return;
        };
        // Through other lenses in all cameras each seems to stand elsewhere.
        let scaled = focal_lengths(points);
        if scaled.as_ref().is_some_and(FocalLengths::is_sure) {
            return;
        }
        // If all people go one way, a late camera shows them all aside.
        let mut left = findings.unexplained();
        left.retain(|&camera| !self.may_be_late(camera));
        let most = (left.len() / ONE_IN).max(1);
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

    /// Of the cameras that are `left`, the one that is most surely displaced against the others.
    fn surest(&self, points: &LensPoints, left: &[usize]) -> Option<(usize, DisagreementCause)> {
        let causes = left.iter().filter_map(|&camera| {
            let found = displaced(points, camera, left)?;
            let is_sure = found.is_certain() && self.fits_sightings(camera, &found.changed, left);
            is_sure.then_some((found.cost_ratio, camera, found.cause))
        });
        let surest = causes.min_by(|a, b| a.0.total_cmp(&b.0));
        surest.map(|(_, camera, cause)| (camera, cause))
    }

    /// Whether the sightings of a camera that is changed so meet those of the others no worse than as it is calibrated.
    ///
    /// Not of a camera that has too few sightings in common with them, as in a second: crops of so little time err to one side.
    ///
    /// A crop is cut for somebody, and where a camera sees that person badly it shows another: beside somebody whom few cameras
    /// see, always the same one. Sightings are of whoever is there.
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
