//! Cameras whose pictures stand still every other tick while those of the others move: a recording of half the rate, or with frames
//! written twice. On average they are half a tick late, which bends lines of sight as another lens does.

use farfield_proto::order_statistics::upper_median;

use super::super::samples::{Burst, Trail};

/// Keypoints that must be seen at both of two ticks to tell of their way.
const MIN_COMMON: usize = 5;
/// Ways that must be known, and least mean of them, pixels.
const MIN_WAYS: usize = 20;
const LEAST_PX: f64 = 1.5;
/// A way is none where it is less than this share of the mean.
const STILL: f64 = 0.35;
/// Which share of ways is none where frames are held, and of most other cameras at the most: who comes towards a camera hardly
/// moves in its picture (0.24 were seen on the sample).
const HELD: f64 = 0.42;
const MOVING: f64 = 0.3;

/// Per camera whether it holds frames while most others do not.
pub(super) fn held(bursts: &[&Burst], n_cameras: usize) -> Vec<bool> {
    let still = |camera: usize| {
        let trails = bursts.iter().flat_map(|burst| &burst.trails);
        let own = trails.filter(|trail| trail.camera == camera);
        let counted: Vec<(usize, usize)> = own.filter_map(still_ways).collect();
        let (still, all) = counted
            .iter()
            .fold((0, 0), |sum, it| (sum.0 + it.0, sum.1 + it.1));
        (all > 0).then(|| still as f64 / all as f64)
    };
    let shares: Vec<Option<f64>> = (0..n_cameras).map(still).collect();
    let usual = upper_median(shares.iter().flatten().copied().collect()).unwrap_or(0.0);
    let is_held = |share: &Option<f64>| usual <= MOVING && share.is_some_and(|it| it >= HELD);
    shares.iter().map(is_held).collect()
}

/// How many ways of a trail from tick to tick are none, and of how many.
fn still_ways(trail: &Trail) -> Option<(usize, usize)> {
    let way_px = |tick: usize| {
        let ((_, before), (_, after)) = (trail.at(tick - 1)?, trail.at(tick)?);
        let both = before
            .iter()
            .zip(after)
            .filter(|(p, q)| p.score > 0.0 && q.score > 0.0);
        let ways = both.map(|(p, q)| {
            let [x, y] = [0, 1].map(|axis: usize| f64::from(q.pixel[axis] - p.pixel[axis]));
            libm::hypot(x, y)
        });
        let ways: Vec<f64> = ways.collect();
        (ways.len() >= MIN_COMMON)
            .then(|| upper_median(ways))
            .flatten()
    };
    let ways: Vec<f64> = (1..trail.len()).filter_map(way_px).collect();
    let mean = ways.iter().sum::<f64>() / ways.len().max(1) as f64;
    let still = ways.iter().filter(|way| **way < STILL * mean).count();
    (ways.len() >= MIN_WAYS && mean >= LEAST_PX).then_some((still, ways.len()))
}

#[cfg(test)]
mod tests {
    use farfield_proto::tick::Tick;

    use super::super::super::samples::{SeenBody, SeenKeypoint};
    use super::*;

    #[test]
    fn a_camera_with_doubled_frames_is_told_from_those_that_move() {
        let body = |x: usize| -> SeenBody {
            let seen = |k: usize| SeenKeypoint {
                pixel: [(4 * x + k) as f32, (10 * k) as f32],
                score: 0.9,
            };
            (0..17).map(|k| Some(seen(k))).collect()
        };
        let trail = |camera: usize, shown: fn(usize) -> usize| {
            let bodies: Vec<SeenBody> = (0..60).map(|tick| body(shown(tick))).collect();
            Trail::of(1, camera, &bodies)
        };
        let burst = |doubled: usize| Burst {
            first: Tick(0),
            trails: (0..4)
                .map(|camera| {
                    trail(
                        camera,
                        if camera < doubled {
                            |t| t / 2 * 2
                        } else {
                            |t| t
                        },
                    )
                })
                .collect(),
        };
        assert_eq!(held(&[&burst(1)], 4), [true, false, false, false]);
        assert_eq!(held(&[&burst(0)], 4), [false; 4]);
        // All of half the rate: that is the rate of the venue, and nobody's fault.
        assert_eq!(held(&[&burst(4)], 4), [false; 4]);
    }
}
