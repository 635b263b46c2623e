//! Peak assignment: if the maps of several persons, or of one person's left and right, show the
//! same peak, it is assigned to one of them.
//!
//! ```text
//!   views of one viewpoint -> claims (possible owners of a peak of one kind of joint)
//!                          -> peaks near the predictions -> places (one per physical peak)
//!                          -> one assignment of claims to places -> notches in the losers' maps
//! ```
//!
//! There is one decision per viewpoint, kind of joint and group of claims that may share a peak,
//! over all people there. The sum of the costs is least, and the order of the persons does not
//! matter. The cost of a place for a claim is its negative log likelihood,
//!
//! ```text
//!   c = d^2/(2 sigma^2) - ln h        removed from a lost peak: share (1 - exp(c_winner - c_loser))
//! ```
//!
//! d is the distance of the peak's ray from the claim's prediction, sigma the expected error of
//! that prediction, h the value of the claim's own map there (on the place's ray, if it shows no
//! peak). A claim may also get no place. If a place goes to another claim, a claim whose map shows
//! it keeps the share that its likelihood supports. Two wrists predicted at one spot both keep the
//! peak, and a peak that is only at another's prediction is removed. No peak is ever removed
//! completely, so that a wrong decision can be undone.
//!
//! Rays are compared, not pixels: two persons of one viewpoint may come from different cameras.
//! Decisions only read; [`PeakAssignment::carve`] changes the maps of one person.

mod claims;
#[cfg(test)]
mod tests;

use farfield_proto::id::ViewpointIndex;
use farfield_proto::keypoints::KeypointSet;
use rayon::prelude::*;

use self::claims::{Claims, JointKind};
use crate::assign::Assigner;
use crate::estimate::estimator::Estimator;
use crate::estimate::evidence::Notch;
use crate::estimate::occlusion::BodyCapsules;
use crate::method::Method;

/// Cost of getting no place: as of a peak of 0.3 at two and a half sigmas.
const WITHOUT: f64 = 2.5 * 2.5 / 2.0 + 1.2;
/// Persons from which viewpoints are processed in parallel: fewer take less time than waking
/// threads.
const PARALLEL_FROM: usize = 4;
/// Notches that remove less than this of a peak are omitted: two near peaks do that to each other.
const LEAST_DEPTH: f64 = 0.05;

/// Owners of the peaks of all viewpoints.
#[derive(Debug, Clone)]
pub struct PeakAssignment {
    kinds: Vec<JointKind>,
    viewpoints: Vec<ViewpointAssignment>,
}

impl PeakAssignment {
    /// For the keypoints of a network at `n_viewpoints`.
    pub fn new(keypoints: &KeypointSet, n_viewpoints: usize) -> Self {
        let assignment = |index| ViewpointAssignment::new(ViewpointIndex(index as u16));
        Self {
            kinds: JointKind::of_network(keypoints),
            viewpoints: (0..n_viewpoints).map(assignment).collect(),
        }
    }

    /// Decides the owners of the peaks of this tick. `bodies` are those of `tracks`, whose views
    /// are placed.
    ///
    /// Cost: per viewpoint a few distances per pair of persons who are apart in its view; for those
    /// who meet, the cells around each prediction with another nearby.
    pub fn decide(
        &mut self,
        tracks: &[impl AsRef<Estimator> + Sync],
        bodies: &[BodyCapsules],
        method: &Method,
    ) {
        let kinds = &self.kinds;
        if method.parameters.contact.yield_share <= 0.0 {
            for assignment in &mut self.viewpoints {
                assignment.notches.clear();
            }
        } else if tracks.len() < PARALLEL_FROM {
            for assignment in &mut self.viewpoints {
                assignment.decide(kinds, tracks, bodies, method);
            }
        } else {
            self.viewpoints
                .par_iter_mut()
                .for_each(|assignment| assignment.decide(kinds, tracks, bodies, method));
        }
    }

    /// Removes the peaks of others from the maps of `track`, which is at `index` of the tracks that
    /// were decided on.
    pub fn carve(&self, index: usize, track: &mut Estimator) {
        for assignment in &self.viewpoints {
            for lost in assignment.notches.iter().filter(|lost| lost.track == index) {
                track.views_mut()[lost.view].carve(lost.keypoint, &lost.notch);
            }
        }
    }

    /// How many peaks were assigned to another at this tick, over all viewpoints.
    #[cfg(test)]
    fn n_lost(&self) -> usize {
        self.viewpoints.iter().map(|c| c.notches.len()).sum()
    }
}

/// A peak that a person loses.
#[derive(Debug, Clone, Copy)]
struct LostPeak {
    track: usize,
    view: usize,
    keypoint: usize,
    notch: Notch,
}

/// The assignments of one viewpoint, with their buffers.
#[derive(Debug, Clone)]
struct ViewpointAssignment {
    viewpoint: ViewpointIndex,
    claims: Claims,
    assigner: Assigner,
    /// Cost per claim and place, claim by claim.
    costs: Vec<f64>,
    notches: Vec<LostPeak>,
}

impl ViewpointAssignment {
    fn new(viewpoint: ViewpointIndex) -> Self {
        Self {
            viewpoint,
            claims: Claims::default(),
            assigner: Assigner::default(),
            costs: Vec::new(),
            notches: Vec::new(),
        }
    }

    fn decide(
        &mut self,
        kinds: &[JointKind],
        tracks: &[impl AsRef<Estimator>],
        bodies: &[BodyCapsules],
        method: &Method,
    ) {
        self.notches.clear();
        self.claims.meet(self.viewpoint, tracks, bodies, method);
        for kind in kinds {
            for group in 0..self.claims.gather(kind, tracks, method) {
                self.claims.take(group, tracks);
                if self.claims.find_places() {
                    self.assign(tracks, method.parameters.contact.yield_share);
                }
            }
        }
    }

    /// Assigns each place to one claim, and records the losses of the others.
    fn assign(&mut self, tracks: &[impl AsRef<Estimator>], yield_share: f64) {
        let claims = &self.claims;
        let (n_claims, n_places) = (claims.n_claims(), claims.n_places());
        self.costs.clear();
        for claim in 0..n_claims {
            let costs = (0..n_places).map(|place| claims.cost(claim, place, tracks, WITHOUT));
            self.costs.extend(costs);
        }
        let costs = &self.costs;
        let cost = |claim: usize, place: usize| {
            if place < n_places {
                costs[claim * n_places + place]
            } else {
                WITHOUT
            }
        };
        // As many ways to get no place as there are claims.
        let of_claim = self.assigner.assign(n_claims, n_places + n_claims, cost);
        for peak in claims.peaks() {
            let winner = of_claim.iter().position(|place| *place == Some(peak.place));
            let Some(winner) = winner.filter(|winner| *winner != peak.claim) else {
                continue;
            };
            let behind = cost(peak.claim, peak.place) - cost(winner, peak.place);
            let depth = yield_share * (1.0 - libm::exp(-behind));
            if depth < LEAST_DEPTH {
                continue;
            }
            let own = of_claim[peak.claim];
            let (track, view, keypoint) = claims.whose(peak.claim);
            self.notches.push(LostPeak {
                track,
                view,
                keypoint,
                notch: Notch {
                    at: peak.cell,
                    height: peak.height,
                    stays: own
                        .and_then(|place| claims.peak_of(peak.claim, place))
                        .map(|own| (own.cell, own.height)),
                    depth,
                },
            });
        }
    }
}
