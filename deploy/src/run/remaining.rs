//! How long a run will still take, measured from what of it was done lately. Nothing is said before that can be known.

use std::time::Duration;

use tokio::time::Instant;

/// For how long ticks must have passed: the first ones wait for caches, detection passes and each other.
const KNOWN_AFTER: Duration = Duration::from_secs(3);
/// As many must have passed, or it takes very long: the first tick of all has a detection pass of every camera in it, and told by
/// that alone a run of a minute seems to take ten.
const KNOWN_AFTER_TICKS: u64 = 10;
const KNOWN_AT_LAST: Duration = Duration::from_secs(30);
/// What is longer ago than one or two of these does not count: the first ticks are slow, and so are those with many people.
const LATELY: Duration = Duration::from_secs(15);

/// From so many ticks on nobody waits for the end, a month also at 100 000 a second: recordings that repeat have more.
const WITHOUT_END: i64 = 1 << 38;

/// Whether a run of so many ticks ends by itself, as far as anybody cares.
pub(super) fn has_end(n_ticks: i64) -> bool {
    n_ticks < WITHOUT_END
}

/// Watches ticks go by.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct TimeLeft {
    /// When the first tick was told of.
    first: Option<Instant>,
    /// When what counts began, and how many ticks were done then.
    began: Option<(Instant, u64)>,
    /// The same of what will count next.
    next: Option<(Instant, u64)>,
}

impl TimeLeft {
    /// Takes in that `done` of `total` ticks are done at `now`; says how much time is left, once that is known.
    pub(crate) fn at(&mut self, now: Instant, done: u64, total: u64) -> Option<String> {
        self.first.get_or_insert(now);
        let next = *self.next.get_or_insert((now, done));
        if now.duration_since(next.0) >= LATELY {
            self.began = self.next.replace((now, done));
        }
        let (began, before) = *self.began.get_or_insert((now, done));
        let elapsed = now.duration_since(began);
        let passed = done.saturating_sub(before);
        if elapsed < KNOWN_AFTER || passed == 0 || done >= total {
            return None;
        }
        let since_first = now.duration_since(self.first.unwrap_or(now));
        if passed < KNOWN_AFTER_TICKS && since_first < KNOWN_AT_LAST {
            return None;
        }
        let left_s = elapsed.as_secs_f64() / passed as f64 * (total - done) as f64;
        Some(format!("about {} left", span(left_s)))
    }
}

/// A time as people say it when they do not know it exactly.
fn span(seconds: f64) -> String {
    let minutes = seconds / 60.0;
    match seconds {
        ..10.0 => format!("{:.0} s", seconds.ceil()),
        ..90.0 => format!("{:.0} s", (seconds / 10.0).round() * 10.0),
        ..5400.0 => format!("{:.0} min", minutes.ceil()),
        _ => format!("{:.1} h", minutes / 60.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_time_left_is_told_from_the_ticks_that_were_measured_and_not_before() {
        let start = Instant::now();
        let at = |s: u64| start + Duration::from_secs(s);
        let mut left = TimeLeft::default();
        assert_eq!(left.at(at(0), 1, 301), None);
        assert_eq!(left.at(at(2), 11, 301), None, "two seconds are no measure");
        // 5 ticks a second, and 280 to go.
        assert_eq!(left.at(at(4), 21, 301).unwrap(), "about 60 s left");
        assert_eq!(left.at(at(60), 301, 301), None, "all is done");
    }

    #[test]
    fn a_few_slow_ticks_are_no_measure_and_where_all_are_slow_it_is_told_at_last() {
        let start = Instant::now();
        let at = |s: u64| start + Duration::from_secs(s);
        let mut left = TimeLeft::default();
        // Two ticks in ten seconds, and from there on two a second: 90 take a minute, not seven.
        let said = [(0, 1), (5, 2), (10, 3), (13, 9)].map(|(s, done)| left.at(at(s), done, 90));
        assert_eq!(said, [const { None }; 4]);
        let mut left = TimeLeft::default();
        let slow = (0..=40).step_by(10).map(|s| left.at(at(s), s / 10 + 1, 90));
        assert!(slow.last().flatten().is_some(), "a tick in ten seconds");
    }

    #[test]
    fn a_slow_start_is_forgotten() {
        let start = Instant::now();
        let mut left = TimeLeft::default();
        // 30 s at 1 a second, then 10 a second: 2000 to go take 200 s.
        let done = |s: u64| if s < 30 { s } else { 30 + 10 * (s - 30) };
        let said = (0..=70).filter_map(|s| {
            let (done, now) = (done(s), start + Duration::from_secs(s));
            left.at(now, done, done + 2000)
        });
        assert_eq!(said.last().unwrap(), "about 4 min left");
    }

    #[test]
    fn a_recording_that_repeats_has_no_end_and_one_of_a_year_has() {
        assert!(has_end(0) && has_end(365 * 86_400 * 1000));
        assert!(!has_end(1 << 40));
    }

    #[test]
    fn a_run_that_stands_still_promises_nothing() {
        let start = Instant::now();
        let mut left = TimeLeft::default();
        assert_eq!(left.at(start, 5, 100), None);
        assert_eq!(left.at(start + Duration::from_mins(1), 5, 100), None);
    }

    #[test]
    fn a_time_that_nobody_knows_exactly_is_round() {
        for (seconds, said) in [
            (0.2, "1 s"),
            (41.0, "40 s"),
            (95.0, "2 min"),
            (5000.0, "84 min"),
            (9000.0, "2.5 h"),
        ] {
            assert_eq!(span(seconds), said);
        }
    }
}
