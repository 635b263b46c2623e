//! Cameras of the Linux kernel (`Video4Linux`), without a child process.
//!
//! The camera is set to the calibration's size and the venue's rate, or refused with a list of what
//! it offers. Frames are numbered by the driver's count, so lost frames leave gaps in the ticks.

mod controls;
mod formats;
#[cfg(test)]
mod vivid_tests;

use std::io;
use std::path::Path;
use std::time::Duration;

use farfield_proto::tick::Tick;
use farfield_proto::toml_file::unknown_name;
use farfield_proto::venue::DeviceSettings;
use v4l::buffer::{Flags, Type};
use v4l::frameinterval::FrameIntervalEnum;
use v4l::framesize::FrameSizeEnum;
use v4l::io::mmap::Stream;
use v4l::io::traits::CaptureStream as _;
use v4l::video::Capture as _;
use v4l::video::capture::Parameters;
use v4l::{Device, Format, FourCC, Fraction};

use super::queue::{Prefetch, Sender, WhenFull};
use super::{ExpectedSource, Frame, FrameContent, FrameSource, SourceError, SourceInfo};
use crate::guarded::guarded;
use formats::{FORMATS, PictureDecoder, PixelFormat};

/// Buffers that the driver fills in turn.
const BUFFERS: u32 = 4;

/// A camera that is silent for longer is gone. Closing waits at most this long.
const SILENCE: Duration = Duration::from_secs(2);

/// Largest relative difference between the camera's rate and the venue's.
const RATE_TOLERANCE: f64 = 0.005;

pub(super) fn probe(
    device: &Path,
    settings: &DeviceSettings,
    expected: &ExpectedSource,
) -> Result<SourceInfo, SourceError> {
    Ok(SourceInfo {
        ticks: None,
        size_px: Some(expected.size_px),
        rate_hz: configure(device, settings, expected)?.rate_hz,
        ..SourceInfo::default()
    })
}

pub(super) fn open(
    device: &Path,
    settings: &DeviceSettings,
    expected: ExpectedSource,
    from: Tick,
) -> Result<V4lSource, SourceError> {
    let configured = configure(device, settings, &expected)?;
    let refused = |problem: io::Error| unreadable(&expected, problem.to_string());
    let stream = Stream::with_buffers(&configured.device, Type::VideoCapture, BUFFERS);
    let mut stream = stream.map_err(refused)?;
    stream.set_timeout(SILENCE);
    let (decoder, at) = (configured.decoder, expected.clone());
    let capture = move |sender: Sender<Stamped>| capture(&mut stream, &decoder, from, &at, &sender);
    let prefetch = Prefetch::spawn(WhenFull::DropOldest, capture).map_err(refused)?;
    Ok(V4lSource {
        prefetch,
        expected,
        read: 0,
        stamp_us: None,
    })
}

/// Frames of a kernel device; only the newest ones are kept.
pub(super) struct V4lSource {
    prefetch: Prefetch<Stamped>,
    expected: ExpectedSource,
    read: u64,
    stamp_us: Option<i64>,
}

/// A frame and its capture time by the driver's clock, microseconds.
type Stamped = (Frame, i64);

