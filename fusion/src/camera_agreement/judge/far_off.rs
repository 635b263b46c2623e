//! Sightings of a camera that are elsewhere than where people are, whatever the cause.

use farfield_proto::order_statistics::upper_median;

use super::super::report::{Disagreement, DisagreementCause};
use super::Judge;

/// What the sightings of a camera cost against poses that is told of whatever the cause, and as a factor of what those of most
/// do. On real cameras that are right 0.24 and 1.3 were seen.
const FAR_OFF: f64 = 0.5;
const FAR_OFF_FACTOR: f64 = 2.5;
/// Cameras whose costs tell what is usual.
const MIN_CAMERAS: usize = 3;

impl Judge<'_> {
    /// Cameras whose sightings are clearly elsewhere than where people are, or of others than are there, while those of the
    /// others are not: whatever the cause.
    pub(super) fn find_far_off(&self, all: &mut Vec<Disagreement>, told: &mut [bool]) {
        let limit = self
            .usual_cost()
            .map(|usual| FAR_OFF.max(FAR_OFF_FACTOR * usual));
        let showing = self.fits.iter().filter(|fit| fit.met.shows_them()).count();
        for (camera, fit) in self.fits.iter().enumerate() {
            let is_off = limit
                .zip(fit.cost_now)
                .is_some_and(|(limit, cost)| cost >= limit);
            let shows_others = showing >= 2 && fit.met.shows_others();
            if (is_off || shows_others) && !told[camera] {
                told[camera] = true;
                all.push(self.disagreement(&[camera], DisagreementCause::Unexplained));
            }
        }
    }

    /// The median of what sightings cost against poses; `None` of fewer than three cameras.
    fn usual_cost(&self) -> Option<f64> {
        let known: Vec<f64> = self.fits.iter().filter_map(|fit| fit.cost_now).collect();
        (known.len() >= MIN_CAMERAS)
            .then(|| upper_median(known))
            .flatten()
    }
}
