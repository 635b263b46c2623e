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
mod tests {
    use super::*;
    use crate::fault_profile::{Bias, Hidden, Leak, MirrorFault, Missing};

    const RATE_HZ: f64 = 60.0;
    /// Ticks of a long run, and number of averaged streams: sampling errors of a few percent.
    const TICKS: usize = 20_000;
    const OWNERS: u16 = 24;

    /// The draws of the left wrists of many people, `[person][tick]`.
    fn long_runs(profile: &FaultProfile, seed: u64) -> Vec<Vec<KeypointDraws>> {
        let run = |person| {
            let owner = StreamOwner {
                camera: 2,
                person,
                keypoint: 9,
            };
            let mut streams = KeypointStreams::new(profile, RATE_HZ, seed, owner);
            let next = |_| {
                let draws = streams.draws();
                streams.advance();
                draws
            };
            (0..TICKS).map(next).collect()
        };
        (0..OWNERS).map(run).collect()
    }

    fn mean(values: impl Iterator<Item = f64>) -> f64 {
        let (mut sum, mut n) = (0.0, 0.0);
        for value in values {
            sum += value;
            n += 1.0;
        }
        sum / n
    }

    fn assert_near(what: &str, got: f64, expected: f64, tolerance: f64) {
        assert!(
            (got - expected).abs() < tolerance,
            "{what}: {got}, expected {expected} to {tolerance}"
        );
    }

    /// Mean length in ticks of the runs in which `on` is true, without runs cut by the start or the
    /// end.
    fn mean_run(runs: &[Vec<KeypointDraws>], on: impl Fn(&KeypointDraws) -> bool) -> f64 {
        let lengths = runs.iter().flat_map(|run| {
            let groups: Vec<_> = run.chunk_by(|a, b| on(a) == on(b)).collect();
            let inner = groups[1..groups.len() - 1].iter();
            let long = inner.filter(|group| on(&group[0])).map(|group| group.len());
            long.collect::<Vec<_>>()
        });
        mean(lengths.map(|n| n as f64))
    }

    fn correlation(
        runs: &[Vec<KeypointDraws>],
        lag: usize,
        of: impl Fn(&KeypointDraws) -> f64,
    ) -> f64 {
        let products = runs.iter().flat_map(|run| run.iter().zip(&run[lag..]));
        let product = mean(products.map(|(a, b)| of(a) * of(b)));
        product / mean(runs.iter().flatten().map(|d| of(d).powi(2)))
    }

    #[test]
    fn the_bias_has_rms_1_and_decays_with_its_time_constant() {
        let runs = long_runs(&FaultProfile::standard(), 1);
        let square = mean(runs.iter().flatten().map(|d| {
            let [x, y] = d.bias;
            x * x + y * y
        }));
        // 24 runs of 333 s contain about 24 x 333 / 4 s = 2000 independent values of two axes.
        assert_near("mean square", square, 1.0, 0.1);
        for axis in [0, 1] {
            let at = |s: f64| correlation(&runs, (s * RATE_HZ) as usize, |d| d.bias[axis]);
            assert_near("after 2 s", at(2.0), (-1.0f64).exp(), 0.1);
            assert_near("after 1 s", at(1.0), (-0.5f64).exp(), 0.1);
        }
        let slow = Bias {
            time_constant_s: 0.5,
            ..Bias::default()
        };
        let faster = FaultProfile {
            bias: Some(slow),
            ..FaultProfile::none()
        };
        let after = correlation(&long_runs(&faster, 1), 30, |d| d.bias[0]);
        assert_near("after 0.5 s", after, (-1.0f64).exp(), 0.05);
    }

    #[test]
    fn the_jitter_has_rms_1_and_no_memory() {
        let runs = long_runs(&FaultProfile::standard(), 2);
        let square = mean(runs.iter().flatten().map(|d| {
            let [x, y] = d.jitter;
            x * x + y * y
        }));
        assert_near("mean square", square, 1.0, 0.01);
        let next = correlation(&runs, 1, |d| d.jitter[0]);
        assert_near("next tick", next, 0.0, 0.01);
        let across = mean(runs.iter().flatten().map(|d| d.jitter[0] * d.jitter[1]));
        assert_near("other axis", across, 0.0, 0.01);
    }

    #[test]
    fn streams_of_other_owners_are_independent() {
        let runs = long_runs(&FaultProfile::standard(), 3);
        for (a, b) in runs.iter().zip(&runs[1..]) {
            let product = mean(a.iter().zip(b).map(|(a, b)| a.jitter[0] * b.jitter[0]));
            assert_near("two persons", product, 0.0, 0.02);
        }
    }

