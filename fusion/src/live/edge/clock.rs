//! How far an edge's clock is off, and how long the round trip to it is.
//!
//! Four instants per exchange, as NTP has them (RFC 5905, section 8): t1 fusion sends a box set, t2 the edge
//! hears it, t3 the edge sends patches, t4 they arrive.
//!
//! ```text
//!   round trip = (t4 - t1) - (t3 - t2)
//!   offset     = ((t2 - t1) + (t3 - t4)) / 2       the edge's clock less fusion's
//! ```
//!
//! The error of the offset is at most half of the round trip, and least where nothing waited in a queue: so
//! the exchange with the shortest round trip of the last seconds is believed.

use std::collections::VecDeque;

use farfield_proto::message::live::MAX_CLOCK_CORRECTION_US;

use crate::live::{Micros, SECOND_US};

/// How long an exchange counts.
const LIFE_US: Micros = 8 * SECOND_US;
/// The best exchange of each of these spans is kept.
const SPAN_US: Micros = SECOND_US / 4;
/// Exchanges after which the clock is known.
const ENOUGH: u32 = 4;
/// The correction is told anew when it is wrong by more: less is the restlessness of queues.
const DEAD_BAND_US: Micros = 500;
/// Largest offset that is measured: a machine that was never told the time is in 1970.
const LARGEST_US: Micros = 100 * 365 * 86_400 * SECOND_US;
/// What is longer, or earlier, is no exchange.
const LONGEST_US: Micros = 60 * SECOND_US;

/// One exchange, in the clock that each instant was read from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Exchange {
    /// Fusion sent the box set: fusion's clock.
    pub boxes_sent_us: Micros,
    /// For how long the edge had it when it sent the patches.
    pub held_us: Micros,
    /// The edge sent the patches: its corrected clock.
    pub patches_sent_us: Micros,
    /// The correction that was in force then.
    pub correction_us: Micros,
    /// They arrived: fusion's clock.
    pub arrived_us: Micros,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[expect(clippy::struct_field_names, reason = "the unit is part of each name")]
struct Measured {
    at_us: Micros,
    round_trip_us: Micros,
    /// Of the edge's own clock, before any correction.
    offset_us: Micros,
}

/// What is known of one edge's clock.
#[derive(Debug, Clone, Default)]
pub struct EdgeClock {
    /// The best of each span, oldest first.
    best: VecDeque<Measured>,
    exchanges: u32,
    newest_round_trip_us: Option<Micros>,
    /// Round trips as they mostly are, microseconds: a running mean.
    usual_round_trip_us: f64,
    told_us: Option<Micros>,
}

impl EdgeClock {
    /// Takes an exchange; one that cannot have been is left out.
    pub fn add(&mut self, exchange: &Exchange) {
        let Some(measured) = measure(exchange) else {
            return;
        };
        self.newest_round_trip_us = Some(measured.round_trip_us);
        let round_trip_us = measured.round_trip_us as f64;
        let weight = if self.exchanges == 0 { 1.0 } else { 0.05 };
        self.usual_round_trip_us += weight * (round_trip_us - self.usual_round_trip_us);
        self.exchanges = self.exchanges.saturating_add(1);
        let span = measured.at_us.div_euclid(SPAN_US);
        match self.best.back_mut() {
            Some(last) if last.at_us.div_euclid(SPAN_US) >= span => {
                if measured.round_trip_us <= last.round_trip_us {
                    *last = Measured {
                        at_us: last.at_us,
                        ..measured
                    };
                }
            }
            _ => self.best.push_back(measured),
        }
        let oldest_us = measured.at_us - LIFE_US;
        while self.best.front().is_some_and(|m| m.at_us < oldest_us) {
            self.best.pop_front();
        }
        if let Some(offset_us) = self.offset_us() {
            let told_us = self.told_us.unwrap_or(0);
            let is_wrong = (offset_us + told_us).abs() > DEAD_BAND_US;
            self.told_us = Some(if is_wrong { -offset_us } else { told_us });
        }
    }

    /// Forgets everything: another edge stands in the place.
    pub fn clear(&mut self) {
        *self = Self::default();
    }

    /// Whether enough is known to use what the edge says.
    pub fn is_known(&self) -> bool {
        self.exchanges >= ENOUGH
    }

    /// The edge's own clock less fusion's, before any correction; `None` until it is known.
    pub fn offset_us(&self) -> Option<Micros> {
        self.shortest().map(|m| m.offset_us)
    }

    /// The shortest round trip of the last seconds; `None` until it is known.
    pub fn round_trip_us(&self) -> Option<Micros> {
        self.shortest().map(|m| m.round_trip_us)
    }

    /// The round trip of the newest exchange.
    pub fn newest_round_trip_us(&self) -> Option<Micros> {
        self.newest_round_trip_us
    }

    /// The round trip as it mostly is; `None` until it is known.
    pub fn usual_round_trip_us(&self) -> Option<Micros> {
        self.is_known()
            .then_some(self.usual_round_trip_us as Micros)
    }

    /// What the edge shall add to its clock; `None` until it is known, and where it is more than can be told.
    pub fn correction_us(&self) -> Option<i32> {
        let told_us = i32::try_from(self.told_us?).ok()?;
        (told_us.unsigned_abs() <= MAX_CLOCK_CORRECTION_US.unsigned_abs()).then_some(told_us)
    }

