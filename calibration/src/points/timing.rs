//! Clocks of all cameras relative to one, from the point's path in their pictures, and sights at common moments.
//!
//! [`find_lag`] finds the delay of one clock relative to another. At the correct lag both cameras see one point at every
//! moment, and one essential matrix explains all of them; at a wrong lag none explains many. The search goes from coarse to
//! fine: a wide gate first, so that a lag that is off by a step is still visible, then narrower ones. Moments at which the
//! point does not move in either picture give no information on time, and are left out.

use farfield_proto::order_statistics::value_after;
use nalgebra::Vector3;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use super::view::{Seen, Track, View};
use crate::geometry::{TwoViews, least_loss};

/// Widest gate, radians: with a wider one, wrong lags also fit.
const COARSE_GATE_RAD: f64 = 0.008;
/// Moments of the coarse search.
const COARSE_MOMENTS: usize = 90;
/// Moments of the fine search.
const FINE_MOMENTS: usize = 250;
/// Least number of moments of a lag.
const LEAST_MOMENTS: usize = 30;
/// Random samples at a coarse lag.
const COARSE_SAMPLES: usize = 36;
/// Random samples at a fine lag.
const FINE_SAMPLES: usize = 120;
/// Number of lags that are refined.
const CANDIDATES: usize = 8;
/// Most lags of the coarse search.
const MOST_LAGS: usize = 20_000;
/// Longest time between two sights that are interpolated, seconds.
const GAP_S: f64 = 0.35;
/// Least time during which both saw the point, seconds.
const LEAST_OVERLAP_S: f64 = 8.0;

/// The clock of a second camera relative to a first: what the first saw at `t`, the second saw at
/// `t + behind_s + drift (t - pivot_s)`, each on its own clock (frames over the nominal rate).
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Lag {
    pub(super) behind_s: f64,
    pub(super) drift: f64,
    pub(super) pivot_s: f64,
    /// 1 if every moment agrees at the finest gate, 0 if none does.
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

    /// Times between which the point moves by `step_rad`.
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

    /// The 75th percentile of the angular speed.
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

/// The lag of the second track relative to the first, with the rates `rates_hz`; `None` if they have too little in common.
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
    // At half a step from the true lag three quarters of the moments are within the gate.
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
    /// Pairs of bearings at a lag: at most `most` moments, evenly spaced over those at which the point moved in both.
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
        // A few moments can agree by chance.
        let count = pairs.len() as f64;
        (1.0 - loss) * count / (count + 15.0)
    }

    /// Halves the step and the gate until the gate is `fine_rad`.
    fn refine(&self, lag_s: f64, step_s: f64, gate_rad: f64, fine_rad: f64) -> Option<Lag> {
        let [a0, a1] = self.a.range_s()?;
        let [b0, b1] = self.b.range_s()?;
        // The middle of the common time.
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

/// Least agreement of joined clocks.
const LEAST_AGREEMENT: f64 = 0.35;
/// Most common moments.
const MOST_MOMENTS: f64 = 1500.0;

/// Sets the clocks of `tracks` relative to the camera with the most sights; false for those without a lag.
pub(super) fn join_clocks(
    tracks: &mut [Track],
    rates_hz: &[f64],
    gate_px: f64,
    seed: u64,
) -> Vec<bool> {
    let smooth: Vec<Track> = tracks.iter().map(Track::without_outliers).collect();
    let mut joined = vec![false; tracks.len()];
    let duration_s = |i: usize| smooth[i].seen.len() as f64 / rates_hz[i];
    let Some(hub) = (0..tracks.len()).max_by(|a, b| duration_s(*a).total_cmp(&duration_s(*b)))
    else {
        return joined;
    };
    set_own_clock(&mut tracks[hub], rates_hz[hub]);
    joined[hub] = true;
    let mut bases = vec![hub];
    while let Some(base) = bases.pop() {
        let waiting: Vec<usize> = (0..tracks.len()).filter(|i| !joined[*i]).collect();
        let found: Vec<(usize, Option<Lag>)> = waiting
            .into_par_iter()
            .map(|i| {
                let rates = [rates_hz[base], rates_hz[i]];
                (i, find_lag(&smooth[base], &smooth[i], rates, gate_px, seed))
            })
            .collect();
        for (i, lag) in found {
            let Some(lag) = lag.filter(|lag| lag.agreement >= LEAST_AGREEMENT) else {
                continue;
            };
            let base_track = tracks[base].clone();
            set_clock(
                &mut tracks[i],
                rates_hz[i],
                &lag,
                &base_track,
                rates_hz[base],
            );
            joined[i] = true;
            bases.push(i);
        }
    }
    joined
}

/// Sets the clock to frame number over rate.
pub(super) fn set_own_clock(track: &mut Track, rate_hz: f64) {
    track.state.period_s = 1.0 / rate_hz;
    track.state.pivot_s = track.state.pivot_frame / rate_hz;
}

fn set_clock(track: &mut Track, rate_hz: f64, lag: &Lag, base: &Track, base_rate_hz: f64) {
    let stretch = 1.0 + lag.drift;
    let own_s = track.state.pivot_frame / rate_hz;
    // First on the nominal clock of the base, then on the common clock.
    let on_base_s = (own_s - lag.behind_s + lag.drift * lag.pivot_s) / stretch;
    let base_scale = base.state.period_s * base_rate_hz;
    track.state.pivot_s = base.state.time_s(on_base_s * base_rate_hz);
    track.state.period_s = base_scale / (rate_hz * stretch);
}

/// The times of the first and last sight, seconds.
pub(super) fn range_s(track: &Track) -> Option<[f64; 2]> {
    let (first, last) = (track.seen.first()?, track.seen.last()?);
    Some([first, last].map(|seen| track.state.time_s(seen.frame)))
}

/// The sights of each camera at common moments, interpolated between its frames; the sights of one moment share a tick.
pub(super) fn at_common_moments(tracks: &[Track], joined: &[bool]) -> Vec<View> {
    let used = || tracks.iter().zip(joined).filter(|(_, joined)| **joined);
    let ranges = used().filter_map(|(track, _)| range_s(track));
    let [start, end] = ranges.fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], [c, d]| {
        [a.min(c), b.max(d)]
    });
    let shortest = used().map(|(track, _)| track.state.period_s);
    let shortest_s = shortest.fold(f64::INFINITY, f64::min);
    let step_s = ((end - start) / MOST_MOMENTS).max(shortest_s);
    let count = ((end - start) / step_s).clamp(0.0, 2.0 * MOST_MOMENTS) as usize;
    let each = tracks.iter().zip(joined).map(|(track, joined)| {
        let smooth = track.without_outliers();
        let state = track.state;
        let gap = (GAP_S / state.period_s).max(1.5);
        let seen = (0..count).filter(|_| *joined).filter_map(|tick| {
            let time_s = start + tick as f64 * step_s;
            let frame = state.pivot_frame + (time_s - state.pivot_s) / state.period_s;
            let seen: Seen = smooth.at(frame, gap)?;
            Some((tick, seen))
        });
        View {
            state,
            seen: seen.collect(),
        }
    });
    each.collect()
}
