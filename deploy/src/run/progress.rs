//! Progress of a run: a bar on a terminal, otherwise a line every few seconds; and the time left.

use std::io::{IsTerminal as _, stderr};
use std::ops::Range;
use std::time::Duration;

use farfield_fusion_node::{LinkProgress, Progress};
use farfield_node::process::{LineKind, say};
use farfield_proto::message::live::EdgeLink;
use farfield_proto::tick::Tick;
use indicatif::{HumanBytes, ProgressBar, ProgressStyle};
use tokio::time::Instant;

use super::check::RunPlan;

/// How much fusion reports of each tick.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum ProgressDetail {
    /// The number of persons.
    Counts,
    /// Their poses, too.
    Bodies,
}

/// Shows a run in progress.
pub(crate) trait Follow {
    /// The detail that it needs of each tick.
    fn detail(&self) -> ProgressDetail;

    /// A tick is done.
    fn tick(&mut self, progress: &Progress);

    /// Live, once a second: the state of the links to the edges.
    fn links(&mut self, _links: &LinkProgress) {}

    /// Whether lines of this kind are printed.
    fn wants(&self, _kind: LineKind) -> bool {
        true
    }

    /// Prints a line for the operator.
    fn print(&mut self, line: &str) {
        say(format_args!("{line}"));
    }

    /// There will be no more ticks.
    fn finish(&mut self);
}

/// Interval of lines without a terminal.
const LINE_EVERY: Duration = Duration::from_secs(10);

/// Time before the first line; a shorter run prints none.
const FIRST_LINE_AFTER: Duration = Duration::from_secs(1);

/// Shows the progress of one run on standard error.
pub(super) struct ProgressLine {
    bar: Option<ProgressBar>,
    first: Option<i64>,
    /// `None`: the run has no end.
    total: Option<i64>,
    /// Live: delay of the poses and state of every edge.
    links: Option<String>,
    began: Option<Instant>,
    left: TimeLeft,
    last_line: Option<Instant>,
}

impl ProgressLine {
    pub(super) fn new(plan: &RunPlan) -> Self {
        let total = total_of(plan.ticks.as_ref());
        let bar = stderr().is_terminal().then(|| {
            let (bar, shown) = match total {
                Some(total) => (
                    ProgressBar::new(total.unsigned_abs()),
                    "{bar:30} {pos}/{len} {msg}",
                ),
                None => (ProgressBar::new_spinner(), "{spinner} {msg}"),
            };
            if let Ok(style) = ProgressStyle::with_template(shown) {
                bar.set_style(style);
            }
            bar.set_message("starting");
            bar
        });
        Self {
            bar,
            first: plan.ticks.as_ref().map(|ticks| ticks.start.0),
            total,
            links: None,
            began: None,
            left: TimeLeft::default(),
            last_line: None,
        }
    }

    fn is_line_due(&self, now: Instant, elapsed: Duration) -> bool {
        match self.last_line {
            Some(last) => now.duration_since(last) >= LINE_EVERY,
            None => elapsed >= FIRST_LINE_AFTER,
        }
    }
}

/// Number of ticks of a run that has an end.
fn total_of(ticks: Option<&Range<Tick>>) -> Option<i64> {
    let total = ticks.map(|ticks| ticks.end - ticks.start);
    total.filter(|total| has_end(*total))
}

/// Delay and edges, appended to a line.
fn shown(links: &LinkProgress) -> String {
    let ms = |us: u32| f64::from(us) / 1e3;
    let delay = links.delay_us.map_or_else(String::new, |(p50_us, p99_us)| {
        format!(", delay {:.0} ms (99 %: {:.0} ms)", ms(p50_us), ms(p99_us))
    });
    let edge = |link: &EdgeLink| {
        let name = &link.viewpoint;
        match (link.live, link.round_trip_us) {
            (true, Some(us)) => format!("; {name} {:.1} ms", ms(us)),
            (true, None) => format!("; {name} there"),
            (false, _) if link.refused.is_some() => format!("; {name} refused"),
            (false, _) => format!("; {name} silent"),
        }
    };
    let edges: String = links.edges.iter().map(edge).collect();
    format!("{delay}{edges}")
}

impl Follow for ProgressLine {
    fn detail(&self) -> ProgressDetail {
        ProgressDetail::Counts
    }

    fn tick(&mut self, tick: &Progress) {
        let now = Instant::now();
        let elapsed = now.duration_since(*self.began.get_or_insert(now));
        let elapsed_s = elapsed.as_secs_f64();
        let done = tick.tick.0 - *self.first.get_or_insert(tick.tick.0) + 1;
        // The first report comes after the first tick, so rates are counted from there.
        let rate = if elapsed_s > 0.0 {
            (done - 1) as f64 / elapsed_s
        } else {
            0.0
        };
        let bytes_per_s = if elapsed_s > 0.0 {
            tick.bytes as f64 / elapsed_s
        } else {
            0.0
        };
        let links = self.links.as_deref().unwrap_or_default();
        let total = self.total.map(i64::unsigned_abs);
        let left = total.and_then(|total| self.left.at(now, done.unsigned_abs(), total));
        let left = left.map_or_else(String::new, |left| format!("{left}, "));
        let message = format!(
            "{left}tick {}, {rate:.1} ticks/s, {} persons, {}/s{links}",
            tick.tick,
            tick.persons,
            HumanBytes(bytes_per_s as u64)
        );
        if let Some(bar) = &self.bar {
            bar.set_position(done.unsigned_abs());
            bar.set_message(message);
        } else if self.is_line_due(now, elapsed) {
            self.last_line = Some(now);
            match self.total {
                Some(total) => say(format_args!("{done} of {total}: {message}")),
                None => say(format_args!("{message}")),
            }
        }
    }

