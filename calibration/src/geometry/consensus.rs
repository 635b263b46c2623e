//! Random samples, and how many of them are enough.

use rand::RngExt;
use rand_chacha::ChaCha8Rng;

/// Chance that at least one sample was free of outliers.
const CONFIDENCE: f64 = 0.999;

/// `N` different indices below `count`; `None` when there are fewer.
pub(super) fn sample<const N: usize>(rng: &mut ChaCha8Rng, count: usize) -> Option<[usize; N]> {
    if count < N {
        return None;
    }
    let mut chosen = [usize::MAX; N];
    let mut filled = 0;
    while filled < N {
        let index = rng.random_range(0..count);
        if !chosen.contains(&index) {
            chosen[filled] = index;
            filled += 1;
        }
    }
    Some(chosen)
}

/// Samples of `size` that are needed where `share` of the data are inliers, at most `most`.
pub(super) fn samples_needed(share: f64, size: i32, most: usize) -> usize {
    let clean = (0..size).fold(1.0, |product, _| product * share);
    if clean <= 0.0 {
        return most;
    }
    let needed = libm::log(1.0 - CONFIDENCE) / libm::log1p(-clean.min(1.0 - 1e-12));
    (needed.ceil() as usize).clamp(1, most)
}
