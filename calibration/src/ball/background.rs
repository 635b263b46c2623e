//! What stands still, so that what moves can be told from it.

/// How often the background moves towards the picture while it settles, and afterwards: once a picture, then every other.
const SETTLING: u64 = 30;
const SETTLED_EVERY: u64 = 2;
/// Steps, levels, while it settles and afterwards.
const FIRST_STEP: u8 = 4;
/// How many times its usual change a pixel must differ by.
const TIMES: u8 = 3;
const MOST_CHANGE: u8 = 60;

/// Median and usual change of every pixel, each moved by a level at a time (Manzanera & Richefeu 2007, "A new motion detection
/// algorithm based on sigma-delta background estimation"): of its brightness, or of each of its colours.
///
/// Two bytes a pixel and colour, however many pictures.
#[derive(Debug, Clone, Default)]
pub(super) struct Background {
    median: Vec<u8>,
    change: Vec<u8>,
    levels_per_row: usize,
    pictures: u64,
}

impl Background {
    /// Makes room for pictures of `levels_per_row` x `height`.
    pub(super) fn begin(&mut self, levels_per_row: usize, height: usize) {
        if self.median.len() != levels_per_row * height {
            self.median = vec![0; levels_per_row * height];
            self.change = vec![0; levels_per_row * height];
            self.levels_per_row = levels_per_row;
            self.pictures = 0;
        }
    }

    /// Clears each pixel of `mask` that differs by less than `contrast` levels, or than its usual change, in all that is known
    /// of it, and learns `levels`, row `y` of the picture: `PER_PIXEL` levels a pixel.
    pub(super) fn keep_moving<const PER_PIXEL: usize>(
        &mut self,
        y: usize,
        levels: &[u8],
        contrast: u8,
        mask: &mut [bool],
    ) {
        let start = y * self.levels_per_row;
        let end = start + self.levels_per_row;
        let (Some(median), Some(change)) = (
            self.median.get_mut(start..end),
            self.change.get_mut(start..end),
        ) else {
            return;
        };
        if self.pictures == 0 {
            median.copy_from_slice(levels);
            mask.fill(false);
            return;
        }
        let learning = Learning::after(self.pictures);
        let usual = median
            .chunks_exact_mut(PER_PIXEL)
            .zip(change.chunks_exact_mut(PER_PIXEL));
        let pixels = usual.zip(levels.chunks_exact(PER_PIXEL)).zip(mask);
        for (((median, change), now), is_moving) in pixels {
            let mut moves = false;
            for ((median, change), now) in median.iter_mut().zip(change).zip(now) {
                let off = now.abs_diff(*median);
                moves |= off >= contrast && off >= change.saturating_mul(TIMES);
                learning.apply(*now, off, median, change);
            }
            *is_moving &= moves;
        }
    }

    /// After the last row.
    pub(super) fn end(&mut self) {
        self.pictures += 1;
    }
}

/// How a level learns from the next picture.
#[derive(Debug, Clone, Copy)]
struct Learning {
    is_due: bool,
    step: u8,
}

impl Learning {
    fn after(pictures: u64) -> Self {
        let settles = pictures < SETTLING;
        Self {
            is_due: settles || pictures.is_multiple_of(SETTLED_EVERY),
            step: if settles { FIRST_STEP } else { 1 },
        }
    }

    /// Takes in that a level is `now`, `off` from its `median`.
    fn apply(self, now: u8, off: u8, median: &mut u8, change: &mut u8) {
        if !self.is_due {
            return;
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
        if now > *median {
            *median += self.step.min(off);
        } else {
            *median -= self.step.min(off);
        }
    }
}
