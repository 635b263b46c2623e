//! Properties of a link under any traffic, and the effect of each impairment.

use proptest::prelude::*;

use super::*;

/// Datagrams: microseconds after the one before, bytes.
type Datagrams = Vec<(u64, usize)>;

/// A delivered datagram: its number, time offered, time delivered.
type DatagramDelivery = (usize, u64, u64);

fn traffic() -> impl Strategy<Value = Datagrams> {
    prop::collection::vec((0u64..30_000, 1usize..1400), 1..120)
}

fn impairment() -> impl Strategy<Value = Impairment> {
    let share = || prop_oneof![Just(0.0), 0.0..1.0f64];
    (
        prop_oneof![Just(None), (10_000u32..1_000_000).prop_map(Some)],
        1_500u32..100_000,
        (0u32..300_000, 0u32..50_000, 0u32..50_000),
        (share(), share(), share()),
    )
        .prop_map(
            |(rate_bytes_s, queue_bytes, delays_us, shares)| Impairment {
                rate_bytes_s,
                queue_bytes,
                delay_us: delays_us.0,
                jitter_us: delays_us.1,
                reorder_us: delays_us.2,
                loss: shares.0,
                duplicate: shares.1,
                reorder: shares.2,
            },
        )
}

/// Runs a link until nothing is in flight; returns the deliveries.
fn run(link: &mut RelayLink<usize>, traffic: &Datagrams) -> Vec<DatagramDelivery> {
    let mut came_us = Vec::new();
    let mut arrivals = Vec::new();
    let mut deliver = |link: &mut RelayLink<usize>, came_us: &[u64], until_us: u64| {
        while let Some(due_us) = link.next_due_us().filter(|&due_us| due_us <= until_us) {
            let number = link.take(due_us).unwrap();
            arrivals.push((number, came_us[number], due_us));
        }
    };
    let mut now_us = 0;
    for (number, &(after_us, bytes)) in traffic.iter().enumerate() {
        now_us += after_us;
        deliver(link, &came_us, now_us);
        came_us.push(now_us);
        link.offer(now_us, bytes, number);
    }
    deliver(link, &came_us, u64::MAX);
    arrivals
}

fn link(impairment: Impairment) -> RelayLink<usize> {
    RelayLink::new(impairment, 7)
}

proptest! {
    #[test]
    fn every_datagram_is_accounted_for(impairment in impairment(), traffic in traffic()) {
        let mut link = link(impairment);
        let arrivals = run(&mut link, &traffic);
        let counts = link.counts();
        let gone = counts.lost + counts.dropped + counts.cut;
        prop_assert_eq!(counts.offered.datagrams, traffic.len() as u64);
        prop_assert_eq!(counts.delivered.datagrams, arrivals.len() as u64);
        prop_assert_eq!(counts.delivered.datagrams, counts.offered.datagrams - gone + counts.doubled);
    }

    #[test]
    fn the_same_seed_gives_the_same_fate(impairment in impairment(), traffic in traffic()) {
        prop_assert_eq!(
            run(&mut link(impairment), &traffic),
            run(&mut link(impairment), &traffic)
        );
    }

    #[test]
    fn nothing_arrives_before_or_after_its_bounds(
        impairment in impairment(), traffic in traffic()
    ) {
        let slowest_us = impairment.rate_bytes_s.map_or(0, |rate| {
            u64::from(impairment.queue_bytes) * 1_000_000 / u64::from(rate) + 1
        });
        let least_us = u64::from(impairment.delay_us);
        let most_us = least_us + slowest_us + u64::from(impairment.jitter_us)
            + u64::from(impairment.reorder_us);
        for (number, came_us, arrived_us) in run(&mut link(impairment), &traffic) {
            let took_us = arrived_us - came_us;
            prop_assert!((least_us..=most_us).contains(&took_us), "{number}: {took_us} us");
        }
    }

    #[test]
    fn only_held_back_datagrams_are_overtaken(impairment in impairment(), traffic in traffic()) {
        let arrivals = run(&mut link(Impairment { reorder: 0.0, ..impairment }), &traffic);
        prop_assert!(arrivals.is_sorted_by_key(|&(number, ..)| number));
    }

    #[test]
    fn no_second_carries_more_than_the_rate(impairment in impairment(), traffic in traffic()) {
        // Jitter bunches, duplicates add, and held back datagrams arrive with others.
        let steady = Impairment { jitter_us: 0, duplicate: 0.0, reorder: 0.0, ..impairment };
        let mut link = link(steady);
        run(&mut link, &traffic);
        if let Some(rate) = steady.rate_bytes_s {
            // A second may begin within a datagram.
            let most = u64::from(rate) + on_the_wire(1400) as u64;
            prop_assert!(link.counts().delivered.peak_bytes_s <= most);
        }
    }
}

