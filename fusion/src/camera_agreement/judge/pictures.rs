//! Searches for mistakes in the pictures themselves: two cameras show the same, pictures do not change, show no people or
//! other people, or come through a lens that is not the calibrated one.

mod low_scores;

use super::super::JudgedCamera;
use super::super::frozen::frozen_since;
use super::super::geometry::SightLines;
use super::super::lens::distortion::distortion;
use super::super::lens::focal_lengths::focal_lengths;
use super::super::lens::kind::false_fisheyes;
use super::super::report::DisagreementCause;
use super::super::samples::SeenBody;
use super::super::time_shift::silent::silences;
use super::{Findings, Judge, MIN_KEYPOINTS};

/// Largest difference of keypoints of two cameras that show the same picture, pixels: their crops are not the same.
const SAME_PX: f32 = 6.0;

impl Judge<'_> {
    /// Two cameras whose keypoints are at the same pixels at every pass: one recording that was given for both.
    pub(super) fn find_same_pictures(&self, findings: &mut Findings) {
        let all = findings.unexplained();
        // If people stand in a ring, opposite cameras show the same, but their lines of sight meet those of the others.
        let right = self.taken_for_right(&all);
        let are_right = |a, b| right.len() > 2 && right.contains(&a) && right.contains(&b);
        // Two cameras on one pole may point the same way, so only cameras that stand apart are compared.
        for (a, b) in self.pairs_of(&all) {
            let is_free = !findings.is_explained(a) && !findings.is_explained(b);
            if is_free && !are_right(a, b) && self.show_the_same(a, b) {
                findings.add(self, &[a, b], DisagreementCause::SamePictures);
            }
        }
    }

    fn show_the_same(&self, a: usize, b: usize) -> bool {
        let (mut n, mut same) = (0, 0);
        for pass in &self.passes {
            for one in pass.surest(a) {
                let others = pass.of_camera[b].iter();
                let others = others.map(|other| same_pixels(one, other));
                let (own, common) = others.max().unwrap_or_default();
                same += own;
                n += common;
            }
        }
        n >= MIN_KEYPOINTS && same * 10 >= n * 7
    }

    /// Cameras whose pictures do not change.
    pub(super) fn find_frozen(&self, findings: &mut Findings) {
        for camera in findings.unexplained() {
            let of = (camera, &self.lines[camera]);
            if let Some(since) = frozen_since(self.samples, of, self.rate_hz) {
                let since_tick = since.0;
                findings.add(self, &[camera], DisagreementCause::Frozen { since_tick });
            }
        }
    }

    /// Cameras that show no people although people are in their view.
    pub(super) fn find_silent(&self, findings: &mut Findings) {
        let of_viewpoint = |camera: &JudgedCamera| {
            let of = |other: &&JudgedCamera| other.viewpoint == camera.viewpoint;
            self.cameras.iter().filter(of).count()
        };
        let per_viewpoint: Vec<usize> = self.cameras.iter().map(of_viewpoint).collect();
        let seen: Vec<_> = self.fits.iter().map(|fit| fit.seen.clone()).collect();
        let found = silences(&seen, &per_viewpoint, self.samples, self.rate_hz);
        for camera in findings.unexplained() {
            if let Some(silence) = found[camera] {
                let since_tick = silence.since.map(|tick| tick.0);
                findings.add(self, &[camera], DisagreementCause::Silent { since_tick });
            }
        }
    }

    /// Cameras that show other people than all others, for any reason.
    pub(super) fn find_strangers(&self, findings: &mut Findings) {
        let showing = self
            .fits
            .iter()
            .filter(|fit| fit.people.shows_tracked())
            .count();
        for camera in findings.unexplained() {
            if showing >= 2 && self.fits[camera].people.shows_other_people() {
                findings.add(self, &[camera], DisagreementCause::Unexplained);
            }
        }
    }

    /// Cameras that are calibrated as fisheyes and are none: one of them, or all. Other searches find a fisheye that is not
    /// calibrated as one, because they change a lens as much.
    pub(super) fn find_false_fisheyes(&self, findings: &mut Findings) {
        if !self.lines.iter().any(SightLines::is_fisheye) {
            return;
        }
        let points = self.points_of_moving();
        let cameras = points.and_then(|points| false_fisheyes(points, &self.models));
        let is_free = |cameras: &Vec<usize>| !cameras.iter().any(|&of| findings.is_explained(of));
        if let Some(cameras) = cameras.filter(is_free) {
            let cause = DisagreementCause::LensKind { fisheye: false };
            findings.add(self, &cameras, cause);
        }
    }

    /// Other lenses, of one camera or of all. It runs only if nothing else is found, because other mistakes bend lines
    /// of sight, too.
    pub(super) fn find_other_lenses(&self, findings: &mut Findings) {
        let Some(points) = self.points_of_moving().filter(|_| findings.all.is_empty()) else {
            return;
        };
        let scaled = focal_lengths(points);
        let most = scaled.as_ref().map_or(f64::INFINITY, |scaled| scaled.ratio);
        if let Some(bent) = distortion(points).filter(|bent| bent.ratio < most) {
            let k1_over = (100.0 * bent.k1_over).round() / 100.0;
            let cause = DisagreementCause::Distortion { k1_over };
            findings.add(self, &bent.cameras, cause);
        } else if let Some(scaled) = scaled {
            let factor = scaled.factor;
            let cause = DisagreementCause::FocalLength { factor };
            findings.add(self, &scaled.cameras, cause);
        }
    }
}

/// How many keypoints of two sightings are in the same pixels, and how many both have.
fn same_pixels(one: &SeenBody, other: &SeenBody) -> (usize, usize) {
    let pairs = one
        .iter()
        .zip(other)
        .filter_map(|(p, q)| Some((p.as_ref()?, q.as_ref()?)));
    let near = |p: f32, q: f32| (p - q).abs() <= SAME_PX;
    pairs.fold((0, 0), |(same, n), (p, q)| {
        let is_same = near(p.pixel[0], q.pixel[0]) && near(p.pixel[1], q.pixel[1]);
        (same + usize::from(is_same), n + 1)
    })
}

#[cfg(test)]
mod tests {
    use super::super::super::fixture::{Hall, Mistake};
    use super::super::super::report::DisagreementCause;

    #[test]
    fn two_cameras_on_one_pole_may_show_the_same() {
        let hall = Hall {
            second_offset_m: Some(0.05),
            ..Hall::default()
        };
        assert_eq!(hall.causes(), []);
    }

    /// The hall looks nearly the same from the opposite camera, so a turned camera fits the calibration of that camera
    /// better than its own. Once it was reported to show the pictures of the opposite camera.
    #[test]
    fn a_turned_camera_does_not_show_the_pictures_of_the_opposite_one() {
        for camera in 0..4 {
            for turned_deg in [
                [5.0, 0.0, 0.0],
                [-5.0, 0.0, 0.0],
                [0.0, 5.0, 0.0],
                [0.0, -5.0, 0.0],
            ] {
                let mistake = Mistake {
                    turned_deg,
                    ..Mistake::default()
                };
                let causes = Hall::with(camera, mistake).causes();
                let same = causes
                    .iter()
                    .find(|(_, cause)| *cause == DisagreementCause::SamePictures);
                assert_eq!(same, None, "camera {camera} by {turned_deg:?}");
                assert!(!causes.is_empty(), "camera {camera} by {turned_deg:?}");
            }
        }
    }
}