    #[test]
    fn mirrored_peaks_have_the_share_and_height_of_the_profile() {
        let runs = long_runs(&FaultProfile::standard(), 4);
        let share = mean(runs.iter().flatten().map(|d| f64::from(d.mirror.is_some())));
        // About 800 bursts.
        assert_near("share", share, 0.03, 0.004);
        let length = mean_run(&runs, |d| d.mirror.is_some());
        assert_near("length", length, 0.3 * RATE_HZ, 2.0);
        let heights: Vec<f64> = runs.iter().flatten().filter_map(|d| d.mirror).collect();
        assert!(heights.iter().all(|h| (0.3..1.1).contains(h)));
        assert_near("height", mean(heights.iter().copied()), 0.7, 0.05);
        let changes = runs.iter().flat_map(|run| run.windows(2));
        let inside = changes.filter_map(|w| Some((w[0].mirror?, w[1].mirror?)));
        assert!(inside.clone().count() > 10_000);
        let steps = inside.filter(|(a, b)| a.to_bits() != b.to_bits()).count();
        assert_eq!(steps, 0, "a burst keeps its height");
    }

    #[test]
    fn only_limbs_are_mirrored() {
        for keypoint in 0..17 {
            let owner = StreamOwner {
                keypoint,
                ..StreamOwner::default()
            };
            let profile = FaultProfile {
                mirror: Some(MirrorFault {
                    share: 1.0,
                    ..MirrorFault::default()
                }),
                ..FaultProfile::none()
            };
            let draws = KeypointStreams::new(&profile, RATE_HZ, 7, owner).draws();
            let limb = (7..=10).contains(&keypoint) || (13..=16).contains(&keypoint);
            assert_eq!(draws.mirror.is_some(), limb, "keypoint {keypoint}");
        }
    }

    #[test]
    fn missing_peaks_have_the_share_of_the_profile() {
        let runs = long_runs(&FaultProfile::standard(), 5);
        let share = mean(runs.iter().flatten().map(|d| f64::from(d.missing)));
        // About 400 bursts.
        assert_near("share", share, 0.01, 0.002);
        assert_near("length", mean_run(&runs, |d| d.missing), 0.2 * RATE_HZ, 2.0);
    }

    #[test]
    fn half_the_bursts_leak_and_a_fifth_of_hidden_ones_have_no_peak() {
        let runs = long_runs(&FaultProfile::standard(), 6);
        let leaks = mean(runs.iter().flatten().map(|d| f64::from(d.leaks)));
        // About 27000 bursts.
        assert_near("leaks", leaks, 0.5, 0.015);
        // Bursts follow each other, so every second end ends a leak: twice the length.
        let length = mean_run(&runs, |d| d.leaks);
        assert_near("length of leaks", length, 2.0 * 0.3 * RATE_HZ, 2.0);
        let gone = mean(runs.iter().flatten().map(|d| f64::from(d.hidden.is_none())));
        assert_near("no peak", gone, 0.2, 0.015);
        let length = mean_run(&runs, |d| d.hidden.is_none());
        assert_near("length of no peak", length, 0.3 * RATE_HZ / 0.8, 1.5);
        let heights: Vec<f64> = runs.iter().flatten().filter_map(|d| d.hidden).collect();
        assert!(heights.iter().all(|h| (0.3..0.8).contains(h)));
        assert_near("height", mean(heights.iter().copied()), 0.55, 0.01);
    }

    #[test]
    fn the_share_holds_at_every_rate_and_at_0_and_1() {
        for (share, burst_s, expected) in [
            (0.3, 0.001, 0.3),
            (0.8, 0.001, 0.8),
            (0.0, 0.2, 0.0),
            (1.0, 0.2, 1.0),
            (1.0, 0.0, 1.0),
            (0.0, 0.0, 0.0),
        ] {
            let profile = FaultProfile {
                missing: Some(Missing { share, burst_s }),
                ..FaultProfile::none()
            };
            let runs = long_runs(&profile, 8);
            let got = mean(runs.iter().flatten().map(|d| f64::from(d.missing)));
            assert_near("share", got, expected, 0.01);
        }
    }

    #[test]
    fn disabling_a_fault_changes_no_other_draw() {
        let all = long_runs(&FaultProfile::standard(), 9);
        let profile = FaultProfile {
            jitter: None,
            hidden: None,
            ..FaultProfile::standard()
        };
        let without = long_runs(&profile, 9);
        for (a, b) in all.iter().flatten().zip(without.iter().flatten()) {
            let expected = KeypointDraws {
                jitter: [0.0; 2],
                hidden: None,
                ..*a
            };
            assert_eq!(*b, expected);
        }
    }

    #[test]
    fn a_seed_determines_all_draws() {
        let profile = FaultProfile::standard();
        assert_eq!(long_runs(&profile, 10), long_runs(&profile, 10));
        assert_ne!(long_runs(&profile, 10), long_runs(&profile, 11));
        let certain = FaultProfile {
            leak: Some(Leak {
                probability: 1.0,
                ..Leak::default()
            }),
            hidden: Some(Hidden {
                no_peak: 1.0,
                ..Hidden::default()
            }),
            ..FaultProfile::none()
        };
        let runs = long_runs(&certain, 10);
        assert!(runs.iter().flatten().all(|d| d.leaks && d.hidden.is_none()));
    }
}
