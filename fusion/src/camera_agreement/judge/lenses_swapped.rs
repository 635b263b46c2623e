//! Whether two cameras have each other's lenses: matrix and distortions were exchanged in the calibration, and where they stand
//! was not.

use farfield_proto::camera::CameraModel;
use farfield_proto::frames::Pixel;
use nalgebra::Vector2;

use super::super::lens::LensPoints;
use super::super::refit::resection::{Changed, Observed};
use super::super::report::{Disagreement, DisagreementCause};
use super::Judge;

/// Keypoints that each must show.
const MIN_OBSERVED: usize = 60;
/// What the other's lens must leave of the median distance of each, and of both together.
const EXPLAINS: f64 = 0.8;
const EXPLAINS_BOTH: f64 = 0.65;
/// By how much less than it is the distance must be of both together, metres.
const LEAST_GAIN_M: f64 = 0.01;
/// What the sightings of a camera cost against the others, as a factor of those of a good one, from which on they are tried
/// through another lens: who shows people where nobody is has no keypoints that could be told from the others'.
const DOUBTFUL: f64 = 1.5;
/// Of so many cameras one may cost less than a good one: the best of many is better than most that are right.
const ONE_BETTER_IN: usize = 4;
/// From which factor between focal lengths on people are larger by more than networks err on how large they are.
const ZOOMED_APART: f64 = 1.03;

impl Judge<'_> {
    /// Two cameras that have each other's lenses: of cameras with one lens nobody could tell.
    pub(super) fn find_lenses_swapped(
        &self,
        points: Option<&LensPoints<'_>>,
        all: &mut Vec<Disagreement>,
        told: &mut [bool],
    ) {
        let n = self.cameras.len();
        let pairs = (0..n).flat_map(|a| (a + 1..n).map(move |b| (a, b)));
        let pairs = pairs.filter(|&(a, b)| !told[a] && !told[b] && self.are_apart(a, b));
        let pairs: Vec<(usize, usize)> = pairs
            .filter(|&(a, b)| are_different(self.models[a], self.models[b]))
            .collect();
        if pairs.is_empty() {
            return;
        }
        let costs: Vec<Option<f64>> = (0..n)
            .map(|camera| {
                let others: Vec<usize> = (0..n).filter(|of| *of != camera).collect();
                self.cost_against(camera, &self.as_it_is[camera], &others)
            })
            .collect();
        let mut by_cost: Vec<f64> = costs.iter().flatten().copied().collect();
        by_cost.sort_by(f64::total_cmp);
        let better = by_cost.len().saturating_sub(1) / ONE_BETTER_IN;
        let good = by_cost.get(better).map_or(1.0, |cost| cost.min(1.0));
        let is_doubtful = |camera: usize| costs[camera].is_some_and(|cost| cost >= DOUBTFUL * good);
        let weighed = pairs.into_iter().filter_map(|(a, b)| {
            let by_points = points.and_then(|points| self.with_lenses_swapped(points, (a, b)));
            let by_sightings = || {
                let may_be = is_doubtful(a) && is_doubtful(b);
                // Of who stays at one place nobody knows another principal point from a turn, of one of them alone, say.
                let may_be = may_be && (points.is_some() || self.are_zoomed_apart((a, b)));
                may_be.then(|| self.sighted_through((a, b))).flatten()
            };
            Some((by_points.or_else(by_sightings)?, (a, b)))
        });
        if let Some((_, (a, b))) = weighed.min_by(|one, other| one.0.total_cmp(&other.0)) {
            told[a] = true;
            told[b] = true;
            all.push(self.disagreement(&[a, b], DisagreementCause::LensesSwapped));
        }
    }

    /// Whether the focal lengths of two cameras are so different that people seem larger through the lens of the other.
    fn are_zoomed_apart(&self, (a, b): (usize, usize)) -> bool {
        let factor = self.focal_px(a) / self.focal_px(b);
        factor.max(factor.recip()) >= ZOOMED_APART
    }

    /// What is left of the distances of two cameras where they have each other's lenses; `None` where that is no explanation.
    fn with_lenses_swapped(&self, points: &LensPoints<'_>, pair: (usize, usize)) -> Option<f64> {
        let least_gain_m = LEAST_GAIN_M + points.blur_m();
        self.left_of_both(pair, least_gain_m, |(own, other), others| {
            let observed = points.observed(own, others);
            let through_other = observed.iter().filter_map(|one| {
                let shown = self.through_lens(one.shown, (own, other))?;
                Some(Observed { shown, ..*one })
            });
            let through_other: Vec<Observed> = through_other.collect();
            let median_m = |all: &[Observed]| {
                (all.len() >= MIN_OBSERVED)
                    .then(|| Changed::none().median_m(all))
                    .flatten()
            };
            Some([median_m(&observed)?, median_m(&through_other)?])
        })
    }

    /// The same of the cost of their sightings.
    fn sighted_through(&self, pair: (usize, usize)) -> Option<f64> {
        self.left_of_both(pair, 0.0, |(own, other), others| {
            let as_it_is = &self.as_it_is[own];
            let through_other = as_it_is.through(|place| self.through_lens(place, (own, other)));
            Some([
                self.cost_against(own, as_it_is, others)?,
                self.cost_against(own, &through_other, others)?,
            ])
        })
    }

    /// What the lenses of each other leave of two cameras together, by what `weighed` says of each, beside all others: as it is,
    /// and through the lens of the other.
    fn left_of_both(
        &self,
        (a, b): (usize, usize),
        least_gain: f64,
        weighed: impl Fn((usize, usize), &[usize]) -> Option<[f64; 2]>,
    ) -> Option<f64> {
        let others = (0..self.cameras.len()).filter(|of| *of != a && *of != b);
        let others: Vec<usize> = others.collect();
        let (mut before, mut after) = (0.0, 0.0);
        for pair in [(a, b), (b, a)] {
            let [own_before, own_after] = weighed(pair, &others)?;
            if own_after >= EXPLAINS * own_before {
                return None;
            }
            before += own_before;
            after += own_after;
        }
        let ratio = after / before;
        (ratio < EXPLAINS_BOTH && before - after >= least_gain).then_some(ratio)
    }

    /// Where the `other` lens has what is by a camera's own at a place, both normalised and undistorted.
    fn through_lens(&self, own: Vector2<f64>, (of, other): (usize, usize)) -> Option<Vector2<f64>> {
        let (model, other) = (self.models.get(of)?, self.models.get(other)?);
        let (lens, other_lens) = (model.intrinsics(), other.intrinsics());
        let px = Pixel::new(
            own.x * lens.fx_px + lens.cx_px,
            own.y * lens.fy_px + lens.cy_px,
        );
        let undistorted = other.undistort(model.distort(px)?)?;
        Some(Vector2::new(
            (undistorted.x() - other_lens.cx_px) / other_lens.fx_px,
            (undistorted.y() - other_lens.cy_px) / other_lens.fy_px,
        ))
    }
}

/// Whether their lenses are not alike.
pub(super) fn are_different(a: &CameraModel, b: &CameraModel) -> bool {
    a.intrinsics() != b.intrinsics() || a.lens() != b.lens()
}