impl FrameSource for V4lSource {
    fn next_frame(&mut self) -> Result<Option<Frame>, SourceError> {
        let ended = || SourceError::Ended {
            at: self.expected.at.clone(),
            read: self.read,
            expected: None,
            tool_output: String::new(),
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

fn unreadable(expected: &ExpectedSource, problem: String) -> SourceError {
    SourceError::Unreadable {
        at: expected.at.clone(),
        problem,
    }
}

/// A camera with the venue's settings.
struct ConfiguredDevice {
    device: Device,
    decoder: PictureDecoder,
    /// `None` if the driver reports no rate.
    rate_hz: Option<f64>,
}

/// Opens the device in the first format with the size and the rate.
fn configure(
    path: &Path,
    settings: &DeviceSettings,
    expected: &ExpectedSource,
) -> Result<ConfiguredDevice, SourceError> {
    // The library panics on a path that cannot exist.
    let opened = std::fs::metadata(path).and_then(|_| Device::with_path(path));
    let device = opened.map_err(|problem| SourceError::NotThere {
        at: expected.at.clone(),
        problem: problem.to_string(),
    })?;
    // The library panics on values from the driver that it does not know.
    let configured = guarded(|| set_format(&device, settings.format.as_deref(), expected));
    let controlled = configured.and_then(|(decoder, rate_hz)| {
        guarded(|| controls::set(&device, &settings.controls))?;
        Ok((decoder, rate_hz))
    });
    let (decoder, rate_hz) = controlled.map_err(|problem| unreadable(expected, problem))?;
    Ok(ConfiguredDevice {
        device,
        decoder,
        rate_hz,
    })
}

fn set_format(
    device: &Device,
    wanted: Option<&str>,
    expected: &ExpectedSource,
) -> Result<(PictureDecoder, Option<f64>), String> {
    let tried = formats_named(wanted)?;
    for pixels in tried {
        let fits = try_format(device, pixels, expected);
        if let Some(fits) = fits.map_err(|problem| problem.to_string())? {
            return Ok(fits);
        }
    }
    let [width, height] = expected.size_px;
    Err(format!(
        "it does not offer {width}x{height} at {} frames per second{}; it offers {}",
        expected.rate_hz,
        wanted.map_or_else(String::new, |name| format!(" in {name}")),
        offered(device, expected.size_px)
    ))
}

/// The formats to try: all, or the one with the wanted name.
fn formats_named(wanted: Option<&str>) -> Result<&'static [PixelFormat], String> {
    let Some(wanted) = wanted else {
        return Ok(&FORMATS);
    };
    let named = FORMATS.iter().position(|known| known.name == wanted);
    named.map(|at| &FORMATS[at..=at]).ok_or_else(|| {
        let known = FORMATS.each_ref().map(|known| known.name);
        format!(
            "`source.format`: {}",
            unknown_name("pixel format", wanted, &known)
        )
    })
}

/// `None` if the camera lacks this format, size or rate.
fn try_format(
    device: &Device,
    pixels: &PixelFormat,
    expected: &ExpectedSource,
) -> io::Result<Option<(PictureDecoder, Option<f64>)>> {
    let [width, height] = expected.size_px;
    let fourcc = pixels.fourcc();
    let format = match device.set_format(&Format::new(width, height, fourcc)) {
        Ok(format) => format,
        Err(problem) if problem.kind() == io::ErrorKind::InvalidInput => return Ok(None),
        Err(problem) => return Err(problem),
    };
    let is_wanted = format.fourcc == fourcc && [format.width, format.height] == expected.size_px;
    let rate_hz = set_rate(device, expected.rate_hz);
    let is_off = |found_hz: f64| (found_hz / expected.rate_hz - 1.0).abs() > RATE_TOLERANCE;
    if !is_wanted || rate_hz.is_some_and(is_off) {
        return Ok(None);
    }
    Ok(Some((PictureDecoder::new(pixels, &format), rate_hz)))
}

/// Requests a rate and returns the rate that the driver chose; `None` if the driver has no rate.
fn set_rate(device: &Device, rate_hz: f64) -> Option<f64> {
    /// Rates are fractions of integers; this distinguishes 59.94 from 60.
    const PARTS: f64 = 1000.0;
    let interval = Fraction::new(PARTS as u32, (rate_hz * PARTS).round() as u32);
    let set = device.set_params(&Parameters::new(interval)).ok()?;
    let [part, whole] = [set.interval.numerator, set.interval.denominator].map(f64::from);
    (part > 0.0).then_some(whole / part)
}

fn capture(
    stream: &mut Stream<'_>,
    decoder: &PictureDecoder,
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
                let bytes = &bytes[..(about.bytesused as usize).min(bytes.len())];
                let is_whole = !about.flags.contains(Flags::ERROR);
                // Webcams sometimes send a broken JPEG; the next one is complete.
                let Some(picture) = is_whole.then(|| decoder.decode(bytes)).flatten() else {
                    continue;
                };
                let frame = Frame {
                    tick,
                    capture_offset_us: 0,
                    content: FrameContent::Image(picture),
                };
                let stamp = about.timestamp;
                Ok((frame, stamp.sec * 1_000_000 + stamp.usec))
            }
            Err(problem) => Err(unreadable(expected, problem.to_string())),
        };
        let failed = frame.is_err();
        if !sender.push(frame) || failed {
            return;
        }
    }
}

