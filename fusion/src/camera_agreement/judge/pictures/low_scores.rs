//! Cameras whose keypoints are where people are, and have scores as if they were nowhere: written as one less the score, say, or in
//! another unit. Little of such a camera counts, so nothing else is asked of it.

use std::collections::BTreeMap;

use super::super::super::pairs::{CameraRays, PairAgreement, PictureChange};
use super::super::super::report::DisagreementCause;
use super::super::super::samples::{MIN_SCORE, PassSample};
use super::super::{Findings, Judge, MIN_KEYPOINTS};

/// Which share of the bodies of a camera has mostly scores that are too low. Of right cameras of the Shelf 0.03 had, of the sample and
/// four simulated scenes none.
const MOST: f64 = 0.7;
/// Least of these, and least time from the first to the last, seconds: who steps into a picture is half in it for a moment.
const MIN_BODIES: usize = 6;
const LEAST_S: f64 = 1.0;
/// Least share of their keypoints that is too low: somebody whose legs are hidden has guessed ones for half of his.
const LEAST_SHARE: f64 = 0.66;
/// Which share of the cameras with which it was compared must agree with one by keypoints of any score.
const MOST_OTHERS: f64 = 0.5;

impl Judge<'_> {
    /// Cameras that agree with others once keypoints count whatever their scores are, most of which are too low to count.
    pub(in super::super) fn find_low_scores(&self, findings: &mut Findings) {
        let showing = self.showing().into_iter();
        let unsure: Vec<usize> = showing.filter(|&of| self.is_unsure(of)).collect();
        if unsure.is_empty() {
            return;
        }
        let agreeing = self.agreeing_at_any_score(&unsure);
        let found: Vec<usize> = unsure.into_iter().filter(|of| agreeing(*of)).collect();
        if found.is_empty() {
            return;
        }
        let share = self.share_of_low(&found);
        let is_all = found.len() == self.cameras.len();
        let of_all: &[usize] = if is_all { &[] } else { &found };
        findings.name(self, of_all, DisagreementCause::LowScores { share });
        findings.leave_out(&found);
    }

    fn is_unsure(&self, camera: usize) -> bool {
        let unsure = self.passes.iter().map(|pass| pass.unsure[camera].len());
        let all = self.passes.iter().map(|pass| pass.of_camera[camera].len());
        let (unsure, all): (usize, usize) = (unsure.sum(), all.sum());
        let is_mostly = unsure >= MIN_BODIES && unsure as f64 >= MOST * all as f64;
        // The newest first.
        let shown = self.passes.iter();
        let mut shown = shown.filter(|pass| !pass.unsure[camera].is_empty());
        let last = shown.next();
        let span = last
            .zip(shown.next_back())
            .map_or(0, |(last, first)| last.tick - first.tick);
        let lasts = span as f64 >= LEAST_S * self.rate_hz;
        is_mostly && lasts && self.share_of_low(&[camera]) >= LEAST_SHARE
    }

    /// Whether one of these cameras agrees with most others, once all its keypoints count.
    fn agreeing_at_any_score(&self, unsure: &[usize]) -> impl Fn(usize) -> bool + use<> {
        let passes = self.passes.iter().map(|pass| PassSample {
            tick: pass.tick,
            of_camera: pass.unsure.clone(),
            unsure: Vec::new(),
        });
        let passes: Vec<PassSample> = passes.collect();
        let passes: Vec<&PassSample> = passes.iter().collect();
        let rays = |&camera: &usize| {
            let of = (camera, self.cameras[camera].size_px);
            let change = (PictureChange::AsItIs, self.partners);
            let rays = CameraRays::new(&passes, of, &self.lines[camera], change);
            (camera, rays)
        };
        let at_any: BTreeMap<usize, CameraRays> = unsure.iter().map(rays).collect();
        let rays = |camera: usize| at_any.get(&camera).unwrap_or(&self.as_it_is[camera]);
        let pairs = self.pairs_of(&self.showing());
        let pairs = pairs.into_iter().filter_map(|(a, b)| {
            let pair = PairAgreement::of_common(rays(a), rays(b));
            (pair.len() >= MIN_KEYPOINTS).then_some(((a, b), pair))
        });
        let pairs: BTreeMap<(usize, usize), PairAgreement> = pairs.collect();
        let near = self.agreeing(&pairs, |_| true);
        move |camera| {
            let is_own = |(a, b): &&(usize, usize)| *a == camera || *b == camera;
            let compared = pairs.keys().filter(is_own).count();
            let near = near.iter().filter(is_own).count();
            near > 0 && near as f64 >= MOST_OTHERS * compared as f64
        }
    }

    /// Which share of the keypoints of these cameras is too low, to a hundredth: of those bodies of which most are.
    fn share_of_low(&self, cameras: &[usize]) -> f64 {
        let passes = self.passes.iter();
        let bodies = passes.flat_map(|pass| cameras.iter().flat_map(|&of| &pass.unsure[of]));
        let seen = bodies.flatten().flatten();
        let (low, all) = seen.fold((0_u32, 0_u32), |(low, all), seen| {
            (low + u32::from(seen.score < MIN_SCORE), all + 1)
        });
        (100.0 * f64::from(low) / f64::from(all.max(1))).round() / 100.0
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::super::fixture::{Hall, Mistake, names};
    use super::*;

    /// What is told where these cameras have scores that are one less what they should be, and this wrong beside.
    fn told(cameras: &[usize], beside: Mistake) -> Vec<(Vec<String>, DisagreementCause)> {
        let mut hall = Hall::default();
        for &camera in cameras {
            hall.shows[camera].1 = Mistake {
                scores_written: Some(|score| 1.0 - score),
                ..beside
            };
        }
        hall.causes()
    }

    #[test]
    fn cameras_whose_scores_are_one_less_what_they_should_be_are_named_one_or_all() {
        for (cameras, named) in [(vec![2], names(&[2])), (vec![0, 1, 2, 3], Vec::new())] {
            let told = told(&cameras, Mistake::default());
            let [(of, DisagreementCause::LowScores { share })] = &told[..] else {
                panic!("{told:?}");
            };
            assert_eq!(*of, named);
            assert!(*share > 0.99, "{share}");
        }
    }

    #[test]
    fn of_a_camera_that_is_unsure_and_shows_nobody_where_people_are_it_is_not_told() {
        let mirrored = Mistake {
            mirrored: true,
            ..Mistake::default()
        };
        let told = told(&[2], mirrored);
        let is_low =
            |cause: &DisagreementCause| matches!(cause, DisagreementCause::LowScores { .. });
        assert!(!told.iter().any(|(_, cause)| is_low(cause)), "{told:?}");
    }
}
