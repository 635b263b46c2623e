//! Normal draws. `rand_distr` draws other numbers, which would change all simulations.

use std::f64::consts::TAU;

/// Two independent normal numbers with mean 0 and this sigma, from two uniform ones: `u` in (0, 1],
/// `v` in [0, 1) (Box and Muller 1958).
///
/// ```text
///   sigma sqrt(-2 ln u) (cos 2 pi v, sin 2 pi v)
/// ```
pub(crate) fn box_muller(u: f64, v: f64, sigma: f64) -> [f64; 2] {
    let radius = (-2.0 * u.ln()).sqrt() * sigma;
    let (sin, cos) = (TAU * v).sin_cos();
    [radius * cos, radius * sin]
}

#[cfg(test)]
mod tests {
    use rand::{RngExt as _, SeedableRng as _};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    #[test]
    fn many_draws_have_the_requested_mean_and_sigma() {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let pairs = (0..20_000).map(|_| box_muller(1.0 - rng.random::<f64>(), rng.random(), 2.0));
        let all: Vec<f64> = pairs.flatten().collect();
        let mean = |of: fn(f64) -> f64| all.iter().map(|&x| of(x)).sum::<f64>() / all.len() as f64;
        assert!(mean(|x| x).abs() < 0.05);
        assert!((mean(|x| x * x) - 4.0).abs() < 0.1);
        // Within one sigma: 68.3 %.
        assert!((mean(|x| f64::from(u8::from(x.abs() < 2.0))) - 0.683).abs() < 0.01);
    }

    #[test]
    fn the_ends_of_the_uniform_numbers_are_finite() {
        for u in [1.0, f64::MIN_POSITIVE, 1.0 - f64::EPSILON] {
            assert!(box_muller(u, 0.0, 1.0).iter().all(|x| x.is_finite()));
        }
    }
}
