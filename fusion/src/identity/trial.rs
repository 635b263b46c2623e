//! What a tentative person must go through: what it explains must keep being explained, no more
//! viewpoints may contradict it than bear it out, and it must not be a picture.

use crate::identity::phase::Verdict;
use crate::identity::poster::Stillness;
use crate::identity::tentative::TentativeTick;
use crate::method::Method;

/// Looks before contradictions can end a trial: detectors miss people now and then.
const MIN_LOOKS: u32 = 3;

/// The votes of the looks since a birth.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct Trial {
    looks: u32,
    seen: u32,
    missed: u32,
}

impl Trial {
    /// Takes in what the viewpoints of one look said: how many saw the body, how many should have. A look
    /// in which no viewpoint could say anything is none.
    pub(crate) fn hear(&mut self, [seen, missed]: [u32; 2]) {
        if seen + missed == 0 {
            return;
        }
        self.looks += 1;
        self.seen += seen;
        self.missed += missed;
    }

    /// Whether the viewpoints that look contradict the body.
    fn is_contradicted(&self) -> bool {
        self.looks >= MIN_LOOKS && self.missed >= self.seen
    }

    /// The verdict after `ticks`.
    pub(crate) fn verdict(&self, ticks: &[TentativeTick], method: &Method) -> Verdict {
        let births = &method.parameters.births;
        if self.is_contradicted() {
            return Verdict::Nobody;
        }
        let window = births.confirm_ticks as usize;
        if ticks.len() < window {
            return Verdict::Open;
        }
        let seen_s = ticks.len() as f64 * method.dt_s;
        match Stillness::of(ticks, &method.relative_sigmas) {
            Some(stillness) if stillness.is_picture(births) => {
                if seen_s > births.still_s {
                    Verdict::Picture
                } else {
                    Verdict::Open
                }
            }
            _ => Verdict::Somebody,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn contradictions_end_a_trial_and_single_misses_do_not() {
        let mut trial = Trial::default();
        trial.hear([2, 1]);
        trial.hear([1, 3]);
        assert!(!trial.is_contradicted());
        trial.hear([2, 1]);
        assert!(trial.is_contradicted());
        let mut trial = Trial::default();
        for _ in 0..10 {
            trial.hear([2, 1]);
        }
        assert!(!trial.is_contradicted());
    }

    #[test]
    fn looks_that_say_nothing_contradict_nobody() {
        let mut trial = Trial::default();
        for _ in 0..3 {
            trial.hear([0, 0]);
        }
        assert!(!trial.is_contradicted());
    }
}
