//! A refusal by fusion ends a running edge, so it counts only if repeated. Without keys, any
//! program in the network can send a single one.

use super::{Micros, SECOND_US};

/// Number of refusals needed, and their least duration, microseconds. Fusion repeats a refusal once
/// a second.
const ENOUGH: u32 = 3;
const LASTS_US: Micros = 3 * SECOND_US / 2;

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
        let lasts = self.since_us.is_some_and(|at| now_us - at >= LASTS_US);
        lasts && self.count >= ENOUGH
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
