//! How far people go between the pictures that cameras take of a tick: cameras that run freely show who runs at different places.

use std::collections::BTreeMap;

use farfield_proto::order_statistics::upper_median;

use super::super::samples::{Burst, Samples, middle_m};

/// The way that people go in the median while the first and the last camera take their pictures of a tick, metres.
pub(super) fn blur_m(bursts: &[&Burst], samples: &Samples) -> f64 {
    let mut late: BTreeMap<usize, Vec<f64>> = BTreeMap::new();
    for trail in bursts.iter().flat_map(|burst| &burst.trails) {
        let own = (0..trail.len()).filter_map(|tick| Some(trail.at(tick)?.0));
        late.entry(trail.camera).or_default().extend(own);
    }
    let usual = late.into_values().filter_map(upper_median);
    let (first, last) = usual.fold((f64::INFINITY, f64::NEG_INFINITY), |(first, last), late| {
        (first.min(late), last.max(late))
    });
    (last - first).max(0.0) * way_per_tick_m(samples)
}

/// How far people go in a tick in the median, metres.
fn way_per_tick_m(samples: &Samples) -> f64 {
    let pairs = samples.poses.iter().zip(samples.poses.iter().skip(1));
    let ways_m = pairs.flat_map(|(before, after)| {
        let ticks = (after.tick - before.tick).max(1) as f64;
        after.people.iter().filter_map(move |(person, now)| {
            let (_, then) = before.people.iter().find(|(other, _)| other == person)?;
            Some(f64::from((middle_m(now) - middle_m(then)).norm()) / ticks)
        })
    });
    upper_median(ways_m.collect()).unwrap_or(0.0)
}
