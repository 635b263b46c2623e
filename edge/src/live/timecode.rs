//! SMPTE timecode as a tick: hours, minutes, seconds and frames since midnight (SMPTE ST 12-1).
//!
//! Timecode at 29.97 and 59.94 Hz can drop numbers to keep up with the clock. It skips the first
//! two (four) frame numbers of every minute except each tenth. After 24 hours the code restarts at
//! 0. A recording across midnight continues to count, but one that starts after midnight looks like
//! one of the previous day.

use std::fmt;

/// Integer rates at which timecode counts, frames per second.
const COUNTED_HZ: [u32; 7] = [24, 25, 30, 48, 50, 60, 120];
/// Largest relative difference between a venue's rate and a counted rate: 59.94 is counted as 60.
const RATE_TOLERANCE: f64 = 0.002;

/// A time of day in frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Timecode {
    /// Frames since midnight.
    frames: i64,
}

/// Why a text is not a timecode.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum TimecodeError {
    /// The text is not `HH:MM:SS:FF` or, in drop-frame code, `HH:MM:SS;FF`.
    #[error(
        "found timecode {found:?}, expected HH:MM:SS:FF, or HH:MM:SS;FF where numbers are dropped"
    )]
    Form {
        /// The text.
        found: String,
    },
    /// The time does not exist, or its number is a dropped one.
    #[error("found timecode {found:?}, which does not exist at {counted_hz} frames per second")]
    NotThere {
        /// The text.
        found: String,
        /// Frames counted per second.
        counted_hz: u32,
    },
    /// The rate has no timecode, or no drop-frame timecode.
    #[error("at {rate_hz} frames per second there is no{} timecode", if *.drops { " drop-frame" } else { "" })]
    Rate {
        /// The rate.
        rate_hz: Rate,
        /// Whether the code is drop-frame.
        drops: bool,
    },
}

/// Frames per second, compared and printed in thousandths.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Rate {
    thousandths: i64,
}

impl fmt::Display for Rate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:.3}", self.thousandths as f64 / 1000.0)
    }
}

impl Timecode {
    /// Parses the timecode of a recording with `rate_hz` frames per second.
    ///
    /// # Errors
    /// [`TimecodeError`] if the text has another form, the time does not exist, or the rate has no
    /// timecode.
    pub fn parse(text: &str, rate_hz: f64) -> Result<Self, TimecodeError> {
        let form = || TimecodeError::Form {
            found: text.to_owned(),
        };
        let (digits, drops) = fields(text.trim()).ok_or_else(form)?;
        let rate = || TimecodeError::Rate {
            rate_hz: Rate {
                thousandths: (rate_hz * 1000.0).round() as i64,
            },
            drops,
        };
        let counted_hz = counted(rate_hz).ok_or_else(rate)?;
        if drops && counted_hz % 30 != 0 {
            return Err(rate());
        }
        let [hours, minutes, seconds, frames] = digits;
        let dropped = if drops { i64::from(counted_hz / 15) } else { 0 };
        let is_dropped = minutes % 10 != 0 && seconds == 0 && i64::from(frames) < dropped;
        if hours > 23 || minutes > 59 || seconds > 59 || frames >= counted_hz || is_dropped {
            return Err(TimecodeError::NotThere {
                found: text.to_owned(),
                counted_hz,
            });
        }
        let minutes_of_day = i64::from(60 * hours + minutes);
        let numbered =
            (60 * minutes_of_day + i64::from(seconds)) * i64::from(counted_hz) + i64::from(frames);
        Ok(Self {
            frames: numbered - dropped * (minutes_of_day - minutes_of_day / 10),
        })
    }

    /// Frames since midnight.
    pub fn frames(self) -> i64 {
        self.frames
    }
}

/// The counted rate: 30 for 29.97.
fn counted(rate_hz: f64) -> Option<u32> {
    COUNTED_HZ
        .into_iter()
        .find(|&hz| (rate_hz / f64::from(hz) - 1.0).abs() <= RATE_TOLERANCE)
}

