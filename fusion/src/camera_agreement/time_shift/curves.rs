//! The cost between two cameras over the time shift between them.
//!
//! Distances between lines of sight are computed once. The costs of each burst are cached by shift
//! and by half of the keypoints. The cost of all bursts, of one burst or of one half is a sum of
//! these. A burst that has ended does not change, so the caller can pass in its cached costs.

use std::collections::BTreeMap;
use std::sync::Arc;

use nalgebra::Vector3;

use super::super::geometry::{SightLines, meeting};
use super::super::pairs::cost;
use super::super::samples::{Burst, ResultCache, Trail};
use super::{KeypointHalf, MAX_SHIFT_S, index, least};

/// Least number of compared keypoints at a shift.
const MIN_COMPARED: usize = 60;
/// A shift is known if it has at least one in so many of the largest number of compared keypoints.
const MIN_OVERLAP_ONE_IN: usize = 2;
/// Step of the coarse search through the ticks of a burst. The fine search takes all ticks.
const COARSE_TICKS: usize = 3;
/// The fine search covers so many shifts on each side of the least coarse cost and of no shift.
const FINE_REACH_TICKS: isize = 2;
/// Largest number of cameras that each camera is compared with.
const MAX_PARTNERS: usize = 5;

/// The mean cost of two cameras by shift, from `-reach` to `reach` ticks; NaN if unknown.
pub(super) struct Curve {
    pub(super) a: usize,
    pub(super) b: usize,
    pub(super) costs: Vec<f64>,
}

/// The samples of a curve: a half of the keypoints, in all bursts or in one of them.
#[derive(Debug, Clone, Copy)]
pub(super) struct CurvePart {
    pub(super) half: KeypointHalf,
    pub(super) burst: Option<usize>,
}

/// The summed cost of two cameras in a burst at a shift, and the number of compared keypoints;
/// each for the even and for the odd pairs.
#[derive(Debug, Clone, Copy, Default)]
struct SummedCost {
    sums: [f64; 2],
    compared: [usize; 2],
}

impl SummedCost {
    fn add(&mut self, other: &Self) {
        for half in 0..2 {
            self.sums[half] += other.sums[half];
            self.compared[half] += other.compared[half];
        }
    }

    fn compared(&self) -> usize {
        self.compared[0] + self.compared[1]
    }

    /// NaN if too few keypoints were compared.
    fn mean(&self, half: KeypointHalf) -> f64 {
        let (sum, n) = match half {
            KeypointHalf::All => (
                self.sums[0] + self.sums[1],
                self.compared[0] + self.compared[1],
            ),
            KeypointHalf::EvenPairs => (self.sums[0], self.compared[0]),
            KeypointHalf::OddPairs => (self.sums[1], self.compared[1]),
        };
        if n >= MIN_COMPARED {
            sum / n as f64
        } else {
            f64::NAN
        }
    }
}

/// The costs of pairs of cameras in a burst that were computed so far.
#[derive(Debug, Default)]
pub(in crate::camera_agreement) struct BurstCosts {
    /// From every `COARSE_TICKS`th tick; by shift, the lowest first.
    coarse: BTreeMap<(usize, usize), Vec<SummedCost>>,
    /// From all ticks, by shift.
    fine: BTreeMap<((usize, usize), isize), SummedCost>,
}

/// The costs between cameras in some bursts.
pub(in crate::camera_agreement) struct ShiftCosts<'a> {
    bursts: Vec<ComparedBurst<'a>>,
    lines: &'a [SightLines],
    /// Longest shift of the search, ticks.
    pub(super) reach: usize,
}

impl<'a> ShiftCosts<'a> {
    /// For `bursts` and cameras with these `lines`. Costs of these bursts are taken out of `cache`.
    pub(in crate::camera_agreement) fn new(
        bursts: &[&'a Arc<Burst>],
        lines: &'a [SightLines],
        rate_hz: f64,
        cache: &mut ResultCache<Burst, BurstCosts>,
    ) -> Self {
        let compared = |burst: &&'a Arc<Burst>| ComparedBurst {
            burst,
            rays: burst.trails.iter().map(|_| None).collect(),
            costs: cache.take(burst).unwrap_or_default(),
        };
        Self {
            bursts: bursts.iter().map(compared).collect(),
            lines,
            reach: (MAX_SHIFT_S * rate_hz).round().max(1.0) as usize,
        }
    }

    /// The costs that were computed so far.
    pub(in crate::camera_agreement) fn into_cache(self) -> ResultCache<Burst, BurstCosts> {
        let bursts = self.bursts.into_iter();
        bursts
            .map(|own| (Arc::clone(own.burst), own.costs))
            .collect()
    }

    pub(super) fn n_cameras(&self) -> usize {
        self.lines.len()
    }

