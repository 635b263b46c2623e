//! What is wrong with the pictures of cameras themselves: they stand still, or a lens is another than was calibrated.

mod low_scores;
mod same;

use std::borrow::Cow;
use std::sync::Arc;

use super::super::JudgedCamera;
use super::super::frozen::frozen_since;
use super::super::lens::LensPoints;
use super::super::lens::distortion::{DistortionFit, distortion};
use super::super::lens::focal_lengths::{FocalLengths, focal_lengths};
use super::super::pairs::{CameraRays, PairAgreement};
use super::super::report::{Disagreement, DisagreementCause};
use super::super::samples::{Burst, Samples};
use super::super::time_shift::silent::silences;
use super::held::held;
use super::{Judge, MIN_KEYPOINTS};

/// Another k1 than this is no lens distortion: what is zoomed or was moved a little bends the middle of the picture as much.
const MOST_K1_OVER: f64 = 0.75;

/// What the focal lengths of others leave at most of what a camera costs beside these that has the same: half, as one that is right
/// costs more with them.
const SCALED_LEAVES: f64 = 0.5;

impl Judge<'_> {
    /// Cameras whose pictures stand still.
    pub(super) fn find_frozen(&self, all: &mut Vec<Disagreement>, told: &mut [bool]) {
        for camera in 0..told.len() {
            let of = (camera, &self.lines[camera]);
            let since = frozen_since(self.samples, of, self.rate_hz);
            if let (false, Some(since)) = (told[camera], since) {
                let cause = DisagreementCause::Frozen {
                    since_tick: since.0,
                };
                self.tell(&[camera], cause, (all, told));
            }
        }
    }

    /// Cameras that show nobody although people are in their pictures.
    pub(super) fn find_silent(&self, all: &mut Vec<Disagreement>, told: &mut [bool]) {
        let of_viewpoint = |camera: &JudgedCamera| {
            let of = |other: &&JudgedCamera| other.viewpoint == camera.viewpoint;
            self.cameras.iter().filter(of).count()
        };
        let per_viewpoint: Vec<usize> = self.cameras.iter().map(of_viewpoint).collect();
        let seen: Vec<_> = self.fits.iter().map(|fit| fit.seen.clone()).collect();
        let found = silences(&seen, &per_viewpoint, self.samples, self.rate_hz);
        for (camera, silence) in found.into_iter().enumerate() {
            if let (false, Some(silence)) = (told[camera], silence) {
                let since_tick = silence.since.map(|tick| tick.0);
                self.tell(
                    &[camera],
                    DisagreementCause::Silent { since_tick },
                    (all, told),
                );
            }
        }
    }

    /// Other lenses, of one camera or of all. Only where nothing else is found: what is late or turned bends lines of sight,
    /// too. Where cameras only agree with nobody, other focal lengths of all may be why.
    pub(super) fn find_other_lenses(
        &self,
        points: &LensPoints<'_>,
        all: &mut Vec<Disagreement>,
        told: &mut [bool],
    ) {
        let is_unexplained = |told: &Disagreement| told.cause == DisagreementCause::Unexplained;
        if !all.iter().all(is_unexplained) {
            return;
        }
        let scaled = focal_lengths(points);
        if !all.is_empty() {
            if let Some(mut scaled) = scaled.filter(FocalLengths::is_sure) {
                scaled.cameras = self.scaled_alike(&scaled);
                // Of others the factor says nothing.
                let names = scaled.cameras.iter().map(|&of| &self.cameras[of].name);
                let explained: Vec<&String> = names.collect();
                all.retain(|told| told.cameras.iter().any(|name| !explained.contains(&name)));
                self.tell_focal_lengths(scaled, (all, told));
            }
            return;
        }
        let explains_more = |bent: &DistortionFit| {
            scaled
                .as_ref()
                .is_none_or(|scaled| bent.ratio < scaled.ratio)
        };
        match (distortion(points).filter(explains_more), scaled) {
            (Some(bent), _) => {
                let k1_over = (100.0 * bent.k1_over).round() / 100.0;
                let cause = match bent.cameras[..] {
                    [camera] => self.bent_alone(points, (camera, k1_over)),
                    _ => DisagreementCause::Distortion { k1_over },
                };
                self.tell(&bent.cameras, cause, (all, told));
            }
            (None, Some(scaled)) => self.tell_focal_lengths(scaled, (all, told)),
            (None, None) => {}
        }
    }

    /// Cameras that say nothing of the lenses of others: those that hold frames, and fisheyes among other lenses, which may be none.
    pub(super) fn doubtful_witnesses(&self) -> Vec<usize> {
        let n = self.cameras.len();
        let held = held(&self.bursts, n);
        let n_fisheyes = self.lines.iter().filter(|lines| lines.is_fisheye()).count();
        let is_doubtful =
            |&camera: &usize| held[camera] || 2 * n_fisheyes < n && self.lines[camera].is_fisheye();
        (0..n).filter(is_doubtful).collect()
    }

    /// What is kept, without what these cameras showed.
    pub(super) fn without(&self, cameras: &[usize]) -> (Cow<'_, Samples>, Vec<Cow<'_, Burst>>) {
        let bursts = self.bursts.iter();
        if cameras.is_empty() {
            let bursts = bursts.map(|burst| Cow::Borrowed(*burst)).collect();
            return (Cow::Borrowed(self.samples), bursts);
        }
        let mut samples = self.samples.clone();
        for pass in &mut samples.passes {
            let pass = Arc::make_mut(pass);
            for &camera in cameras {
                pass.of_camera[camera].clear();
            }
        }
        let left = bursts.map(|burst| {
            let mut burst = (*burst).clone();
            burst
                .trails
                .retain(|trail| !cameras.contains(&trail.camera));
            Cow::Owned(burst)
        });
        (Cow::Owned(samples), left.collect())
    }

    /// Why one camera alone seems to have another k1: what was moved, turned or zoomed a little bends pictures, too.
    fn bent_alone(
        &self,
        points: &LensPoints<'_>,
        (camera, k1_over): (usize, f64),
    ) -> DisagreementCause {
        match self.displaced_alone(points, camera) {
            Some(DisagreementCause::Distortion { .. }) | None if k1_over.abs() <= MOST_K1_OVER => {
                DisagreementCause::Distortion { k1_over }
            }
            Some(cause) => cause,
            None => self.refitted_alone(camera),
        }
    }

    /// Those cameras, and all that agree with them much better once they have such focal lengths, too: crops of somebody come of one
    /// camera of a viewpoint.
    fn scaled_alike(&self, scaled: &FocalLengths) -> Vec<usize> {
        let all = self.as_it_is.iter();
        let changed = all.map(|rays| rays.through(|place| Some(place / scaled.factor)));
        let changed: Vec<CameraRays> = changed.collect();
        let is_alike = |&camera: &usize| {
            let known = scaled.cameras.iter();
            let others: Vec<usize> = known
                .copied()
                .filter(|&of| self.are_apart(camera, of))
                .collect();
            let cost = |rays: &[CameraRays]| {
                let others = others.iter().map(|&of| &rays[of]);
                PairAgreement::mean_cost_of(&rays[camera], others, MIN_KEYPOINTS)
            };
            let costs = cost(&self.as_it_is).zip(cost(&changed));
            scaled.cameras.contains(&camera)
                || costs.is_some_and(|(before, after)| after < SCALED_LEAVES * before)
        };
        (0..self.cameras.len()).filter(is_alike).collect()
    }

    fn tell_focal_lengths(&self, scaled: FocalLengths, to: (&mut Vec<Disagreement>, &mut [bool])) {
        let FocalLengths {
            cameras, factor, ..
        } = scaled;
        self.tell(&cameras, DisagreementCause::FocalLength { factor }, to);
    }

    /// Tells of a cause, and that these cameras have been told of.
    fn tell(
        &self,
        cameras: &[usize],
        cause: DisagreementCause,
        (all, told): (&mut Vec<Disagreement>, &mut [bool]),
    ) {
        for &camera in cameras {
            told[camera] = true;
        }
        all.push(self.disagreement(cameras, cause));
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::fixture::{Hall, Mistake};
    use super::super::before::JudgedBefore;
    use super::*;

    /// Those that are scaled as the first and the third are, in a hall whose cameras all are but for this one.
    fn alike(but: Option<usize>) -> Vec<usize> {
        let mut hall = Hall::default();
        for (camera, (_, mistake)) in hall.shows.iter_mut().enumerate() {
            let focal_factor = if but == Some(camera) { 1.0 } else { 1.15 };
            *mistake = Mistake {
                focal_factor,
                ..Mistake::default()
            };
        }
        let samples = hall.samples();
        let mut before = JudgedBefore::default();
        let judge = Judge::new(&samples.cameras, &samples.samples, &mut before);
        judge.scaled_alike(&FocalLengths {
            cameras: vec![0, 2],
            factor: 1.15,
            ratio: 0.5,
        })
    }

    #[test]
    fn cameras_of_which_crops_tell_nothing_are_told_with_those_whose_focal_lengths_they_share() {
        assert_eq!(alike(None), [0, 1, 2, 3]);
        assert_eq!(alike(Some(1)), [0, 2, 3]);
    }
}
