//! The controller with a simulated link.

use farfield_proto::id::PersonId;

use super::simulated_link::{RATE_HZ, SimulatedLink, run, run_together};
use super::*;
use crate::live::{SECOND_US, round_robin};

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
        pass_bytes: 0,
        sizes_apart: 0.0,
    }
}

#[test]
fn a_wide_link_carries_all_people_at_the_best_quality() {
    let got = run(&mut controller(0.0), &wide(), 8, 10, 0);
    let all = SendPlan {
        level: CompressionLevel::DEFAULT,
        persons: None,
        every_nth: 1,
    };
    assert_eq!(got.plan, Some(all), "{got:?}");
}

#[test]
fn one_megabit_carries_eight_persons_without_a_queue() {
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
fn edges_share_a_bottleneck_in_any_order_of_start() {
    // Symptom to prevent: rates grew in proportion, so differences remained, and a late edge took
    // the queue of the others for the base delay. The result was 4, 19, 33 and 50 kB/s of 125.
    for (n, mbit_s) in [(2, 0.5), (4, 1.0), (4, 2.0), (16, 4.0)] {
        for (one_way_us, apart_s) in [(1_000, 0), (10_000, 5), (50_000, 5)] {
            let line = SimulatedLink {
                bytes_per_s: 125_000.0 * mbit_s,
                one_way_us,
                jitter_us: 2_000,
                ..wide()
            };
            let mut edges: Vec<_> = (0..n).map(|_| controller(0.0)).collect();
            let mut controllers: Vec<_> = edges.iter_mut().collect();
            let got = run_together(&mut controllers, &line, 8, 0..120, apart_s);
            let rates = || got.iter().map(|edge| edge.arrived_bytes_per_s);
            let sum: f64 = rates().sum();
            let mean = sum / f64::from(n);
            let apart = rates().map(|rate| (rate / mean - 1.0).abs());
            let apart = apart.fold(0.0, f64::max);
            let used = sum / line.bytes_per_s;
            let queue_us = got.iter().map(|edge| edge.worst_queue_us).max();
            println!(
                "{n} edges, {mbit_s} Mbit/s, {one_way_us} us: {:.0} % from the mean, {:.0} % used, {queue_us:?} us",
                100.0 * apart,
                100.0 * used
            );
            assert!(
                apart < 0.2 && used > 0.85,
                "{n}, {mbit_s}, {one_way_us}: {got:?}"
            );
            assert!(
                queue_us < Some(200_000),
                "{n}, {mbit_s}, {one_way_us}: {got:?}"
            );
        }
    }
}

#[test]
fn edges_with_different_costs_share_a_thin_bottleneck() {
    // Symptom to prevent: all edges tolerated the same queue, and their rates stayed up to 29 %
    // from the mean.
    for sizes_apart in [0.1, 0.2, 0.3] {
        for (mbit_s, jitter_us) in [(0.5, 10_000), (1.0, 500), (1.0, 10_000)] {
            let line = SimulatedLink {
                bytes_per_s: 125_000.0 * mbit_s,
                one_way_us: 10_000,
                jitter_us,
                sizes_apart,
                ..wide()
            };
            let mut edges: Vec<_> = (0..4).map(|_| controller(0.0)).collect();
            let mut controllers: Vec<_> = edges.iter_mut().collect();
            let got = run_together(&mut controllers, &line, 8, 0..60, 0);
            let mean = got.iter().map(|edge| edge.arrived_bytes_per_s).sum::<f64>() / 4.0;
            let apart = got
                .iter()
                .map(|edge| (edge.arrived_bytes_per_s / mean - 1.0).abs())
                .fold(0.0, f64::max);
            let used = 4.0 * mean / line.bytes_per_s;
            println!(
                "sizes {sizes_apart} apart, {mbit_s} Mbit/s, jitter {jitter_us} us: {:.0} % from the mean, {:.0} % used",
                100.0 * apart,
                100.0 * used
            );
            let queue_us = got.iter().map(|edge| edge.worst_queue_us).max();
            assert!(
                apart < 0.12 && used > 0.9 && queue_us < Some(150_000),
                "{sizes_apart}, {mbit_s}, {jitter_us}: {got:?}"
            );
        }
    }
}

#[test]
fn a_link_with_jitter_is_used_fully() {
    // Symptom to prevent: a wider link tolerated a shorter queue, and jitter alone exceeded it: a
    // fifth of 2 Mbit/s was used.
    for mbit_s in [0.1, 1.0, 2.0] {
        for jitter_us in [5_000, 20_000, 40_000] {
            let line = SimulatedLink {
                bytes_per_s: 125_000.0 * mbit_s,
                jitter_us,
                ..wide()
            };
            let got = run(&mut controller(0.0), &line, 8, 60, 0);
            let used = got.arrived_bytes_per_s / line.bytes_per_s;
            println!(
                "{mbit_s} Mbit/s, jitter {jitter_us} us: {:.0} % used, queue {} us",
                100.0 * used,
                got.worst_queue_us
            );
            assert!(
                used > 0.8 && got.worst_queue_us < 150_000,
                "{mbit_s}, {jitter_us}: {got:?}"
            );
        }
    }
}

#[test]
fn spare_budget_makes_some_ticks_a_level_finer() {
    let mut finer_n = 0;
    for budget in (60_000..240_000).step_by(3_000) {
        let mut controller = controller(f64::from(budget));
        controller.plan(8, 0);
        let per_tick = controller.rate() / RATE_HZ;
        let plans: Vec<_> = (0..40).map(|_| controller.plan(8, 0)).collect();
        assert!(
            plans
                .iter()
                .all(|plan| plan.level >= CompressionLevel::DEFAULT)
        );
        if plans.iter().any(|plan| plan.persons.is_some()) {
            continue;
        }
        let cost = |plan: &SendPlan| controller.cost(plan.level, 8);
        let mean = plans.iter().map(cost).sum::<f64>() / 40.0;
        assert!(mean <= 1.02 * per_tick, "{budget}: {mean} of {per_tick}");
        let named = plans.iter().filter(|plan| plan.level == controller.level());
        assert!(named.count() >= 19, "{budget}: {plans:?}");
        finer_n += usize::from(plans.iter().any(|plan| plan.level != plans[0].level));
    }
    assert!(finer_n > 10, "{finer_n}");
}

#[test]
fn requested_detection_passes_do_not_keep_a_shared_link_full() {
    // Symptom to prevent: no person was detected over a full link, so passes were requested at
    // every tick. Their sightings, 60 kB/s of each edge, kept the link of 125 kB/s full forever.
    let line = SimulatedLink {
        bytes_per_s: 125_000.0,
        one_way_us: 10_000,
        pass_bytes: 4_200,
        ..wide()
    };
    let mut edges: Vec<_> = (0..4).map(|_| controller(0.0)).collect();
    let mut controllers: Vec<_> = edges.iter_mut().collect();
    let got = run_together(&mut controllers, &line, 8, 0..60, 0);
    for edge in &got {
        assert!(edge.worst_queue_us < 200_000, "{got:?}");
        assert!(edge.lost < 0.05 && edge.persons_share > 0.05, "{got:?}");
        assert!((15..=60).contains(&edge.passes), "{got:?}");
    }
}

#[test]
fn a_link_without_a_queue_is_measured_by_its_losses() {
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
fn a_wide_link_with_loss_and_jitter_is_used_fully() {
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
fn a_lasting_increase_of_delay_becomes_the_base_delay() {
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
fn a_restored_link_carries_its_former_rate() {
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
fn a_budget_is_respected_without_reports_of_fusion() {
    for budget in [50_000.0, 20_000.0, 7_000.0, 3_000.0, 1_000.0] {
        let mut edge = controller(budget);
        let plan = edge.plan(8, 0);
        let planned = planned_bytes_per_s(&edge, plan, 8);
        println!("{budget} bytes a second: {planned:.0}, {plan:?}");
        assert!(
            (0.7 * budget..=budget).contains(&planned),
            "{budget}: {planned}, {plan:?}"
        );
    }
    let mut edge = controller(1_000.0);
    let plan = edge.plan(8, 0);
    assert_eq!(plan.level, CompressionLevel::SMALLEST);
    assert!(plan.persons.is_some(), "{plan:?}");
    assert!(plan.every_nth > 10);
}

/// Bytes per second of `plan` for `persons`, with round robin at each tick.
fn planned_bytes_per_s(edge: &RateController, plan: SendPlan, persons: u32) -> f64 {
    /// Enough that each person has a turn of being sent more often.
    const PROCESSED: i64 = 1 << 14;
    let most = plan.persons.unwrap_or(f64::from(persons));
    let mut chosen = Vec::new();
    let bytes = (0..PROCESSED).map(|number| {
        let all = (1..=persons).map(PersonId);
        round_robin::choose(all, most, Tick(number), &mut chosen);
        edge.cost(plan.level, chosen.len())
    });
    bytes.sum::<f64>() / PROCESSED as f64 * RATE_HZ / f64::from(plan.every_nth)
}

#[test]
fn without_people_only_keepalives_are_sent() {
    let mut edge = controller(0.0);
    let plan = edge.plan(0, 0);
    assert_eq!(
        (plan.level, plan.persons, plan.every_nth),
        (CompressionLevel::DEFAULT, None, 1)
    );
}

/// A controller on a wide link with this time per person, after some seconds at its own plan.
fn on_a_computer(person_us: u32, workers: usize, persons: usize) -> RateController {
    let mut edge = controller(0.0);
    edge.set_workers(workers, f64::INFINITY);
    compute(&mut edge, person_us, persons, 0..6 * SECOND_US);
    edge
}

/// Processes `persons` of `person_us` each, one after the other.
fn compute(
    edge: &mut RateController,
    person_us: u32,
    persons: usize,
    time_us: std::ops::Range<Micros>,
) {
    let period_us = (1e6 / RATE_HZ) as Micros;
    let mut now_us = time_us.start;
    while now_us < time_us.end {
        let plan = edge.plan(persons, now_us);
        let worked_on = plan.persons.map_or(persons, |most| most.ceil() as usize);
        let took_us = person_us * worked_on as u32;
        now_us += Micros::from(took_us).max(period_us * i64::from(plan.every_nth));
        edge.worked(worked_on, took_us, now_us);
    }
}

#[test]
fn a_slow_computer_processes_ticks_that_all_edges_share() {
    let plan = |person_us, persons| {
        let edge = on_a_computer(person_us, 1, persons);
        let plan = edge.last_plan();
        (plan.every_nth, plan.persons, edge.overload().is_some())
    };
    assert_eq!(plan(10_000, 1), (1, None, false));
    assert_eq!(plan(35_000, 1), (4, Some(1.0), true));
    let (nth, persons, is_overloaded) = plan(35_000, 2);
    assert!(nth == 4 && is_overloaded, "{nth}");
    // 50 ms of 67 for people of 35 ms.
    assert!((persons.unwrap() - 1.43).abs() < 0.05, "{persons:?}");
    let overload = on_a_computer(35_000, 1, 2).overload().unwrap();
    assert!((overload.done_per_s - 21.4).abs() < 0.5, "{overload:?}");
    assert!((overload.asked_per_s - 120.0).abs() < 1e-6);
}

#[test]
fn a_computer_with_time_again_processes_every_tick_within_4_s() {
    let mut edge = on_a_computer(35_000, 1, 1);
    compute(&mut edge, 5_000, 1, 6 * SECOND_US..7 * SECOND_US);
    assert_eq!(edge.last_plan().every_nth, 4, "it does not swing");
    compute(&mut edge, 5_000, 1, 7 * SECOND_US..10 * SECOND_US);
    assert_eq!((edge.last_plan().every_nth, edge.overload()), (1, None));
}

#[test]
fn an_edge_skips_more_ticks_only_under_an_unbearable_load() {
    let mut edge = on_a_computer(45_000, 1, 1);
    let mut nth_at = |person_us, second: Micros| {
        let time_us = second * SECOND_US..(second + 6) * SECOND_US;
        compute(&mut edge, person_us, 1, time_us);
        edge.last_plan().every_nth
    };
    assert_eq!(nth_at(55_000, 6), 4, "55 of 67 ms");
    assert_eq!(nth_at(70_000, 12), 8);
    assert_eq!(nth_at(55_000, 18), 8);
    assert_eq!(nth_at(45_000, 24), 4);
}

#[test]
fn a_slower_edge_takes_no_more_people() {
    let mut edge = on_a_computer(45_000, 1, 2);
    let before = edge.last_plan();
    compute(&mut edge, 52_000, 2, 6 * SECOND_US..7 * SECOND_US);
    let after = edge.last_plan();
    assert_eq!((before.every_nth, after.every_nth), (4, 4));
    assert!(after.persons <= before.persons, "{before:?} {after:?}");
}

#[test]
fn a_tick_without_people_does_not_skip_more_ticks() {
    let mut edge = on_a_computer(45_000, 1, 1);
    compute(&mut edge, 55_000, 1, 6 * SECOND_US..9 * SECOND_US);
    edge.plan(0, 9 * SECOND_US);
    compute(&mut edge, 55_000, 1, 9 * SECOND_US..10 * SECOND_US);
    assert_eq!(edge.last_plan().every_nth, 4);
}

#[test]
fn a_slow_second_does_not_skip_more_ticks() {
    let mut edge = on_a_computer(45_000, 1, 1);
    compute(&mut edge, 75_000, 1, 6 * SECOND_US..7 * SECOND_US);
    assert_eq!(edge.last_plan().every_nth, 4);
    compute(&mut edge, 75_000, 1, 7 * SECOND_US..10 * SECOND_US);
    assert_eq!(edge.last_plan().every_nth, 8);
}

#[test]
fn time_allows_the_crops_that_fit_the_planned_ticks() {
    // 35 ms each: one fits into 50 of 67 ms.
    let mut edge = on_a_computer(35_000, 1, 1);
    assert!(edge.has_time_for(1) && !edge.has_time_for(2));
    edge.follow(8);
    edge.plan(1, 6 * SECOND_US);
    assert!(edge.has_time_for(2) && !edge.has_time_for(3));
}

#[test]
fn an_edge_works_only_on_ticks_of_fusions_plan() {
    let followed = |person_us, common_nth| {
        let mut edge = on_a_computer(person_us, 1, 1);
        edge.follow(common_nth);
        let plan = edge.plan(1, 6 * SECOND_US);
        (plan.every_nth, plan.persons, edge.needed_nth())
    };
    assert_eq!(followed(10_000, 4), (4, Some(1.0), 1), "it could do more");
    assert_eq!(followed(35_000, 1), (4, Some(1.0), 4));
    assert_eq!(
        followed(35_000, 2),
        (4, Some(1.0), 4),
        "every other of them"
    );
    assert_eq!(followed(10_000, 0), (1, None, 1), "fusion has no plan");
    let mut empty = on_a_computer(35_000, 1, 1);
    empty.plan(0, 6 * SECOND_US);
    assert_eq!(empty.needed_nth(), 0, "no person is visible");
}

#[test]
fn capacity_left_by_fewer_ticks_is_used_for_finer_patches() {
    let mut edge = controller(100_000.0);
    let all = edge.plan(8, 0);
    assert!(all.level > CompressionLevel::DEFAULT && all.persons.is_none());
    edge.follow(4);
    let few = edge.plan(8, 0);
    assert_eq!(
        (few.level, few.persons),
        (CompressionLevel::DEFAULT, Some(8.0))
    );
}

#[test]
fn a_slow_computer_is_no_thin_link() {
    let edge = on_a_computer(35_000, 1, 1);
    assert!(edge.has_room(6 * SECOND_US));
    assert_eq!(edge.level(), CompressionLevel::DEFAULT);
}
