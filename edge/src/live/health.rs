//! The health of a camera, from its pictures and their absence.

use farfield_proto::message::live::CameraHealth;

use super::{Micros, SECOND_US};
use crate::picture::Picture;

/// A camera is frozen if its picture stays equal, bit for bit, for longer than this, microseconds.
/// The noise of a sensor never repeats.
pub const FROZEN_US: Micros = SECOND_US / 2;
/// Mean of the sampled bytes (0 to 255) below which a picture is black. A covered lens has noise;
/// studio black is 0.
pub const BLACK_BELOW: f64 = 6.0;
/// Periods without a frame after which a camera is silent.
pub const SILENT_PERIODS: i64 = 3;
/// First and longest pause before a failed camera is opened again, microseconds.
pub const BACKOFF_US: [Micros; 2] = [SECOND_US, 30 * SECOND_US];
/// Sampled bytes of a picture: enough to cover a distant person, few enough to cost less than a
/// copy of the picture.
const SAMPLES: usize = 1 << 16;

/// Digest of sampled bytes of a picture, for comparison with the next one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PictureSample {
    /// Hash of the sampled bytes.
    pub hash: u64,
    /// Their mean, 0 to 255.
    pub mean: f64,
}

/// Samples evenly spread bytes of a picture. Hash: FNV-1a, 64 bits.
pub fn sample_picture(picture: &Picture) -> PictureSample {
    let (bytes, [offset, gain]) = picture.sample_bytes();
    // Odd and not a multiple of 3, so that all colours, and other columns in each row, are sampled.
    let mut stride = (bytes.len() / SAMPLES) | 1;
    if stride.is_multiple_of(3) {
        stride += 2;
    }
    let (mut hash, mut sum, mut n) = (0xcbf2_9ce4_8422_2325u64, 0u64, 0u64);
    for &byte in bytes.iter().step_by(stride) {
        // FNV-1a.
        hash = (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3);
        sum += u64::from(byte);
        n += 1;
    }
    PictureSample {
        hash,
        mean: (sum as f64 / n.max(1) as f64 - offset) * gain,
    }
}

/// The health of one camera over time.
#[derive(Debug, Clone)]
pub struct CameraWatch {
    period_us: Micros,
    last: Option<PictureSample>,
    /// Since when the picture is unchanged.
    same_since_us: Micros,
    seen_us: Option<Micros>,
    failed: bool,
    failures: u32,
    /// Number and offsets of the frames in the last second.
    frames: u32,
    offsets_us: i64,
    counted_since_us: Option<Micros>,
    rate: (f32, i32),
}

impl CameraWatch {
    /// For a camera with a frame every `period_us`.
    pub fn new(period_us: Micros) -> Self {
        Self {
            period_us,
            last: None,
            same_since_us: 0,
            seen_us: None,
            failed: false,
            failures: 0,
            frames: 0,
            offsets_us: 0,
            counted_since_us: None,
            rate: (0.0, 0),
        }
    }

    /// Records a frame that arrived at `now_us`, with a `sample` if it is a picture.
    pub fn record(&mut self, sample: Option<PictureSample>, offset_us: i32, now_us: Micros) {
        let same = sample.is_some() && sample.map(|g| g.hash) == self.last.map(|g| g.hash);
        if !same {
            self.same_since_us = now_us;
            self.failures = 0;
        }
        self.last = sample;
        self.seen_us = Some(now_us);
        self.failed = false;
        self.count(now_us);
        self.frames += 1;
        self.offsets_us += i64::from(offset_us);
    }

    /// Records a failure of the source; returns the pause before it is opened again, microseconds.
    /// The pause doubles until a new picture arrives.
    pub fn failed(&mut self) -> Micros {
        let [first, longest] = BACKOFF_US;
        let wait_us = (first << self.failures.min(10)).min(longest);
        self.failures = self.failures.saturating_add(1);
        self.failed = true;
        wait_us
    }

    /// The health at `now_us`.
    pub fn health(&self, now_us: Micros) -> CameraHealth {
        let (Some(seen_us), false) = (self.seen_us, self.failed) else {
            return if self.failed {
                CameraHealth::Failed
            } else {
                CameraHealth::Silent
            };
        };
        if now_us - seen_us > SILENT_PERIODS * self.period_us {
            return CameraHealth::Silent;
        }
        match self.last {
            Some(sample) if sample.mean < BLACK_BELOW => CameraHealth::Black,
            Some(_) if seen_us - self.same_since_us > FROZEN_US => CameraHealth::Frozen,
            _ => CameraHealth::Works,
        }
    }

    /// Frames per second and their mean offset from the ticks, microseconds, in the last complete
    /// second.
    pub fn rate(&mut self, now_us: Micros) -> (f32, i32) {
        self.count(now_us);
        self.rate
    }

