//! Capture times of an RTSP stream by the camera's clock. RTCP sender reports (RFC 3550, section
//! 6.4.1) relate time stamps of the stream to clock time.
//!
//! ffmpeg (5.1 or later) attaches the reports to each coded picture, but writes them only to MP4,
//! as a box `prft` before each picture (ISO/IEC 14496-12, section 8.16.5). ffmpeg therefore also
//! copies the coded pictures to a local socket, where only these boxes are read.
//!
//! In H.264 and H.265 a picture ends when the next one begins, so ffmpeg attaches the report of the
//! next picture. For other codings this is unknown, and no time is used.

use std::ffi::OsString;
use std::io::{self, BufReader, Read};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicI64, Ordering};
use std::thread::JoinHandle;

use farfield_node::clock;
use tempfile::TempDir;

/// From 1900, the start of NTP's time, to 1970, seconds.
const NTP_TO_UNIX_S: i64 = 2_208_988_800;
/// Smaller values of seconds belong to NTP's second era, which begins in 2036.
const FIRST_ERA_FROM_S: u32 = 1 << 31;
/// Largest difference between two offsets of one report, microseconds: times are rounded to
/// milliseconds and to units of the stream.
const ROUNDING_US: i64 = 1_100;
/// Consecutive pictures that must agree. Before the first report ffmpeg uses the varying time at
/// which it writes a picture.
const STEADY: u32 = 30;
/// A time this recent is no report of the camera, microseconds: ffmpeg writes a picture when the
/// next one arrives.
const JUST_WRITTEN_US: i64 = 4_000;
/// MP4's codes for H.264 and H.265.
const ENDED_BY_NEXT: [[u8; 4]; 4] = [*b"avc1", *b"avc3", *b"hev1", *b"hvc1"];
/// Marks an unknown offset.
const UNKNOWN: i64 = i64::MIN;

/// The clock of a streaming camera.
pub(super) struct SenderClock {
    offset_us: Arc<AtomicI64>,
    // The folder is removed with it.
    _folder: TempDir,
    socket: PathBuf,
    thread: Option<JoinHandle<()>>,
}

impl SenderClock {
    /// Opens the socket and reads it on a thread.
    ///
    /// # Errors
    /// If the system cannot create the socket or the thread.
    pub(super) fn open() -> io::Result<Self> {
        let folder = tempfile::Builder::new().prefix("farfield-").tempdir()?;
        let socket = folder.path().join("pictures");
        let listener = UnixListener::bind(&socket)?;
        let offset_us = Arc::new(AtomicI64::new(UNKNOWN));
        let heard = Arc::clone(&offset_us);
        let listen = move || {
            let Ok((pictures, _)) = listener.accept() else {
                return;
            };
            let (mut pictures, mut steady) = (BufReader::new(pictures), SteadyOffset::default());
            let now_us = || clock::unix_time().as_micros() as i64;
            let ended = read_times(&mut pictures, now_us, |time| {
                if let Some(offset_us) = steady.add(time) {
                    heard.store(offset_us, Ordering::Relaxed);
                }
            });
            // It ends with ffmpeg. Unreadable data must not stop ffmpeg.
            if ended.is_err_and(|error| error.kind() != io::ErrorKind::UnexpectedEof) {
                heard.store(UNKNOWN, Ordering::Relaxed);
                drop(io::copy(&mut pictures, &mut io::sink()));
            }
        };
        let thread = std::thread::Builder::new().name("sender clock".to_owned());
        Ok(Self {
            offset_us,
            _folder: folder,
            thread: Some(thread.spawn(listen)?),
            socket,
        })
    }

    /// Arguments for ffmpeg's second output, with the time stamps of the first. MP4 does not accept
    /// every coding; with `tee`, ffmpeg then continues without this output.
    pub(super) fn output(&self) -> Vec<OsString> {
        let words = "-map 0:v:0 -c:v copy -f tee".split(' ');
        let mut outputs = OsString::from(
            "[f=mp4:onfail=ignore:avoid_negative_ts=disabled:write_prft=wallclock:movflags=frag_every_frame+empty_moov]unix:",
        );
        outputs.push(&self.socket);
        outputs.push("|[f=null]-");
        words.map(OsString::from).chain([outputs]).collect()
    }

