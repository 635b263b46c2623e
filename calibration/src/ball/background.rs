//! The still background, which separates what moves from it.

/// Pictures during which the background settles: it is updated at every picture then, and at every second one afterwards.
const SETTLING: u64 = 30;
const SETTLED_EVERY: u64 = 2;
/// Step while it settles, levels; 1 afterwards.
const FIRST_STEP: u8 = 4;
/// Least difference of a moving pixel, in units of its usual change.
const TIMES: u8 = 3;
/// Differences from here on do not update the usual change, levels.
const MOST_CHANGE: u8 = 60;

/// Median and usual change of every pixel, each updated by one level at a time (Manzanera & Richefeu 2007, "A new motion
/// detection algorithm based on sigma-delta background estimation"), of its brightness or of each of its colours.
///
/// Memory is two bytes per pixel and colour, for any number of pictures.
#[derive(Debug, Clone, Default)]
pub(super) struct Background {
    median: Vec<u8>,
    change: Vec<u8>,
    levels_per_row: usize,
    pictures: u64,
}

impl Background {
    /// Allocates for pictures of `levels_per_row` x `height`.
    pub(super) fn begin(&mut self, levels_per_row: usize, height: usize) {
        if self.median.len() != levels_per_row * height {
            self.median = vec![0; levels_per_row * height];
            self.change = vec![0; levels_per_row * height];
            self.levels_per_row = levels_per_row;
            self.pictures = 0;
        }
    }

    /// Clears each pixel of `mask` whose levels all differ from the background by less than `contrast`, or by less than
    /// [`TIMES`] times their usual change. Then learns `levels`, row `y` of the picture, with `PER_PIXEL` levels per pixel.
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

    /// Call it after the last row.
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

    /// Updates `median` and `change` with the level `now`, which differs from `median` by `off`.
    fn apply(self, now: u8, off: u8, median: &mut u8, change: &mut u8) {
        if !self.is_due {
            return;
        }
        // A large difference is a passing object, and carries little information on how this pixel usually changes.
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
