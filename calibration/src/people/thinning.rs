//! Selects frames of a long recording so that memory stays bounded. An adjustment uses a few thousand keypoints, and tracklets
//! need only enough frames to follow each other.

use crate::points::Timing;

/// Frames per second that are kept of synchronised cameras.
const KEPT_HZ: f64 = 10.0;
/// Frames per second that are kept if bodies are interpolated between frames: feet accelerate with 50 m/s^2, so they deviate by
/// 7 mm from a straight line between frames that are 1/30 s apart.
const KEPT_BETWEEN_HZ: f64 = 25.0;
/// Length of the stretches that are kept or left out, seconds.
const STRETCH_S: f64 = 2.0;

/// Keypoints of all cameras that need about 0.7 GB: 400,000 bodies of 17 each.
pub const MOST_KEYPOINTS: usize = 400_000 * 17;

/// Selects the frames to keep.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Thinning {
    rate_hz: f64,
    offset_s: f64,
    /// One of so many frames is kept if `is_strided`.
    stride: i64,
    is_strided: bool,
    /// One of so many stretches is kept, the same in all cameras.
    stretches: i64,
    /// With unknown clocks stretches would differ between cameras. Then frames are kept for this long from the first one,
    /// seconds.
    until_s: f64,
    /// Number of the first frame, with unknown clocks: cameras may start with any number, and recordings that were started
    /// manually begin within minutes.
    begin: f64,
    is_unknown: bool,
}

impl Thinning {
    /// For a camera of `rate_hz` whose frame 0 is at `offset_s`. It keeps all frames until [`Self::coarsen`] is called. An invalid
    /// rate keeps all frames.
    pub fn new(rate_hz: f64, offset_s: f64, timing: Timing) -> Self {
        let kept_hz = match timing {
            Timing::Synchronised => KEPT_HZ,
            Timing::Clocks | Timing::Unknown => KEPT_BETWEEN_HZ,
        };
        let stride = libm::floor(rate_hz / kept_hz);
        Self {
            rate_hz,
            offset_s: if timing == Timing::Clocks {
                offset_s
            } else {
                0.0
            },
            stride: if stride.is_finite() {
                (stride as i64).max(1)
            } else {
                1
            },
            is_strided: false,
            stretches: 1,
            until_s: f64::INFINITY,
            begin: 0.0,
            is_unknown: timing == Timing::Unknown,
        }
    }

    /// Sets the number of the recording's first frame, from which time counts with unknown clocks.
    pub fn begin(&mut self, number: f64) {
        if self.is_unknown && number.is_finite() {
            self.begin = number;
        }
    }

    /// Whether frame `number` is kept.
    pub fn keeps(&self, number: f64) -> bool {
        let time_s = number / self.rate_hz + self.offset_s;
        if !time_s.is_finite() {
            return true;
        }
        let stretch = libm::floor(time_s / STRETCH_S) as i64;
        (number as i64).rem_euclid(self.stride_now()) == 0
            && stretch.rem_euclid(self.stretches) == 0
            && (number - self.begin) / self.rate_hz < self.until_s
    }

    fn stride_now(&self) -> i64 {
        if self.is_strided { self.stride } else { 1 }
    }

    /// Keeps fewer frames: first ten a second (25 or more if clocks differ), then half as many each time. `first` and `last` are
    /// the numbers of the first and the last frame so far.
    pub fn coarsen(&mut self, first: f64, last: f64) {
        if !self.is_strided && self.stride > 1 {
            self.is_strided = true;
        } else if self.is_unknown {
            self.until_s = (f64::midpoint(first, last) - self.begin) / self.rate_hz;
        } else {
            self.stretches = self.stretches.saturating_mul(2);
        }
    }

    /// Keeps no more than `other`, the selection of another camera.
    pub fn follow(&mut self, other: &Self) {
        self.is_strided |= other.is_strided;
        self.stretches = self.stretches.max(other.stretches);
        self.until_s = self.until_s.min(other.until_s);
    }

