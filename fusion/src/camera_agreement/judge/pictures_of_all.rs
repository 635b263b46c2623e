//! Whether all cameras, or one, would agree if their keypoints were at other places in the pictures: found in smaller,
//! cropped or stretched pictures, counted from below, or with x and y exchanged. Files of another program are like
//! this, all in the same way.
//!
//! ```text
//!   u = S T u' + t       u': shown, u: true place, pixels; T: a turn by quarters or a reflection, S: a scale of x and y, t: a shift
//! ```
//!
//! Keypoints that shrink to a point fit everywhere if cameras point at one place. So the distances of lines of sight
//! are scaled as if each person were as large as people are.

mod change;
mod compared;

use std::collections::BTreeSet;

use farfield_proto::order_statistics::upper_median;

use self::change::{Change, candidates_of_one};
use self::compared::{Compared, Precision, corrected};
use super::super::pairs::{CameraRays, HALF_COST_M, PairAgreement};
use super::super::report::{DisagreementCause, PictureOfAll};
use super::{Judge, MIN_KEYPOINTS};

/// Fewest viewpoints: lines of sight of two meet with many changes.
const MIN_VIEWPOINTS: usize = 3;
/// Share of agreeing pairs from which no change is searched, and smallest share that must agree with the change.
const MAX_AGREEING_BEFORE: f64 = 0.5;
const MIN_AGREEING_AFTER: f64 = 0.75;
/// Largest share of the cost that a change may leave.
const MAX_COST_RATIO: f64 = 0.5;
/// A change is the best of many, so it explains a little of anything. The cost of one in a single camera is multiplied
/// by this.
const HANDICAP_OF_ONE: f64 = 1.3;
/// Smallest cost of the sightings of a single camera for a search. It is reached if half of the keypoints are as far
/// off as a cost can express.
const MIN_COST_OF_ONE: f64 = 0.5;
/// Valid extents of people, metres.
const EXTENTS_M: std::ops::RangeInclusive<f64> = 0.9..=2.1;
/// Most passes, pairs of cameras, and people per camera that are compared during the search.
const MAX_PASSES: usize = 4;
const MAX_PAIRS: usize = 12;
const MAX_PEOPLE: usize = 3;

