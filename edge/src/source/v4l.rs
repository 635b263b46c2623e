//! Cameras of the Linux kernel's `Video4Linux`, without a child process in between.
//!
//! The camera is set to the calibration's size and the venue's rate, or refused. Frames are numbered
//! by the driver's own count, so frames that the driver lost leave a hole in the ticks.

use std::io;
use std::path::Path;
use std::time::Duration;

use farfield_proto::tick::Tick;
use image::{ImageFormat, RgbImage};
use v4l::buffer::{Flags, Type};
use v4l::io::mmap::Stream;
use v4l::io::traits::CaptureStream as _;
use v4l::video::Capture as _;
use v4l::video::capture::Parameters;
use v4l::{Device, Format, FourCC, Fraction};

use super::queue::{Prefetch, Sender, WhenFull};
use super::{ExpectedSource, Frame, FrameContent, FrameSource, SourceError, SourceInfo};

/// Pixel formats in order of preference: uncompressed first, where the bus carries it at the rate.
const FORMATS: [&[u8; 4]; 3] = [b"RGB3", b"YUYV", b"MJPG"];

/// Buffers that the driver fills in turn.
const BUFFERS: u32 = 4;

/// A camera that is silent for longer is gone; also the longest that closing waits.
const SILENCE: Duration = Duration::from_secs(2);

/// Largest relative difference between the camera's rate and the venue's.
const RATE_TOLERANCE: f64 = 0.005;

pub(super) fn probe(device: &Path, expected: &ExpectedSource) -> Result<SourceInfo, SourceError> {
    let (_, _, rate_hz) = configure(device, expected)?;
    Ok(SourceInfo {
        ticks: None,
        size_px: Some(expected.size_px),
        rate_hz,
        ..SourceInfo::default()
    })
}

pub(super) fn open(
    device: &Path,
    expected: ExpectedSource,
    from: Tick,
) -> Result<V4lSource, SourceError> {
    let (device, format, _) = configure(device, &expected)?;
    let unreadable = |problem: io::Error| unreadable(&expected, &problem);
    let mut stream =
        Stream::with_buffers(&device, Type::VideoCapture, BUFFERS).map_err(unreadable)?;
    stream.set_timeout(SILENCE);
    let at = expected.clone();
    let capture = move |sender: Sender<Stamped>| capture(&mut stream, &format, from, &at, &sender);
    let prefetch = Prefetch::spawn(WhenFull::DropOldest, capture).map_err(unreadable)?;
    Ok(V4lSource {
        prefetch,
        expected,
        read: 0,
        stamp_us: None,
    })
}

/// Frames of a kernel device; those not taken in time are dropped, the newest counts.
pub(super) struct V4lSource {
    prefetch: Prefetch<Stamped>,
    expected: ExpectedSource,
    read: u64,
    stamp_us: Option<i64>,
}

/// A frame with the driver's time of its capture, microseconds.
type Stamped = (Frame, i64);

impl FrameSource for V4lSource {
    fn next_frame(&mut self) -> Result<Option<Frame>, SourceError> {
        let ended = || SourceError::Ended {
            at: self.expected.at.clone(),
            read: self.read,
            expected: None,
            said: String::new(),
        };
        let (frame, stamp_us) = self.prefetch.pop().ok_or_else(ended)??;
        self.read += 1;
        self.stamp_us = Some(stamp_us);
        Ok(Some(frame))
    }

    fn stamp_us(&self) -> Option<i64> {
        self.stamp_us
    }
}

fn unreadable(expected: &ExpectedSource, problem: &io::Error) -> SourceError {
    SourceError::Unreadable {
        at: expected.at.clone(),
        problem: problem.to_string(),
    }
}

/// Opens the device in the first format that has the size and the rate; says the rate, where the
/// driver knows one.
fn configure(
    path: &Path,
    expected: &ExpectedSource,
) -> Result<(Device, Format, Option<f64>), SourceError> {
    let device = Device::with_path(path).map_err(|problem| SourceError::NotThere {
        at: expected.at.clone(),
        problem: problem.to_string(),
    })?;
    let mut refused = unreadable(
        expected,
        &io::Error::other("it offers none of the pixel formats RGB3, YUYV and MJPG"),
    );
    for fourcc in FORMATS.map(FourCC::new) {
        let [width, height] = expected.size_px;
        let format = device
            .set_format(&Format::new(width, height, fourcc))
            .map_err(|problem| unreadable(expected, &problem))?;
        if format.fourcc != fourcc {
            continue;
        }
        let fits = expected
            .check_size([format.width, format.height])
            .and_then(|()| set_rate(&device, expected));
        match fits {
            Ok(rate_hz) => return Ok((device, format, rate_hz)),
            Err(problem) => refused = problem,
        }
    }
    Err(refused)
}

/// Asks for the venue's rate; `None` from a driver that has no rate to set.
fn set_rate(device: &Device, expected: &ExpectedSource) -> Result<Option<f64>, SourceError> {
    /// Rates are fractions of whole numbers; this keeps 59.94 apart from 60.
    const PARTS: f64 = 1000.0;
    let interval = Fraction::new(PARTS as u32, (expected.rate_hz * PARTS).round() as u32);
    let Ok(set) = device.set_params(&Parameters::new(interval)) else {
        return Ok(None);
    };
    if set.interval.numerator == 0 {
        return Ok(None);
    }
    let found_hz = f64::from(set.interval.denominator) / f64::from(set.interval.numerator);
    if (found_hz / expected.rate_hz - 1.0).abs() > RATE_TOLERANCE {
        let (at, expected_hz) = (expected.at.clone(), expected.rate_hz);
        return Err(SourceError::Rate {
            at,
            found_hz,
            expected_hz,
        });
    }
    Ok(Some(found_hz))
}

