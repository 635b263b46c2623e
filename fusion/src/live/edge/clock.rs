//! Clock offset of an edge, and round trip to it.
//!
//! Four instants per exchange, as in NTP (RFC 5905, section 8): t1 fusion sends a box set, t2 the
//! edge receives it, t3 the edge sends patches, t4 they arrive.
//!
//! ```text
//!   round trip = (t4 - t1) - (t3 - t2)
//!   t3 - t4 <= offset <= t2 - t1                   the edge's clock less fusion's
//! ```
//!
//! An exchange proves only that neither direction takes negative time, whatever share of the round
//! trip each has. The exchanges of the last seconds without queueing give the tightest bounds, each
//! direction separately. If the system reports that NTP or PTP synchronises the edge's clock, the
//! offset is zero as far as the bounds allow. Otherwise it is the middle, as in NTP.

use std::collections::VecDeque;

use farfield_proto::message::health::SystemClock;
use farfield_proto::message::live::MAX_CLOCK_CORRECTION_US;

use super::common_clock::OffsetBounds;
use crate::live::{Micros, SECOND_US};

/// How long an exchange counts.
const LIFE_US: Micros = 8 * SECOND_US;
/// The best of each of these spans is remembered.
const SPAN_US: Micros = SECOND_US / 4;
/// Relative drift of two clocks, parts per million: bounds widen by this. Oscillators are good to
/// 50, and each node's clock approaches its system's by 100 (`VenueClock`).
const DRIFT_PPM: Micros = 300;
/// Exchanges after which the clock is known.
const ENOUGH: u32 = 4;
/// An exchange that contradicts the others by more was made with a clock that has been set.
const CONTRADICTION_US: Micros = 1_000;
/// After so many of them in a row, the earlier exchanges are discarded.
const CONTRADICTIONS: usize = 3;
/// The correction changes only if its error is larger: smaller errors come from queues.
const DEAD_BAND_US: Micros = 500;
/// Largest offset that is measured: a machine without any time source is in 1970.
const LARGEST_US: Micros = 100 * 365 * 86_400 * SECOND_US;
/// Limit of round trip and hold time: other exchanges are invalid.
const LONGEST_US: Micros = 60 * SECOND_US;

/// One exchange, in the clock that each instant was read from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Exchange {
    /// Fusion sent the box set: fusion's clock.
    pub boxes_sent_us: Micros,
    /// How long the edge had held it when it sent the patches.
    pub held_us: Micros,
    /// The edge sent the patches: its corrected clock.
    pub patches_sent_us: Micros,
    /// The correction in force at that time.
    pub correction_us: Micros,
    /// They arrived: fusion's clock.
    pub arrived_us: Micros,
}

/// Result of one exchange, or of the best of several.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Measured {
    at_us: Micros,
    round_trip_us: Micros,
    /// Of the edge's own clock, before any correction.
    offset: OffsetBounds,
}

/// State of one edge's clock.
#[derive(Debug, Clone, Default)]
pub struct EdgeClock {
    /// The best of each span, oldest first.
    best: VecDeque<Measured>,
    /// The newest exchanges, if they contradict those.
    contradictions: Vec<Measured>,
    exchanges: u32,
    newest_round_trip_us: Option<Micros>,
    /// Usual round trip, microseconds: a running mean.
    usual_round_trip_us: f64,
    /// The edge's report about its system's clock.
    system: Option<SystemClock>,
    /// Common time of the venue's systems, relative to fusion's clock.
    common_us: Micros,
    reported_us: Option<Micros>,
}

