//! Conversion between ticks and times.

use farfield_proto::tick::Tick;

use super::Micros;

/// The venue's ticks on the venue's clock: tick t is at epoch + t / rate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TickTime {
    epoch_us: u64,
    rate_hz: f64,
}

impl TickTime {
    /// Tick 0 is at `epoch_us` of Unix time; `rate_hz`, above 0, ticks follow per second.
    pub fn new(epoch_us: u64, rate_hz: f64) -> Self {
        Self { epoch_us, rate_hz }
    }

    /// The epoch for which `tick` is at `at_us`; 0 if that would be before 1970.
    pub fn with_tick_at(tick: Tick, at_us: Micros, rate_hz: f64) -> Self {
        let epoch_us = at_us.saturating_sub(span_us(tick, rate_hz));
        Self::new(u64::try_from(epoch_us).unwrap_or(0), rate_hz)
    }

    /// Unix time of tick 0, microseconds.
    pub fn epoch_us(&self) -> u64 {
        self.epoch_us
    }

    /// Tick period, microseconds.
    pub fn period_us(&self) -> f64 {
        1e6 / self.rate_hz
    }

    /// The time of `tick`.
    pub fn at(&self, tick: Tick) -> Micros {
        let epoch_us = Micros::try_from(self.epoch_us).unwrap_or(Micros::MAX);
        epoch_us.saturating_add(span_us(tick, self.rate_hz))
    }

    /// The first tick that is not before `us`.
    pub fn first_from(&self, us: Micros) -> Tick {
        let epoch_us = Micros::try_from(self.epoch_us).unwrap_or(Micros::MAX);
        let ticks = us.saturating_sub(epoch_us) as f64 * self.rate_hz / 1e6;
        // Tick times are whole microseconds: a tick less than one microsecond behind counts.
        Tick((ticks - self.rate_hz / 1e6).ceil() as i64)
    }
}

/// From tick 0 to `tick`. f64 holds 53 bits, so this is exact to one microsecond for the next two
/// centuries.
fn span_us(tick: Tick, rate_hz: f64) -> Micros {
    (tick.0 as f64 * 1e6 / rate_hz).round() as Micros
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn an_epoch_can_follow_from_the_time_of_a_tick() {
        let time = TickTime::with_tick_at(Tick(300), 1_700_000_005_000_000, 60.0);
        assert_eq!(time.at(Tick(300)), 1_700_000_005_000_000);
        assert_eq!(time.epoch_us(), 1_700_000_000_000_000);
        assert_eq!(TickTime::with_tick_at(Tick(300), 0, 60.0).epoch_us(), 0);
    }

    proptest! {
        #[test]
        fn first_from_the_time_of_a_tick_is_that_tick(
            rate_hz in 10.0f64..500.0, at in 0i64..2_000_000_000,
        ) {
            let time = TickTime::new(0, rate_hz);
            let tick = time.first_from(at * SECOND_US);
            prop_assert!(time.at(tick) >= at * SECOND_US - 1);
            prop_assert!(time.at(tick + -1) < at * SECOND_US);
            prop_assert_eq!(time.first_from(time.at(tick)), tick);
        }
    }

    use super::super::SECOND_US;
}
