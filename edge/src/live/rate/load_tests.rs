//! Single effects of delay and loss; the tests of the controller cover the closed loop.

use super::*;

fn report(tick: i64, one_way_us: i32, bytes: u32) -> HeardPatches {
    HeardPatches {
        tick: Tick(tick),
        one_way_us,
        bytes,
    }
}

/// Sends 60 ticks of 1000 bytes per second for `ticks` ticks from `from`; reports arrive 40 ms
/// later with `delay_us`.
fn run(load: &mut LinkLoad, from: i64, ticks: i64, delay_us: impl Fn(i64) -> i32, share: f64) {
    for tick in from..from + ticks {
        let now = tick * SECOND_US / 60;
        load.sent(Some(Tick(tick)), 900, 1000, now);
        let bytes = (54_000.0 * share) as u32;
        load.receive_report(&report(tick - 2, delay_us(tick), bytes), 0, true, now);
    }
}

#[test]
fn a_constant_delay_is_no_queue() {
    let mut load = LinkLoad::default();
    run(&mut load, 0, 600, |_| 900_000, 1.0);
    assert!(load.rate().is_infinite());
}

#[test]
fn a_standing_queue_lowers_the_rate_below_the_arrivals() {
    let mut load = LinkLoad::default();
    run(&mut load, 0, 240, |_| 10_000, 1.0);
    run(&mut load, 240, 60, |_| 60_000, 1.0);
    assert!(
        load.rate() < 60_000.0 && load.rate() > 25_000.0,
        "{}",
        load.rate()
    );
}

#[test]
fn jitter_is_no_queue() {
    let mut load = LinkLoad::default();
    run(
        &mut load,
        0,
        900,
        |tick| 10_000 + 3_000 * (tick % 7) as i32,
        1.0,
    );
    assert!(load.rate().is_infinite());
}

#[test]
fn radio_noise_is_ignored_but_a_loss_of_a_third_is_not() {
    let mut load = LinkLoad::default();
    run(&mut load, 0, 900, |_| 10_000, 0.93);
    assert!(load.rate().is_infinite());
    run(&mut load, 900, 120, |_| 10_000, 0.66);
    assert!(load.rate() < 45_000.0, "{}", load.rate());
}

#[test]
fn the_own_loss_of_a_link_does_not_lower_the_rate() {
    // Symptom to prevent: a fifth was lost at random, and the rate fell by a quarter every second,
    // to the minimum.
    for share in [0.8, 0.7] {
        let mut load = LinkLoad::default();
        run(&mut load, 0, 1_800, |_| 10_000, share);
        assert!(load.rate() > 60_000.0, "{share}: {}", load.rate());
        // A queue still counts.
        run(&mut load, 1_800, 120, |_| 60_000, share);
        assert!(load.rate() < 60_000.0, "{share}: {}", load.rate());
    }
}

#[test]
fn a_policer_is_not_mistaken_for_random_loss() {
    // A policer of 30 kB/s drops the excess, independent of the delay.
    let mut load = LinkLoad::default();
    let mut rates = Vec::new();
    for tick in 0..3_600 {
        let now = tick * SECOND_US / 60;
        let sent = (load.rate() / 60.0).min(1_000.0);
        load.sent(Some(Tick(tick)), (0.9 * sent) as usize, sent as usize, now);
        let arrived = 0.9 * (60.0 * sent).min(30_000.0);
        load.receive_report(&report(tick - 2, 10_000, arrived as u32), 0, true, now);
        rates.push(sent * 60.0);
    }
    let late = &rates[1_200..];
    let mean = late.iter().sum::<f64>() / late.len() as f64;
    let above = late.iter().filter(|&&rate| rate > 45_000.0).count();
    assert!(mean > 20_000.0 && mean < 40_000.0, "{mean}");
    assert!(above * 20 < late.len(), "{above} of {}", late.len());
}

#[test]
fn a_corrected_clock_is_no_queue() {
    let mut load = LinkLoad::default();
    for tick in 0..600 {
        let now = tick * SECOND_US / 60;
        load.sent(Some(Tick(tick)), 900, 1000, now);
        // The clock is slewed by 80 ms, so that messages seem to be sent earlier.
        let correction = -(tick as i32) * 133;
        load.receive_report(
            &report(tick - 2, 10_000 - correction, 54_000),
            correction,
            true,
            now,
        );
    }
    assert!(load.rate().is_infinite());
}

