//! When the next tick is stepped, and whether over what has come or without input.
//!
//! A tick is stepped when all who are waited for have sent their sets, or its deadline has passed, and the tick
//! before it was. A core that is too slow for the venue does not fall behind for ever: ticks that have been
//! ready for too long are stepped without input, which carries everybody on by the model and costs little.

use super::Micros;

/// How long a tick may be ready before it is stepped without input, microseconds. A detection pass that takes long
/// holds up the ticks behind it: so long they may take to catch up.
pub const LONGEST_LAG_US: Micros = 150_000;

/// What to do now.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Next {
    /// Nothing before this time, unless a message comes.
    WaitUntil(Micros),
    /// Step the next tick over what has come.
    Step,
    /// Step the next tick without input: the core is behind.
    StepWithoutInput,
}

/// Whom the next tick waits for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Waiting {
    /// For nobody.
    ForNobody,
    /// For somebody, until then.
    Until(Micros),
}

/// Keeps the ticks' turns.
#[derive(Debug, Clone, Copy, Default)]
pub struct TickQueue {
    /// When the tick before was ready.
    ready_us: Micros,
    /// When the next tick was seen ready, if it was.
    next_ready_us: Option<Micros>,
}

impl TickQueue {
    /// Whether the next tick, which is at `tick_us`, is stepped at `now_us`.
    pub fn next(&mut self, tick_us: Micros, waiting: Waiting, now_us: Micros) -> Next {
        let ready_us = match (self.next_ready_us, waiting) {
            (Some(ready_us), _) => ready_us,
            (None, Waiting::Until(deadline_us)) if now_us < deadline_us => {
                return Next::WaitUntil(deadline_us);
            }
            (None, Waiting::Until(deadline_us)) => deadline_us,
            // Also a tick that nobody says anything of has its time.
            (None, Waiting::ForNobody) if now_us < tick_us => return Next::WaitUntil(tick_us),
            (None, Waiting::ForNobody) => now_us,
        };
        let ready_us = ready_us.max(self.ready_us);
        self.next_ready_us = Some(ready_us);
        if now_us - ready_us > LONGEST_LAG_US {
            Next::StepWithoutInput
        } else {
            Next::Step
        }
    }

    /// The next tick was handed to the core.
    pub fn stepped(&mut self) {
        if let Some(ready_us) = self.next_ready_us.take() {
            self.ready_us = ready_us;
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const PERIOD_US: Micros = 16_667;

    #[test]
    fn a_tick_waits_for_its_messages_but_not_past_its_deadline() {
        let mut queue = TickQueue::default();
        let missing = Waiting::Until(1_020_000);
        assert_eq!(
            queue.next(1_000_000, missing, 1_010_000),
            Next::WaitUntil(1_020_000)
        );
        assert_eq!(queue.next(1_000_000, missing, 1_020_000), Next::Step);
        queue.stepped();
        assert_eq!(
            queue.next(1_016_667, Waiting::ForNobody, 1_017_000),
            Next::Step
        );
    }

    #[test]
    fn without_anybody_ticks_come_at_their_times() {
        let mut queue = TickQueue::default();
        let early = queue.next(1_000_000, Waiting::ForNobody, 990_000);
        assert_eq!(early, Next::WaitUntil(1_000_000));
        assert_eq!(
            queue.next(1_000_000, Waiting::ForNobody, 1_000_000),
            Next::Step
        );
    }

    #[test]
    fn ticks_behind_a_long_detection_pass_are_stepped_over_what_has_come() {
        let mut queue = TickQueue::default();
        let detection_us = 1_000_000;
        assert_eq!(
            queue.next(
                detection_us,
                Waiting::Until(detection_us + 300_000),
                detection_us + 300_000
            ),
            Next::Step
        );
        queue.stepped();
        // The core takes 5 ms for each of the ticks that wait behind.
        for i in 1..18 {
            let now_us = detection_us + 300_000 + i * 5_000;
            assert_eq!(
                queue.next(detection_us + i * PERIOD_US, Waiting::ForNobody, now_us),
                Next::Step
            );
            queue.stepped();
        }
    }

    proptest! {
        #[test]
        fn a_slow_core_never_falls_behind_for_ever(full_us in 17_000i64..60_000, empty_us in 100i64..8_000) {
            let mut queue = TickQueue::default();
            let (mut now_us, mut over_nothing) = (0, 0.0);
            let n = 2_000;
            for tick in 0..n {
                let tick_us = tick * PERIOD_US;
                let ready_us = tick_us + 10_000;
                now_us = now_us.max(ready_us);
                let waiting = Waiting::Until(ready_us);
                match queue.next(tick_us, waiting, now_us) {
                    Next::Step => now_us += full_us,
                    Next::StepWithoutInput => {
                        now_us += empty_us;
                        over_nothing += 1.0;
                    }
                    Next::WaitUntil(_) => prop_assert!(false, "it was ready"),
                }
                queue.stepped();
                prop_assert!(now_us - ready_us <= LONGEST_LAG_US + full_us + PERIOD_US);
            }
            // As many are left out as must be, and hardly more.
            let share = (full_us - PERIOD_US) as f64 / (full_us - empty_us) as f64;
            prop_assert!((over_nothing / n as f64) < share + 0.02);
        }

        #[test]
        fn a_core_that_is_fast_enough_leaves_nothing_out(full_us in 100i64..15_000) {
            let mut queue = TickQueue::default();
            let mut now_us = 0;
            for tick in 0..1_000 {
                let ready_us = tick * PERIOD_US + 10_000;
                now_us = now_us.max(ready_us);
                prop_assert_eq!(queue.next(tick * PERIOD_US, Waiting::Until(ready_us), now_us), Next::Step);
                queue.stepped();
                now_us += full_us;
            }
        }
    }
}