fn capture(
    stream: &mut Stream<'_>,
    format: &Format,
    from: Tick,
    expected: &ExpectedSource,
    sender: &Sender<Stamped>,
) {
    let mut tick = from;
    let mut last_sequence = None;
    loop {
        let frame = match stream.next() {
            Ok((bytes, about)) => {
                let sequence = about.sequence;
                tick =
                    tick + last_sequence.map_or(0, |last| i64::from(sequence.wrapping_sub(last)));
                last_sequence = Some(sequence);
                if about.flags.contains(Flags::ERROR) {
                    continue;
                }
                let n = (about.bytesused as usize).min(bytes.len());
                match to_rgb(&bytes[..n], format) {
                    Some(image) => {
                        let frame = Frame {
                            tick,
                            capture_offset_us: 0,
                            content: FrameContent::Image(image.into()),
                        };
                        let stamp = about.timestamp;
                        Ok((frame, stamp.sec * 1_000_000 + stamp.usec))
                    }
                    // Webcams send a broken JPEG now and then; the next one is whole.
                    None => continue,
                }
            }
            Err(problem) => Err(unreadable(expected, &problem)),
        };
        let failed = frame.is_err();
        if !sender.push(frame) || failed {
            return;
        }
    }
}

/// `None` when the bytes are not a whole picture of the format.
fn to_rgb(bytes: &[u8], format: &Format) -> Option<RgbImage> {
    let (width, height) = (format.width, format.height);
    match &format.fourcc.repr {
        b"MJPG" => image::load_from_memory_with_format(bytes, ImageFormat::Jpeg)
            .ok()
            .map(image::DynamicImage::into_rgb8)
            .filter(|image| image.dimensions() == (width, height)),
        b"YUYV" => {
            let rows = rows(bytes, format, width as usize * 2)?;
            RgbImage::from_raw(width, height, rows.flat_map(yuyv_row).collect())
        }
        _ => {
            let rows = rows(bytes, format, width as usize * 3)?;
            RgbImage::from_raw(width, height, rows.flatten().copied().collect())
        }
    }
}

/// The rows of an uncompressed picture, without their padding.
fn rows<'a>(
    bytes: &'a [u8],
    format: &Format,
    row_bytes: usize,
) -> Option<impl Iterator<Item = &'a [u8]>> {
    let stride = (format.stride as usize).max(row_bytes);
    let height = format.height as usize;
    if row_bytes == 0 || bytes.len() < stride * height.checked_sub(1)? + row_bytes {
        return None;
    }
    Some(
        bytes
            .chunks(stride)
            .take(height)
            .map(move |row| &row[..row_bytes]),
    )
}

/// Two pixels share their colour: Y0 U Y1 V, BT.601, studio range.
fn yuyv_row(row: &[u8]) -> impl Iterator<Item = u8> {
    row.chunks_exact(4).flat_map(|pair| {
        let [y0, u, y1, v] = [pair[0], pair[1], pair[2], pair[3]].map(i32::from);
        let (u, v) = (u - 128, v - 128);
        let rgb = |y: i32| {
            let y = 298 * (y - 16) + 128;
            [y + 409 * v, y - 100 * u - 208 * v, y + 516 * u].map(|c| (c >> 8).clamp(0, 255) as u8)
        };
        rgb(y0).into_iter().chain(rgb(y1))
    })
}

#[cfg(test)]
mod tests {
    use farfield_proto::venue::TickFrom;

    use super::super::SourceOrigin;
    use super::*;

    #[test]
    fn padded_yuyv_rows_become_rgb() {
        let mut format = Format::new(2, 2, FourCC::new(b"YUYV"));
        format.stride = 6;
        let bytes = [235, 128, 16, 128, 0, 0, 81, 90, 81, 240];
        let image = to_rgb(&bytes, &format).unwrap();
        assert_eq!(image.get_pixel(0, 0).0, [255, 255, 255]);
        assert_eq!(image.get_pixel(1, 0).0, [0, 0, 0]);
        assert_eq!(image.get_pixel(0, 1).0, [255, 0, 0]);
        assert!(to_rgb(&bytes[..9], &format).is_none());
        assert!(to_rgb(b"no jpeg", &Format::new(2, 2, FourCC::new(b"MJPG"))).is_none());
    }

    #[test]
    fn a_device_that_is_absent_is_refused_by_name() {
        let at = SourceOrigin {
            camera: "left".to_owned(),
            place: "/dev/video-none".to_owned(),
        };
        let expected = ExpectedSource {
            at,
            size_px: [8, 8],
            rate_hz: 60.0,
            first_tick: Tick(0),
            tick_from: TickFrom::Clock,
        };
        let said = probe(Path::new("/dev/video-none"), &expected)
            .unwrap_err()
            .to_string();
        assert!(
            said.starts_with("/dev/video-none: camera `left`: `source`"),
            "{said}"
        );
    }
}
