//! Whether all cameras would agree if the keypoints of all of them were elsewhere in their pictures: found in smaller ones, cut or
//! stretched, counted from below, x and y exchanged. Files of another program are so, all alike, and single cameras seem wrong then.
//!
//! ```text
//!   u = S T u' + t       u': shown, u: meant, pixels; T: a turn by quarters or a reflection, S: a scale of x and y, t: a shift
//! ```
//!
//! Keypoints that shrink to a point meet everywhere where cameras look at one place, so lines of sight pass each other by as many
//! metres as they would if the person whose keypoints they are were as large as people are.

mod change;
mod compared;
mod one_camera;

use std::collections::BTreeSet;

use farfield_proto::order_statistics::upper_median;

use self::change::Change;
use self::compared::{Closeness, Compared, meant};
use super::super::pairs::{CameraRays, HALF_COST_M, PairAgreement};
use super::super::report::DisagreementCause;
use super::{Judge, MIN_KEYPOINTS};

/// Cameras of so many viewpoints tell: lines of two meet through many changes.
const MIN_VIEWPOINTS: usize = 3;
/// Where so large a share of the pairs agrees as it is, nothing is looked for; and so large a one must afterwards.
const AGREE_BEFORE: f64 = 0.5;
const AGREE_AFTER: f64 = 0.75;
/// What the change leaves of the cost at most.
const LEAVES: f64 = 0.5;
/// How far people extend then, metres.
const EXTENTS_M: std::ops::RangeInclusive<f64> = 0.9..=2.1;
/// Passes, pairs of cameras and people of one that are compared while a change is looked for.
const PASSES: usize = 4;
const PAIRS: usize = 12;
const PEOPLE: usize = 3;

