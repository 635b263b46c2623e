//! Cameras that are calibrated as fisheyes and are none.

use super::super::geometry::SightLines;
use super::super::lens::kind::other_kind;
use super::super::report::{Disagreement, DisagreementCause};
use super::Judge;

impl Judge<'_> {
    /// Cameras that are called fisheyes and are none: one of them, or all. By all cameras, also by those that tell nothing of the
    /// lenses of others. Of fisheyes that are not called so other causes are told, which move a lens as much.
    pub(super) fn find_no_fisheyes(&self, all: &mut Vec<Disagreement>, told: &mut [bool]) {
        if !self.lines.iter().any(SightLines::is_fisheye) {
            return;
        }
        let points = self.lens_points(&self.bursts, self.samples);
        let other = points.and_then(|points| other_kind(&points, &self.models));
        let Some(other) = other.filter(|other| other.are_called_fisheyes) else {
            return;
        };
        if other.cameras.iter().any(|&camera| told[camera]) {
            return;
        }
        for &camera in &other.cameras {
            told[camera] = true;
        }
        let cause = DisagreementCause::LensKind { fisheye: false };
        all.push(self.disagreement(&other.cameras, cause));
    }
}