impl EdgeClock {
    /// Adds an exchange; an invalid one is ignored.
    pub fn add(&mut self, exchange: &Exchange) {
        let Some(measured) = measure(exchange) else {
            return;
        };
        self.newest_round_trip_us = Some(measured.round_trip_us);
        let round_trip_us = measured.round_trip_us as f64;
        let weight = if self.exchanges == 0 { 1.0 } else { 0.05 };
        self.usual_round_trip_us += weight * (round_trip_us - self.usual_round_trip_us);
        self.exchanges = self.exchanges.saturating_add(1);
        if self.contradicts(&measured) {
            self.contradictions.push(measured);
            if self.contradictions.len() < CONTRADICTIONS {
                return;
            }
            self.best.clear();
            for measured in std::mem::take(&mut self.contradictions) {
                self.remember(measured);
            }
        } else {
            self.contradictions.clear();
            self.remember(measured);
        }
        self.update_correction();
    }

    /// Sets the edge's report about its system's clock.
    pub fn set_system(&mut self, system: Option<SystemClock>) {
        self.system = system;
        self.update_correction();
    }

    /// Sets the common time of all systems.
    pub fn set_common(&mut self, common_us: Micros) {
        self.common_us = common_us;
        self.update_correction();
    }

    /// Forgets everything: another edge took the place.
    pub fn clear(&mut self) {
        *self = Self {
            common_us: self.common_us,
            ..Self::default()
        };
    }

    /// Whether there are enough exchanges to use the edge's times.
    pub fn is_known(&self) -> bool {
        self.exchanges >= ENOUGH && !self.best.is_empty()
    }

    /// Whether the edge's system reports that its clock is synchronised.
    pub fn is_synchronised(&self) -> bool {
        self.system.is_some_and(|system| system.synchronised)
    }

    /// The edge's own clock minus fusion's, before any correction, best estimate; `None` until it
    /// is known.
    pub fn offset_us(&self) -> Option<Micros> {
        let bounds = self.bounds()?;
        Some(if self.is_synchronised() {
            bounds.nearest(self.common_us.saturating_sub(self.ahead_us()))
        } else {
            bounds.middle_us()
        })
    }

    /// The clock of the edge's system minus fusion's, best estimate.
    pub fn system_offset_us(&self) -> Option<Micros> {
        Some(self.offset_us()?.saturating_add(self.ahead_us()))
    }

    /// Greatest error of [`Self::offset_us`], microseconds; `None` until it is known.
    pub fn uncertainty_us(&self) -> Option<Micros> {
        let (bounds, offset_us) = (self.bounds()?, self.offset_us()?);
        Some((offset_us - bounds.lo_us).max(bounds.hi_us - offset_us))
    }

    /// Bounds of the offset of the edge's system clock; `None` until it is known.
    pub fn system_bounds(&self) -> Option<OffsetBounds> {
        Some(self.bounds()?.moved(self.ahead_us()))
    }

    /// The shortest round trip of the last seconds; `None` until it is known.
    pub fn round_trip_us(&self) -> Option<Micros> {
        let round_trips = self.best.iter().map(|m| m.round_trip_us);
        round_trips.min().filter(|_| self.is_known())
    }

    /// The round trip of the newest exchange.
    pub fn newest_round_trip_us(&self) -> Option<Micros> {
        self.newest_round_trip_us
    }

    /// The usual round trip; `None` until it is known.
    pub fn usual_round_trip_us(&self) -> Option<Micros> {
        self.is_known()
            .then_some(self.usual_round_trip_us as Micros)
    }

    /// The correction that the edge shall add to its clock; `None` until it is known, or if it
    /// exceeds the protocol's limit.
    pub fn correction_us(&self) -> Option<i32> {
        let reported_us = i32::try_from(self.reported_us?).ok()?;
        (reported_us.unsigned_abs() <= MAX_CLOCK_CORRECTION_US.unsigned_abs())
            .then_some(reported_us)
    }

    /// Least error of the edge's system clock, whatever the split of the round trip.
    pub fn surely_off_us(&self) -> Micros {
        self.system_bounds()
            .map_or(0, |bounds| bounds.beyond_us(self.common_us))
    }

    /// By how much the edge's system is ahead of the clock that the edge uses.
    fn ahead_us(&self) -> Micros {
        self.system.map_or(0, |system| system.ahead_us)
    }

