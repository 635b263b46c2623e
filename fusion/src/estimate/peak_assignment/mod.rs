//! Whose peak is it: where the maps of several persons, or of one person's left and right, show the
//! same peak, it is given to one of them.
//!
//! ```text
//!   views of one viewpoint -> claims (who may own a peak of one kind of joint)
//!                          -> peaks near the predictions -> places (one per physical peak)
//!                          -> one assignment of claims to places -> notches in the losers' maps
//! ```
//!
//! One decision per viewpoint, kind of joint and group of claims that may have a peak in common, over all who meet there:
//! the sum of the costs is least, and the order of the persons does not matter. The cost of a place for a claim is its negative log
//! likelihood,
//!
//! ```text
//!   c = d^2/(2 sigma^2) - ln h        taken of a lost peak: share (1 - exp(c_winner - c_loser))
//! ```
//!
//! d the distance of the peak's ray from the claim's prediction, sigma the expected error of that
//! prediction, h what the claim's own map shows there (on the place's ray, where it shows no peak). A
//! claim may also go without a place. Of a place that goes to another, a claim whose map shows it
//! keeps what speaks for it: two wrists predicted at one spot both keep the peak, and a peak that lies
//! at another's prediction alone goes. Nothing is ever taken away whole, so that a wrong decision can
//! be undone.
//!
//! Rays are compared, not pixels: two persons of one viewpoint may come from different cameras.
//! Decisions only read; [`PeakAssignment::carve`] changes the maps of one person.

mod claim;
mod claims;
mod groups;
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

/// Cost of going without a place: as of a peak of 0.3 at two and a half sigmas.
const WITHOUT: f64 = 2.5 * 2.5 / 2.0 + 1.2;
/// Persons from which viewpoints are worked on in parallel: fewer are done sooner than threads wake up.
const PARALLEL_FROM: usize = 4;
/// Notches that take less than this of a peak are left out: it is what two near peaks do to each other.
const LEAST_DEPTH: f64 = 0.05;

/// Whose the peaks of all viewpoints are.
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
            kinds: JointKind::of(keypoints),
            viewpoints: (0..n_viewpoints).map(assignment).collect(),
        }
    }

    /// Decides whose the peaks of this tick are. `bodies` are those of `tracks`, whose views are placed.
    ///
    /// Cost: per viewpoint a few distances per pair of persons who are apart in its view; for those who
    /// meet, the cells around each prediction that another comes near.
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

    /// Takes what is another's out of the maps of `track`, the one at `index` of those that were
    /// decided on.
    pub fn carve(&self, index: usize, track: &mut Estimator) {
        for assignment in &self.viewpoints {
            for lost in assignment.notches.iter().filter(|lost| lost.track == index) {
                track.views_mut()[lost.view].carve(lost.keypoint, &lost.notch);
            }
        }
    }

    /// How many peaks were given to another at this tick, over all viewpoints.
    #[cfg(test)]
    fn n_lost(&self) -> usize {
        self.viewpoints.iter().map(|c| c.notches.len()).sum()
    }
}

/// A peak that somebody loses.
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

    /// Gives each place to one claim, and notes what the others lose.
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
        // As many ways to go without as there are claims.
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