    fn count(&mut self, now_us: Micros) {
        let since_us = *self.counted_since_us.get_or_insert(now_us);
        let passed_us = now_us - since_us;
        if passed_us < SECOND_US {
            return;
        }
        let per_s = f64::from(self.frames) * SECOND_US as f64 / passed_us as f64;
        let offset_us = self.offsets_us / i64::from(self.frames.max(1));
        self.rate = (per_s as f32, offset_us as i32);
        (self.frames, self.offsets_us) = (0, 0);
        self.counted_since_us = Some(now_us);
    }
}

#[cfg(test)]
mod tests {
    use image::{Rgb, RgbImage};

    use super::*;
    use crate::picture::{ColourCoding, YuvLayout, YuvPicture};

    const PERIOD: Micros = 16_667;

    fn picture(shade: u8, dot: u32) -> Picture {
        let mut image = RgbImage::from_pixel(640, 480, Rgb([shade; 3]));
        for dx in 0..12 {
            for dy in 0..24 {
                image.put_pixel(dot + dx, 100 + dy, Rgb([200, 100, 50]));
            }
        }
        image.into()
    }

    /// The pictures of a camera, one per period, made by `shot` from the frame number.
    fn watched(frames: i64, shot: impl Fn(i64) -> Picture) -> (CameraWatch, Micros) {
        let mut watch = CameraWatch::new(PERIOD);
        for n in 0..frames {
            watch.record(Some(sample_picture(&shot(n))), 1000, n * PERIOD);
        }
        (watch, frames * PERIOD)
    }

    #[test]
    fn a_camera_with_a_moving_person_works() {
        let (watch, now) = watched(90, |n| picture(30, 5 + n as u32));
        assert_eq!(watch.health(now), CameraHealth::Works);
    }

    #[test]
    fn fake_a_frozen_camera_works_again_with_the_next_new_picture() {
        let (mut watch, now) = watched(90, |n| picture(30, 5 + n.min(40) as u32));
        assert_eq!(watch.health(now), CameraHealth::Frozen);
        watch.record(Some(sample_picture(&picture(30, 200))), 0, now);
        assert_eq!(watch.health(now), CameraHealth::Works);
    }

    #[test]
    fn fake_a_camera_with_its_lens_covered_is_black() {
        let (watch, now) = watched(5, |n| {
            RgbImage::from_pixel(64, 48, Rgb([n as u8 % 3; 3])).into()
        });
        assert_eq!(watch.health(now), CameraHealth::Black);
    }

    #[test]
    fn video_black_stored_as_16_is_black() {
        let mean = |value: u8, coding: ColourCoding| {
            let bytes = vec![value; 64 * 48].into();
            let picture = YuvPicture::new([64, 48], YuvLayout::Grey, coding, bytes);
            sample_picture(&Picture::Yuv(picture.unwrap())).mean
        };
        let limited = mean(16, ColourCoding::default());
        assert!(limited.abs() < BLACK_BELOW, "{limited}");
        let full = mean(16, ColourCoding::FULL_RANGE);
        assert!(full > BLACK_BELOW, "{full}");
    }

    #[test]
    fn fake_a_camera_without_frames_is_silent() {
        let (watch, now) = watched(10, |n| picture(30, 5 + n as u32));
        assert_eq!(watch.health(now + 2 * PERIOD), CameraHealth::Works);
        assert_eq!(watch.health(now + 3 * PERIOD), CameraHealth::Silent);
        assert_eq!(CameraWatch::new(PERIOD).health(0), CameraHealth::Silent);
    }

    #[test]
    fn fake_a_camera_that_fails_repeatedly_is_opened_less_often() {
        let mut watch = CameraWatch::new(PERIOD);
        let waits: Vec<Micros> = (0..7).map(|_| watch.failed() / SECOND_US).collect();
        assert_eq!(waits, [1, 2, 4, 8, 16, 30, 30]);
        assert_eq!(watch.health(0), CameraHealth::Failed);
        watch.record(None, 0, 0);
        assert_eq!(watch.health(0), CameraHealth::Works);
        assert_eq!(watch.failed(), SECOND_US);
    }

    #[test]
    fn frames_without_pictures_neither_freeze_nor_are_black() {
        let mut watch = CameraWatch::new(PERIOD);
        (0..120).for_each(|n| watch.record(None, -500, n * PERIOD));
        assert_eq!(watch.health(120 * PERIOD), CameraHealth::Works);
        let (per_s, offset_us) = watch.rate(120 * PERIOD);
        assert!((per_s - 60.0).abs() < 1.5, "{per_s}");
        assert_eq!(offset_us, -500);
    }
}
