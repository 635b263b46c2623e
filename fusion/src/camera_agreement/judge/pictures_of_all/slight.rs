//! Pictures that were all zoomed or cut by some percent: most cameras agree well enough then, and single ones seem to be turned
//! or moved.
//!
//! ```text
//!   u = s (u' - c) + c   or   u = u' + t        u': shown, u: meant, pixels; c: the middle of the picture
//! ```
//!
//! What one camera has wrong moves neither s nor t: a fault of one camera is none of the others.

use std::collections::BTreeMap;

use super::super::super::pairs::{HALF_COST_M, best_matches};
use super::super::super::report::{AgreementReport, DisagreementCause};
use super::super::super::samples::COMPARED;
use super::super::Judge;
use super::change::{Change, Deed, LEAST_CUT};
use super::compared::{BodyRays, Closeness, Compared, cost_of};

/// Pairs of cameras that are compared.
const PAIRS: usize = 24;
/// Least pairs of sightings that tell, and of how many pairs of cameras.
const MIN_MATCHES: usize = 20;
/// So many are looked at: each is tried with some eighty changes.
const MOST_MATCHES: usize = 360;
const MIN_PAIRS: usize = 3;
/// First steps: shifts as shares of the picture, logarithms of the scale. Where none of them leaves less nothing is looked for.
const FIRST_STEP: f64 = 0.03;
const ROUNDS: usize = 14;
const SHORTER: f64 = 0.7;
/// Most that is little, as shares and as a logarithm: cameras side by side tell nothing of some shifts, however far.
const MOST: f64 = 0.2;
/// What right cameras leave of the cost is 0.99 at least, and of theirs a zoom of 0.005 at most.
const LEAVES: f64 = 0.82;
const LEAST_ZOOM: f64 = 0.05;
/// What the one change must leave as a share of what the other leaves, which explains a part of it.
const STANDS_OUT: f64 = 0.9;
/// The same of pictures that were cut, where other focal lengths of several cameras are told of, which explain a part of it, too.
const STANDS_OUT_OF_LENSES: f64 = 0.5;
/// Of so many pairs of cameras the cost must be less, each by more than chance has it.
const MOST_PAIRS: f64 = 0.75;
const LEAVES_OF_PAIR: f64 = 0.95;

/// Two sightings that are of one person: the pass, the two cameras, and which sighting of each.
struct Match {
    pass: usize,
    cameras: (usize, usize),
    bodies: [usize; 2],
}

impl Match {
    /// Of each the pass, the camera, and which of those that it has there.
    fn sightings(&self) -> [[usize; 3]; 2] {
        let (a, b) = self.cameras;
        let [one, other] = self.bodies;
        [[self.pass, a, one], [self.pass, b, other]]
    }
}

/// What a change leaves.
struct Fit {
    change: Change,
    /// Of the cost of all.
    ratio: f64,
    /// In which share of the pairs of cameras it leaves less.
    better: f64,
}

impl Judge<'_> {
    /// What was done to all pictures alike, by little. Where other lenses of several cameras are told of already that is it, but that
    /// pictures which were cut may look zoomed.
    pub(super) fn changed_slightly(
        &self,
        pairs: &[(usize, usize)],
        report: &AgreementReport,
    ) -> Option<DisagreementCause> {
        let is_told_of_several = |is: fn(&DisagreementCause) -> bool| {
            let mut told = report.disagreements.iter();
            told.any(|told| told.cameras.len() > 1 && is(&told.cause))
        };
        if is_told_of_several(|cause| {
            matches!(
                cause,
                DisagreementCause::Distortion { .. } | DisagreementCause::LensKind { .. }
            )
        }) || self.are_several_late(report)
        {
            return None;
        }
        let compared = self.compared(pairs, (PAIRS, COMPARED));
        let matches = compared.matches();
        let step = matches.len().div_ceil(MOST_MATCHES).max(1);
        let matches: Vec<Match> = matches.into_iter().step_by(step).collect();
        if matches.len() < MIN_MATCHES {
            return None;
        }
        let [cut, zoomed] = [Deed::Cut, Deed::Zoomed].map(|deed| compared.fitted(deed, &matches));
        let left = |fit: &Option<Fit>| fit.as_ref().map_or(1.0, |fit| fit.ratio);
        let (of_cut, of_zoomed) = (left(&cut), left(&zoomed));
        let is_told = |fit: &Fit| fit.ratio < LEAVES && fit.better >= MOST_PAIRS;
        let aside = |fit: &Fit| {
            let [x, y] = fit.change.shift.map(f64::abs);
            x.max(y)
        };
        let are_lenses_told =
            is_told_of_several(|cause| matches!(cause, DisagreementCause::FocalLength { .. }));
        let stands_out = if are_lenses_told {
            STANDS_OUT_OF_LENSES
        } else {
            STANDS_OUT
        };
        if of_cut < stands_out * of_zoomed {
            let is_cut = |fit: &Fit| is_told(fit) && (LEAST_CUT..=MOST).contains(&aside(fit));
            let fit = cut.filter(is_cut)?;
            let change = fit.change.name()?;
            return Some(DisagreementCause::PictureOfAll { change });
        }
        if are_lenses_told {
            return None;
        }
        let zoom = |fit: &Fit| libm::log(fit.change.scale[0]).abs();
        let is_zoom = |fit: &Fit| is_told(fit) && (LEAST_ZOOM..=MOST).contains(&zoom(fit));
        let fit = zoomed.filter(|fit| of_zoomed < STANDS_OUT * of_cut && is_zoom(fit))?;
        // Who shows keypoints too far out has a longer lens.
        let factor = (1000.0 / fit.change.scale[0]).round() / 1000.0;
        Some(DisagreementCause::FocalLength { factor })
    }
}