#[test]
fn headers_take_their_part_of_the_rate() {
    // IP fragments have a header each.
    assert_eq!([0, 100, 1472, 1473].map(on_the_wire), [28, 128, 1500, 1521]);
}

#[test]
fn a_perfect_link_delivers_all_at_once_and_in_order() {
    let traffic = vec![(0, 100), (0, 200), (5, 300)];
    let arrivals = run(&mut link(Impairment::default()), &traffic);
    assert_eq!(arrivals, [(0, 0, 0), (1, 0, 0), (2, 5, 5)]);
}

#[test]
fn a_full_queue_drops_datagrams() {
    let slow = Impairment {
        rate_bytes_s: Some(1000),
        queue_bytes: 256,
        ..Impairment::default()
    };
    let mut link = link(slow);
    // With headers each has 128 bytes and takes 128 ms.
    let arrivals = run(
        &mut link,
        &vec![(0, 100), (0, 100), (0, 100), (128_000, 100)],
    );
    assert_eq!(
        arrivals,
        [(0, 0, 128_000), (1, 0, 256_000), (3, 128_000, 384_000)]
    );
    assert_eq!(link.counts().dropped, 1);
    assert_eq!(link.counts().longest_wait_us, 128_000);
}

#[test]
fn a_share_is_lost_and_another_doubled() {
    let bad = Impairment {
        loss: 0.05,
        duplicate: 0.1,
        reorder: 0.2,
        ..Impairment::default()
    };
    let mut link = link(bad);
    run(&mut link, &vec![(1000, 100); 20_000]);
    let counts = link.counts();
    for (name, found, expected) in [
        ("lost", counts.lost, 1000.0),
        ("doubled", counts.doubled, 1900.0),
        ("held back", counts.held_back, 3800.0),
    ] {
        // Five standard deviations of a count.
        let off = (found as f64 - expected).abs();
        assert!(off < 5.0 * f64::sqrt(expected), "{name}: {found}");
    }
}

#[test]
fn a_cut_lets_nothing_in_and_ends_by_itself() {
    let mut link = link(Impairment::default());
    link.cut(1_000_000);
    let arrivals = run(&mut link, &vec![(0, 10), (999_999, 10), (1, 10)]);
    assert_eq!(arrivals, [(2, 1_000_000, 1_000_000)]);
    assert_eq!(link.counts().cut, 2);
}

#[test]
fn an_impairment_may_change_while_datagrams_are_on_the_way() {
    let far = Impairment {
        delay_us: 50_000,
        ..Impairment::default()
    };
    let mut link = link(far);
    link.offer(0, 10, 0);
    link.set(Impairment::default());
    link.offer(10, 10, 1);
    assert_eq!(link.impairment(), Impairment::default());
    // The second does not overtake the first, since reordering is off.
    assert_eq!(
        (link.take(49_999), link.take(50_000), link.take(50_000)),
        (None, Some(0), Some(1))
    );
    link.restart_counts();
    assert_eq!(link.counts().offered.datagrams, 0);
}
