//! How far a recording is: a bar on a terminal, nothing elsewhere.

use std::io::{IsTerminal as _, stderr};

use indicatif::{ProgressBar, ProgressStyle};

/// Counts pictures of all cameras.
pub(super) struct PictureProgress {
    bar: ProgressBar,
}

impl PictureProgress {
    pub(super) fn new(pictures: u64) -> Self {
        let bar = if stderr().is_terminal() {
            ProgressBar::new(pictures)
        } else {
            ProgressBar::hidden()
        };
        if let Ok(style) = ProgressStyle::with_template("{bar:30} {pos}/{len} pictures {eta}") {
            bar.set_style(style);
        }
        Self { bar }
    }

    /// One more picture is written.
    pub(super) fn one(&self) {
        self.bar.inc(1);
    }
}

impl Drop for PictureProgress {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}
