//! What is known of a camera, in numbers.

use farfield_proto::message::agreement::{AgreementVerdict, CameraAgreement};

use super::super::report::CameraDetails;
use super::{Judge, rounded};

impl Judge<'_> {
    /// How a camera agrees.
    pub(super) fn numbers(&self, camera: usize, verdict: AgreementVerdict) -> CameraAgreement {
        let own = self
            .pairs
            .iter()
            .filter(|((a, b), _)| *a == camera || *b == camera);
        let keypoints = own.clone().map(|(_, pair)| pair.len() as u64).sum();
        let medians = own.filter_map(|(&(a, b), pair)| {
            let side = usize::from(b == camera);
            let focal_px = [a, b].map(|of| self.focal_px(of));
            Some((pair.median_m()?, pair.median_px(focal_px)?[side]))
        });
        let best = medians.min_by(|a, b| a.0.total_cmp(&b.0));
        let best =
            best.filter(|(m, px)| ((1000.0 * m) as f32).is_finite() && (*px as f32).is_finite());
        CameraAgreement {
            verdict,
            keypoints,
            distance_mm: best.map(|(m, _)| rounded(m * 1000.0) as f32),
            distance_px: best.map(|(_, px)| rounded(px) as f32),
            late_ticks: self
                .late(camera)
                .or_else(|| self.known_late(camera))
                .map(|late| late as f32)
                .filter(|late| late.is_finite()),
        }
    }

    /// What else is known of a camera.
    pub(super) fn details(&self, camera: usize) -> CameraDetails {
        let passes = || self.fits[camera].seen.iter();
        let sightings: usize = passes().map(|pass| pass.sightings).sum();
        let used: usize = passes().map(|pass| pass.used).sum();
        let drift = self.drifts[camera].map(|drift| rounded(drift.ticks_per_minute));
        CameraDetails {
            share_used: (used > 0)
                .then(|| (100.0 * used as f64 / sightings as f64).round() / 100.0),
            drift_ticks_per_minute: drift,
        }
    }
}
