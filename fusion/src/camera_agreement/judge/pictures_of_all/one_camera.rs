//! Whether one camera would agree if its keypoints were elsewhere in its pictures: one file was found in smaller pictures than
//! the others, or has x and y exchanged.

use super::super::super::pairs::CameraRays;
use super::super::super::report::PictureOfAll;
use super::super::Judge;
use super::LEAVES;
use super::change::tried_of_one;

/// A change that is named explains a little of anything, as there are many.
const HANDICAP: f64 = 1.3;
/// What sightings cost at least that are nowhere near where they should be: half of their keypoints are as far off as costs
/// can tell.
const NOTHING_MEETS: f64 = 0.5;

impl Judge<'_> {
    /// The change of the pictures of `camera` that costs least beside these `others`, and what it leaves of the cost
    /// `as_it_is`; `None` where that is much.
    pub(in crate::camera_agreement) fn picture_of_one(
        &self,
        camera: usize,
        others: &[usize],
        as_it_is: f64,
    ) -> Option<(f64, PictureOfAll)> {
        if as_it_is < NOTHING_MEETS {
            return None;
        }
        let weighed = self.other_pictures(camera).into_iter();
        let weighed = weighed.filter_map(|(rays, change)| {
            let cost = self.cost_against(camera, &rays, others)?;
            Some((HANDICAP * cost / as_it_is, change))
        });
        let best = weighed.min_by(|a, b| a.0.total_cmp(&b.0));
        best.filter(|(ratio, _)| *ratio < LEAVES)
    }

    /// The sightings of `camera` as they would be, had its pictures been changed in one way or another, and which.
    fn other_pictures(&self, camera: usize) -> Vec<(CameraRays, PictureOfAll)> {
        let changed = tried_of_one().into_iter();
        let changed = changed.filter_map(|it| Some((self.rays_changed(camera, &it), it.name()?)));
        changed.collect()
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::super::fixture::{Hall, Mistake, names};
    use super::super::super::super::report::{DisagreementCause, PictureOfAll};

    /// What is said of a hall whose third camera, 1920 x 1200, has its keypoints written so.
    fn told(rewritten: fn([f32; 2]) -> [f32; 2]) -> Vec<(Vec<String>, DisagreementCause)> {
        let mistake = Mistake {
            rewritten: Some(rewritten),
            ..Mistake::default()
        };
        Hall::with(2, mistake).causes()
    }

    #[test]
    fn one_camera_whose_keypoints_are_counted_otherwise_is_named_with_how() {
        for (rewritten, change) in [
            (
                (|[x, y]| [y, x]) as fn([f32; 2]) -> [f32; 2],
                PictureOfAll::XAndYExchanged,
            ),
            (|[x, y]| [x, 1199.0 - y], PictureOfAll::FromBelow),
            (|[x, y]| [1919.0 - x, y], PictureOfAll::Mirrored),
            (|[x, y]| [1199.0 - y, x], PictureOfAll::QuarterTurned),
        ] {
            let cause = DisagreementCause::OtherPicture { change };
            assert_eq!(told(rewritten), [(names(&[2]), cause)]);
        }
    }

    #[test]
    fn one_camera_whose_keypoints_were_found_in_smaller_or_larger_pictures_is_named_with_the_factor()
     {
        for (rewritten, factor) in [
            (
                (|[x, y]| [0.5 * x, 0.5 * y]) as fn([f32; 2]) -> [f32; 2],
                2.0,
            ),
            (|[x, y]| [x / 1.5, y / 1.5], 1.5),
            (|[x, y]| [2.0 * x, 2.0 * y], 0.5),
        ] {
            let change = PictureOfAll::Resized {
                scale: [factor; 2],
                shift: [0.0; 2],
            };
            assert_eq!(
                told(rewritten),
                [(names(&[2]), DisagreementCause::OtherPicture { change })]
            );
        }
    }
}
