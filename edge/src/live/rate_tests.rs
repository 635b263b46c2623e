//! The controller at the end of a simulated link: a queue behind a rate, delay, jitter, loss.

use std::collections::VecDeque;

use super::*;
use crate::live::SECOND_US;

const RATE_HZ: f64 = 60.0;
/// What a person costs at each level, bytes; not what the controller believes at first.
const TRUE_BYTES: [usize; LEVELS] = [700, 450, 380, 300, 250, 215, 190];

/// A link and the fusion behind it.
struct SimulatedLink {
    bytes_per_s: f64,
    /// What does not get through within so long is dropped, microseconds; 0: no queue at all.
    longest_queue_us: i64,
    one_way_us: i64,
    jitter_us: i64,
    loss: f64,
    /// When nothing gets through, either way, seconds.
    cut_s: std::ops::Range<i64>,
    /// From when on the way takes how long, seconds and microseconds.
    then: (i64, i64),
}

impl SimulatedLink {
    fn delay_us(&self, at_us: i64) -> i64 {
        let (from_s, then_us) = self.then;
        if at_us / SECOND_US < from_s {
            self.one_way_us
        } else {
            then_us
        }
    }

    fn is_cut(&self, at_us: i64) -> bool {
        self.cut_s.contains(&(at_us / SECOND_US))
    }
}

/// What came of a run.
#[derive(Debug, Default)]
struct RunOutcome {
    /// Of the last half.
    worst_queue_us: i64,
    arrived_bytes_per_s: f64,
    lost: f64,
    plan: Option<SendPlan>,
    /// Persons sent per second, of all that there are.
    persons_share: f64,
}

struct Random(u64);

impl Random {
    fn next(&mut self) -> f64 {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }
}

fn run(
    controller: &mut RateController,
    line: &SimulatedLink,
    persons: usize,
    seconds: i64,
    from_s: i64,
) -> RunOutcome {
    let mut random = Random(7);
    let mut free_at = 0i64;
    // Arrivals: (when, tick, sent, payload).
    let mut under_way: VecDeque<(i64, i64, i64, usize)> = VecDeque::new();
    let mut arrived: VecDeque<(i64, usize)> = VecDeque::new();
    let mut newest: Option<(i64, i64)> = None;
    let mut words: VecDeque<(i64, HeardPatches)> = VecDeque::new();
    let mut outcome = RunOutcome::default();
    let (mut sent_n, mut lost_n, mut persons_n, mut bytes_n) = (0.0, 0.0, 0.0, 0.0);
    let ticks = seconds * 60;
    for tick in from_s * 60..from_s * 60 + ticks {
        let now = tick * SECOND_US / 60;
        let second_half = tick - from_s * 60 > ticks / 2;
        while words.front().is_some_and(|(at, _)| *at <= now) {
            let (at, word) = words.pop_front().unwrap();
            if !line.is_cut(at) {
                controller.hear(&word, 0, at);
            }
        }
        let plan = controller.plan(persons, now);
        outcome.plan = Some(plan);
        if tick % i64::from(plan.every_nth) == 0 && controller.may_send(Tick(tick), now) {
            let n = plan.persons.unwrap_or(persons).min(persons);
            let wobble = 0.8 + 0.4 * random.next();
            let bytes =
                (n as f64 * TRUE_BYTES[usize::from(plan.level.number())] as f64 * wobble) as usize;
            let messages = bytes.div_ceil(MESSAGE_BYTES - 40).max(1);
            controller.packed(plan.level, n, messages, bytes + 40 * messages);
            for _ in 0..messages {
                let payload = bytes / messages + 40;
                controller.sent(MessageKind::Patches(Tick(tick)), payload, now);
                let start = free_at.max(now);
                let takes =
                    ((payload + MESSAGE_OVERHEAD_BYTES) as f64 / line.bytes_per_s * 1e6) as i64;
                sent_n += f64::from(u8::from(second_half));
                if start - now > line.longest_queue_us
                    || random.next() < line.loss
                    || line.is_cut(now)
                {
                    lost_n += f64::from(u8::from(second_half));
                    continue;
                }
                free_at = start + takes;
                let jitter = (random.next() * line.jitter_us as f64) as i64;
                under_way.push_back((free_at + line.delay_us(now) + jitter, tick, now, payload));
                if second_half {
                    outcome.worst_queue_us = outcome.worst_queue_us.max(start - now);
                    bytes_n += (payload + MESSAGE_OVERHEAD_BYTES) as f64;
                }
            }
            persons_n += n as f64 * f64::from(u8::from(second_half));
        }
        under_way.make_contiguous().sort_by_key(|(at, ..)| *at);
        while under_way.front().is_some_and(|(at, ..)| *at <= now) {
            let (at, tick, sent, payload) = under_way.pop_front().unwrap();
            arrived.push_back((at, payload));
            if newest.is_none_or(|(known, _)| tick > known) {
                newest = Some((tick, at - sent));
            }
        }
        arrived.retain(|(at, _)| now - at < SECOND_US);
        if let Some((tick, way)) = newest {
            let bytes = arrived.iter().map(|(_, payload)| *payload as u32).sum();
            let word = HeardPatches {
                tick: Tick(tick),
                one_way_us: way as i32,
                bytes,
            };
            words.push_back((now + line.delay_us(now), word));
        }
    }
    let half_s = seconds as f64 / 2.0;
    outcome.arrived_bytes_per_s = bytes_n / half_s;
    outcome.lost = lost_n / f64::max(sent_n, 1.0);
    outcome.persons_share = persons_n / (half_s * RATE_HZ * persons as f64);
    outcome
}