    /// Describes the selection; `None` if all frames are kept.
    pub fn in_words(&self) -> Option<String> {
        let rate_hz = self.rate_hz / self.stride_now() as f64;
        let mut parts = Vec::new();
        if self.stride_now() > 1 {
            parts.push(format!("{rate_hz:.1} frames a second"));
        }
        if self.stretches > 1 {
            let period_s = STRETCH_S * self.stretches as f64;
            parts.push(format!("{STRETCH_S} s of every {period_s} s"));
        }
        if self.until_s.is_finite() {
            parts.push(format!(
                "the first {:.0} s of each recording, within which all cameras must be started",
                self.until_s
            ));
        }
        (!parts.is_empty()).then(|| parts.join(", "))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn kept(thinning: &Thinning, frames: u32) -> Vec<u32> {
        let frames = 0..frames;
        frames.filter(|it| thinning.keeps(f64::from(*it))).collect()
    }

    #[test]
    fn synchronised_cameras_keep_the_same_frames() {
        let mut thinning = Thinning::new(60.0, 3.3, Timing::Synchronised);
        assert_eq!(kept(&thinning, 24).len(), 24);
        assert!(thinning.in_words().is_none());
        thinning.coarsen(0.0, 23.0);
        assert_eq!(kept(&thinning, 24), [0, 6, 12, 18]);
        assert_eq!(thinning.in_words().unwrap(), "10.0 frames a second");
        let slow = Thinning::new(12.0, 0.0, Timing::Synchronised);
        assert_eq!(kept(&slow, 100).len(), 100);
        assert!(slow.in_words().is_none());
    }

    #[test]
    fn stretches_cover_the_same_time_in_all_cameras() {
        let mut first = Thinning::new(60.0, 0.0, Timing::Clocks);
        let mut second = Thinning::new(30.0, 1.0, Timing::Clocks);
        first.coarsen(0.0, 1000.0);
        first.coarsen(0.0, 1000.0);
        first.coarsen(0.0, 1000.0);
        second.follow(&first);
        let times = |thinning: &Thinning, hz: f64, offset_s: f64| -> Vec<f64> {
            let kept = kept(thinning, 2000);
            kept.iter()
                .map(|it| f64::from(*it) / hz + offset_s)
                .collect()
        };
        for time_s in times(&first, 60.0, 0.0)
            .into_iter()
            .chain(times(&second, 30.0, 1.0))
        {
            assert!(time_s.rem_euclid(8.0) < 2.0, "{time_s}");
        }
        assert!(second.in_words().unwrap().contains("2 s of every 8 s"));
    }

    #[test]
    fn cameras_with_unknown_clocks_keep_the_beginning() {
        let mut thinning = Thinning::new(30.0, 0.0, Timing::Unknown);
        thinning.coarsen(0.0, 3000.0);
        assert_eq!(kept(&thinning, 3000).len(), 1500);
        thinning.coarsen(0.0, 1500.0);
        assert_eq!(kept(&thinning, 3000).len(), 750);
    }

    #[test]
    fn with_unknown_clocks_the_beginning_may_have_any_number() {
        let mut early = Thinning::new(30.0, 0.0, Timing::Unknown);
        let mut late = Thinning::new(60.0, 0.0, Timing::Unknown);
        early.begin(0.0);
        late.begin(900_000.0);
        early.coarsen(0.0, 3000.0);
        late.follow(&early);
        let frames = (900_000..906_000).filter(|it| late.keeps(f64::from(*it)));
        // 50 s at 60 Hz, all frames: the stride of the 30 Hz camera is one.
        assert_eq!(frames.count(), 3000);
        late.coarsen(900_000.0, 902_000.0);
        late.coarsen(900_000.0, 902_000.0);
        assert!(late.keeps(900_000.0) && !late.keeps(901_100.0));
        assert!(late.in_words().unwrap().contains("s of each recording"));
        // With known clocks the beginning has no effect.
        let mut given = Thinning::new(30.0, 0.0, Timing::Clocks);
        given.begin(900_000.0);
        assert_eq!(given, Thinning::new(30.0, 0.0, Timing::Clocks));
    }

    #[test]
    fn invalid_rates_keep_all_frames() {
        for rate_hz in [0.0, -1.0, f64::NAN, f64::INFINITY, 1e300] {
            let thinning = Thinning::new(rate_hz, f64::NAN, Timing::Clocks);
            assert!(thinning.keeps(0.0), "{rate_hz}");
            let _kept = kept(&thinning, 100);
        }
    }
}
