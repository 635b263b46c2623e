//! Inference that fails again and again: what is reported of it, and when an edge gives up.

use super::{Micros, SECOND_US};

/// A failure is reported for so long, microseconds: until it would have come again.
const REPORTED_US: Micros = 2 * SECOND_US;
/// An edge whose inference fails for so long without any success is of no use: whoever started it starts it again,
/// microseconds.
const GIVEN_UP_US: Micros = 10 * SECOND_US;
/// Fewest failures after which it gives up.
const ENOUGH: u64 = 5;

/// The failures of an edge's inference.
#[derive(Debug, Clone, Default)]
pub struct Failures {
    /// Since when it has failed without a success between, and how often.
    since: Option<(Micros, u64)>,
    last: Option<(Micros, String)>,
    all: u64,
}

impl Failures {
    /// Inference has worked.
    pub fn worked(&mut self) {
        self.since = None;
    }

    /// Inference has failed at `now_us`; whether the edge should give up.
    pub fn failed(&mut self, why: String, now_us: Micros) -> bool {
        let (since_us, times) = self.since.unwrap_or((now_us, 0));
        self.since = Some((since_us, times + 1));
        self.last = Some((now_us, why));
        self.all += 1;
        now_us - since_us >= GIVEN_UP_US && times + 1 >= ENOUGH
    }

    /// What failed in the last seconds, in words; `None` where nothing did.
    pub fn words(&self, now_us: Micros) -> Option<String> {
        let (at_us, why) = self.last.as_ref()?;
        let is_recent = now_us - at_us <= REPORTED_US;
        let times = self.all;
        is_recent.then(|| format!("ticks are not done, {times} so far: {why}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_failure_is_reported_for_seconds_and_a_lasting_one_ends_the_edge() {
        let mut failures = Failures::default();
        assert_eq!(failures.words(0), None);
        let why = || "no memory".to_owned();
        assert!(!failures.failed(why(), 0));
        assert_eq!(
            failures.words(SECOND_US).unwrap(),
            "ticks are not done, 1 so far: no memory"
        );
        assert_eq!(failures.words(3 * SECOND_US), None);
        let ends = (1..30).find(|second| failures.failed(why(), second * SECOND_US));
        assert_eq!(ends, Some(10));
    }

    #[test]
    fn one_that_works_in_between_goes_on() {
        let mut failures = Failures::default();
        for second in 0..60 {
            assert!(!failures.failed("at times".to_owned(), second * SECOND_US));
            if second % 5 == 0 {
                failures.worked();
            }
        }
        // Few failures long after each other are no lasting one.
        let mut rare = Failures::default();
        assert!((0..4).all(|i| !rare.failed("rare".to_owned(), i * 20 * SECOND_US)));
    }
}
