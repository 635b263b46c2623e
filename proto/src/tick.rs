//! The venue's frame number, which is the only clock of the algorithm; and microseconds, the unit
//! of all other clocks.

use std::fmt;
use std::ops::{Add, Range, Sub};

use serde::{Deserialize, Serialize};

/// Frame number at the venue's rate (frames per second), the same for all cameras.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default, Serialize, Deserialize,
)]
#[serde(transparent)]
pub struct Tick(pub i64);

impl Tick {
    /// Seconds from tick 0 at `rate_hz`.
    pub fn seconds(self, rate_hz: f64) -> f64 {
        self.0 as f64 / rate_hz
    }
}

impl Add<i64> for Tick {
    type Output = Self;

    fn add(self, ticks: i64) -> Self {
        Self(self.0.saturating_add(ticks))
    }
}

impl Sub for Tick {
    type Output = i64;

    fn sub(self, earlier: Self) -> i64 {
        self.0.saturating_sub(earlier.0)
    }
}

impl fmt::Display for Tick {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

/// Microseconds: a time of a clock (since 1970 for wall clocks), or a duration.
pub type Micros = i64;

/// Microseconds of a second.
pub const SECOND_US: Micros = 1_000_000;

/// Parses a half-open range of ticks, `A..B`.
///
/// # Errors
/// A message for the operator when the text does not have that form or the range is empty.
pub fn parse_range(text: &str) -> Result<Range<Tick>, String> {
    let wrong = || format!("found {text:?}, expected A..B with A below B, for example 300..900");
    let (from, to) = text.split_once("..").ok_or_else(wrong)?;
    let tick = |t: &str| t.trim().parse().map(Tick).map_err(|_| wrong());
    let range = tick(from)?..tick(to)?;
    if range.is_empty() {
        Err(wrong())
    } else {
        Ok(range)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_range_is_half_open_and_never_empty() {
        assert_eq!(parse_range("300..900"), Ok(Tick(300)..Tick(900)));
        assert_eq!(parse_range("-5..1"), Ok(Tick(-5)..Tick(1)));
        for bad in ["", "5", "5..", "..5", "5..5", "9..5", "1..=5", "a..b"] {
            assert!(parse_range(bad).is_err(), "{bad:?}");
        }
    }
}
