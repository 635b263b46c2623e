//! The streams of faults have the shares and lengths of the profile.

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

fn correlation(runs: &[Vec<KeypointDraws>], lag: usize, of: impl Fn(&KeypointDraws) -> f64) -> f64 {
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
