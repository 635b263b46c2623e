//! Which counters have grown of late. Nodes count losses since their start: one of yesterday is no alarm.

use std::collections::BTreeMap;

use farfield_proto::tick::{Micros, SECOND_US};

/// How long a loss is worth a word.
const LATELY_US: Micros = 60 * SECOND_US;

/// Counters, by the keys of their alarms: the value, and when it last grew.
#[derive(Debug, Clone, Default)]
pub(super) struct Growth(BTreeMap<String, (u64, Option<Micros>)>);

impl Growth {
    /// Whether a counter that is `value` now has grown in the last minute. What it was when it was first heard of is not
    /// known to be new; a node that starts again counts from 0.
    pub(super) fn has_grown(&mut self, key: &str, value: u64, now_us: Micros) -> bool {
        let Some((before, grown_us)) = self.0.get_mut(key) else {
            self.0.insert(key.to_owned(), (value, None));
            return false;
        };
        if value > *before {
            *grown_us = Some(now_us);
        }
        *before = value;
        grown_us.is_some_and(|grown_us| now_us.saturating_sub(grown_us) < LATELY_US)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_loss_is_said_for_a_minute() {
        let mut growth = Growth::default();
        let mut at = |s: Micros, value| growth.has_grown("link/ne/dropped", value, s * SECOND_US);
        assert!(!at(0, 7), "nobody knows when the seven were lost");
        assert!(!at(1, 7));
        assert!(at(2, 8) && at(61, 8));
        assert!(!at(62, 8));
        assert!(!at(63, 0), "it has started again");
        assert!(at(64, 1));
    }
}
