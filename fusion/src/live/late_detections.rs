//! Whether an edge's detection passes take longer than fusion ever waits, again and again: then a parameter is wrong.

use super::{Micros, SECOND_US};

/// So many in a minute must have come too late.
const ENOUGH: u32 = 5;
const MINUTE_US: Micros = 60 * SECOND_US;

/// The late detection passes of one viewpoint.
#[derive(Debug, Clone, Default)]
pub struct LateDetections {
    since_us: Option<Micros>,
    late: u32,
    is_told: bool,
}

impl LateDetections {
    /// Takes note of sightings that came at `at_us`, so long after their tick; whether an operator should be told now.
    /// Where fusion did not wait for as long as it may, by what it has learnt of the link, the parameter is not to blame.
    pub fn is_told(&mut self, after_ms: f64, deadline_ms: f64, at_us: Micros) -> bool {
        if after_ms <= deadline_ms || self.is_told {
            return false;
        }
        if self
            .since_us
            .is_none_or(|since_us| at_us - since_us > MINUTE_US)
        {
            (self.since_us, self.late) = (Some(at_us), 0);
        }
        self.late += 1;
        self.is_told = self.late >= ENOUGH;
        self.is_told
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn told(after_ms: f64, every_us: Micros) -> usize {
        let mut late = LateDetections::default();
        let passes = (0..100).filter(|i| late.is_told(after_ms, 400.0, i * every_us));
        passes.count()
    }

    #[test]
    fn advice_is_given_once_and_only_where_it_helps() {
        assert_eq!(told(450.0, SECOND_US), 1);
        assert_eq!(told(300.0, SECOND_US), 0, "fusion did not wait that long");
        assert_eq!(
            told(450.0, 20 * SECOND_US),
            0,
            "now and then a pass is late"
        );
    }
}
