//! How far one camera's clock is behind another's, from nothing but the point's path in both pictures.
//!
//! At the right lag the two see one point at every moment, and one essential matrix explains all of them; at a wrong lag
//! none explains many. The lags are searched from coarse to fine: wide gates first, so that a lag which is off by a step
//! still shows, then ever narrower ones. Moments at which the point stood still in either picture say nothing of time, and
//! are thinned out.

use farfield_proto::order_statistics::value_after;
use nalgebra::Vector3;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use super::view::Track;
use crate::geometry::{TwoViews, least_loss};

/// Widest gate, radians: with a wider one, wrong lags fit too.
const COARSE_GATE_RAD: f64 = 0.008;
/// Moments that are compared in the coarse search and in the fine one.
const COARSE_MOMENTS: usize = 90;
const FINE_MOMENTS: usize = 250;
/// Moments that a lag needs to be looked at.
const LEAST_MOMENTS: usize = 30;
/// Random samples at a coarse and at a fine lag.
const COARSE_SAMPLES: usize = 36;
const FINE_SAMPLES: usize = 120;
/// Lags that are looked at more closely.
const CANDIDATES: usize = 8;
/// Most lags of the coarse search.
const MOST_LAGS: usize = 20_000;
/// Two sights with more time between them are not joined, seconds.
const GAP_S: f64 = 0.35;
/// Least time that both saw the point, seconds.
const LEAST_OVERLAP_S: f64 = 8.0;

/// The clock of a second camera from that of a first: what the first saw at `t`, the second saw at
/// `t + behind_s + drift (t - pivot_s)`, each on its own clock (frames over the nominal rate).
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Lag {
    pub(super) behind_s: f64,
    pub(super) drift: f64,
    pub(super) pivot_s: f64,
    /// 1 when every moment agrees at the finest gate, 0 when none.
    pub(super) agreement: f64,
}

/// A track on its own clock: frames over its nominal rate.
#[derive(Debug, Clone, Copy)]
struct Timed<'a> {
    track: &'a Track,
    rate_hz: f64,
}

impl Timed<'_> {
    fn bearing(&self, time_s: f64) -> Option<Vector3<f64>> {
        let gap = (GAP_S * self.rate_hz).max(1.5);
        Some(self.track.at(time_s * self.rate_hz, gap)?.bearing)
    }

    fn range_s(&self) -> Option<[f64; 2]> {
        let frames = [
            self.track.seen.first()?.frame,
            self.track.seen.last()?.frame,
        ];
        Some(frames.map(|frame| frame / self.rate_hz))
    }

    /// Times at which the point has moved by `step_rad` since the one before.
    fn moving_s(&self, step_rad: f64) -> Vec<(f64, Vector3<f64>)> {
        let mut times: Vec<(f64, Vector3<f64>)> = Vec::new();
        for seen in &self.track.seen {
            let moved = times
                .last()
                .is_none_or(|(_, b)| (b - seen.bearing).norm() > step_rad);
            if moved {
                times.push((seen.frame / self.rate_hz, seen.bearing));
            }
        }
        times
    }

    /// Angle per second that three quarters of the moving moments stay below.
    fn speed(&self, times: &[(f64, Vector3<f64>)]) -> f64 {
        let mut speeds: Vec<f64> = times
            .iter()
            .filter_map(|(t, bearing)| {
                let later = self.bearing(t + 0.2)?;
                Some((later - bearing).norm() / 0.2)
            })
            .collect();
        speeds.sort_by(f64::total_cmp);
        value_after(&speeds, 0.75).unwrap_or(0.0)
    }
}

/// The lag of the second track behind the first, with the rates `rates_hz`; `None` where too little is in common.
pub(super) fn find_lag(
    first: &Track,
    second: &Track,
    rates_hz: [f64; 2],
    gate_px: f64,
    seed: u64,
) -> Option<Lag> {
    let a = Timed {
        track: first,
        rate_hz: rates_hz[0],
    };
    let b = Timed {
        track: second,
        rate_hz: rates_hz[1],
    };
    let fine_rad = gate_px / first.focal_px().min(second.focal_px());
    let step_rad = 2.0 * fine_rad;
    let times = a.moving_s(step_rad);
    let speed = a.speed(&times).max(b.speed(&b.moving_s(step_rad)));
    if speed <= 0.0 {
        return None;
    }
    let gate_rad = COARSE_GATE_RAD.max(fine_rad);
    // At half a step from the truth three quarters of the moments are within the gate.
    let ([a0, a1], [b0, b1]) = (a.range_s()?, b.range_s()?);
    let range = [b0 - a1 + LEAST_OVERLAP_S, b1 - a0 - LEAST_OVERLAP_S];
    let mut step_s = 2.0 * gate_rad / speed;
    step_s = step_s.max((range[1] - range[0]) / MOST_LAGS as f64);
    let count = ((range[1] - range[0]) / step_s).ceil().max(0.0) as usize + 1;
    let coarse = Search {
        a,
        b,
        times: &times,
        seed,
    };
    let mut lags: Vec<(f64, f64)> = (0..count)
        .into_par_iter()
        .map(|k| {
            let lag_s = range[0] + k as f64 * step_s;
            let pairs = coarse.pairs(lag_s, 0.0, 0.0, COARSE_MOMENTS);
            let agreement = coarse.agreement(&pairs, gate_rad, COARSE_SAMPLES, 0.75, k as u64);
            (lag_s, agreement)
        })
        .collect();
    lags.sort_by(|x, y| y.1.total_cmp(&x.1).then(x.0.total_cmp(&y.0)));
    let candidates = apart(&lags, 3.0 * step_s);
    let refined = candidates
        .into_par_iter()
        .filter_map(|lag_s| coarse.refine(lag_s, step_s, gate_rad, fine_rad));
    let refined: Vec<Lag> = refined.collect();
    refined
        .into_iter()
        .max_by(|x, y| x.agreement.total_cmp(&y.agreement))
}

