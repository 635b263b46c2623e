//! When the next tick is stepped, and whether with the messages that came or without input.
//!
//! A tick is stepped when all awaited edges have sent their sets, or at its deadline, after the
//! previous tick. A core that is too slow for the venue does not fall further and further behind.
//! Ticks that have been ready for too long are stepped without input, which predicts all people by
//! the model and costs little.

use super::Micros;

/// How long a tick may be ready before it is stepped without input, microseconds. A long detection
/// pass delays the ticks behind it: they may take that long to catch up.
pub const LONGEST_LAG_US: Micros = 150_000;

/// What to do now.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Next {
    /// Wait until this time, unless a message comes.
    WaitUntil(Micros),
    /// Step the next tick with the messages that came.
    Step,
    /// Step the next tick without input: the core is behind.
    StepWithoutInput,
}

/// What the next tick waits for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Waiting {
    /// Nothing.
    ForNone,
    /// Messages, until this time.
    Until(Micros),
}

/// Order of the ticks.
#[derive(Debug, Clone, Copy, Default)]
pub struct TickQueue {
    /// When the previous tick was ready.
    ready_us: Micros,
    /// When the next tick became ready, if it did.
    next_ready_us: Option<Micros>,
}

impl TickQueue {
    /// What to do at `now_us` about the next tick, which is at `tick_us`.
    pub fn next(&mut self, tick_us: Micros, waiting: Waiting, now_us: Micros) -> Next {
        let ready_us = match (self.next_ready_us, waiting) {
            (Some(ready_us), _) => ready_us,
            (None, Waiting::Until(deadline_us)) if now_us < deadline_us => {
                return Next::WaitUntil(deadline_us);
            }
            (None, Waiting::Until(deadline_us)) => deadline_us,
            // A tick without awaited edges also waits for its time.
            (None, Waiting::ForNone) if now_us < tick_us => return Next::WaitUntil(tick_us),
            (None, Waiting::ForNone) => now_us,
        };
        let ready_us = ready_us.max(self.ready_us);
        self.next_ready_us = Some(ready_us);
        if now_us - ready_us > LONGEST_LAG_US {
            Next::StepWithoutInput
        } else {
            Next::Step
        }
    }

    /// The next tick was given to the core.
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
    fn a_tick_waits_for_messages_until_its_deadline() {
        let mut queue = TickQueue::default();
        let missing = Waiting::Until(1_020_000);
        assert_eq!(
            queue.next(1_000_000, missing, 1_010_000),
            Next::WaitUntil(1_020_000)
        );
        assert_eq!(queue.next(1_000_000, missing, 1_020_000), Next::Step);
        queue.stepped();
        assert_eq!(
            queue.next(1_016_667, Waiting::ForNone, 1_017_000),
            Next::Step
        );
    }

    #[test]
    fn without_edges_ticks_are_stepped_at_their_times() {
        let mut queue = TickQueue::default();
        let early = queue.next(1_000_000, Waiting::ForNone, 990_000);
        assert_eq!(early, Next::WaitUntil(1_000_000));
        assert_eq!(
            queue.next(1_000_000, Waiting::ForNone, 1_000_000),
            Next::Step
        );
    }

    #[test]
    fn ticks_after_a_long_detection_pass_use_their_messages() {
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
                queue.next(detection_us + i * PERIOD_US, Waiting::ForNone, now_us),
                Next::Step
            );
            queue.stepped();
        }
    }

    proptest! {
        #[test]
        fn a_slow_core_skips_as_few_ticks_as_possible(full_us in 17_000i64..60_000, empty_us in 100i64..8_000) {
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
            // As few are skipped as possible.
            let share = (full_us - PERIOD_US) as f64 / (full_us - empty_us) as f64;
            prop_assert!((over_nothing / n as f64) < share + 0.02);
        }

        #[test]
        fn a_fast_core_skips_no_tick(full_us in 100i64..15_000) {
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
