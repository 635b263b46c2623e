//! Cameras whose keypoints are at the right places but have scores too low to count: written as one less the score, for
//! example, or in another unit. Few keypoints of such a camera count, so later searches leave it out.

use std::collections::BTreeMap;

use super::super::super::pairs::{CameraRays, PairAgreement, PictureChange};
use super::super::super::report::DisagreementCause;
use super::super::super::samples::{MIN_SCORE, PassSample};
use super::super::{Findings, Judge, MIN_KEYPOINTS};

/// Smallest share of the bodies of a camera that have mostly low scores. With valid scores it was 0.03 on the Shelf,
/// and 0 on the sample and four simulated scenes.
const MIN_LOW_BODIES_SHARE: f64 = 0.7;
/// Fewest such bodies, and shortest time from the first to the last, seconds: people who step into a picture are half
/// in it for a moment.
const MIN_BODIES: usize = 6;
const MIN_SPAN_S: f64 = 1.0;
/// Smallest share of low scores among their keypoints: if the legs of a person are hidden, half of the keypoints are
/// guesses.
const MIN_LOW_KEYPOINTS_SHARE: f64 = 0.66;
/// Smallest share of the other cameras that must agree with one if keypoints of any score count.
const MIN_AGREEING_SHARE: f64 = 0.5;

impl Judge<'_> {
    /// Cameras with mostly low scores that agree with others if keypoints of any score count.
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
        let is_mostly = unsure >= MIN_BODIES && unsure as f64 >= MIN_LOW_BODIES_SHARE * all as f64;
        // Passes are ordered from the newest to the oldest.
        let shown = self.passes.iter();
        let mut shown = shown.filter(|pass| !pass.unsure[camera].is_empty());
        let last = shown.next();
        let span = last
            .zip(shown.next_back())
            .map_or(0, |(last, first)| last.tick - first.tick);
        let lasts = span as f64 >= MIN_SPAN_S * self.rate_hz;
        is_mostly && lasts && self.share_of_low(&[camera]) >= MIN_LOW_KEYPOINTS_SHARE
    }

    /// Whether one of these cameras agrees with most others if all its keypoints count.
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
            near > 0 && near as f64 >= MIN_AGREEING_SHARE * compared as f64
        }
    }

    /// Share of low scores among the keypoints of these cameras, to a hundredth, in bodies that have mostly low scores.
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

    /// The causes reported if these cameras write one less the score, and also have the `other` mistake.
    fn causes(cameras: &[usize], other: Mistake) -> Vec<(Vec<String>, DisagreementCause)> {
        let mut hall = Hall::default();
        for &camera in cameras {
            hall.shows[camera].1 = Mistake {
                scores_written: Some(|score| 1.0 - score),
                ..other
            };
        }
        hall.causes()
    }

    #[test]
    fn inverted_scores_are_found_in_one_camera_and_in_all() {
        for (cameras, named) in [(vec![2], names(&[2])), (vec![0, 1, 2, 3], Vec::new())] {
            let causes = causes(&cameras, Mistake::default());
            let [(of, DisagreementCause::LowScores { share })] = &causes[..] else {
                panic!("{causes:?}");
            };
            assert_eq!(*of, named);
            assert!(*share > 0.99, "{share}");
        }
    }

    #[test]
    fn low_scores_at_wrong_places_are_not_reported() {
        let mirrored = Mistake {
            mirrored: true,
            ..Mistake::default()
        };
        let causes = causes(&[2], mirrored);
        let is_low =
            |cause: &DisagreementCause| matches!(cause, DisagreementCause::LowScores { .. });
        assert!(!causes.iter().any(|(_, cause)| is_low(cause)), "{causes:?}");
    }
}
