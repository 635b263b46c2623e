//! Whether an edge's detection passes repeatedly take longer than fusion ever waits: then a
//! parameter is wrong.

use super::{Micros, SECOND_US};

/// Late passes in a minute for a warning.
const ENOUGH: u32 = 5;
const MINUTE_US: Micros = 60 * SECOND_US;

/// The late detection passes of one viewpoint.
#[derive(Debug, Clone, Default)]
pub struct LateDetections {
    since_us: Option<Micros>,
    late: u32,
    is_warned: bool,
}

impl LateDetections {
    /// Records sightings that came at `at_us`, `after_ms` after their tick; returns whether to warn
    /// the operator now. The parameter is not the cause if fusion waited less than `deadline_ms`
    /// allows.
    pub fn is_warning_due(&mut self, after_ms: f64, deadline_ms: f64, at_us: Micros) -> bool {
        if after_ms <= deadline_ms || self.is_warned {
            return false;
        }
        if self
            .since_us
            .is_none_or(|since_us| at_us - since_us > MINUTE_US)
        {
            (self.since_us, self.late) = (Some(at_us), 0);
        }
        self.late += 1;
        self.is_warned = self.late >= ENOUGH;
        self.is_warned
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn warnings(after_ms: f64, every_us: Micros) -> usize {
        let mut late = LateDetections::default();
        let passes = (0..100).filter(|i| late.is_warning_due(after_ms, 400.0, i * every_us));
        passes.count()
    }

    #[test]
    fn the_warning_comes_once_and_only_for_the_parameter() {
        assert_eq!(warnings(450.0, SECOND_US), 1);
        assert_eq!(
            warnings(300.0, SECOND_US),
            0,
            "fusion did not wait that long"
        );
        assert_eq!(
            warnings(450.0, 20 * SECOND_US),
            0,
            "now and then a pass is late"
        );
    }
}
