//! Capture times of live frames: the presentation times that ffmpeg's filter `showinfo` writes
//! among its messages.
//!
//! The delay of a picture varies with coding, network and decoding. Its time in an RTP or RTSP
//! stream comes from the camera's clock. The format of the lines is documented for ffmpeg 5.1 to 8:
//! first `config in time_base: 1/90000`, then `n:   0 pts:   3003` per decoded frame. If the stream
//! changes, ffmpeg rebuilds its filters, and `n` restarts at 0.

use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::time::Duration;

use crate::picture::ColourMatrix;

/// Marks a line of the filter.
const MARK: &str = "[Parsed_showinfo";
/// Times that wait for their pictures: far more than fit between the filter and the pipe.
const WAITING: usize = 256;
/// How long a picture waits for its time, which was written before it.
const PATIENCE: Duration = Duration::from_millis(50);
/// Consecutive pictures that wait in vain before waiting stops, until a picture finds its time.
/// Each wait delays all later pictures.
const MAX_IN_VAIN: u32 = 5;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct FrameTime {
    /// Number of the frame since the stream was opened.
    number: u64,
    /// Time by the stream's clock, microseconds.
    stamp_us: Option<i64>,
    /// Colour matrix, from the previous frame's line.
    matrix: ColourMatrix,
}

/// Reads the lines in the thread that collects messages.
#[derive(Debug)]
pub(super) struct FrameTimeReader {
    /// Seconds per unit as a fraction.
    time_base: Option<[i64; 2]>,
    /// The filter's number of the last frame, and the frame number at which the filter counted 0.
    last: Option<u64>,
    began_at: u64,
    matrix: ColourMatrix,
    times: SyncSender<FrameTime>,
}

/// Assigns times to pictures in the thread that reads pictures.
#[derive(Debug)]
pub(super) struct FrameTimes {
    times: Receiver<FrameTime>,
    /// A time that was read but belongs to a later picture.
    next: Option<FrameTime>,
    matrix: ColourMatrix,
    /// Consecutive pictures without a time.
    in_vain: u32,
    /// Whether the end of waiting was reported.
    is_reported: bool,
}

/// The two connected ends.
pub(super) fn frame_times() -> (FrameTimeReader, FrameTimes) {
    let (sender, receiver) = sync_channel(WAITING);
    let reader = FrameTimeReader {
        time_base: None,
        last: None,
        began_at: 0,
        matrix: ColourMatrix::default(),
        times: sender,
    };
    let times = FrameTimes {
        times: receiver,
        next: None,
        matrix: ColourMatrix::default(),
        in_vain: 0,
        is_reported: false,
    };
    (reader, times)
}

impl FrameTimeReader {
    /// Reads a line; `true` if it is one of the filter's.
    pub(super) fn read(&mut self, line: &str) -> bool {
        if !line.starts_with(MARK) {
            return false;
        }
        if let Some(matrix) = word_after(line, "color_space:") {
            self.matrix = ColourMatrix::parse(matrix);
        }
        if let Some(base) = word_after(line, "config in time_base:") {
            self.time_base = base
                .trim_end_matches(',')
                .split_once('/')
                .and_then(|(n, of)| Some([n.parse().ok()?, of.parse().ok().filter(|n| *n > 0)?]));
        } else if let Some(number) = word_after(line, " n:").and_then(|n| n.parse().ok()) {
            let time = FrameTime {
                number: self.since_opened(number),
                stamp_us: self.stamp_us(line),
                matrix: self.matrix,
            };
            // If pictures are not taken, their times are not needed.
            self.times.try_send(time).ok();
        }
        true
    }

    /// The frame number since the stream was opened, for the filter's `number`.
    fn since_opened(&mut self, number: u64) -> u64 {
        if let Some(last) = self.last.filter(|last| number <= *last) {
            self.began_at = self.began_at.saturating_add(last).saturating_add(1);
        }
        self.last = Some(number);
        self.began_at.saturating_add(number)
    }

    fn stamp_us(&self, line: &str) -> Option<i64> {
        let [unit, per_s] = self.time_base?;
        let pts: i64 = word_after(line, " pts:")?.parse().ok()?;
        let units = i128::from(pts) * i128::from(unit);
        let us = units.checked_mul(1_000_000)? / i128::from(per_s);
        us.try_into().ok()
    }
}

impl FrameTimes {
    /// The time of a picture, microseconds; `None` if the stream has none.
    pub(super) fn for_picture(&mut self, number: u64) -> Option<i64> {
        loop {
            let Some(time) = self.next.take().or_else(|| self.wait()) else {
                self.in_vain = self.in_vain.saturating_add(1);
                return None;
            };
            if time.number == number {
                self.in_vain = 0;
                self.matrix = time.matrix;
                return time.stamp_us;
            }
            if time.number > number {
                self.next = Some(time);
                return None;
            }
        }
    }

