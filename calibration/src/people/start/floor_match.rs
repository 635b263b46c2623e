//! The relative position of two cameras' floors: a rotation about the vertical and a shift, from the paths of feet.
//!
//! Identities are unknown. Every tracklet of one camera with every simultaneous one of the other proposes a motion of the
//! plane, and so do pairs of these; the feet of all others vote.

use std::collections::BTreeMap;

use nalgebra::Vector2;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Least number of ticks that two tracklets share.
const LEAST_SHARED: usize = 5;
/// Least root mean square distance of feet from their middle for their path to determine a rotation, metres.
const LEAST_SPREAD_M: f64 = 0.35;
/// Largest distance of matching feet: a constant part.
const GATE_M: f64 = 0.35;
/// The part that is relative to their distances from both cameras.
const GATE_SHARE: f64 = 0.05;
/// Two motions differ if their rotations differ by more, or their shifts by three gates.
const SAME_RAD: f64 = 0.2;
/// Number of motions that are kept.
const MOST_KEPT: usize = 4;

/// The feet of a camera by tick: (tracklet, position).
pub(in crate::people) type Feet = BTreeMap<i64, Vec<(usize, Vector2<f64>)>>;

/// The effort of a search.
#[derive(Debug, Clone, Copy)]
pub(in crate::people) struct Effort {
    /// Most motions proposed by one pair of tracklets, and by two.
    single: usize,
    double: usize,
    /// Ticks at which feet vote.
    ticks: usize,
}

impl Effort {
    pub(in crate::people) const FULL: Self = Self {
        single: 800,
        double: 1500,
        ticks: 80,
    };
    /// For one of hundreds of lags.
    pub(in crate::people) const QUICK: Self = Self {
        single: 120,
        double: 0,
        ticks: 40,
    };
}

/// The position of a foot in both cameras.
type FootPair = (Vector2<f64>, Vector2<f64>);

/// b = R(angle) a + shift.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::people) struct PlaneMotion {
    pub(in crate::people) angle_rad: f64,
    pub(in crate::people) shift_m: Vector2<f64>,
    /// The share of feet that agree.
    pub(in crate::people) score: f64,
}

impl PlaneMotion {
    pub(in crate::people) fn apply(&self, a: &Vector2<f64>) -> Vector2<f64> {
        let (s, c) = (libm::sin(self.angle_rad), libm::cos(self.angle_rad));
        Vector2::new(c * a.x - s * a.y, s * a.x + c * a.y) + self.shift_m
    }

    /// Least squares.
    fn fit(pairs: &[FootPair], least_spread_m: f64) -> Option<Self> {
        let count = pairs.len() as f64;
        let sum = pairs
            .iter()
            .fold((Vector2::zeros(), Vector2::zeros()), |s, p| {
                (s.0 + p.0, s.1 + p.1)
            });
        let (middle_a, middle_b) = (sum.0 / count, sum.1 / count);
        let (mut dot, mut cross, mut spread) = (0.0, 0.0, 0.0);
        for (a, b) in pairs {
            let (a, b) = (a - middle_a, b - middle_b);
            dot += a.dot(&b);
            cross += a.perp(&b);
            spread += a.norm_squared().min(b.norm_squared());
        }
        if count < 2.0 || (spread / count).sqrt() < least_spread_m {
            return None;
        }
        let turned = Self {
            angle_rad: libm::atan2(cross, dot),
            shift_m: Vector2::zeros(),
            score: 0.0,
        };
        Some(Self {
            shift_m: middle_b - turned.apply(&middle_a),
            ..turned
        })
    }
}

/// The ticks of `a` that `b` also has, `late` ticks earlier.
pub(in crate::people) fn shared_ticks(a: &Feet, b: &Feet, late: i64) -> Vec<i64> {
    let (Some(first), Some(last)) = (b.keys().next(), b.keys().next_back()) else {
        return Vec::new();
    };
    let between = a.range(first + late..=last + late).map(|(tick, _)| *tick);
    between
        .filter(|tick| b.contains_key(&(tick - late)))
        .collect()
}

/// Motions on which many feet agree, the best first; the ticks of `b` are `late` too low.
pub(in crate::people) fn motions(
    a: &Feet,
    b: &Feet,
    late: i64,
    effort: Effort,
    seed: u64,
) -> Vec<PlaneMotion> {
    let ticks = shared_ticks(a, b, late);
    let shared = shared_tracklets(a, b, late, &ticks, effort.single);
    if ticks.is_empty() {
        return Vec::new();
    }
    let stride = ticks.len().div_ceil(effort.ticks);
    let ticks: Vec<i64> = ticks.into_iter().step_by(stride).collect();
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut found = Vec::new();
    let step = shared.len().div_ceil(effort.single).max(1);
    for pairs in shared.iter().step_by(step) {
        found.extend(PlaneMotion::fit(pairs, LEAST_SPREAD_M));
    }
    if shared.len() >= 2 {
        for _ in 0..effort.double {
            let (i, j) = (
                rng.random_range(0..shared.len()),
                rng.random_range(0..shared.len()),
            );
            if i == j {
                continue;
            }
            let both: Vec<_> = shared[i].iter().chain(&shared[j]).copied().collect();
            found.extend(PlaneMotion::fit(&both, LEAST_SPREAD_M));
        }
    }
    let mut scored: Vec<PlaneMotion> = found
        .into_iter()
        .map(|it| settled(it, a, b, late, &ticks, 0))
        .collect();
    scored.sort_by(|x, y| y.score.total_cmp(&x.score));
    // Only the best are refined.
    let mut kept: Vec<PlaneMotion> = Vec::new();
    for it in scored {
        if kept.iter().any(|other| is_same(other, &it)) {
            continue;
        }
        kept.push(it);
        if kept.len() >= 2 * MOST_KEPT {
            break;
        }
    }
    let mut kept: Vec<PlaneMotion> = kept
        .into_iter()
        .map(|it| settled(it, a, b, late, &ticks, 3))
        .collect();
    kept.sort_by(|x, y| y.score.total_cmp(&x.score));
    kept.truncate(MOST_KEPT);
    kept
}

