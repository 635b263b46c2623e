//! The random draws of faults: one `ChaCha8` stream per fault, camera, person and keypoint.
//!
//! Streams are independent: to disable a fault, or to add a camera or a person, changes no other
//! draw. Every stream starts at tick 0 and advances tick by tick, also while the person is absent.
//! So its value at a tick does not depend on the order of requests.

use std::f64::consts::FRAC_1_SQRT_2;

use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

use crate::fault_profile::FaultProfile;
use crate::normal::box_muller;

/// Keypoints of a person, as in COCO.
pub(super) const N_KEYPOINTS: usize = 17;

/// What is drawn. The numbers are part of the meaning of every seed; the scene's own draws use
/// lower numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum DrawnFault {
    Bias = 16,
    Jitter = 17,
    Mirror = 18,
    Leak = 19,
    Hidden = 20,
    Missing = 21,
    Timing = 22,
}

/// The owner of a stream.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct StreamOwner {
    pub(super) camera: u16,
    pub(super) person: u16,
    pub(super) keypoint: u16,
}

pub(super) fn stream(seed: u64, fault: DrawnFault, owner: StreamOwner) -> ChaCha8Rng {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let parts = [fault as u16, owner.camera, owner.person, owner.keypoint];
    rng.set_stream(parts.iter().fold(0, |id, &part| id << 16 | u64::from(part)));
    rng
}

/// A point of an isotropic normal distribution with 2D RMS 1.
fn normal_2d(rng: &mut ChaCha8Rng) -> [f64; 2] {
    // 1 - u is never 0.
    let u = 1.0 - rng.random::<f64>();
    box_muller(u, rng.random(), FRAC_1_SQRT_2)
}

/// A first-order autoregressive point with 2D RMS 1.
#[derive(Debug, Clone)]
struct Drift {
    rng: ChaCha8Rng,
    /// Correlation from one tick to the next.
    keep: f64,
    value: [f64; 2],
}

impl Drift {
    fn new(mut rng: ChaCha8Rng, time_constant_ticks: f64) -> Self {
        // At 0 the quotient is -inf and the error is white.
        let keep = (-1.0 / time_constant_ticks).exp();
        let value = normal_2d(&mut rng);
        Self { rng, keep, value }
    }

    fn advance(&mut self) {
        let [x, y] = normal_2d(&mut self.rng);
        let fresh = (1.0 - self.keep * self.keep).sqrt();
        let [a, b] = self.value;
        self.value = [self.keep * a + fresh * x, self.keep * b + fresh * y];
    }
}

/// Bursts of geometric length, each with its own level.
#[derive(Debug, Clone)]
struct Bursts {
    rng: ChaCha8Rng,
    /// Probability per tick that a burst ends, and that one begins.
    ends: f64,
    begins: f64,
    /// Remaining ticks of the present state, including this one.
    left: u64,
    on: bool,
    level: f64,
}

impl Bursts {
    /// Bursts of `burst_ticks` on average, for `share` of the time. A burst lasts at least one
    /// tick, and longer where `share` requires it.
    fn new(mut rng: ChaCha8Rng, share: f64, burst_ticks: f64) -> Self {
        let ends = (1.0 / burst_ticks).min((1.0 - share) / share).min(1.0);
        let begins = if share < 1.0 {
            ends * share / (1.0 - share)
        } else {
            1.0
        };
        let on = rng.random::<f64>() < share;
        let mut bursts = Self {
            rng,
            ends,
            begins,
            left: 0,
            on,
            level: 0.0,
        };
        bursts.start(on);
        bursts
    }

    fn start(&mut self, on: bool) {
        self.on = on;
        let chance = if on { self.ends } else { self.begins };
        self.left = geometric(&mut self.rng, chance);
        if on {
            self.level = self.rng.random();
        }
    }

    fn advance(&mut self) {
        self.left -= 1;
        if self.left == 0 {
            self.start(!self.on);
        }
    }

    /// The level of the burst, uniform from 0 to 1; `None` between bursts.
    fn level(&self) -> Option<f64> {
        self.on.then_some(self.level)
    }
}

/// Bursts without pause, each with two levels of its own, uniform from 0 to 1.
#[derive(Debug, Clone)]
struct Spells {
    rng: ChaCha8Rng,
    ends: f64,
    left: u64,
    levels: [f64; 2],
}

impl Spells {
    fn new(rng: ChaCha8Rng, spell_ticks: f64) -> Self {
        let mut spells = Self {
            rng,
            ends: (1.0 / spell_ticks).min(1.0),
            left: 0,
            levels: [0.0; 2],
        };
        spells.start();
        spells
    }

    fn start(&mut self) {
        self.left = geometric(&mut self.rng, self.ends);
        self.levels = [self.rng.random(), self.rng.random()];
    }

