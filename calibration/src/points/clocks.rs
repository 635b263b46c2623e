//! The clocks of all cameras on that of one, and sights at common moments.

use rayon::prelude::*;

use super::timing::{Lag, find_lag};
use super::view::{Seen, Track, View};

/// Agreement at which two clocks count as joined.
const LEAST_AGREEMENT: f64 = 0.35;
/// Most common moments.
const MOST_MOMENTS: f64 = 1500.0;
/// Two sights with more time between them are not joined, seconds.
const GAP_S: f64 = 0.35;

/// Sets the clocks of `tracks` to that of the camera with the most sights; false for those that no lag was found for.
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

/// The clock that frames over the rate make.
pub(super) fn set_own_clock(track: &mut Track, rate_hz: f64) {
    track.state.period_s = 1.0 / rate_hz;
    track.state.pivot_s = track.state.pivot_frame / rate_hz;
}

fn set_clock(track: &mut Track, rate_hz: f64, lag: &Lag, base: &Track, base_rate_hz: f64) {
    let stretch = 1.0 + lag.drift;
    let own_s = track.state.pivot_frame / rate_hz;
    // On the nominal clock of the base, then on that of all.
    let on_base_s = (own_s - lag.behind_s + lag.drift * lag.pivot_s) / stretch;
    let base_scale = base.state.period_s * base_rate_hz;
    track.state.pivot_s = base.state.time_s(on_base_s * base_rate_hz);
    track.state.period_s = base_scale / (rate_hz * stretch);
}

/// First and last time that a camera saw the point, seconds.
pub(super) fn range_s(track: &Track) -> Option<[f64; 2]> {
    let (first, last) = (track.seen.first()?, track.seen.last()?);
    Some([first, last].map(|seen| track.state.time_s(seen.frame)))
}

/// What each camera saw at common moments, between its frames; the sights of one moment share a tick.
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