/// The four numbers, and whether a `;` or `.` marks drop-frame code.
fn fields(text: &str) -> Option<([u32; 4], bool)> {
    let at = text.rfind([':', ';', '.'])?;
    let (time, frames) = (&text[..at], &text[at + 1..]);
    let drops = !text[at..].starts_with(':');
    let mut parts = time.split([':', ';']).chain([frames]);
    let mut numbers = [0; 4];
    for number in &mut numbers {
        let part = parts.next()?;
        let is_number = (2..=3).contains(&part.len()) && part.bytes().all(|b| b.is_ascii_digit());
        *number = part.parse().ok().filter(|_| is_number)?;
    }
    parts.next().is_none().then_some((numbers, drops))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn frames(text: &str, rate_hz: f64) -> i64 {
        Timecode::parse(text, rate_hz).unwrap().frames()
    }

    #[test]
    fn without_drops_every_number_counts() {
        assert_eq!(frames("00:00:00:00", 25.0), 0);
        assert_eq!(frames("10:00:00:00", 25.0), 900_000);
        assert_eq!(frames("23:59:59:29", 30.0), 2_591_999);
        assert_eq!(frames("01:00:00:59", 60.0), 216_059);
        assert_eq!(frames("00:01:00:00", 29.97), 1800);
    }

    /// SMPTE ST 12-1 at 29.97 Hz: 17 982 frames in ten minutes, 107 892 in an hour, 2 589 408 in a
    /// day.
    #[test]
    fn drop_frame_code_keeps_up_with_the_clock() {
        let hz = 30_000.0 / 1001.0;
        assert_eq!(frames("00:00:59;29", hz), 1799);
        assert_eq!(frames("00:01:00;02", hz), 1800);
        assert_eq!(frames("00:02:00;02", hz), 3598);
        assert_eq!(frames("00:09:59;29", hz), 17_981);
        assert_eq!(frames("00:10:00;00", hz), 17_982);
        assert_eq!(frames("01:00:00;00", hz), 107_892);
        assert_eq!(frames("23:59:59;29", hz), 2_589_407);
        let double = 60_000.0 / 1001.0;
        assert_eq!(frames("00:01:00;04", double), 3600);
        assert_eq!(frames("01:00:00;00", double), 215_784);
        assert_eq!(frames("00:10:00.00", hz), 17_982);
    }

    #[test]
    fn dropped_numbers_and_impossible_times_are_refused() {
        let hz = 30_000.0 / 1001.0;
        for text in [
            "00:01:00;00",
            "00:01:00;01",
            "24:00:00:00",
            "00:60:00:00",
            "00:00:60:00",
            "00:00:00:30",
        ] {
            assert!(
                matches!(
                    Timecode::parse(text, hz),
                    Err(TimecodeError::NotThere { .. })
                ),
                "{text}"
            );
        }
        assert!(Timecode::parse("00:20:00;00", hz).is_ok());
    }

    #[test]
    fn invalid_timecodes_are_refused() {
        for text in [
            "",
            "1:2:3:4",
            "00:00:00",
            "00:00:00:00:00",
            "aa:00:00:00",
            "00:00:00:-1",
            "00:00:00:0000",
        ] {
            assert!(
                matches!(Timecode::parse(text, 25.0), Err(TimecodeError::Form { .. })),
                "{text}"
            );
        }
        assert!(matches!(
            Timecode::parse("00:00:00:00", 37.0),
            Err(TimecodeError::Rate { .. })
        ));
        let error = Timecode::parse("00:00:00;00", 25.0)
            .unwrap_err()
            .to_string();
        assert_eq!(
            error,
            "at 25.000 frames per second there is no drop-frame timecode"
        );
    }

    proptest! {
        #[test]
        fn later_code_is_later(a in 0u32..86_400, b in 0u32..86_400, fa in 4u32..30, fb in 4u32..30) {
            let hz = 30_000.0 / 1001.0;
            let text = |s: u32, f: u32| format!("{:02}:{:02}:{:02};{f:02}", s / 3600, s / 60 % 60, s % 60);
            let order = (a, fa).cmp(&(b, fb));
            prop_assert_eq!(frames(&text(a, fa), hz).cmp(&frames(&text(b, fb), hz)), order);
            // The two numbers of a minute, and the remainder of dropping in a day: 86 ms.
            let of_clock = (f64::from(a) + f64::from(fa) / 30.0) * hz;
            prop_assert!((frames(&text(a, fa), hz) as f64 - of_clock).abs() < 2.0 + 2.6);
        }

        #[test]
        fn no_text_panics(text in ".{0,16}", hz in 0.0f64..200.0) {
            drop(Timecode::parse(&text, hz));
        }
    }
}