/// Sizes listed per format; a camera has up to thirty.
const LISTED_SIZES: usize = 12;

/// Formats with their rates at the wanted size, or with the sizes that they have instead.
fn offered(device: &Device, wanted_px: [u32; 2]) -> String {
    let formats = device.enum_formats().unwrap_or_default();
    let one = |fourcc: FourCC| {
        let name = fourcc.to_string().trim_end().to_owned();
        if !FORMATS.iter().any(|known| known.fourcc() == fourcc) {
            return format!("{name} (not supported)");
        }
        let [width, height] = wanted_px;
        match rates(device, fourcc, wanted_px) {
            rates if rates.is_empty() => format!("{name} {}", sizes(device, fourcc)),
            rates => format!("{name} {width}x{height} at {} per second", rates.join(", ")),
        }
    };
    let formats: Vec<_> = formats.iter().map(|format| one(format.fourcc)).collect();
    if formats.is_empty() {
        return "no pictures: it is no camera, or one that needs another program to set it up"
            .to_owned();
    }
    formats.join("; ")
}

fn rates(device: &Device, fourcc: FourCC, [width, height]: [u32; 2]) -> Vec<String> {
    let intervals = device.enum_frameintervals(fourcc, width, height);
    let rate = |[part, whole]: [u32; 2]| {
        let rate_hz = f64::from(whole) / f64::from(part.max(1));
        ((rate_hz * 1000.0).round() / 1000.0).to_string()
    };
    let one = |interval: &FrameIntervalEnum| match interval {
        FrameIntervalEnum::Discrete(every) => rate([every.numerator, every.denominator]),
        FrameIntervalEnum::Stepwise(steps) => {
            let [slowest, fastest] =
                [&steps.max, &steps.min].map(|every| rate([every.numerator, every.denominator]));
            format!("{slowest} to {fastest}")
        }
    };
    let intervals = intervals.unwrap_or_default();
    intervals.iter().map(|found| one(&found.interval)).collect()
}

fn sizes(device: &Device, fourcc: FourCC) -> String {
    let sizes = device.enum_framesizes(fourcc).unwrap_or_default();
    let one = |size: &FrameSizeEnum| match size {
        FrameSizeEnum::Discrete(size) => format!("{}x{}", size.width, size.height),
        FrameSizeEnum::Stepwise(steps) => format!(
            "{}x{} to {}x{}",
            steps.min_width, steps.min_height, steps.max_width, steps.max_height
        ),
    };
    let mut listed: Vec<_> = sizes
        .iter()
        .take(LISTED_SIZES)
        .map(|found| one(&found.size))
        .collect();
    if sizes.len() > LISTED_SIZES {
        listed.push(format!("{} more", sizes.len() - LISTED_SIZES));
    }
    listed.join(", ")
}

#[cfg(test)]
mod tests {
    use farfield_proto::venue::TickFrom;

    use super::super::SourceOrigin;
    use super::*;

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
            keypoints: 17,
            tick_from: TickFrom::Clock,
        };
        let settings = DeviceSettings::default();
        for path in ["/dev/video-none", "/dev/video\0"] {
            let refused = probe(Path::new(path), &settings, &expected).unwrap_err();
            let is_absent = matches!(refused, SourceError::NotThere { .. });
            let text = refused.to_string();
            assert!(
                is_absent && text.starts_with("/dev/video-none: camera `left`: `source`"),
                "{path:?}: {text}"
            );
        }
    }

    #[test]
    fn a_pixel_format_is_found_by_its_name() {
        let names =
            |wanted| formats_named(wanted).map(|found| found.iter().map(|known| known.name));
        assert!(
            names(None)
                .unwrap()
                .eq(FORMATS.each_ref().map(|known| known.name))
        );
        assert!(names(Some("Y10")).unwrap().eq(["Y10"]));
        let refused = formats_named(Some("MJPEG")).err().unwrap();
        assert!(refused.contains("did you mean `MJPG`?"), "{refused}");
    }
}
