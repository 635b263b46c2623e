//! The venue's ticks by this machine's clock.
//!
//! ```text
//!   tick = round((own clock + correction - epoch) x rate)
//! ```
//!
//! Epoch and correction come from fusion. A small change of the correction is slewed, so that ticks
//! keep their length; a large one is a step, as in NTP (RFC 5905, section 11.3).

use farfield_proto::message::live::LiveBoxes;
use farfield_proto::tick::Tick;

use super::{Micros, SECOND_US};

/// Change of the correction from which the clock is stepped, microseconds: a tick at 60 Hz. A slew
/// of more would take seconds, with wrong ticks throughout.
pub const STEP_FROM_US: Micros = 16_667;
/// Slew rate, microseconds per second: half a percent, which changes a tick of 60 Hz by 83
/// microseconds.
pub const SLEW_US_PER_S: Micros = 5_000;

/// The venue's ticks by this machine's clock.
#[derive(Debug, Clone, PartialEq)]
pub struct TickClock {
    rate_hz: f64,
    epoch_us: Option<u64>,
    /// The current correction.
    correction_us: Micros,
    /// The target of the slew.
    wanted_us: Micros,
    slewed_at_us: Option<Micros>,
    steps: u64,
}

impl TickClock {
    /// A clock without an epoch.
    pub fn new(rate_hz: f64) -> Self {
        Self {
            rate_hz,
            epoch_us: None,
            correction_us: 0,
            wanted_us: 0,
            slewed_at_us: None,
            steps: 0,
        }
    }

    /// Sets epoch and correction from fusion's message at `now_us`. Returns whether the clock was
    /// stepped, which invalidates earlier time differences.
    pub fn set(&mut self, live: &LiveBoxes, now_us: Micros) -> bool {
        self.slew(now_us);
        let mut stepped = self.epoch_us.replace(live.epoch_us) != Some(live.epoch_us);
        // A restarted fusion does not know the correction yet, so the previous one stays.
        self.wanted_us = live
            .clock_correction_us
            .map_or(self.wanted_us, Micros::from);
        if (self.wanted_us - self.correction_us).abs() >= STEP_FROM_US {
            self.correction_us = self.wanted_us;
            stepped = true;
        }
        self.steps += u64::from(stepped);
        stepped
    }

    /// Number of steps. Counts from a tick before a step are invalid.
    pub fn steps(&self) -> u64 {
        self.steps
    }

    /// Slews the correction for the time since the last call.
    pub fn slew(&mut self, now_us: Micros) {
        let since_us = self.slewed_at_us.map_or(0, |at| (now_us - at).max(0));
        let most_us = since_us.saturating_mul(SLEW_US_PER_S) / SECOND_US;
        // Time too short for a microsecond of slew is kept for the next call.
        if most_us > 0 || self.slewed_at_us.is_none() {
            self.slewed_at_us = Some(now_us);
        }
        self.correction_us += (self.wanted_us - self.correction_us).clamp(-most_us, most_us);
    }

    /// Unix time of tick 0, microseconds; `None` before fusion's first message.
    pub fn epoch_us(&self) -> Option<u64> {
        self.epoch_us
    }

    /// The current correction, microseconds.
    pub fn correction_us(&self) -> i32 {
        self.correction_us as i32
    }

    /// The tick nearest to `own_us`.
    pub fn tick_at(&self, own_us: Micros) -> Option<Tick> {
        let since_us = self.since_epoch_us(own_us)?;
        Some(Tick((since_us as f64 * self.rate_hz / 1e6).round() as i64))
    }

    /// Time of `tick` by this machine's clock, microseconds.
    pub fn own_time_us(&self, tick: Tick) -> Option<Micros> {
        let epoch_us = Micros::try_from(self.epoch_us?).ok()?;
        let since_us = (tick.seconds(self.rate_hz) * 1e6).round() as Micros;
        Some(
            epoch_us
                .saturating_add(since_us)
                .saturating_sub(self.correction_us),
        )
    }

    /// Time from `tick` to `own_us`, microseconds.
    pub fn after_us(&self, own_us: Micros, tick: Tick) -> Option<Micros> {
        Some(own_us.saturating_sub(self.own_time_us(tick)?))
    }

    /// Length of a tick, microseconds.
    pub fn period_us(&self) -> Micros {
        (1e6 / self.rate_hz).round() as Micros
    }