    /// By how much the clock is off at least, whichever share of the round trip each way takes.
    pub fn surely_off_us(&self) -> Micros {
        let of = |m: &Measured| (m.offset_us.abs() - m.round_trip_us / 2).max(0);
        self.shortest().map_or(0, of)
    }

    fn shortest(&self) -> Option<&Measured> {
        let best = self.best.iter().min_by_key(|m| m.round_trip_us);
        best.filter(|_| self.is_known())
    }
}

fn measure(exchange: &Exchange) -> Option<Measured> {
    let Exchange {
        boxes_sent_us: t1,
        held_us,
        patches_sent_us: t3,
        correction_us,
        arrived_us: t4,
    } = *exchange;
    let t2 = t3.saturating_sub(held_us);
    let round_trip_us = t4.saturating_sub(t1).saturating_sub(held_us);
    let offset_us = (t2.saturating_sub(t1)).saturating_add(t3.saturating_sub(t4)) / 2;
    let possible = (0..LONGEST_US).contains(&round_trip_us) && held_us >= 0;
    let near = offset_us.abs() < LARGEST_US && correction_us.abs() < LARGEST_US;
    (possible && near).then_some(Measured {
        at_us: t4,
        round_trip_us,
        offset_us: offset_us - correction_us,
    })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// An edge whose clock is off by `offset_us`, `there_us` and `back_us` away.
    fn exchange(at_us: Micros, offset_us: Micros, there_us: Micros, back_us: Micros) -> Exchange {
        let correction_us = 1_000;
        Exchange {
            boxes_sent_us: at_us,
            held_us: 4_000,
            patches_sent_us: at_us + there_us + 4_000 + offset_us + correction_us,
            correction_us,
            arrived_us: at_us + there_us + 4_000 + back_us,
        }
    }

    #[test]
    fn a_clock_that_is_off_is_found_whatever_correction_is_in_force() {
        let mut clock = EdgeClock::default();
        for i in 0..3 {
            clock.add(&exchange(i * 16_667, 20_000, 40_000, 40_000));
            assert_eq!((clock.offset_us(), clock.correction_us()), (None, None));
        }
        clock.add(&exchange(60_000, 20_000, 40_000, 40_000));
        assert_eq!(clock.offset_us(), Some(20_000));
        assert_eq!(clock.round_trip_us(), Some(80_000));
        assert_eq!(clock.correction_us(), Some(-20_000));
        assert_eq!(
            clock.surely_off_us(),
            0,
            "a lopsided link would look the same"
        );
    }

    #[test]
    fn a_clock_that_is_far_off_is_surely_off() {
        let mut clock = EdgeClock::default();
        (0..10).for_each(|i| clock.add(&exchange(i * 16_667, -500_000, 100_000, 100_000)));
        assert_eq!(clock.surely_off_us(), 400_000);
    }

    #[test]
    fn a_clock_that_is_set_right_is_known_to_be_within_the_last_seconds() {
        let mut clock = EdgeClock::default();
        (0..100).for_each(|i| clock.add(&exchange(i * 16_667, 500_000, 1_000, 1_000)));
        (100..800).for_each(|i| clock.add(&exchange(i * 16_667, 0, 1_200, 1_200)));
        assert_eq!(
            (clock.offset_us(), clock.correction_us()),
            (Some(0), Some(0))
        );
    }

    #[test]
    fn what_is_told_can_be_read_up_to_the_bound_and_beyond_nothing_is_told() {
        let most_us = Micros::from(MAX_CLOCK_CORRECTION_US);
        for (offset_us, told) in [
            (most_us, Some(-MAX_CLOCK_CORRECTION_US)),
            (-most_us, Some(MAX_CLOCK_CORRECTION_US)),
            (most_us + 1, None),
            (-most_us - 1, None),
            (1 << 40, None),
        ] {
            let mut clock = EdgeClock::default();
            (0..10).for_each(|i| clock.add(&exchange(i * 16_667, offset_us, 100, 100)));
            assert_eq!(clock.correction_us(), told, "{offset_us}");
        }
    }

    #[test]
    fn what_cannot_have_been_counts_for_nothing() {
        let mut clock = EdgeClock::default();
        for i in 0..10 {
            clock.add(&Exchange {
                held_us: 1 << 40,
                ..exchange(i, 0, 5, 5)
            });
            clock.add(&Exchange {
                patches_sent_us: i64::MAX,
                ..exchange(i, 0, 5, 5)
            });
            clock.add(&Exchange {
                boxes_sent_us: i64::MIN,
                ..exchange(i, 0, 5, 5)
            });
        }
        assert!(!clock.is_known());
    }

    proptest! {
        #[test]
        fn queues_hardly_disturb_the_offset(
            waits in prop::collection::vec((0i64..150_000, 0i64..150_000), 100..400),
            offset in -200_000i64..200_000,
        ) {
            let mut clock = EdgeClock::default();
            for (i, (there, back)) in (0i64..).zip(&waits) {
                clock.add(&exchange(i * 16_667, offset, 5_000 + there, 5_000 + back));
            }
            let found = clock.offset_us().unwrap();
            let round_trip = clock.round_trip_us().unwrap();
            prop_assert!((found - offset).abs() <= (round_trip - 10_000) / 2 + 1);
            prop_assert!(Micros::from(clock.correction_us().unwrap() + found as i32).abs() <= DEAD_BAND_US);
            prop_assert!(clock.best.len() <= (LIFE_US / SPAN_US + 2) as usize);
        }
    }
}