impl Compared<'_> {
    /// Each sighting with the one of the other camera that fits it best as all is.
    fn matches(&self) -> Vec<Match> {
        let closeness = Closeness::of(HALF_COST_M);
        let mut all = Vec::new();
        for (index, pass) in self.passes.iter().enumerate() {
            let rays = self.rays(pass, (&Change::NONE, closeness));
            for &(a, b) in &self.pairs {
                let (few, many) = if rays[a].len() <= rays[b].len() {
                    (a, b)
                } else {
                    (b, a)
                };
                let cost = |own: usize, other: usize| {
                    self.cost((few, many), [&rays[few][own], &rays[many][other]])
                };
                let best = best_matches(rays[few].len(), rays[many].len(), cost);
                all.extend(best.into_iter().map(|bodies| Match {
                    pass: index,
                    cameras: (few, many),
                    bodies,
                }));
            }
        }
        all
    }

    fn cost(&self, (a, b): (usize, usize), bodies: [&BodyRays; 2]) -> Option<f64> {
        let centers_m = [a, b].map(|camera| &self.cameras[camera].lines.center_m);
        cost_of(centers_m, bodies, Closeness::of(HALF_COST_M))
    }

    /// The mean cost of each pair of cameras with all pictures changed so, and how many sightings it is of.
    fn costs(&self, change: &Change, matches: &[Match]) -> BTreeMap<(usize, usize), (f64, usize)> {
        let closeness = Closeness::of(HALF_COST_M);
        let mut rays: BTreeMap<[usize; 3], BodyRays> = BTreeMap::new();
        for shown in matches.iter().flat_map(Match::sightings) {
            let of = || self.rays_of(shown, (change, closeness));
            rays.entry(shown).or_insert_with(of);
        }
        let mut costs: BTreeMap<(usize, usize), (f64, usize)> = BTreeMap::new();
        for of in matches {
            let (a, b) = of.cameras;
            let bodies = of.sightings().map(|shown| &rays[&shown]);
            // What a change makes impossible is no better.
            let cost = self.cost(of.cameras, bodies).unwrap_or(1.0);
            let (sum, n) = costs.entry((a.min(b), a.max(b))).or_default();
            *sum += cost;
            *n += 1;
        }
        costs
    }

    /// With as much of a deed as leaves the least; `None` where nothing is less with a little of it.
    fn fitted(&self, deed: Deed, matches: &[Match]) -> Option<Fit> {
        let mean = |change: &Change| {
            let costs = self.costs(change, matches);
            costs.values().map(|(sum, _)| sum).sum::<f64>() / matches.len() as f64
        };
        let none = Change::nothing_of(deed);
        let before = mean(&none).max(f64::MIN_POSITIVE);
        let (mut change, mut cost) = (none, before);
        let mut step = FIRST_STEP;
        for round in 0..ROUNDS {
            let unchanged = change;
            for axis in deed.axes() {
                for by in [step, -step] {
                    let tried = change.with(axis, by);
                    let of_tried = mean(&tried);
                    if of_tried < cost {
                        (change, cost) = (tried, of_tried);
                    }
                }
            }
            if round == 0 && change == none {
                return None;
            }
            if change == unchanged {
                step *= SHORTER;
            }
        }
        let (before_by_pair, by_pair) = (self.costs(&none, matches), self.costs(&change, matches));
        let pairs = before_by_pair.iter().zip(&by_pair);
        let better = pairs
            .filter(|((_, (before, _)), (_, (after, _)))| *after < LEAVES_OF_PAIR * before)
            .count();
        let n_pairs = by_pair.len();
        (n_pairs >= MIN_PAIRS).then(|| Fit {
            change,
            ratio: cost / before,
            better: better as f64 / n_pairs as f64,
        })
    }
}