    fn links(&mut self, links: &LinkProgress) {
        self.links = Some(shown(links));
    }

    fn print(&mut self, line: &str) {
        match &self.bar {
            Some(bar) => bar.suspend(|| say(format_args!("{line}"))),
            None => say(format_args!("{line}")),
        }
    }

    fn finish(&mut self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}

/// Minimum time measured: the first ticks wait for caches, detection passes and each other.
const KNOWN_AFTER: Duration = Duration::from_secs(3);
/// Minimum ticks measured, unless they take very long. The first tick has a detection pass in every camera: from it
/// alone, a run of a minute seems to take ten.
const KNOWN_AFTER_TICKS: u64 = 10;
const KNOWN_AT_LAST: Duration = Duration::from_secs(30);
/// Older ticks than one or two of these do not count: the first ticks are slow, and so are those with many people.
const LATELY: Duration = Duration::from_secs(15);

/// Runs with this many ticks count as endless (a month at 100 000 ticks a second): recordings that repeat have more.
const WITHOUT_END: i64 = 1 << 38;

/// Whether a run of so many ticks ends by itself.
pub(super) fn has_end(n_ticks: i64) -> bool {
    n_ticks < WITHOUT_END
}

/// Measures the recent rate of ticks.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct TimeLeft {
    /// Time of the first report.
    first: Option<Instant>,
    /// Start of the measured span: time and ticks done.
    began: Option<(Instant, u64)>,
    /// Start of the next span.
    next: Option<(Instant, u64)>,
}

impl TimeLeft {
    /// Records that `done` of `total` ticks are done at `now`. Returns the time left, once it is known.
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

/// A rounded time.
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
    fn a_run_without_an_end_has_no_total() {
        let total = |end| total_of(Some(&(Tick(5)..Tick(end))));
        assert_eq!(total(125), Some(120));
        assert_eq!(total(1 << 40), None, "a recording that repeats");
        assert_eq!(total_of(None), None, "cameras");
    }

    #[test]
    fn the_live_line_shows_delay_and_state_of_every_edge() {
        let edge = |name: &str, live, refused: Option<&str>| EdgeLink {
            viewpoint: name.to_owned(),
            live,
            refused: refused.map(str::to_owned),
            round_trip_us: Some(1_240),
            clock_offset_us: None,
            horizon_ticks: 2.0,
            bytes_per_s: 0,
            late: 0,
            missing: 0,
            unreadable: 0,
        };
        let links = LinkProgress {
            delay_us: Some((31_400, 44_000)),
            edges: vec![
                edge("north", true, None),
                edge("east", false, None),
                edge("south", false, Some("its clock is off")),
            ],
        };
        assert_eq!(
            shown(&links),
            ", delay 31 ms (99 %: 44 ms); north 1.2 ms; east silent; south refused"
        );
    }

    #[test]
    fn the_time_left_is_known_after_enough_ticks() {
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
    fn a_few_slow_ticks_give_no_estimate_until_much_time_has_passed() {
        let start = Instant::now();
        let at = |s: u64| start + Duration::from_secs(s);
        let mut left = TimeLeft::default();
        // Two ticks in ten seconds, and from there on two a second: 90 take a minute, not seven.
        let shown = [(0, 1), (5, 2), (10, 3), (13, 9)].map(|(s, done)| left.at(at(s), done, 90));
        assert_eq!(shown, [const { None }; 4]);
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
        let shown = (0..=70).filter_map(|s| {
            let (done, now) = (done(s), start + Duration::from_secs(s));
            left.at(now, done, done + 2000)
        });
        assert_eq!(shown.last().unwrap(), "about 4 min left");
    }

    #[test]
    fn only_a_repeating_recording_has_no_end() {
        assert!(has_end(0) && has_end(365 * 86_400 * 1000));
        assert!(!has_end(1 << 40));
    }

    #[test]
    fn a_run_without_progress_has_no_estimate() {
        let start = Instant::now();
        let mut left = TimeLeft::default();
        assert_eq!(left.at(start, 5, 100), None);
        assert_eq!(left.at(start + Duration::from_mins(1), 5, 100), None);
    }

    #[test]
    fn times_are_rounded() {
        for (seconds, shown) in [
            (0.2, "1 s"),
            (41.0, "40 s"),
            (95.0, "2 min"),
            (5000.0, "84 min"),
            (9000.0, "2.5 h"),
        ] {
            assert_eq!(span(seconds), shown);
        }
    }
}