    fn advance(&mut self) {
        self.left -= 1;
        if self.left == 0 {
            self.start();
        }
    }
}

/// Ticks until an event with probability `chance` per tick: at least 1.
fn geometric(rng: &mut ChaCha8Rng, chance: f64) -> u64 {
    let u: f64 = 1.0 - rng.random::<f64>();
    if chance >= 1.0 {
        1
    } else {
        // `as` saturates when the chance is 0.
        1_u64.saturating_add((u.ln() / (-chance).ln_1p()) as u64)
    }
}

/// The draws for one keypoint of one person in one camera at one tick, independent of its position
/// and of what covers it.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct KeypointDraws {
    /// Bias and jitter, of 2D RMS 1.
    pub(super) bias: [f64; 2],
    pub(super) jitter: [f64; 2],
    /// Height of the mirrored peak relative to the true one, during a burst.
    pub(super) mirror: Option<f64>,
    /// Whether the other person's keypoint shows if another body covers this one.
    pub(super) leaks: bool,
    /// Height of the peak if a body covers the keypoint; `None`: no peak.
    pub(super) hidden: Option<f64>,
    /// Whether there is no peak.
    pub(super) missing: bool,
}

/// The streams of one keypoint of one person in one camera; streams of disabled faults are absent.
#[derive(Debug, Clone)]
pub(super) struct KeypointStreams {
    bias: Option<Drift>,
    jitter: Option<(ChaCha8Rng, [f64; 2])>,
    mirror: Option<(Bursts, [f64; 2])>,
    leak: Option<(Spells, f64)>,
    hidden: Option<(Spells, f64, [f64; 2])>,
    missing: Option<Bursts>,
}

impl KeypointStreams {
    /// The streams at tick 0, for ticks of `rate_hz`.
    pub(super) fn new(profile: &FaultProfile, rate_hz: f64, seed: u64, owner: StreamOwner) -> Self {
        let rng = |fault| stream(seed, fault, owner);
        Self {
            bias: profile
                .bias
                .map(|f| Drift::new(rng(DrawnFault::Bias), f.time_constant_s * rate_hz)),
            jitter: profile.jitter.map(|_| {
                let mut rng = rng(DrawnFault::Jitter);
                let value = normal_2d(&mut rng);
                (rng, value)
            }),
            mirror: profile
                .mirror
                .filter(|_| super::opposite(owner.keypoint.into()).is_some())
                .map(|f| {
                    let bursts = Bursts::new(rng(DrawnFault::Mirror), f.share, f.burst_s * rate_hz);
                    (bursts, f.height)
                }),
            leak: profile.leak.map(|f| {
                let spells = Spells::new(rng(DrawnFault::Leak), f.burst_s * rate_hz);
                (spells, f.probability)
            }),
            hidden: profile.hidden.map(|f| {
                let spells = Spells::new(rng(DrawnFault::Hidden), f.burst_s * rate_hz);
                (spells, f.no_peak, f.height)
            }),
            missing: profile
                .missing
                .map(|f| Bursts::new(rng(DrawnFault::Missing), f.share, f.burst_s * rate_hz)),
        }
    }

    pub(super) fn advance(&mut self) {
        if let Some(bias) = &mut self.bias {
            bias.advance();
        }
        if let Some((rng, value)) = &mut self.jitter {
            *value = normal_2d(rng);
        }
        if let Some((bursts, _)) = &mut self.mirror {
            bursts.advance();
        }
        if let Some((spells, _)) = &mut self.leak {
            spells.advance();
        }
        if let Some((spells, ..)) = &mut self.hidden {
            spells.advance();
        }
        if let Some(bursts) = &mut self.missing {
            bursts.advance();
        }
    }

    pub(super) fn draws(&self) -> KeypointDraws {
        let within = |[least, most]: [f64; 2], level: f64| least + (most - least) * level;
        KeypointDraws {
            bias: self.bias.as_ref().map_or([0.0; 2], |drift| drift.value),
            jitter: self.jitter.as_ref().map_or([0.0; 2], |(_, value)| *value),
            mirror: self
                .mirror
                .as_ref()
                .and_then(|(bursts, height)| Some(within(*height, bursts.level()?))),
            leaks: self
                .leak
                .as_ref()
                .is_some_and(|(spells, probability)| spells.levels[0] < *probability),
            hidden: self.hidden.as_ref().and_then(|(spells, no_peak, height)| {
                (spells.levels[0] >= *no_peak).then(|| within(*height, spells.levels[1]))
            }),
            missing: self.missing.as_ref().is_some_and(|bursts| bursts.on),
        }
    }
}

#[cfg(test)]
#[path = "streams_tests.rs"]
mod tests;