    /// Unix time by the camera's clock minus the stream's time stamp, microseconds; `None` before a
    /// report.
    pub(super) fn offset_us(&self) -> Option<i64> {
        Some(self.offset_us.load(Ordering::Relaxed)).filter(|us| *us != UNKNOWN)
    }
}

impl Drop for SenderClock {
    fn drop(&mut self) {
        // If ffmpeg never connected, the thread still waits for a connection.
        drop(UnixStream::connect(&self.socket));
        if let Some(thread) = self.thread.take() {
            thread.join().ok();
        }
    }
}

/// The content of a `prft` box.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct PictureTime {
    /// Unix time, microseconds.
    unix_us: i64,
    /// Time by the stream's clock, microseconds.
    stamp_us: i64,
}

/// The difference of the two times once it is steady.
#[derive(Debug, Default)]
struct SteadyOffset {
    first_us: i64,
    agree: u32,
}

impl SteadyOffset {
    /// Adds the time of a picture and returns the offset; `None` means that the picture has no
    /// report.
    fn add(&mut self, time: Option<PictureTime>) -> Option<i64> {
        let Some(time) = time else {
            self.agree = 0;
            return None;
        };
        let offset_us = time.unix_us.saturating_sub(time.stamp_us);
        if self.agree > 0 && self.first_us.saturating_sub(offset_us).abs() <= ROUNDING_US {
            self.agree = self.agree.saturating_add(1);
        } else {
            (self.first_us, self.agree) = (offset_us, 1);
        }
        (self.agree >= STEADY).then_some(self.first_us)
    }
}

/// Reads the boxes of an MP4 stream to its end. `now_us` is the Unix time, used to recognise times
/// that are no reports.
fn read_times(
    mut stream: impl Read,
    now_us: impl Fn() -> i64,
    mut hear: impl FnMut(Option<PictureTime>),
) -> io::Result<()> {
    let (mut units_per_s, mut is_ended_by_next) = (None, false);
    let mut before: Option<PictureTime> = None;
    loop {
        let size = u32::from_be_bytes(take(&mut stream)?);
        let kind: [u8; 4] = take(&mut stream)?;
        let body = match size {
            1 => u64::from_be_bytes(take(&mut stream)?).checked_sub(16),
            _ => u64::from(size).checked_sub(8),
        };
        let body = body.ok_or(io::ErrorKind::InvalidData)?;
        let mut inside = stream.by_ref().take(body);
        match &kind {
            // The content of these boxes is read as if it were outside.
            b"moov" | b"trak" | b"mdia" | b"minf" | b"stbl" => continue,
            b"mdhd" => units_per_s = Some(units_of(&mut inside)?).filter(|units| *units > 0),
            b"stsd" => is_ended_by_next = ENDED_BY_NEXT.contains(&coding_of(&mut inside)?),
            b"prft" if is_ended_by_next => {
                let time = time_of(&mut inside, units_per_s)?;
                hear(before.zip(time).map(|(before, time)| PictureTime {
                    unix_us: before.unix_us,
                    ..time
                }));
                let is_report = |time: &PictureTime| {
                    now_us().saturating_sub(time.unix_us).abs() >= JUST_WRITTEN_US
                };
                before = time.filter(is_report);
            }
            _ => {}
        }
        io::copy(&mut inside, &mut io::sink())?;
    }
}

/// The coding of the pictures, from a box `stsd`.
fn coding_of(inside: &mut impl Read) -> io::Result<[u8; 4]> {
    // Version, flags, number of entries, size of the first entry.
    take::<12>(inside)?;
    take(inside)
}

/// Units of the stream's time per second, from a box `mdhd`.
fn units_of(inside: &mut impl Read) -> io::Result<u32> {
    let [version, ..]: [u8; 4] = take(inside)?;
    if version == 0 {
        take::<8>(inside)?;
    } else {
        take::<16>(inside)?;
    }
    take(inside).map(u32::from_be_bytes)
}

