//! What is wrong with the pictures of cameras themselves: they stand still, show nobody or other people, or come through a
//! lens that is not the calibrated one.

mod low_scores;
mod same;

use super::super::JudgedCamera;
use super::super::frozen::frozen_since;
use super::super::geometry::SightLines;
use super::super::lens::distortion::distortion;
use super::super::lens::focal_lengths::focal_lengths;
use super::super::lens::kind::called_fisheyes;
use super::super::report::DisagreementCause;
use super::super::time_shift::silent::silences;
use super::{Findings, Judge};

impl Judge<'_> {
    /// Cameras whose pictures stand still.
    pub(super) fn find_frozen(&self, findings: &mut Findings) {
        for camera in findings.unexplained() {
            let of = (camera, &self.lines[camera]);
            if let Some(since) = frozen_since(self.samples, of, self.rate_hz) {
                let since_tick = since.0;
                findings.add(self, &[camera], DisagreementCause::Frozen { since_tick });
            }
        }
    }

    /// Cameras that show nobody although people are in their pictures.
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

    /// Cameras that show other people than all the others do, for whatever reason.
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

    /// Cameras that are calibrated as fisheyes and are none: one of them, or all. A fisheye that is not calibrated as one is
    /// found by other searches, which move a lens as much.
    pub(super) fn find_called_fisheyes(&self, findings: &mut Findings) {
        if !self.lines.iter().any(SightLines::is_fisheye) {
            return;
        }
        let points = self.points_of_moving();
        let cameras = points.and_then(|points| called_fisheyes(points, &self.models));
        let is_free = |cameras: &Vec<usize>| !cameras.iter().any(|&of| findings.is_explained(of));
        if let Some(cameras) = cameras.filter(is_free) {
            let cause = DisagreementCause::LensKind { fisheye: false };
            findings.add(self, &cameras, cause);
        }
    }

    /// Other lenses, of one camera or of all. Only if nothing else is found, because other mistakes bend lines of sight, too.
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
