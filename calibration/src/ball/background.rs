//! What stands still, so that what moves can be told from it.

/// How often the background moves towards the picture while it settles, and afterwards: once a picture, then every other.
const SETTLING: u64 = 30;
const SETTLED_EVERY: u64 = 2;
/// Steps, levels, while it settles and afterwards.
const FIRST_STEP: u8 = 4;
/// How many times its usual change a pixel must differ by.
const TIMES: u8 = 3;
const MOST_CHANGE: u8 = 60;

/// Median and usual change of every pixel's brightness, each moved by a level at a time (Manzanera & Richefeu 2007, "A new
/// motion detection algorithm based on sigma-delta background estimation").
///
/// Two bytes a pixel, however many pictures.
#[derive(Debug, Clone, Default)]
pub(super) struct Background {
    median: Vec<u8>,
    change: Vec<u8>,
    width: usize,
    pictures: u64,
}

impl Background {
    /// Makes room for pictures of `width` x `height`.
    pub(super) fn begin(&mut self, width: usize, height: usize) {
        if self.median.len() != width * height {
            self.median = vec![0; width * height];
            self.change = vec![0; width * height];
            self.width = width;
            self.pictures = 0;
        }
    }

    /// Clears each pixel of `mask` that differs by less than `contrast` levels, or than its usual change, and learns
    /// `brightness`, row `y` of the picture.
    pub(super) fn keep_moving(
        &mut self,
        y: usize,
        brightness: &[u8],
        contrast: u8,
        mask: &mut [bool],
    ) {
        let start = y * self.width;
        let end = start + self.width;
        let (Some(median), Some(change)) = (
            self.median.get_mut(start..end),
            self.change.get_mut(start..end),
        ) else {
            return;
        };
        if self.pictures == 0 {
            median.copy_from_slice(brightness);
            mask.fill(false);
            return;
        }
        let learns = self.pictures < SETTLING || self.pictures.is_multiple_of(SETTLED_EVERY);
        let step = if self.pictures < SETTLING {
            FIRST_STEP
        } else {
            1
        };
        let pixels = median.iter_mut().zip(change).zip(brightness).zip(mask);
        for (((median, change), now), is_moving) in pixels {
            let off = now.abs_diff(*median);
            *is_moving &= off >= contrast && off >= change.saturating_mul(TIMES);
            if !learns {
                continue;
            }
            // What lies far off is somebody passing, and says little of how this pixel usually changes.
            if off < MOST_CHANGE {
                let usual = off.max(1);
                *change = if *change < usual {
                    *change + 1
                } else {
                    change.saturating_sub(u8::from(*change > usual))
                };
            }
            if *now > *median {
                *median += step.min(off);
            } else {
                *median -= step.min(off);
            }
        }
    }

    /// After the last row.
    pub(super) fn end(&mut self) {
        self.pictures += 1;
    }
}