fn controller(budget: f64) -> RateController {
    RateController::new(RATE_HZ, CompressionLevel::DEFAULT, budget, MESSAGE_BYTES)
}

fn wide() -> SimulatedLink {
    SimulatedLink {
        bytes_per_s: 1e8,
        longest_queue_us: SECOND_US,
        one_way_us: 5_000,
        jitter_us: 0,
        loss: 0.0,
        cut_s: 0..0,
        then: (i64::MAX, 0),
    }
}

#[test]
fn a_wide_link_carries_everybody_at_the_best_quality() {
    let got = run(&mut controller(0.0), &wide(), 8, 10, 0);
    let all = SendPlan {
        level: CompressionLevel::DEFAULT,
        persons: None,
        every_nth: 1,
    };
    assert_eq!(got.plan, Some(all), "{got:?}");
}

#[test]
fn one_megabit_carries_eight_persons_at_a_lower_quality_without_a_queue() {
    for one_way_us in [0, 10_000, 40_000, 100_000] {
        let line = SimulatedLink {
            bytes_per_s: 125_000.0,
            one_way_us,
            ..wide()
        };
        let got = run(&mut controller(0.0), &line, 8, 40, 0);
        assert!(got.worst_queue_us < 100_000, "{one_way_us}: {got:?}");
        assert!(got.persons_share > 0.8, "{one_way_us}: {got:?}");
        assert!(
            got.arrived_bytes_per_s > 0.6 * line.bytes_per_s,
            "{one_way_us}: {got:?}"
        );
    }
}

#[test]
fn a_link_that_drops_what_it_cannot_carry_is_found_by_its_losses() {
    let line = SimulatedLink {
        bytes_per_s: 60_000.0,
        longest_queue_us: 0,
        one_way_us: 20_000,
        ..wide()
    };
    let got = run(&mut controller(0.0), &line, 8, 40, 0);
    assert!(
        got.lost < 0.25 && got.arrived_bytes_per_s > 0.4 * line.bytes_per_s,
        "{got:?}"
    );
}

