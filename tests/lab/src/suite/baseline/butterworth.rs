//! A zero-phase Butterworth low-pass, which uses future samples.
//!
//! Equals `scipy.signal.filtfilt` with `butter(2, ...)` (and Pose2Sim, which calls the two passes order 4): odd extension at
//! both ends, steady state at the first sample, forwards, then backwards.

use std::f64::consts::{PI, SQRT_2};

/// A digital low-pass of order 2; two passes make order 4.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ZeroPhase {
    b: [f64; 3],
    a: [f64; 3],
}

impl ZeroPhase {
    /// Samples by which a signal is extended at each end: three times the filter's length, scipy's default. Shorter signals are
    /// not filtered.
    pub const PAD: usize = 9;

    /// The filter whose single pass has its -3 dB point at `cutoff_hz`, for samples at `rate_hz`: the bilinear transform of the
    /// analogue prototype with a prewarped cutoff. `cutoff_hz` is limited to below half the rate.
    pub fn new(cutoff_hz: f64, rate_hz: f64) -> Self {
        let k = (PI * (cutoff_hz / rate_hz).clamp(1e-6, 0.499)).tan();
        let norm = 1.0 / (1.0 + SQRT_2 * k + k * k);
        let b0 = k * k * norm;
        Self {
            b: [b0, 2.0 * b0, b0],
            a: [
                1.0,
                2.0 * (k * k - 1.0) * norm,
                (1.0 - SQRT_2 * k + k * k) * norm,
            ],
        }
    }

    /// Filters `values` in both directions.
    pub fn filter(&self, values: &[f64]) -> Vec<f64> {
        let n = values.len();
        if n <= Self::PAD {
            return values.to_vec();
        }
        let (first, last) = (values[0], values[n - 1]);
        let mut extended = Vec::with_capacity(n + 2 * Self::PAD);
        extended.extend((1..=Self::PAD).rev().map(|i| 2.0 * first - values[i]));
        extended.extend_from_slice(values);
        extended.extend((1..=Self::PAD).map(|i| 2.0 * last - values[n - 1 - i]));
        self.pass(&mut extended);
        extended.reverse();
        self.pass(&mut extended);
        extended.reverse();
        extended[Self::PAD..Self::PAD + n].to_vec()
    }

    /// One pass in place (transposed direct form II), from the steady state of the first value.
    fn pass(&self, values: &mut [f64]) {
        let [b0, b1, b2] = self.b;
        let [_, a1, a2] = self.a;
        // The states for a constant input u with output u.
        let steady = [1.0 - b0, b2 - a2];
        let first = values.first().copied().unwrap_or(0.0);
        let mut state = steady.map(|s| s * first);
        for value in values {
            let input = *value;
            let output = b0 * input + state[0];
            state = [
                b1 * input - a1 * output + state[1],
                b2 * input - a2 * output,
            ];
            *value = output;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The golden numbers have 12 digits.
    const TOLERANCE: f64 = 1e-10;

    /// scipy 1.17.1: `b, a = butter(2, cutoff/(60/2)); filtfilt(b, a, x)` with
    /// `x = sin(0.3 t) + 0.25 cos(2.1 t) + 0.02 t`, `t = arange(40)`, at these samples.
    const AT: [usize; 8] = [0, 1, 2, 7, 19, 30, 38, 39];
    const GOLDEN: [(f64, [f64; 8]); 4] = [
        (
            4.0,
            [
                0.281_618_685_370,
                0.454_522_048_836,
                0.616_534_687_282,
                0.808_204_727_075,
                -0.057_734_093_992,
                0.932_858_493_913,
                0.118_674_974_502,
                0.215_474_757_933,
            ],
        ),
        (
            6.0,
            [
                0.249_867_014_450,
                0.440_413_063_071,
                0.634_252_304_461,
                0.953_471_414_198,
                -0.146_320_291_246,
                0.989_687_634_530,
                0.044_377_118_416,
                0.255_411_663_144,
            ],
        ),
        (
            8.0,
            [
                0.248_623_363_572,
                0.414_189_807_763,
                0.610_142_973_297,
                0.991_383_885_936,
                -0.164_087_813_835,
                1.008_830_968_100,
                -0.019_674_388_938,
                0.264_292_992_439,
            ],
        ),
        (
            10.0,
            [
                0.250_200_947_525,
                0.379_136_473_602,
                0.582_352_754_461,
                0.999_282_788_848,
                -0.169_862_765_798,
                1.013_115_727_909,
                -0.072_796_121_339,
                0.262_083_443_417,
            ],
        ),
    ];

    #[test]
    fn the_filter_equals_that_of_scipy() {
        let signal: Vec<f64> = (0..40)
            .map(|t| {
                let t = f64::from(t);
                (0.3 * t).sin() + 0.25 * (2.1 * t).cos() + 0.02 * t
            })
            .collect();
        for (cutoff_hz, golden) in GOLDEN {
            let filtered = ZeroPhase::new(cutoff_hz, 60.0).filter(&signal);
            for (at, expected) in AT.into_iter().zip(golden) {
                let got = filtered[at];
                assert!(
                    (got - expected).abs() < TOLERANCE,
                    "{cutoff_hz} Hz, sample {at}: {got}, scipy {expected}"
                );
            }
        }
    }

    #[test]
    fn constant_and_short_signals_are_unchanged() {
        let filtered = ZeroPhase::new(6.0, 60.0).filter(&[3.25; 50]);
        assert!(filtered.iter().all(|v| (v - 3.25).abs() < TOLERANCE));
        let short = [1.0, 5.0, 2.0];
        assert_eq!(ZeroPhase::new(6.0, 60.0).filter(&short), short);
    }
}
