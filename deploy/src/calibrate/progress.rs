//! How far the look at recordings is: a bar on a terminal, a line now and then elsewhere.

use std::fmt;
use std::io::{IsTerminal as _, stderr};
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use farfield_node::process::say;
use indicatif::{ProgressBar, ProgressStyle};
use tokio::time::Instant;

/// How often a line is printed where there is no terminal; a short look needs none.
const LINE_EVERY: Duration = Duration::from_secs(10);

/// Counts pictures of all cameras.
pub(super) struct LookProgress {
    bar: Option<ProgressBar>,
    pictures: u64,
    done: AtomicU64,
    last_line: Mutex<Instant>,
}

impl LookProgress {
    /// Of so many pictures.
    pub(super) fn new(pictures: u64) -> Self {
        let bar = stderr().is_terminal().then(|| {
            // The bar itself draws no more than twenty times a second.
            let bar = ProgressBar::new(pictures);
            if let Ok(style) = ProgressStyle::with_template("{bar:30} {pos}/{len} pictures {eta}") {
                bar.set_style(style);
            }
            bar
        });
        Self {
            bar,
            pictures,
            done: AtomicU64::new(0),
            last_line: Mutex::new(Instant::now()),
        }
    }

    /// One more picture was looked at.
    pub(super) fn one(&self) {
        let done = self.done.fetch_add(1, Ordering::Relaxed) + 1;
        if let Some(bar) = &self.bar {
            bar.inc(1);
        } else if let Ok(mut last) = self.last_line.try_lock()
            && last.elapsed() >= LINE_EVERY
        {
            *last = Instant::now();
            say(format_args!("{done} of {} pictures", self.pictures));
        }
    }

    /// Says a line above the bar.
    pub(super) fn say(&self, line: fmt::Arguments<'_>) {
        match &self.bar {
            Some(bar) => bar.suspend(|| say(line)),
            None => say(line),
        }
    }
}

impl Drop for LookProgress {
    fn drop(&mut self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}
