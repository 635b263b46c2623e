//! What a kernel camera offers, in words, for error messages.

use v4l::frameinterval::FrameIntervalEnum;
use v4l::framesize::FrameSizeEnum;
use v4l::video::Capture as _;
use v4l::{Device, FourCC};

use super::formats::FORMATS;

/// Sizes listed per format; a camera has up to thirty.
const LISTED_SIZES: usize = 12;

/// Formats with their rates at the wanted size, or with the sizes that they have instead.
pub(super) fn offered(device: &Device, wanted_px: [u32; 2]) -> String {
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