/// The time in a box `prft`.
fn time_of(inside: &mut impl Read, units_per_s: Option<u32>) -> io::Result<Option<PictureTime>> {
    let [version, ..]: [u8; 4] = take(inside)?;
    let _track: [u8; 4] = take(inside)?;
    let [seconds, fraction]: [u32; 2] = [take(inside)?, take(inside)?].map(u32::from_be_bytes);
    let units = match version {
        0 => u32::from_be_bytes(take(inside)?).into(),
        _ => i64::from_be_bytes(take(inside)?),
    };
    Ok(units_per_s.map(|per_s| {
        let us_of = |n: i128, of: i128| n.saturating_mul(1_000_000) / of;
        let after_us = us_of(fraction.into(), 1 << 32) as i64;
        let era_s = if seconds < FIRST_ERA_FROM_S {
            1 << 32
        } else {
            0
        };
        PictureTime {
            unix_us: (era_s + i64::from(seconds) - NTP_TO_UNIX_S) * 1_000_000 + after_us,
            stamp_us: us_of(units.into(), per_s.into())
                .try_into()
                .unwrap_or(i64::MAX),
        }
    }))
}

fn take<const N: usize>(stream: &mut impl Read) -> io::Result<[u8; N]> {
    let mut bytes = [0; N];
    stream.read_exact(&mut bytes).map(|()| bytes)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn mp4_box(kind: [u8; 4], body: &[u8]) -> Vec<u8> {
        let size = (body.len() as u32 + 8).to_be_bytes();
        [&size[..], &kind, body].concat()
    }

    /// The offsets for two pictures, 0.5 s and 0.6 s after the first, with the reports 7.5 s and
    /// 7.75 s.
    fn heard(coding: [u8; 4], now_us: i64) -> Vec<[i64; 2]> {
        let mdhd = [&[0; 12][..], &90_000_u32.to_be_bytes(), &[0; 4]].concat();
        let stsd = [&[0; 12][..], &coding, &[0; 40]].concat();
        let minf = mp4_box(*b"minf", &mp4_box(*b"stbl", &mp4_box(*b"stsd", &stsd)));
        let mdia = mp4_box(*b"mdia", &[mp4_box(*b"mdhd", &mdhd), minf].concat());
        let prft = |quarters: u32, units: i64| {
            let ntp = (NTP_TO_UNIX_S as u32 + 7).to_be_bytes();
            let fraction = (quarters << 30).to_be_bytes();
            let head = [1, 0, 0, 24, 0, 0, 0, 1];
            let body = [&head[..], &ntp, &fraction, &units.to_be_bytes()].concat();
            mp4_box(*b"prft", &body)
        };
        let stream = [
            mp4_box(*b"ftyp", b"iso5"),
            mp4_box(*b"moov", &mp4_box(*b"trak", &mdia)),
            prft(2, 45_000),
            mp4_box(*b"mdat", &[7; 3000]),
            prft(3, 54_000),
        ];
        let mut heard = Vec::new();
        let bytes = stream.concat();
        let end = read_times(
            bytes.as_slice(),
            || now_us,
            |time| {
                heard.extend(time.map(|time| [time.unix_us, time.stamp_us]));
            },
        );
        assert_eq!(end.unwrap_err().kind(), io::ErrorKind::UnexpectedEof);
        heard
    }

    #[test]
    fn boxes_contain_times_of_the_next_picture_in_track_units() {
        assert_eq!(heard(*b"avc1", 0), [[7_500_000, 600_000]]);
        assert_eq!(heard(*b"mp4v", 0), [[0; 2]; 0], "it is not known of which");
        let just_written_us = 7_501_000;
        assert_eq!(heard(*b"avc1", just_written_us), [[0; 2]; 0]);
    }

    #[test]
    fn only_times_that_agree_for_long_come_from_reports() {
        let mut steady = SteadyOffset::default();
        let time = |n: i64| PictureTime {
            unix_us: 1_000_000 + n * 40_000,
            stamp_us: n * 40_000,
        };
        assert!((0..29).all(|n| steady.add(Some(time(n))).is_none()));
        assert_eq!(steady.add(None), None);
        let heard: Vec<Option<i64>> = (0..30).map(|n| steady.add(Some(time(n)))).collect();
        assert_eq!((heard[28], heard[29]), (None, Some(1_000_000)));
    }

    proptest! {
        #[test]
        fn no_bytes_make_it_panic(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
            let end = read_times(bytes.as_slice(), || 0, |_| {});
            prop_assert!(end.is_err());
        }
    }
}
