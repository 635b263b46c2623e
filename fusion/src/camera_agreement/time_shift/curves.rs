//! What two cameras cost beside each other, over the time by which one is moved against the other.
//!
//! Distances between lines of sight are looked at once for all who ask. What each burst costs is kept by shift and by half of the
//! keypoints; what all bursts tell, one of them, or a half, is a sum of these. A burst that has ended does not change: who
//! judges again hands in what is known of it already.

use std::collections::BTreeMap;
use std::sync::Arc;

use nalgebra::Vector3;

use super::super::geometry::{SightLines, meeting};
use super::super::pairs::cost;
use super::super::samples::found::Found;
use super::super::samples::{Burst, Trail};
use super::{KeypointHalf, LONGEST_S, index, least};

/// Keypoints that must have been compared at a shift.
const MIN_COMPARED: usize = 60;
/// One in so many of the keypoints that are compared where most are must be compared at a shift for it to tell.
const OVERLAP: usize = 2;
/// Of the ticks of a burst every so many are compared at first; later, near the least cost, all.
const COARSE_TICKS: usize = 3;
/// So many shifts beside the least cost, and beside none, are looked at again.
const BESIDE: isize = 2;
/// Other cameras that one is compared with.
const MAX_PARTNERS: usize = 5;

/// Of two cameras: the mean cost by shift, from `-reach` to `reach` ticks; not a number where nothing is known.
pub(super) struct Curve {
    pub(super) a: usize,
    pub(super) b: usize,
    pub(super) costs: Vec<f64>,
}

/// What a curve is drawn of: a half of the keypoints, in all bursts or in one of them.
#[derive(Debug, Clone, Copy)]
pub(super) struct CurvePart {
    pub(super) half: KeypointHalf,
    pub(super) burst: Option<usize>,
}

/// What two cameras cost in a burst at a shift, summed, and how many keypoints that is of: of the even and of the odd pairs.
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

    /// How many keypoints were compared.
    fn compared(&self) -> usize {
        self.compared[0] + self.compared[1]
    }

    /// Not a number where too little is known.
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

/// What pairs of cameras cost in a burst, as far as was asked.
#[derive(Debug, Default)]
pub(in crate::camera_agreement) struct BurstCosts {
    /// Of some ticks, from the lowest shift on.
    coarse: BTreeMap<(usize, usize), Vec<SummedCost>>,
    /// Of all ticks, by shift.
    fine: BTreeMap<((usize, usize), isize), SummedCost>,
}

/// What cameras cost beside each other in some bursts.
pub(in crate::camera_agreement) struct ShiftCosts<'a> {
    bursts: Vec<LookedAt<'a>>,
    lines: &'a [SightLines],
    /// Longest shift that is looked for, ticks.
    pub(super) reach: usize,
}

impl<'a> ShiftCosts<'a> {
    /// In `bursts`, of cameras with these `lines`; what was `found` already is taken out of there.
    pub(in crate::camera_agreement) fn of(
        bursts: &[&'a Arc<Burst>],
        lines: &'a [SightLines],
        rate_hz: f64,
        found: &mut Found<Burst, BurstCosts>,
    ) -> Self {
        let looked_at = |burst: &&'a Arc<Burst>| LookedAt {
            burst,
            drawn: burst.trails.iter().map(|_| None).collect(),
            costs: found.take(burst).unwrap_or_default(),
        };
        Self {
            bursts: bursts.iter().map(looked_at).collect(),
            lines,
            reach: (LONGEST_S * rate_hz).round().max(1.0) as usize,
        }
    }