fn is_same(a: &PlaneMotion, b: &PlaneMotion) -> bool {
    let turn = a.angle_rad - b.angle_rad;
    let turn = libm::atan2(libm::sin(turn), libm::cos(turn)).abs();
    turn < SAME_RAD && (a.shift_m - b.shift_m).norm() < 3.0 * GATE_M
}

fn shared_tracklets(
    a: &Feet,
    b: &Feet,
    late: i64,
    ticks: &[i64],
    most: usize,
) -> Vec<Vec<FootPair>> {
    let mut shared: BTreeMap<(usize, usize), Vec<FootPair>> = BTreeMap::new();
    for tick in ticks {
        for (i, at_a) in a.get(tick).into_iter().flatten() {
            for (j, at_b) in b.get(&(tick - late)).into_iter().flatten() {
                shared.entry((*i, *j)).or_default().push((*at_a, *at_b));
            }
        }
    }
    let mut shared: Vec<_> = shared
        .into_values()
        .filter(|pairs| pairs.len() >= LEAST_SHARED)
        .collect();
    // The longest determine the motion best.
    shared.sort_by_key(|pairs| std::cmp::Reverse(pairs.len()));
    shared.truncate(2 * most);
    shared
}

/// Refits the motion up to `rounds` times to the feet that agree with it, and sets its score.
fn settled(
    mut motion: PlaneMotion,
    a: &Feet,
    b: &Feet,
    late: i64,
    ticks: &[i64],
    rounds: usize,
) -> PlaneMotion {
    for round in 0..=rounds {
        let (score, pairs) = votes(&motion, a, b, late, ticks);
        motion.score = score;
        if round == rounds {
            break;
        }
        let Some(next) = PlaneMotion::fit(&pairs, LEAST_SPREAD_M) else {
            break;
        };
        let (score, _) = votes(&next, a, b, late, ticks);
        if score <= motion.score {
            break;
        }
        motion = PlaneMotion { score, ..next };
    }
    motion
}

/// The share of agreeing feet, relative to the camera that sees fewer, and the agreeing pairs.
fn votes(
    motion: &PlaneMotion,
    a: &Feet,
    b: &Feet,
    late: i64,
    ticks: &[i64],
) -> (f64, Vec<FootPair>) {
    let (mut agreeing, mut possible) = (0.0, 0.0);
    let mut pairs = Vec::new();
    for tick in ticks {
        let (Some(own), Some(others)) = (a.get(tick), b.get(&(tick - late))) else {
            continue;
        };
        possible += own.len().min(others.len()) as f64;
        let mut taken = vec![false; others.len()];
        for (_, at_a) in own {
            let moved = motion.apply(at_a);
            let each = others.iter().enumerate().filter(|(j, _)| !taken[*j]);
            let nearest = each
                .map(|(j, (_, at_b))| (j, at_b, (moved - at_b).norm()))
                .min_by(|x, y| x.2.total_cmp(&y.2));
            let Some((j, at_b, distance)) = nearest else {
                continue;
            };
            let gate = GATE_M + GATE_SHARE * (at_a.norm() + at_b.norm());
            if distance < gate {
                taken[j] = true;
                agreeing += 1.0 - (distance / gate) * (distance / gate);
                pairs.push((*at_a, *at_b));
            }
        }
    }
    (agreeing / f64::max(possible, 1.0), pairs)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn four_walkers_without_identities_determine_the_motion_of_the_plane() {
        let truth = PlaneMotion {
            angle_rad: 2.4,
            shift_m: Vector2::new(3.0, -7.0),
            score: 0.0,
        };
        let (mut a, mut b) = (Feet::new(), Feet::new());
        for tick in 0..100_i64 {
            let t = tick as f64 * 0.1;
            for person in 0..4 {
                let phase = 1.7 * person as f64;
                let at = Vector2::new(
                    3.0 * libm::sin(0.5 * t + phase),
                    2.0 * libm::cos(0.37 * t + 2.0 * phase),
                );
                a.entry(tick).or_default().push((person, at));
                b.entry(tick)
                    .or_default()
                    .push((3 - person, truth.apply(&at)));
            }
        }
        let found = motions(&a, &b, 0, Effort::FULL, 1);
        let best = found.first().unwrap();
        let off = best.angle_rad - truth.angle_rad;
        assert!(libm::sin(off).abs() < 1e-6 && libm::cos(off) > 0.0);
        assert!((best.shift_m - truth.shift_m).norm() < 1e-6);
    }
}