    fn since_epoch_us(&self, own_us: Micros) -> Option<Micros> {
        let epoch_us = Micros::try_from(self.epoch_us?).ok()?;
        Some(
            own_us
                .saturating_add(self.correction_us)
                .saturating_sub(epoch_us),
        )
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn live(epoch_us: u64, clock_correction_us: i32) -> LiveBoxes {
        LiveBoxes {
            sequence: 0,
            epoch_us,
            clock_correction_us: Some(clock_correction_us),
            heard: None,
            every_nth_tick: 0,
        }
    }

    #[test]
    fn without_an_epoch_there_is_no_tick() {
        let clock = TickClock::new(60.0);
        assert_eq!(clock.tick_at(5), None);
        assert_eq!(clock.own_time_us(Tick(5)), None);
    }

    #[test]
    fn a_tick_is_the_nearest_one() {
        let mut clock = TickClock::new(50.0);
        clock.set(&live(1_000_000, 0), 0);
        assert_eq!(clock.tick_at(1_000_000), Some(Tick(0)));
        assert_eq!(clock.tick_at(1_009_999), Some(Tick(0)));
        assert_eq!(clock.tick_at(1_010_001), Some(Tick(1)));
        assert_eq!(clock.tick_at(985_000), Some(Tick(-1)));
        assert_eq!(clock.after_us(1_023_000, Tick(1)), Some(3_000));
    }

    #[test]
    fn a_large_correction_is_a_step_and_a_small_one_is_slewed() {
        let mut clock = TickClock::new(60.0);
        assert!(clock.set(&live(0, 500_000), 0));
        assert_eq!(clock.correction_us(), 500_000);
        assert!(!clock.set(&live(0, 490_000), 0));
        assert_eq!(clock.correction_us(), 500_000);
        clock.slew(SECOND_US);
        assert_eq!(clock.correction_us(), 495_000);
        clock.slew(10 * SECOND_US);
        assert_eq!(clock.correction_us(), 490_000);
    }

    #[test]
    fn a_correction_outlives_the_fusion_that_sent_it() {
        // Symptom to prevent: a restarted fusion sent a correction of 0 until it had measured one,
        // and a correct clock was stepped away.
        let mut clock = TickClock::new(60.0);
        clock.set(&live(0, -80_000), 0);
        let not_known = LiveBoxes {
            clock_correction_us: None,
            ..live(0, 0)
        };
        assert!(!clock.set(&not_known, SECOND_US));
        assert_eq!(clock.correction_us(), -80_000);
        // A slew in progress continues.
        clock.set(&live(0, -81_000), SECOND_US);
        assert!(!clock.set(&not_known, 2 * SECOND_US));
        assert_eq!(clock.correction_us(), -81_000);
    }

    #[test]
    fn another_epoch_is_a_step() {
        let mut clock = TickClock::new(60.0);
        assert!(clock.set(&live(5, 0), 0));
        assert!(!clock.set(&live(5, 0), 1));
        assert!(clock.set(&live(6, 0), 2));
    }

    proptest! {
        #[test]
        fn the_time_of_a_tick_is_of_that_tick(
            second in -4e9f64..4e9, rate_hz in 10.0f64..1000.0, correction in -1_000_000i32..1_000_000,
        ) {
            let tick = (second * rate_hz) as i64;
            let mut clock = TickClock::new(rate_hz);
            clock.set(&live(1_700_000_000_000_000, correction), 0);
            let at = clock.own_time_us(Tick(tick)).unwrap();
            prop_assert_eq!(clock.tick_at(at), Some(Tick(tick)));
            let half = clock.period_us() / 2;
            prop_assert!(clock.after_us(at, Tick(tick)).unwrap().abs() <= 1);
            prop_assert_eq!(clock.tick_at(at + half - 2), Some(Tick(tick)));
        }

        #[test]
        fn the_slew_rate_does_not_depend_on_the_calls(steps in prop::collection::vec(1i64..3000, 1..200)) {
            let mut clock = TickClock::new(60.0);
            clock.set(&live(0, 0), 0);
            clock.set(&live(0, 10_000), 0);
            let mut now = 0;
            for step in steps {
                now += step;
                clock.slew(now);
            }
            let wanted = (now * SLEW_US_PER_S / SECOND_US).min(10_000);
            prop_assert!((Micros::from(clock.correction_us()) - wanted).abs() <= 1 + wanted / 2);
            prop_assert!(Micros::from(clock.correction_us()) <= wanted);
        }
    }
}