    /// Bounds from all exchanges of the last seconds.
    fn bounds(&self) -> Option<OffsetBounds> {
        let newest_us = self.best.back()?.at_us;
        let faded = self.best.iter().map(|m| {
            let fade_us = (newest_us - m.at_us).max(0) * DRIFT_PPM / SECOND_US;
            (m.offset.lo_us - fade_us, m.offset.hi_us + fade_us)
        });
        let (lo_us, hi_us) = faded.reduce(|a, b| (a.0.max(b.0), a.1.min(b.1)))?;
        let bounds = if lo_us <= hi_us {
            OffsetBounds { lo_us, hi_us }
        } else {
            // The clock drifts faster than that: the offset is between the bounds.
            OffsetBounds {
                lo_us: hi_us,
                hi_us: lo_us,
            }
        };
        self.is_known().then_some(bounds)
    }

    fn contradicts(&self, measured: &Measured) -> bool {
        self.bounds().is_some_and(|bounds| {
            let OffsetBounds { lo_us, hi_us } = measured.offset;
            (lo_us - bounds.hi_us).max(bounds.lo_us - hi_us) > CONTRADICTION_US
        })
    }

    fn remember(&mut self, measured: Measured) {
        let span = measured.at_us.div_euclid(SPAN_US);
        match self.best.back_mut() {
            Some(last) if last.at_us.div_euclid(SPAN_US) >= span => {
                last.round_trip_us = last.round_trip_us.min(measured.round_trip_us);
                last.offset.lo_us = last.offset.lo_us.max(measured.offset.lo_us);
                last.offset.hi_us = last.offset.hi_us.min(measured.offset.hi_us);
            }
            _ => self.best.push_back(measured),
        }
        let oldest_us = measured.at_us - LIFE_US;
        while self.best.front().is_some_and(|m| m.at_us < oldest_us) {
            self.best.pop_front();
        }
    }

    fn update_correction(&mut self) {
        if let Some(offset_us) = self.offset_us() {
            let reported_us = self.reported_us.unwrap_or(0);
            let is_wrong = offset_us.saturating_add(reported_us).saturating_abs() > DEAD_BAND_US;
            self.reported_us = Some(if is_wrong {
                offset_us.saturating_neg()
            } else {
                reported_us
            });
        }
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
    let (lo_us, hi_us) = (t3.saturating_sub(t4), t2.saturating_sub(t1));
    let possible = (0..LONGEST_US).contains(&round_trip_us) && held_us >= 0;
    let near = [lo_us, hi_us, correction_us]
        .iter()
        .all(|us| us.unsigned_abs() < LARGEST_US.unsigned_abs());
    (possible && near).then(|| Measured {
        at_us: t4,
        round_trip_us,
        offset: OffsetBounds { lo_us, hi_us }.moved(-correction_us),
    })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// An edge whose clock is off by `offset_us`, with one-way delays of `there_us` and `back_us`.
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
    fn the_offset_is_measured_under_any_correction() {
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
            "an asymmetric link would look the same"
        );
    }

    #[test]
    fn a_large_offset_is_certain() {
        let mut clock = EdgeClock::default();
        (0..10).for_each(|i| clock.add(&exchange(i * 16_667, -500_000, 100_000, 100_000)));
        assert_eq!(clock.surely_off_us(), 400_000);
    }

    #[test]
    fn a_corrected_clock_is_known_within_seconds() {
        let mut clock = EdgeClock::default();
        (0..100).for_each(|i| clock.add(&exchange(i * 16_667, 500_000, 1_000, 1_000)));
        (100..800).for_each(|i| clock.add(&exchange(i * 16_667, 0, 1_200, 1_200)));
        assert_eq!(
            (clock.offset_us(), clock.correction_us()),
            (Some(0), Some(0))
        );
    }

