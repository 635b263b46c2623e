//! Random numbers of a scene: one stream per purpose and person, so that no draw moves another.

use rand::SeedableRng as _;
use rand_chacha::ChaCha8Rng;

/// What is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Purpose {
    /// Lenses of generated cameras.
    Cameras = 1,
    /// Where a network believes hips and knees to be.
    Definition = 2,
    /// Who gets the ball.
    Ball = 3,
    /// Shape and clothes of a person.
    Build = 4,
}

/// The stream of `purpose` for the `index`-th of whatever it is drawn for.
pub(super) fn draws(seed: u64, purpose: Purpose, index: usize) -> ChaCha8Rng {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(((purpose as u64) << 32) | index as u64);
    rng
}