impl Judge<'_> {
    /// A change of the pictures of all cameras, if few pairs agree and nearly all would with the change.
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
        if agreeing >= MAX_AGREEING_BEFORE * self.pairs.len() as f64 && !self.pairs.is_empty() {
            return None;
        }
        let compared = self.compared(&pairs);
        let before = compared.mean_cost(&Change::NONE, Precision::fine(HALF_COST_M))?;
        let (change, after) = compared.best()?;
        if after > MAX_COST_RATIO * before {
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

    /// A selection of passes, pairs of cameras and people to compare.
    fn compared(&self, pairs: &[(usize, usize)]) -> Compared<'_> {
        let step = self.passes.len().div_ceil(MAX_PASSES).max(1);
        let passes = self.passes.iter().step_by(step).map(|pass| {
            let cameras = (0..self.cameras.len()).map(|camera| pass.surest(camera));
            cameras
                .map(|bodies| bodies.iter().take(MAX_PEOPLE).collect())
                .collect()
        });
        let step = pairs.len().div_ceil(MAX_PAIRS).max(1);
        Compared {
            cameras: self.cameras,
            models: &self.models,
            keypoints: &self.venue.keypoints,
            pairs: pairs.iter().copied().step_by(step).collect(),
            passes: passes.collect(),
        }
    }

    /// Whether nearly all pairs that can be compared agree with this change.
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
        agreeing >= MIN_VIEWPOINTS && agreeing as f64 >= MIN_AGREEING_AFTER * all.len() as f64
    }

    /// The sightings of a camera with this change of its pictures.
    fn rays_changed(&self, camera: usize, change: &Change) -> CameraRays {
        let (lines, model) = (&self.lines[camera], self.models[camera]);
        self.as_it_is[camera].through(|place| {
            let px = place.component_mul(&lines.focal_px()) + lines.principal_px();
            Some(lines.normalised(corrected([px.x, px.y], model, &lines.size_px(), change)?))
        })
    }

    /// The change of the pictures of `camera` with the least cost relative to these `others`, and the share that it
    /// leaves of the cost `as_it_is`; `None` if no change explains enough. One file may be of smaller pictures, or have
    /// x and y exchanged.
    pub(in crate::camera_agreement) fn picture_of_one(
        &self,
        camera: usize,
        others: &[usize],
        as_it_is: f64,
    ) -> Option<(f64, PictureOfAll)> {
        if as_it_is < MIN_COST_OF_ONE {
            return None;
        }
        let weighed = self.other_pictures(camera).into_iter();
        let weighed = weighed.filter_map(|(rays, change)| {
            let cost = self.cost_against(camera, &rays, others)?;
            Some((HANDICAP_OF_ONE * cost / as_it_is, change))
        });
        let best = weighed.min_by(|a, b| a.0.total_cmp(&b.0));
        best.filter(|(ratio, _)| *ratio < MAX_COST_RATIO)
    }

    /// The sightings of `camera` with each candidate change of its pictures.
    fn other_pictures(&self, camera: usize) -> Vec<(CameraRays, PictureOfAll)> {
        let changed = candidates_of_one().into_iter();
        let changed = changed.filter_map(|it| Some((self.rays_changed(camera, &it), it.name()?)));
        changed.collect()
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::fixture::{Hall, Mistake, names};
    use super::*;

    /// Maps the pixel of a keypoint to the written one, in pictures of 1920 x 1200.
    type Written = fn([f32; 2]) -> [f32; 2];

    /// The causes reported if all cameras of the hall write their keypoints so.
    fn causes_of_all(rewritten: Written) -> Vec<(Vec<String>, DisagreementCause)> {
        let mut hall = Hall::default();
        for (_, mistake) in &mut hall.shows {
            mistake.rewritten = Some(rewritten);
        }
        hall.causes()
    }

    #[test]
    fn another_pixel_convention_in_all_cameras_is_named() {
        let cases: [(Written, PictureOfAll); 5] = [
            (|[x, y]| [x, 1199.0 - y], PictureOfAll::FromBelow),
            (|[x, y]| [1919.0 - x, y], PictureOfAll::Mirrored),
            (|[x, y]| [1919.0 - x, 1199.0 - y], PictureOfAll::HalfTurned),
            (|[x, y]| [y, x], PictureOfAll::XAndYExchanged),
            (|[x, y]| [1199.0 - y, x], PictureOfAll::QuarterTurned),
        ];
        for (rewritten, change) in cases {
            let cause = DisagreementCause::PictureOfAll { change };
            assert_eq!(causes_of_all(rewritten), [(Vec::new(), cause)]);
        }
    }

    #[test]
    fn another_picture_size_in_all_cameras_is_named_with_its_correction() {
        let cases: [(Written, [f64; 2], [f64; 2]); 6] = [
            (|[x, y]| [0.5 * x, 0.5 * y], [2.0; 2], [0.0; 2]),
            (|[x, y]| [1.5 * x, 1.5 * y], [0.667; 2], [0.0; 2]),
            (|[x, y]| [x / 3.0, y / 1.875], [3.0, 1.875], [0.0; 2]),
            // Cropped to 4:3 in the middle.
            (|[x, y]| [x - 160.0, y], [1.0; 2], [0.083, 0.0]),
            (|[x, y]| [x - 160.0, y - 100.0], [1.0; 2], [0.083; 2]),
            // Scaled to 640 x 640 with bars.
            (|[x, y]| [x / 3.0, y / 3.0 + 120.0], [3.0; 2], [0.0, -0.3]),
        ];
        for (rewritten, true_scale, true_shift) in cases {
            let causes = causes_of_all(rewritten);
            let [
                (
                    cameras,
                    DisagreementCause::PictureOfAll {
                        change: PictureOfAll::Resized { scale, shift },
                    },
                ),
            ] = &causes[..]
            else {
                panic!("{true_scale:?} {true_shift:?}: {causes:?}");
            };
            assert!(cameras.is_empty());
            for axis in 0..2 {
                let ratio = scale[axis] / true_scale[axis];
                assert!((ratio - 1.0).abs() < 0.05, "{causes:?}");
                let off = shift[axis] - true_shift[axis];
                assert!(off.abs() < 0.05, "{causes:?}");
            }
        }
    }

    #[test]
    fn a_cropped_picture_in_one_camera_names_that_camera() {
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

    /// The causes reported if the third camera of the hall writes its keypoints so.
    fn causes_of_one(rewritten: Written) -> Vec<(Vec<String>, DisagreementCause)> {
        let mistake = Mistake {
            rewritten: Some(rewritten),
            ..Mistake::default()
        };
        Hall::with(2, mistake).causes()
    }

    #[test]
    fn another_pixel_convention_in_one_camera_is_named() {
        let cases: [(Written, PictureOfAll); 4] = [
            (|[x, y]| [y, x], PictureOfAll::XAndYExchanged),
            (|[x, y]| [x, 1199.0 - y], PictureOfAll::FromBelow),
            (|[x, y]| [1919.0 - x, y], PictureOfAll::Mirrored),
            (|[x, y]| [1199.0 - y, x], PictureOfAll::QuarterTurned),
        ];
        for (rewritten, change) in cases {
            let cause = DisagreementCause::OtherPicture { change };
            assert_eq!(causes_of_one(rewritten), [(names(&[2]), cause)]);
        }
    }

    #[test]
    fn another_picture_size_in_one_camera_is_named_with_its_factor() {
        let cases: [(Written, f64); 3] = [
            (|[x, y]| [0.5 * x, 0.5 * y], 2.0),
            (|[x, y]| [x / 1.5, y / 1.5], 1.5),
            (|[x, y]| [2.0 * x, 2.0 * y], 0.5),
        ];
        for (rewritten, factor) in cases {
            let change = PictureOfAll::Resized {
                scale: [factor; 2],
                shift: [0.0; 2],
            };
            assert_eq!(
                causes_of_one(rewritten),
                [(names(&[2]), DisagreementCause::OtherPicture { change })]
            );
        }
    }
}
