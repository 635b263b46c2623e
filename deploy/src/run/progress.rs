//! How far a run is: a bar on a terminal, a line now and then elsewhere.

use std::io::{IsTerminal as _, stderr};
use std::ops::Range;
use std::time::Duration;

use farfield_fusion::node::{LinkProgress, Progress};
use farfield_node::process::say;
use farfield_proto::message::live::EdgeLink;
use farfield_proto::tick::Tick;
use indicatif::{HumanBytes, ProgressBar, ProgressStyle};
use tokio::time::Instant;

use super::check::RunPlan;
use super::follow::{Follow, ProgressDetail};
use super::remaining::{TimeLeft, has_end};

/// How often a line is printed where there is no terminal.
const LINE_EVERY: Duration = Duration::from_secs(10);

/// How long a run may take before the first line: a short one needs none.
const FIRST_LINE_AFTER: Duration = Duration::from_secs(1);

/// Shows the progress of one run on standard error.
pub(super) struct ProgressLine {
    bar: Option<ProgressBar>,
    first: Option<i64>,
    /// `None`: there is no end.
    total: Option<i64>,
    /// Live: the delay of the poses, and how every edge is.
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

/// How many ticks there will be, where there is an end.
fn total_of(ticks: Option<&Range<Tick>>) -> Option<i64> {
    let total = ticks.map(|ticks| ticks.end - ticks.start);
    total.filter(|total| has_end(*total))
}

/// Delay and edges, as the end of a line.
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
        // The first report comes when a tick has passed already: rates count from there.
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

    fn tell(&mut self, line: &str) {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_run_without_an_end_has_no_number_of_ticks() {
        let total = |end| total_of(Some(&(Tick(5)..Tick(end))));
        assert_eq!(total(125), Some(120));
        assert_eq!(total(1 << 40), None, "a recording that repeats");
        assert_eq!(total_of(None), None, "cameras");
    }

    #[test]
    fn live_the_line_says_how_late_poses_are_and_how_every_edge_is() {
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
}
