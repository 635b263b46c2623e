//! When a running edge gives up: after repeated failures of inference, or repeated refusals by
//! fusion. Without keys, any program in the network can send a single refusal, so one does not
//! count.

use super::{Micros, SECOND_US};

/// Time for which a failure is reported, microseconds. A lasting failure would repeat within it.
const REPORTED_US: Micros = 2 * SECOND_US;
/// An edge gives up if inference fails for this time without a success, microseconds. Its
/// supervisor then restarts it.
const GIVE_UP_AFTER_US: Micros = 10 * SECOND_US;
/// Fewest failures before it gives up.
const MIN_FAILURES: u64 = 5;

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
        let is_lasting =
            |(since_us, times)| now_us - since_us >= GIVE_UP_AFTER_US && times >= MIN_FAILURES;
        let words = format!("ticks fail, {} so far: {why}", self.all);
        Some((words, self.since.is_some_and(is_lasting)))
    }
}

/// Number of refusals needed, and their least duration, microseconds. Fusion repeats a refusal once
/// a second.
const MIN_REFUSALS: u32 = 3;
const REFUSALS_LAST_US: Micros = 3 * SECOND_US / 2;

/// Refusals since the last acceptance.
#[derive(Debug, Clone, Default)]
pub struct RepeatedRefusal {
    since_us: Option<Micros>,
    count: u32,
}

impl RepeatedRefusal {
    /// Records a refusal at `now_us`.
    pub fn note_refusal(&mut self, now_us: Micros) {
        self.since_us.get_or_insert(now_us);
        self.count = self.count.saturating_add(1);
    }

    /// Records an acceptance, which cancels earlier refusals.
    pub fn note_acceptance(&mut self) {
        *self = Self::default();
    }

    /// Whether the refusal was repeated often and long enough.
    pub fn is_confirmed(&self, now_us: Micros) -> bool {
        let lasts = self
            .since_us
            .is_some_and(|at| now_us - at >= REFUSALS_LAST_US);
        lasts && self.count >= MIN_REFUSALS
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

    #[test]
    fn a_refusal_once_a_second_is_confirmed_by_the_third() {
        let mut refusal = RepeatedRefusal::default();
        for (second, stands) in [(0, false), (1, false), (2, true)] {
            refusal.note_refusal(second * SECOND_US);
            assert_eq!(refusal.is_confirmed(second * SECOND_US), stands);
        }
    }

    #[test]
    fn neither_one_refusal_nor_many_at_once_are_confirmed() {
        let mut refusal = RepeatedRefusal::default();
        refusal.note_refusal(0);
        assert!(!refusal.is_confirmed(i64::MAX));
        let mut refusal = RepeatedRefusal::default();
        (0..100).for_each(|_| refusal.note_refusal(0));
        assert!(!refusal.is_confirmed(0));
    }

    #[test]
    fn forged_refusals_between_acceptances_are_never_confirmed() {
        let mut refusal = RepeatedRefusal::default();
        for second in 0..100 {
            (0..10).for_each(|_| refusal.note_refusal(second * SECOND_US));
            assert!(!refusal.is_confirmed(second * SECOND_US));
            refusal.note_acceptance();
        }
    }
}