    pub(super) fn bursts(&self) -> impl ExactSizeIterator<Item = &'a Burst> + use<'a, '_> {
        self.bursts.iter().map(|own| own.burst.as_ref())
    }

    /// The curves of every camera with some others.
    pub(super) fn curves(&mut self, part: CurvePart) -> Vec<Curve> {
        let mut curves: Vec<Curve> = Vec::new();
        for a in 0..self.lines.len() {
            let compared = curves.iter().filter(|c| c.b == a).count();
            let mut left = MAX_PARTNERS.saturating_sub(compared);
            for b in a + 1..self.lines.len() {
                if left == 0 {
                    break;
                }
                if let Some(costs) = self.curve((a, b), part) {
                    curves.push(Curve { a, b, costs });
                    left -= 1;
                }
            }
        }
        curves
    }

    /// The mean cost between two cameras over the shift of the second against the first.
    fn curve(&mut self, pair: (usize, usize), part: CurvePart) -> Option<Vec<f64>> {
        let (a, b) = pair;
        if (self.lines[a].center_m - self.lines[b].center_m).norm() < 1e-6 {
            return None;
        }
        let (lines, reach) = (self.lines, self.reach);
        let bursts = match part.burst {
            Some(burst) => self.bursts.get_mut(burst..=burst)?,
            None => &mut self.bursts[..],
        };
        let mut sums = vec![SummedCost::default(); 2 * reach + 1];
        for burst in &mut *bursts {
            let coarse = burst.coarse(pair, lines, reach);
            for (sum, own) in sums.iter_mut().zip(coarse) {
                sum.add(own);
            }
        }
        let most = sums.iter().map(SummedCost::compared).max().unwrap_or(0);
        // If few ticks overlap, little cost is left without the constant part, at any shift.
        let is_known = |sum: &SummedCost| MIN_OVERLAP_ONE_IN * sum.compared() >= most;
        let means = sums.iter().map(|sum| {
            if is_known(sum) {
                sum.mean(part.half)
            } else {
                f64::NAN
            }
        });
        let mut costs: Vec<f64> = means.collect();
        let near = least(&costs)?.0.cast_signed() - reach.cast_signed();
        let fine = near - FINE_REACH_TICKS..=near + FINE_REACH_TICKS;
        for shift in fine.chain(-FINE_REACH_TICKS..=FINE_REACH_TICKS) {
            if shift.unsigned_abs() <= reach {
                let mut all = SummedCost::default();
                for burst in &mut *bursts {
                    all.add(&burst.fine(pair, lines, shift));
                }
                costs[index(shift, reach)] = all.mean(part.half);
            }
        }
        Some(costs)
    }
}

/// A burst and the costs in it.
struct ComparedBurst<'a> {
    burst: &'a Arc<Burst>,
    /// Lines of sight per trail, computed when needed.
    rays: Vec<Option<TrailRays>>,
    costs: BurstCosts,
}

impl ComparedBurst<'_> {
    /// The costs from every `COARSE_TICKS`th tick; by shift, the lowest first.
    fn coarse(
        &mut self,
        pair: (usize, usize),
        lines: &[SightLines],
        reach: usize,
    ) -> &[SummedCost] {
        if !self.costs.coarse.contains_key(&pair) {
            let trails = self.trail_pairs(pair, lines);
            let shifts = -reach.cast_signed()..=reach.cast_signed();
            let mut buffers = Buffers::default();
            let costs = shifts.map(|shift| self.cost(&trails, shift, COARSE_TICKS, &mut buffers));
            let costs = costs.collect();
            self.costs.coarse.insert(pair, costs);
        }
        &self.costs.coarse[&pair]
    }

    /// The cost from all ticks.
    fn fine(&mut self, pair: (usize, usize), lines: &[SightLines], shift: isize) -> SummedCost {
        if let Some(known) = self.costs.fine.get(&(pair, shift)) {
            return *known;
        }
        let trails = self.trail_pairs(pair, lines);
        let cost = self.cost(&trails, shift, 1, &mut Buffers::default());
        self.costs.fine.insert((pair, shift), cost);
        cost
    }

    /// The pairs of trails of one person in both cameras. Computes their lines of sight.
    fn trail_pairs(&mut self, (a, b): (usize, usize), lines: &[SightLines]) -> Vec<(usize, usize)> {
        let trails = &self.burst.trails;
        let in_camera =
            |camera: usize| (0..trails.len()).filter(move |&at| trails[at].camera == camera);
        let pairs = in_camera(a).filter_map(|first| {
            let is_same = |&second: &usize| trails[second].person == trails[first].person;
            Some((first, in_camera(b).find(is_same)?))
        });
        let pairs: Vec<(usize, usize)> = pairs.collect();
        for at in pairs.iter().flat_map(|&(first, second)| [first, second]) {
            let trail = &trails[at];
            self.rays[at].get_or_insert_with(|| TrailRays::new(trail, &lines[trail.camera]));
        }
        pairs
    }

    /// The cost of these pairs of trails at a shift, from every `every`th tick.
    fn cost(
        &self,
        trails: &[(usize, usize)],
        shift: isize,
        every: usize,
        buffers: &mut Buffers,
    ) -> SummedCost {
        let mut sum = SummedCost::default();
        for &(first, second) in trails {
            if let (Some(first), Some(second)) = (&self.rays[first], &self.rays[second]) {
                first.compare(second, shift, every, buffers, &mut sum);
            }
        }
        sum
    }
}

