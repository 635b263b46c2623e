//! How far a run is: a bar on a terminal, a line now and then elsewhere.

use std::io::{IsTerminal as _, stderr};
use std::time::Duration;

use farfield_fusion::node::{Progress, say};
use indicatif::{HumanBytes, ProgressBar, ProgressStyle};
use tokio::time::Instant;

use super::check::Plan;
use super::follow::{Detail, Follow};

/// How often a line is printed where there is no terminal.
const LINE_EVERY: Duration = Duration::from_secs(10);

/// How long a run may take before the first line: a short one needs none.
const FIRST_LINE_AFTER: Duration = Duration::from_secs(1);

/// Shows the progress of one run on standard error.
pub(super) struct ProgressLine {
    bar: Option<ProgressBar>,
    first: i64,
    total: i64,
    began: Option<Instant>,
    last_line: Option<Instant>,
}

impl ProgressLine {
    pub(super) fn new(plan: &Plan) -> Self {
        let total = plan.ticks.end - plan.ticks.start;
        let bar = stderr().is_terminal().then(|| {
            let bar = ProgressBar::new(total.unsigned_abs());
            if let Ok(style) = ProgressStyle::with_template("{bar:30} {pos}/{len} {msg} {eta}") {
                bar.set_style(style);
            }
            bar.set_message("starting");
            bar
        });
        Self {
            bar,
            first: plan.ticks.start.0,
            total,
            began: None,
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

impl Follow for ProgressLine {
    fn detail(&self) -> Detail {
        Detail::Counts
    }

    fn tick(&mut self, tick: &Progress) {
        let now = Instant::now();
        let elapsed = now.duration_since(*self.began.get_or_insert(now));
        let elapsed_s = elapsed.as_secs_f64();
        let done = tick.tick.0 - self.first + 1;
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
        let message = format!(
            "tick {}, {rate:.1} ticks/s, {} persons, {}/s",
            tick.tick,
            tick.persons,
            HumanBytes(bytes_per_s as u64)
        );
        if let Some(bar) = &self.bar {
            bar.set_position(done.unsigned_abs());
            bar.set_message(message);
        } else if self.is_line_due(now, elapsed) {
            self.last_line = Some(now);
            say(format_args!("{done} of {}: {message}", self.total));
        }
    }

    fn finish(&mut self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}
