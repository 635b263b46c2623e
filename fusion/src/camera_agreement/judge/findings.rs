//! What the searches have found so far, and which cameras it explains.

use super::super::report::{Disagreement, DisagreementCause};
use super::super::words;
use super::Judge;

/// Findings in the order in which they were found.
pub(in crate::camera_agreement) struct Findings {
    pub(in crate::camera_agreement) all: Vec<Disagreement>,
    /// Per camera whether later searches leave it out.
    explained: Vec<bool>,
}

impl Findings {
    /// Nothing is found yet of so many cameras.
    pub(super) fn new(n_cameras: usize) -> Self {
        Self {
            all: Vec::new(),
            explained: vec![false; n_cameras],
        }
    }

    /// Whether a finding explains this camera.
    pub(in crate::camera_agreement) fn is_explained(&self, camera: usize) -> bool {
        self.explained[camera]
    }

    /// The cameras that no finding explains.
    pub(in crate::camera_agreement) fn unexplained(&self) -> Vec<usize> {
        let all = 0..self.explained.len();
        all.filter(|&camera| !self.explained[camera]).collect()
    }

    /// Leaves these cameras out of later searches.
    pub(super) fn leave_out(&mut self, cameras: &[usize]) {
        for &camera in cameras {
            self.explained[camera] = true;
        }
    }

    /// Adds a cause that explains these cameras.
    pub(in crate::camera_agreement) fn add(
        &mut self,
        judge: &Judge<'_>,
        cameras: &[usize],
        cause: DisagreementCause,
    ) {
        self.leave_out(cameras);
        self.name(judge, cameras, cause);
    }

    /// Adds a cause that names these cameras, and explains none but what the caller leaves out.
    pub(super) fn name(&mut self, judge: &Judge<'_>, cameras: &[usize], cause: DisagreementCause) {
        let names = cameras.iter();
        let names = names.map(|&camera| judge.cameras[camera].name.clone());
        let finding = Disagreement::new(names.collect(), cause, judge.rate_hz);
        self.all.push(finding);
    }
}

impl Disagreement {
    /// A cause of these cameras, with its sentences.
    pub(in crate::camera_agreement) fn new(
        cameras: Vec<String>,
        cause: DisagreementCause,
        rate_hz: f64,
    ) -> Self {
        let (found, remedy) = words::sentences(&cameras, cause, rate_hz);
        Self {
            cameras,
            cause,
            part_ticks: None,
            found,
            remedy,
        }
    }
}