/// Memory that comparisons reuse.
#[derive(Default)]
struct Buffers {
    /// Compared ticks; for each, the tick of the other trail just before the same instant, and the
    /// share of the way to its next tick.
    ticks: Vec<(usize, usize, f64)>,
    gaps_m: Vec<f64>,
}

/// The summed cost of the distances of one keypoint from their median. Reorders the distances.
fn cost_of_change(gaps_m: &mut [f64]) -> f64 {
    if gaps_m.is_empty() {
        return 0.0;
    }
    let (_, middle_m, _) = gaps_m.select_nth_unstable_by(gaps_m.len() / 2, f64::total_cmp);
    let middle_m = *middle_m;
    gaps_m.iter().map(|gap_m| cost(gap_m - middle_m)).sum()
}

/// The lines of sight of a trail.
struct TrailRays {
    center_m: Vector3<f64>,
    /// Time of the picture after each tick, ticks.
    late: Vec<Option<f64>>,
    n_keypoints: usize,
    /// All ticks of the first keypoint, then of the next; zero if it is not seen.
    directions: Vec<Vector3<f64>>,
}

impl TrailRays {
    fn new(trail: &Trail, lines: &SightLines) -> Self {
        let ticks = (0..trail.len()).map(|tick| trail.at(tick));
        let n_keypoints = ticks.clone().flatten().map(|(_, seen)| seen.len()).next();
        let n_keypoints = n_keypoints.unwrap_or(0);
        let mut directions = Vec::with_capacity(trail.len() * n_keypoints);
        for keypoint in 0..n_keypoints {
            directions.extend(ticks.clone().map(|seen| {
                let seen = seen.and_then(|(_, seen)| seen.get(keypoint));
                let seen = seen.filter(|seen| seen.score > 0.0);
                seen.map_or_else(Vector3::zeros, |seen| lines.direction(seen.pixel))
            }));
        }
        Self {
            center_m: lines.center_m,
            late: ticks.map(|tick| tick.map(|(late, _)| late)).collect(),
            n_keypoints,
            directions,
        }
    }

    /// The directions of a keypoint by tick.
    fn keypoint(&self, keypoint: usize) -> &[Vector3<f64>] {
        let n_ticks = self.late.len();
        &self.directions[keypoint * n_ticks..][..n_ticks]
    }

    /// Adds the cost to `other`, taken `shift` ticks later, from every `every`th tick.
    fn compare(
        &self,
        other: &Self,
        shift: isize,
        every: usize,
        buffers: &mut Buffers,
        sum: &mut SummedCost,
    ) {
        let Buffers { ticks, gaps_m } = buffers;
        ticks.clear();
        ticks.extend((0..self.late.len()).step_by(every).filter_map(|tick| {
            let (before, share) = other.around(tick.cast_signed() + shift, self.late[tick]?)?;
            Some((tick, before, share))
        }));
        for keypoint in 0..self.n_keypoints.min(other.n_keypoints) {
            let (own, theirs) = (self.keypoint(keypoint), other.keypoint(keypoint));
            gaps_m.clear();
            gaps_m.extend(ticks.iter().filter_map(|&(tick, before, share)| {
                let (p, q) = (&theirs[before], &theirs[before + usize::from(share > 0.0)]);
                if p.norm_squared() == 0.0 || q.norm_squared() == 0.0 {
                    return None;
                }
                let between = p + (q - p) * share;
                let met = meeting((&self.center_m, &own[tick]), (&other.center_m, &between));
                Some(met?.signed_gap_m)
            }));
            let half = usize::from(KeypointHalf::OddPairs.has(keypoint));
            sum.sums[half] += cost_of_change(gaps_m);
            sum.compared[half] += gaps_m.len();
        }
    }

    /// The tick just before the instant `late` ticks after `at`, and the share of the way to its
    /// next tick.
    fn around(&self, at: isize, late: f64) -> Option<(usize, f64)> {
        let at = usize::try_from(at).ok()?;
        let own = (*self.late.get(at)?)?;
        // From the picture of that tick to the instant, ticks.
        let ahead = late - own;
        let whole = ahead.floor();
        let before = usize::try_from(at.cast_signed() + whole as isize).ok()?;
        let share = ahead - whole;
        self.late.get(before).copied().flatten()?;
        if share < 1e-3 {
            return Some((before, 0.0));
        }
        self.late.get(before + 1).copied().flatten()?;
        Some((before, share))
    }
}