    #[test]
    fn corrections_beyond_the_protocol_limit_are_not_sent() {
        let most_us = Micros::from(MAX_CLOCK_CORRECTION_US);
        for (offset_us, correction) in [
            (most_us, Some(-MAX_CLOCK_CORRECTION_US)),
            (-most_us, Some(MAX_CLOCK_CORRECTION_US)),
            (most_us + 1, None),
            (-most_us - 1, None),
            (1 << 40, None),
        ] {
            let mut clock = EdgeClock::default();
            (0..10).for_each(|i| clock.add(&exchange(i * 16_667, offset_us, 100, 100)));
            assert_eq!(clock.correction_us(), correction, "{offset_us}");
        }
    }

    #[test]
    fn impossible_exchanges_are_ignored() {
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

    fn synchronised(ahead_us: Micros) -> SystemClock {
        SystemClock {
            synchronised: true,
            max_error_us: None,
            ahead_us,
        }
    }

    #[test]
    fn a_synchronised_clock_is_not_corrected_for_an_asymmetric_link() {
        for (there_us, back_us) in [(10_000, 30_000), (10_000, 90_000), (90_000, 10_000)] {
            let mut clock = EdgeClock::default();
            (0..100).for_each(|i| clock.add(&exchange(i * 16_667, 0, there_us, back_us)));
            let assumed_us = clock.correction_us().unwrap();
            assert_eq!(
                Micros::from(assumed_us).abs(),
                (there_us - back_us).abs() / 2
            );
            clock.set_system(Some(synchronised(0)));
            assert_eq!(
                (clock.offset_us(), clock.correction_us()),
                (Some(0), Some(0))
            );
            assert_eq!(clock.uncertainty_us(), Some(there_us.max(back_us)));
        }
    }

    #[test]
    fn a_proved_offset_is_corrected_despite_a_synchronised_system() {
        let mut clock = EdgeClock::default();
        clock.set_system(Some(synchronised(0)));
        (0..100).for_each(|i| clock.add(&exchange(i * 16_667, 50_000, 10_000, 30_000)));
        // It is at least 20 ms ahead.
        assert_eq!(clock.correction_us(), Some(-20_000));
        assert_eq!(clock.surely_off_us(), 20_000);
    }

    #[test]
    fn a_clock_jump_is_followed_within_a_few_exchanges() {
        let mut clock = EdgeClock::default();
        (0..600).for_each(|i| clock.add(&exchange(i * 16_667, -2_000_000, 30_000, 10_000)));
        assert!(clock.surely_off_us() > 1_900_000);
        (600..603).for_each(|i| clock.add(&exchange(i * 16_667, 0, 30_000, 10_000)));
        assert_eq!(clock.surely_off_us(), 0);
        assert!(clock.offset_us().unwrap().abs() <= 10_000);
    }

    #[test]
    fn a_corrected_system_is_right_despite_the_edges_old_time() {
        let mut clock = EdgeClock::default();
        let exchanges = |clock: &mut EdgeClock, from: i64| {
            (from..from + 60)
                .for_each(|i| clock.add(&exchange(i * 16_667, -2_000_000, 30_000, 10_000)));
        };
        clock.set_system(Some(synchronised(0)));
        exchanges(&mut clock, 0);
        assert!(clock.surely_off_us() > 1_900_000);
        clock.set_system(Some(synchronised(2_000_000)));
        assert_eq!(clock.surely_off_us(), 0);
        exchanges(&mut clock, 60);
        assert_eq!(
            clock.correction_us(),
            Some(2_000_000),
            "exact, on an asymmetric link"
        );
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
            // Each direction takes at least 5 ms.
            prop_assert!((found - offset).abs() <= clock.uncertainty_us().unwrap() - 5_000);
            let round_trip = clock.round_trip_us().unwrap();
            prop_assert!(clock.uncertainty_us().unwrap() <= round_trip / 2 + LIFE_US * DRIFT_PPM / SECOND_US + 1);
            prop_assert!(Micros::from(clock.correction_us().unwrap() + found as i32).abs() <= DEAD_BAND_US);
            prop_assert!(clock.best.len() <= (LIFE_US / SPAN_US + 2) as usize);
        }
    }
}