#[test]
fn repeated_and_late_reports_are_ignored() {
    let mut load = LinkLoad::default();
    run(&mut load, 0, 300, |_| 10_000, 1.0);
    for _ in 0..100 {
        load.receive_report(&report(200, 900_000, 0), 0, true, 5 * SECOND_US);
    }
    assert!(load.rate().is_infinite());
}

#[test]
fn a_cut_link_is_silent_until_the_next_report() {
    let mut load = LinkLoad::default();
    assert!(!load.is_silent(9 * SECOND_US));
    run(&mut load, 0, 60, |_| 10_000, 1.0);
    load.sent(Some(Tick(60)), 900, 1000, SECOND_US);
    assert!(!load.is_silent(SECOND_US + SILENCE_US));
    assert!(load.is_silent(2 * SECOND_US));
    run(&mut load, 120, 1, |_| 10_000, 1.0);
    assert!(!load.is_silent(2 * SECOND_US));
}

#[test]
fn an_edge_that_rarely_sends_is_not_cut_off() {
    let mut load = LinkLoad::default();
    run(&mut load, 0, 2, |_| 10_000, 1.0);
    assert!(!load.is_silent(9 * SECOND_US));
}

#[test]
fn a_report_about_an_unsent_tick_is_ignored() {
    // Symptom to prevent: after one report about the last possible tick, all real ones were stale,
    // and the link counted as cut forever.
    let mut load = LinkLoad::default();
    load.receive_report(&report(5, 0, 0), 0, true, 0);
    run(&mut load, 0, 60, |_| 10_000, 1.0);
    for tick in [60, 1 << 40, i64::MAX] {
        load.receive_report(&report(tick, i32::MAX, 0), 0, true, SECOND_US);
    }
    run(&mut load, 60, 120, |_| 10_000, 1.0);
    assert!(!load.is_silent(3 * SECOND_US) && load.rate().is_infinite());
}

/// Interrupts the link for `silent_ticks` from tick `from`, with `both_ways` also the boxes. The
/// first report then has `delay_us`. Returns whether passes are refused right after it.
fn is_choked_after(
    load: &mut LinkLoad,
    from: i64,
    silent_ticks: i64,
    both_ways: bool,
    delay_us: i32,
) -> bool {
    let at = |tick: i64| tick * SECOND_US / 60;
    for tick in from..from + silent_ticks {
        load.sent(Some(Tick(tick)), 900, 1000, at(tick));
    }
    let back = from + silent_ticks;
    if both_ways {
        load.boxes_returned_after(at(silent_ticks), at(back));
    }
    load.sent(Some(Tick(back)), 900, 1000, at(back));
    let now_us = at(back + 2);
    load.receive_report(&report(back, delay_us, 27_000), 0, true, now_us);
    load.is_choked(now_us)
}

#[test]
fn a_link_with_repeated_outages_is_not_full() {
    // Symptom to prevent: with interruptions of 0.7 s every 4 s, passes were refused for a second,
    // and fusion lost all people.
    for both_ways in [true, false] {
        let mut load = LinkLoad::default();
        for cut in 0..10 {
            run(&mut load, cut * 240, 190, |_| 10_000, 1.0);
            let from = cut * 240 + 190;
            assert!(
                !is_choked_after(&mut load, from, 45, both_ways, 12_000),
                "{cut}, {both_ways}"
            );
        }
        assert!(load.rate().is_infinite(), "{}", load.rate());
    }
}

#[test]
fn a_queue_or_loss_after_silence_means_a_full_link() {
    let cut = |delay_us: i32, share: f64| {
        let mut load = LinkLoad::default();
        run(&mut load, 0, 190, |_| 10_000, 1.0);
        is_choked_after(&mut load, 190, 45, false, delay_us);
        run(&mut load, 240, 190, |_| 10_000, share);
        is_choked_after(&mut load, 430, 45, false, delay_us)
    };
    assert!(cut(600_000, 1.0));
    assert!(cut(12_000, 0.6));
    assert!(!cut(12_000, 1.0));
}

#[test]
fn returning_boxes_allow_passes_at_once() {
    let mut load = LinkLoad::default();
    run(&mut load, 0, 120, |_| 10_000, 1.0);
    for tick in 120..180 {
        load.sent(Some(Tick(tick)), 900, 1000, tick * SECOND_US / 60);
    }
    let now_us = 3 * SECOND_US;
    assert!(load.is_choked(now_us) && load.is_silent(now_us));
    load.boxes_returned_after(OUTAGE_US - 1, now_us);
    assert!(load.is_choked(now_us), "boxes kept coming");
    load.boxes_returned_after(SECOND_US, now_us);
    assert!(!load.is_choked(now_us) && !load.is_silent(now_us));
}