impl Judge<'_> {
    /// What is wrong with the pictures of all cameras alike, where hardly any two agree, and nearly all would.
    pub(in crate::camera_agreement) fn picture_of_all(&self) -> Option<DisagreementCause> {
        let showing = self.showing();
        let viewpoints: BTreeSet<_> = showing
            .iter()
            .map(|&camera| self.cameras[camera].viewpoint)
            .collect();
        if viewpoints.len() < MIN_VIEWPOINTS {
            return None;
        }
        let pairs = self.pairs_of(&showing);
        let agreeing = self.agreeing(&self.pairs, |_| true).len() as f64;
        if agreeing >= AGREE_BEFORE * self.pairs.len() as f64 && !self.pairs.is_empty() {
            return None;
        }
        let compared = self.compared(&pairs);
        let before = compared.mean_cost(&Change::NONE, Closeness::of(HALF_COST_M))?;
        let (change, after) = compared.best()?;
        if after > LEAVES * before {
            return None;
        }
        let change_name = change.name()?;
        let extent_m = upper_median(compared.extents_m(&change))?;
        let are_people = EXTENTS_M.contains(&extent_m);
        (are_people && self.agree_with(&change, &pairs)).then_some(
            DisagreementCause::PictureOfAll {
                change: change_name,
            },
        )
    }

    /// Some passes of some of these pairs of cameras, and some people of each.
    fn compared(&self, pairs: &[(usize, usize)]) -> Compared<'_> {
        let step = self.passes.len().div_ceil(PASSES).max(1);
        let passes = self.passes.iter().step_by(step).map(|pass| {
            let cameras = (0..self.cameras.len()).map(|camera| pass.surest(camera));
            cameras
                .map(|bodies| bodies.iter().take(PEOPLE).collect())
                .collect()
        });
        let step = pairs.len().div_ceil(PAIRS).max(1);
        Compared {
            cameras: self.cameras,
            models: &self.models,
            keypoints: &self.venue.keypoints,
            pairs: pairs.iter().copied().step_by(step).collect(),
            passes: passes.collect(),
        }
    }

    /// Whether nearly all pairs that can be compared agree with all their keypoints changed so.
    fn agree_with(&self, change: &Change, pairs: &[(usize, usize)]) -> bool {
        let cameras = 0..self.cameras.len();
        let rays: Vec<CameraRays> = cameras
            .map(|camera| self.rays_changed(camera, change))
            .collect();
        let all = pairs.iter().map(|&(a, b)| {
            let pair = PairAgreement::of_common(&rays[a], &rays[b]);
            ((a, b), pair)
        });
        let all = all
            .filter(|(_, pair)| pair.len() >= MIN_KEYPOINTS)
            .collect();
        let agreeing = self.agreeing(&all, |_| true).len();
        agreeing >= MIN_VIEWPOINTS && agreeing as f64 >= AGREE_AFTER * all.len() as f64
    }

    /// The sightings of a camera, with its pictures changed so.
    fn rays_changed(&self, camera: usize, change: &Change) -> CameraRays {
        let (lines, model) = (&self.lines[camera], self.models[camera]);
        self.as_it_is[camera].through(|place| {
            let px = place.component_mul(&lines.focal_px()) + lines.principal_px();
            Some(lines.normalised(meant([px.x, px.y], (model, &lines.size_px()), change)?))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::fixture::{Hall, Mistake, names};
    use super::super::super::report::PictureOfAll;
    use super::*;

    /// Where a keypoint is written, pixels.
    type Written = fn([f32; 2]) -> [f32; 2];

    /// What is said of a hall all of whose cameras, 1920 x 1200, have their keypoints written so.
    fn told(rewritten: Written) -> Vec<(Vec<String>, DisagreementCause)> {
        let mut hall = Hall::default();
        for (_, mistake) in &mut hall.shows {
            mistake.rewritten = Some(rewritten);
        }
        hall.causes()
    }

    #[test]
    fn keypoints_that_are_counted_otherwise_in_all_cameras_are_named() {
        let cases: [(Written, PictureOfAll); 5] = [
            (|[x, y]| [x, 1199.0 - y], PictureOfAll::FromBelow),
            (|[x, y]| [1919.0 - x, y], PictureOfAll::Mirrored),
            (|[x, y]| [1919.0 - x, 1199.0 - y], PictureOfAll::HalfTurned),
            (|[x, y]| [y, x], PictureOfAll::XAndYExchanged),
            (|[x, y]| [1199.0 - y, x], PictureOfAll::QuarterTurned),
        ];
        for (rewritten, change) in cases {
            let cause = DisagreementCause::PictureOfAll { change };
            assert_eq!(told(rewritten), [(Vec::new(), cause)]);
        }
    }

    #[test]
    fn keypoints_of_other_pictures_in_all_cameras_are_named_with_what_mends_them() {
        let cases: [(Written, [f64; 2], [f64; 2]); 6] = [
            (|[x, y]| [0.5 * x, 0.5 * y], [2.0; 2], [0.0; 2]),
            (|[x, y]| [1.5 * x, 1.5 * y], [0.667; 2], [0.0; 2]),
            (|[x, y]| [x / 3.0, y / 1.875], [3.0, 1.875], [0.0; 2]),
            // 4:3 of the middle of the picture.
            (|[x, y]| [x - 160.0, y], [1.0; 2], [0.083, 0.0]),
            (|[x, y]| [x - 160.0, y - 100.0], [1.0; 2], [0.083; 2]),
            // 640 x 640 with bars.
            (|[x, y]| [x / 3.0, y / 3.0 + 120.0], [3.0; 2], [0.0, -0.3]),
        ];
        for (rewritten, meant, moved) in cases {
            let told = told(rewritten);
            let [(cameras, DisagreementCause::PictureOfAll { change })] = &told[..] else {
                panic!("{meant:?} {moved:?}: {told:?}");
            };
            let PictureOfAll::Resized { scale, shift } = change else {
                panic!("{meant:?} {moved:?}: {told:?}");
            };
            assert!(cameras.is_empty());
            for axis in 0..2 {
                assert!((scale[axis] / meant[axis] - 1.0).abs() < 0.05, "{told:?}");
                assert!((shift[axis] - moved[axis]).abs() < 0.05, "{told:?}");
            }
        }
    }

    #[test]
    fn a_picture_that_was_cut_in_one_camera_alone_is_none_of_all() {
        let hall = Hall::with(
            2,
            Mistake {
                rewritten: Some(|[x, y]| [x - 40.0, y]),
                ..Mistake::default()
            },
        );
        let causes = hall.causes();
        assert_eq!(causes.len(), 1, "{causes:?}");
        assert_eq!(causes[0].0, names(&[2]), "{causes:?}");
    }
}
