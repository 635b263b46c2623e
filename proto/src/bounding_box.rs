//! Predicted image regions of people.

use serde::{Deserialize, Serialize};

/// The predicted region of one person in one camera: a rotated rectangle in undistorted pixels.
///
/// Ohashi 2020, eq. (2). A rotation turns +x towards +y (clockwise on the screen) and is the
/// negative of B' in eq. (4): an upright person has 0, a person lying with the head to the image's
/// right has +pi/2.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct BoundingBox {
    /// Centre (x, y), undistorted pixels.
    pub center_px: [f32; 2],
    /// Width and height along the rotated axes, undistorted pixels, both above zero.
    pub size_px: [f32; 2],
    /// Rotation, radians.
    pub rotation_rad: f32,
}

/// Change of a [`BoundingBox`] per tick, with which an edge extrapolates an old box.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct BoxRate {
    /// Motion of the centre, pixels per tick.
    pub center_px: [f32; 2],
    /// Growth of the size, pixels per tick.
    pub size_px: [f32; 2],
    /// Rotation, radians per tick.
    pub rotation_rad: f32,
}

/// Share of its size by which a box grows per tick of age, because its rates are predictions too.
pub const WIDENING_PER_TICK: f32 = 0.02;

/// Largest factor by which a box grows with age: larger crops only lose detail.
pub const WIDENING_MAX: f32 = 1.5;

impl BoundingBox {
    /// The box extrapolated by `ticks` (negative: back in time) and widened by
    /// [`WIDENING_PER_TICK`] per tick.
    #[must_use]
    pub fn moved_on(&self, rate: &BoxRate, ticks: i64) -> Self {
        if ticks == 0 {
            return *self;
        }
        let n = ticks as f32;
        let widening = (1.0 + WIDENING_PER_TICK * n.abs()).min(WIDENING_MAX);
        let grown = |i: usize| {
            ((self.size_px[i] + n * rate.size_px[i]).max(self.size_px[i] * 0.5)) * widening
        };
        Self {
            center_px: [
                self.center_px[0] + n * rate.center_px[0],
                self.center_px[1] + n * rate.center_px[1],
            ],
            size_px: [grown(0), grown(1)],
            rotation_rad: self.rotation_rad + n * rate.rotation_rad,
        }
    }

    /// Whether every number is finite and the size is above zero.
    pub fn is_valid(&self) -> bool {
        let finite = self
            .center_px
            .iter()
            .chain(&self.size_px)
            .all(|v| v.is_finite())
            && self.rotation_rad.is_finite();
        finite && self.size_px.iter().all(|&v| v > 0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_old_box_follows_its_rates_and_widens() {
        let b = BoundingBox {
            center_px: [100.0, 50.0],
            size_px: [40.0, 80.0],
            rotation_rad: 0.1,
        };
        let rate = BoxRate {
            center_px: [2.0, -1.0],
            size_px: [1.0, 2.0],
            rotation_rad: 0.05,
        };
        let later = b.moved_on(&rate, 5);
        assert!(
            (later.center_px[0] - 110.0).abs() < 1e-3 && (later.center_px[1] - 45.0).abs() < 1e-3
        );
        assert!(later.size_px[0] > 45.0 && later.size_px[1] > 90.0);
        assert!((later.rotation_rad - 0.35).abs() < 1e-6);
    }

    #[test]
    fn a_later_box_is_moved_back_and_a_current_one_is_unchanged() {
        let b = BoundingBox {
            center_px: [1.0, 2.0],
            size_px: [3.0, 4.0],
            rotation_rad: 0.0,
        };
        let rate = BoxRate {
            center_px: [9.0, 9.0],
            ..BoxRate::default()
        };
        assert_eq!(b.moved_on(&rate, 0), b);
        let back = b.moved_on(&rate, -3);
        assert!((back.center_px[0] + 26.0).abs() < 1e-3 && (back.center_px[1] + 25.0).abs() < 1e-3);
        assert!(back.size_px[0] > 3.0);
    }
}
