//! Random numbers of a scene: one stream per purpose and person, so that draws are independent.

use rand::SeedableRng as _;
use rand_chacha::ChaCha8Rng;

/// The purpose of a draw.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Purpose {
    /// Lenses of generated cameras.
    Cameras = 1,
    /// The network's own definition of hips and knees.
    Definition = 2,
    /// The receivers of the ball.
    Ball = 3,
    /// Shape and clothes of a person.
    Build = 4,
}

/// The stream of `purpose` for item `index`.
pub(super) fn draws(seed: u64, purpose: Purpose, index: usize) -> ChaCha8Rng {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(((purpose as u64) << 32) | index as u64);
    rng
}