    /// What is found by now.
    pub(in crate::camera_agreement) fn into_found(self) -> Found<Burst, BurstCosts> {
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

    /// Of every camera those beside some others.
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
        // Of a few ticks little is left once what stays the same is left out, whatever they show.
        let is_known = |sum: &SummedCost| OVERLAP * sum.compared() >= most;
        let means = sums.iter().map(|sum| {
            if is_known(sum) {
                sum.mean(part.half)
            } else {
                f64::NAN
            }
        });
        let mut costs: Vec<f64> = means.collect();
        let near = least(&costs)?.0.cast_signed() - reach.cast_signed();
        for shift in (near - BESIDE..=near + BESIDE).chain(-BESIDE..=BESIDE) {
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

/// A burst, and what was found in it.
struct LookedAt<'a> {
    burst: &'a Arc<Burst>,
    /// Per trail its lines of sight, once they were needed.
    drawn: Vec<Option<Drawn>>,
    costs: BurstCosts,
}

impl LookedAt<'_> {
    /// Of some ticks, from the lowest shift on.
    fn coarse(
        &mut self,
        pair: (usize, usize),
        lines: &[SightLines],
        reach: usize,
    ) -> &[SummedCost] {
        if !self.costs.coarse.contains_key(&pair) {
            let trails = self.drawn_of(pair, lines);
            let shifts = -reach.cast_signed()..=reach.cast_signed();
            let mut buffers = Buffers::default();
            let costs = shifts.map(|shift| self.at(&trails, (shift, COARSE_TICKS), &mut buffers));
            let costs = costs.collect();
            self.costs.coarse.insert(pair, costs);
        }
        &self.costs.coarse[&pair]
    }

    /// Of all ticks.
    fn fine(&mut self, pair: (usize, usize), lines: &[SightLines], shift: isize) -> SummedCost {
        if let Some(known) = self.costs.fine.get(&(pair, shift)) {
            return *known;
        }
        let trails = self.drawn_of(pair, lines);
        let cost = self.at(&trails, (shift, 1), &mut Buffers::default());
        self.costs.fine.insert((pair, shift), cost);
        cost
    }

    /// The trails of one person in both cameras; their lines of sight are drawn then.
    fn drawn_of(&mut self, (a, b): (usize, usize), lines: &[SightLines]) -> Vec<(usize, usize)> {
        let trails = &self.burst.trails;
        let of = |camera: usize| (0..trails.len()).filter(move |&at| trails[at].camera == camera);
        let pairs = of(a).filter_map(|first| {
            let is_same = |&second: &usize| trails[second].person == trails[first].person;
            Some((first, of(b).find(is_same)?))
        });
        let pairs: Vec<(usize, usize)> = pairs.collect();
        for at in pairs.iter().flat_map(|&(first, second)| [first, second]) {
            let trail = &trails[at];
            self.drawn[at].get_or_insert_with(|| Drawn::of(trail, &lines[trail.camera]));
        }
        pairs
    }

    /// What these trails cost at a shift, of every so many ticks.
    fn at(
        &self,
        trails: &[(usize, usize)],
        (shift, every): (isize, usize),
        buffers: &mut Buffers,
    ) -> SummedCost {
        let mut sum = SummedCost::default();
        for &(first, second) in trails {
            if let (Some(first), Some(second)) = (&self.drawn[first], &self.drawn[second]) {
                first.compare(second, (shift, every), buffers, &mut sum);
            }
        }
        sum
    }
}

/// What is used again from comparison to comparison.
#[derive(Default)]
struct Buffers {
    /// Ticks that are compared, each with that of the other which is before its instant, and the share of the way to the next.
    ticks: Vec<(usize, usize, f64)>,
    gaps_m: Vec<f64>,
}

/// What the distances of one keypoint cost beyond what stays the same, summed. Puts them in another order.
fn cost_of_change(gaps_m: &mut [f64]) -> f64 {
    if gaps_m.is_empty() {
        return 0.0;
    }
    let (_, middle_m, _) = gaps_m.select_nth_unstable_by(gaps_m.len() / 2, f64::total_cmp);
    let middle_m = *middle_m;
    gaps_m.iter().map(|gap_m| cost(gap_m - middle_m)).sum()
}

/// The lines of sight of a trail.
struct Drawn {
    center_m: Vector3<f64>,
    /// Per tick: when its picture was taken, ticks after it.
    late: Vec<Option<f64>>,
    n_keypoints: usize,
    /// Per keypoint all ticks; zero where it is not seen.
    directions: Vec<Vector3<f64>>,
}

impl Drawn {
    fn of(trail: &Trail, lines: &SightLines) -> Self {
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

    /// Where a keypoint is seen, by tick.
    fn keypoint(&self, keypoint: usize) -> &[Vector3<f64>] {
        let n_ticks = self.late.len();
        &self.directions[keypoint * n_ticks..][..n_ticks]
    }

    /// Adds what keypoints cost where `other` is looked up `shift` ticks after this.
    fn compare(
        &self,
        other: &Self,
        (shift, every): (isize, usize),
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

    /// The tick before the instant `late` ticks after `at`, and the share of the way to the next.
    fn around(&self, at: isize, late: f64) -> Option<(usize, f64)> {
        let at = usize::try_from(at).ok()?;
        let own = (*self.late.get(at)?)?;
        // How far the own picture of that tick is from the instant.
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