    /// The colour matrix of the last picture with a time.
    pub(super) fn matrix(&self) -> ColourMatrix {
        self.matrix
    }

    /// Whether pictures no longer wait for their times; `true` once.
    pub(super) fn gives_up(&mut self) -> bool {
        let gives_up = self.in_vain >= MAX_IN_VAIN && !self.is_reported;
        self.is_reported |= gives_up;
        gives_up
    }

    fn wait(&self) -> Option<FrameTime> {
        if self.in_vain < MAX_IN_VAIN {
            self.times.recv_timeout(PATIENCE).ok()
        } else {
            self.times.try_recv().ok()
        }
    }
}

/// The word after `name`, with optional blanks between.
fn word_after<'a>(line: &'a str, name: &str) -> Option<&'a str> {
    let (_, rest) = line.split_once(name)?;
    rest.split_whitespace().next()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_find_their_pictures() {
        let (mut reader, mut times) = frame_times();
        let mark = "[Parsed_showinfo_0 @ 0x55f54c11b240] [info]";
        for line in [
            "config in time_base: 1/90000, frame_rate: 30/1",
            "config out time_base: 0/0, frame_rate: 0/0",
            "n:   0 pts:   9000 pts_time:0.1     pos:       -1 fmt:yuv420p",
            "color_range:unknown color_space:unknown",
            "n:   1 pts:  NOPTS pts_time:NOPTS",
            "n:   3 pts:8100000000 pts_time:90000",
        ] {
            assert!(reader.read(&format!("{mark} {line}")));
        }
        assert!(!reader.read("[rtsp @ 0x1] [error] method DESCRIBE failed: 404 Not Found"));
        assert_eq!(times.for_picture(0), Some(100_000));
        assert_eq!(times.for_picture(1), None);
        assert_eq!(times.for_picture(2), None, "its line was lost");
        assert_eq!(times.for_picture(3), Some(90_000_000_000));
        drop(reader);
        assert_eq!(times.for_picture(4), None);
    }

    #[test]
    fn a_restarted_filter_continues_the_count_of_pictures() {
        let (mut reader, mut times) = frame_times();
        let mut say = |line: &str| assert!(reader.read(&format!("[Parsed_showinfo_0] {line}")));
        say("config in time_base: 1/1000");
        for n in 0..3 {
            say(&format!("n: {n} pts: {}", 40 * n));
        }
        // The sender's encoder was changed: another filter with another unit, whose first line is
        // lost.
        say("config in time_base: 1/100");
        say("n: 1 pts: 16");
        say("n: 2 pts: 20");
        say("n: 0 pts: 24");
        let got: Vec<_> = (0..7).map(|number| times.for_picture(number)).collect();
        let ms = |ms: i64| Some(1000 * ms);
        assert_eq!(
            got,
            [ms(0), ms(40), ms(80), None, ms(160), ms(200), ms(240)]
        );
    }

    #[test]
    fn missing_times_are_waited_for_only_a_few_times() {
        let (mut reader, mut times) = frame_times();
        for number in 0..100 {
            assert_eq!(times.for_picture(number), None);
            assert_eq!(times.gives_up(), number + 1 == u64::from(MAX_IN_VAIN));
        }
        // The number of failed waits is checked, not a clock.
        assert_eq!(times.in_vain, 100);
        for line in [
            "config in time_base: 1/1000",
            "n: 99 pts: 3",
            "n: 100 pts: 4",
        ] {
            reader.read(&format!("[Parsed_showinfo_0] {line}"));
        }
        assert_eq!(times.for_picture(100), Some(4_000));
        assert_eq!(times.in_vain, 0, "they come again, and are waited for");
        assert!(!times.gives_up(), "it is reported once");
    }

    #[test]
    fn malformed_lines_are_ignored() {
        let (mut reader, mut times) = frame_times();
        for line in [
            "[Parsed_showinfo config in time_base: 1/0",
            "[Parsed_showinfo n: 0 pts: 5",
            "[Parsed_showinfo config in time_base: 9223372036854775807/1",
            "[Parsed_showinfo n: 1 pts: 9223372036854775807",
            "[Parsed_showinfo n: -1 pts: 7",
            "[Parsed_showinfo n:",
        ] {
            assert!(reader.read(line));
        }
        assert_eq!([times.for_picture(0), times.for_picture(1)], [None, None]);
    }
}