#[test]
fn a_lossy_and_jittery_link_that_is_wide_is_used_in_full() {
    for (loss, jitter_us) in [(0.01, 5_000), (0.05, 20_000), (0.05, 0)] {
        let line = SimulatedLink {
            loss,
            jitter_us,
            one_way_us: 40_000,
            ..wide()
        };
        let got = run(&mut controller(0.0), &line, 8, 30, 0);
        assert_eq!(
            got.plan.map(|plan| plan.level),
            Some(CompressionLevel::DEFAULT),
            "{loss}: {got:?}"
        );
    }
}

#[test]
fn a_very_thin_link_gets_fewer_persons_and_then_fewer_ticks() {
    let line = SimulatedLink {
        bytes_per_s: 30_000.0,
        one_way_us: 20_000,
        ..wide()
    };
    let got = run(&mut controller(0.0), &line, 8, 40, 0);
    let plan = got.plan.unwrap();
    assert_eq!(plan.level, CompressionLevel::SMALLEST);
    assert!(
        plan.persons.is_some() && got.worst_queue_us < 100_000,
        "{got:?}"
    );
    let line = SimulatedLink {
        bytes_per_s: 6_000.0,
        ..line
    };
    let got = run(&mut controller(0.0), &line, 8, 60, 0);
    assert!(
        got.plan.unwrap().every_nth > 1 && got.worst_queue_us < 250_000,
        "{got:?}"
    );
}

#[test]
fn quality_comes_back_when_the_link_does() {
    let mut edge = controller(0.0);
    let thin = SimulatedLink {
        bytes_per_s: 40_000.0,
        one_way_us: 10_000,
        ..wide()
    };
    let got = run(&mut edge, &thin, 8, 20, 0);
    assert!(
        got.plan.unwrap().level > CompressionLevel::DEFAULT,
        "{got:?}"
    );
    let got = run(&mut edge, &wide(), 8, 60, 20);
    assert_eq!(
        got.plan.map(|plan| (plan.level, plan.persons)),
        Some((CompressionLevel::DEFAULT, None)),
        "{got:?}"
    );
}

#[test]
fn a_way_that_gets_longer_for_good_is_no_queue_for_long() {
    let line = SimulatedLink {
        then: (10, 150_000),
        ..wide()
    };
    let got = run(&mut controller(0.0), &line, 8, 30, 0);
    assert_eq!(
        got.plan.map(|plan| (plan.level, plan.persons)),
        Some((CompressionLevel::DEFAULT, None)),
        "{got:?}"
    );
}

#[test]
fn a_link_that_was_cut_carries_what_it_did_before() {
    let mut edge = controller(0.0);
    let line = SimulatedLink {
        cut_s: 10..15,
        ..wide()
    };
    let got = run(&mut edge, &line, 8, 14, 0);
    let now = 14 * SECOND_US;
    let sent = (0..80).filter(|tick| edge.may_send(Tick(*tick), now));
    assert_eq!(sent.count(), 10, "{got:?}");
    let got = run(&mut edge, &line, 8, 6, 14);
    assert_eq!(
        got.plan.map(|plan| (plan.level, plan.persons)),
        Some((CompressionLevel::DEFAULT, None)),
        "{got:?}"
    );
}

#[test]
fn a_budget_is_planned_for_without_a_word_from_fusion() {
    let mut edge = controller(50_000.0);
    let plan = edge.plan(8, 0);
    assert!(
        edge.cost(plan.level, plan.persons.unwrap_or(8)) * RATE_HZ / f64::from(plan.every_nth)
            <= 50_000.0
    );
    let mut edge = controller(1_000.0);
    let plan = edge.plan(8, 0);
    assert_eq!(
        (plan.level, plan.persons),
        (CompressionLevel::SMALLEST, Some(1))
    );
    assert!(plan.every_nth > 10);
}

#[test]
fn nobody_in_sight_costs_only_a_sign_of_life() {
    let mut edge = controller(0.0);
    let plan = edge.plan(0, 0);
    assert_eq!(
        (plan.level, plan.persons, plan.every_nth),
        (CompressionLevel::DEFAULT, None, 1)
    );
}
