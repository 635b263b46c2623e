//! When the frames of a live stream were taken, as the stream says: its presentation times, which ffmpeg's filter `showinfo`
//! writes between its messages.
//!
//! A picture comes late by what coding, network and decoding take, now more, now less; its time in an RTP or RTSP stream
//! is that of the camera's own clock. The lines are read as they are documented for ffmpeg 5.1 to 8: `config in time_base:
//! 1/90000` first, then `n:   0 pts:   3003` for each frame that leaves the decoder.

use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::time::Duration;

/// What marks a line of the filter.
const MARK: &str = "[Parsed_showinfo";
/// Times that wait for their pictures: far more than are between the filter and the pipe.
const WAITING: usize = 256;
/// How long a picture that is there waits for its time, which was written before it.
const PATIENCE: Duration = Duration::from_millis(50);

/// The time of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct FrameTime {
    /// The frame's number since the stream was opened.
    number: u64,
    /// By the stream's clock, microseconds.
    stamp_us: Option<i64>,
}

/// Reads the lines, where the messages are collected.
#[derive(Debug)]
pub(super) struct FrameTimeReader {
    /// Seconds per unit as a fraction.
    time_base: Option<[i64; 2]>,
    times: SyncSender<FrameTime>,
}

/// Gives each picture its time, where the pictures are read.
#[derive(Debug)]
pub(super) struct FrameTimes {
    times: Receiver<FrameTime>,
    /// The one that was read and is of a later picture.
    next: Option<FrameTime>,
}

/// Both ends.
pub(super) fn frame_times() -> (FrameTimeReader, FrameTimes) {
    let (sender, receiver) = sync_channel(WAITING);
    let reader = FrameTimeReader {
        time_base: None,
        times: sender,
    };
    let times = FrameTimes {
        times: receiver,
        next: None,
    };
    (reader, times)
}

impl FrameTimeReader {
    /// Takes a line; says whether it was one of the filter's.
    pub(super) fn read(&mut self, line: &str) -> bool {
        if !line.starts_with(MARK) {
            return false;
        }
        if let Some(base) = word_after(line, "config in time_base:") {
            self.time_base = base
                .trim_end_matches(',')
                .split_once('/')
                .and_then(|(n, of)| Some([n.parse().ok()?, of.parse().ok().filter(|n| *n > 0)?]));
        } else if let Some(number) = word_after(line, " n:").and_then(|n| n.parse().ok()) {
            let time = FrameTime {
                number,
                stamp_us: self.stamp_us(line),
            };
            // Where nobody takes pictures nobody misses their times.
            self.times.try_send(time).ok();
        }
        true
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
    /// The time of the picture of this number, microseconds; `None` where the stream says none.
    pub(super) fn of(&mut self, number: u64) -> Option<i64> {
        loop {
            let time = match self.next.take() {
                Some(time) => time,
                None => match self.times.recv_timeout(PATIENCE) {
                    Ok(time) => time,
                    Err(RecvTimeoutError::Timeout | RecvTimeoutError::Disconnected) => return None,
                },
            };
            if time.number == number {
                return time.stamp_us;
            }
            if time.number > number {
                self.next = Some(time);
                return None;
            }
        }
    }
}

/// The word behind `name`, which may have blanks before it.
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
        assert_eq!(times.of(0), Some(100_000));
        assert_eq!(times.of(1), None);
        assert_eq!(times.of(2), None, "its line was lost");
        assert_eq!(times.of(3), Some(90_000_000_000));
        drop(reader);
        assert_eq!(times.of(4), None);
    }

    #[test]
    fn lines_that_nobody_wrote_so_break_nothing() {
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
        assert_eq!([times.of(0), times.of(1)], [None, None]);
    }
}