/// The best lags that are at least `least_s` apart.
fn apart(sorted: &[(f64, f64)], least_s: f64) -> Vec<f64> {
    let mut chosen: Vec<f64> = Vec::new();
    for (lag_s, _) in sorted {
        if chosen.len() == CANDIDATES {
            break;
        }
        if chosen.iter().all(|c| (c - lag_s).abs() > least_s) {
            chosen.push(*lag_s);
        }
    }
    chosen
}

struct Search<'a> {
    a: Timed<'a>,
    b: Timed<'a>,
    times: &'a [(f64, Vector3<f64>)],
    seed: u64,
}

impl Search<'_> {
    /// What both saw at a lag, at most `most` moments, evenly spread over those at which the point moved in both.
    fn pairs(&self, lag_s: f64, drift: f64, pivot_s: f64, most: usize) -> Vec<TwoViews> {
        const STILL_RAD: f64 = 0.002;
        let mut moving: Vec<TwoViews> = Vec::new();
        let stride = (self.times.len() / (4 * most)).max(1);
        for (time_s, bearing) in self.times.iter().step_by(stride) {
            let other_s = time_s + lag_s + drift * (time_s - pivot_s);
            let Some(other) = self.b.bearing(other_s) else {
                continue;
            };
            let has_moved = moving.last().is_none_or(|(last_a, last_b)| {
                (last_a - bearing).norm() > STILL_RAD && (last_b - other).norm() > STILL_RAD
            });
            if has_moved {
                moving.push((*bearing, other));
            }
        }
        super::chain::evenly(&moving, most)
    }

    fn agreement(
        &self,
        pairs: &[TwoViews],
        gate_rad: f64,
        samples: usize,
        hopeless: f64,
        salt: u64,
    ) -> f64 {
        if pairs.len() < LEAST_MOMENTS {
            return 0.0;
        }
        let mut rng = ChaCha8Rng::seed_from_u64(self.seed.wrapping_add(salt.wrapping_mul(0x9e37)));
        let loss = least_loss(pairs, gate_rad, samples, hopeless, &mut rng);
        // Few moments agree by chance more easily.
        let count = pairs.len() as f64;
        (1.0 - loss) * count / (count + 15.0)
    }

    /// Halves the step and the gate until the gate is `fine_rad`.
    fn refine(&self, lag_s: f64, step_s: f64, gate_rad: f64, fine_rad: f64) -> Option<Lag> {
        let [a0, a1] = self.a.range_s()?;
        let [b0, b1] = self.b.range_s()?;
        // The middle of what both saw.
        let (from, to) = (a0.max(b0 - lag_s), a1.min(b1 - lag_s));
        let pivot_s = 0.5 * (from + to);
        let reach_s = 0.5 * (to - from).max(1.0);
        let mut best = (lag_s, 0.0, 0.0);
        let (mut step_s, mut gate_rad) = (step_s, gate_rad);
        loop {
            let is_last = gate_rad <= fine_rad;
            let mut found = (best.0, best.1, -1.0);
            for lag in -2..=2i32 {
                for drift in -1..=1i32 {
                    let lag_s = best.0 + 0.5 * step_s * f64::from(lag);
                    let drift = best.1 + 0.5 * step_s / reach_s * f64::from(drift);
                    let pairs = self.pairs(lag_s, drift, pivot_s, FINE_MOMENTS);
                    let agreement = self.agreement(&pairs, gate_rad, FINE_SAMPLES, 0.9, 0);
                    if agreement > found.2 {
                        found = (lag_s, drift, agreement);
                    }
                }
            }
            best = found;
            if is_last {
                break;
            }
            step_s *= 0.5;
            gate_rad = (0.5 * gate_rad).max(fine_rad);
        }
        (best.2 > 0.0).then_some(Lag {
            behind_s: best.0,
            drift: best.1,
            pivot_s,
            agreement: best.2,
        })
    }
}
