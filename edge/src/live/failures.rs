//! Repeated failures of inference: what is reported, and when an edge gives up.

use super::{Micros, SECOND_US};

/// Time for which a failure is reported, microseconds. A lasting failure would repeat within it.
const REPORTED_US: Micros = 2 * SECOND_US;
/// An edge gives up if inference fails for this time without a success, microseconds. Its
/// supervisor then restarts it.
const GIVEN_UP_US: Micros = 10 * SECOND_US;
/// Fewest failures before it gives up.
const ENOUGH: u64 = 5;

/// The failures of an edge's inference.
#[derive(Debug, Clone, Default)]
pub struct Failures {
    /// Time of the first failure since the last success, and number of failures since.
    since: Option<(Micros, u64)>,
    last: Option<(Micros, String)>,
    all: u64,
}

impl Failures {
    /// Records a success.
    pub fn worked(&mut self) {
        self.since = None;
    }

    /// Records a failure at `now_us`.
    pub fn failed(&mut self, why: String, now_us: Micros) {
        let (since_us, times) = self.since.unwrap_or((now_us, 0));
        self.since = Some((since_us, times + 1));
        self.last = Some((now_us, why));
        self.all += 1;
    }

    /// A message about failures in the last seconds, and whether the edge should give up; `None`
    /// without failures.
    pub fn recent(&self, now_us: Micros) -> Option<(String, bool)> {
        let (at_us, why) = self.last.as_ref()?;
        if now_us - at_us > REPORTED_US {
            return None;
        }
        let is_lasting = |(since_us, times)| now_us - since_us >= GIVEN_UP_US && times >= ENOUGH;
        let words = format!("ticks fail, {} so far: {why}", self.all);
        Some((words, self.since.is_some_and(is_lasting)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fail(failures: &mut Failures, second: i64) -> bool {
        failures.failed("no memory".to_owned(), second * SECOND_US);
        failures.recent(second * SECOND_US).unwrap().1
    }

    #[test]
    fn a_failure_is_reported_and_a_lasting_one_ends_the_edge() {
        let mut failures = Failures::default();
        assert_eq!(failures.recent(0), None);
        assert!(!fail(&mut failures, 0));
        let (words, _) = failures.recent(SECOND_US).unwrap();
        assert_eq!(words, "ticks fail, 1 so far: no memory");
        assert_eq!(failures.recent(3 * SECOND_US), None);
        let ends = (1..30).find(|&second| fail(&mut failures, second));
        assert_eq!(ends, Some(10));
        assert_eq!(
            failures.recent(13 * SECOND_US),
            None,
            "it is not called any more"
        );
    }

    #[test]
    fn a_success_between_failures_keeps_the_edge_running() {
        let mut failures = Failures::default();
        for second in 0..60 {
            assert!(!fail(&mut failures, second));
            if second % 5 == 0 {
                failures.worked();
            }
        }
        // A few failures with long pauses are no lasting failure.
        let mut rare = Failures::default();
        assert!((0..4).all(|i| !fail(&mut rare, i * 20)));
    }
}
