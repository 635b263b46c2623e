//! Numbers with a fixed count of decimals.

/// Distance beyond a bound at which an angle still counts as at the bound, radians: an f32 of an
/// angle in its range is off by at most 2^-24 of itself, below 4e-7 up to 2 pi.
const BEYOND_BOUND: f64 = 1e-6;

/// Rounds to the nearest multiple of 10^-decimals; never -0.
///
/// A value that is too large for such decimals, or not finite, is returned unchanged.
pub fn round(value: f64, decimals: u32) -> f64 {
    let scale = 10f64.powi(decimals.cast_signed());
    let scaled = (value * scale).round();
    if scaled.abs() < MAX_EXACT {
        scaled / scale + 0.0
    } else {
        value
    }
}

/// Every integer up to here is an f64.
const MAX_EXACT: f64 = 9_007_199_254_740_992.0;

/// Moves `value` to the bound of `range` if it is slightly beyond it.
///
/// A value beyond by more than the error of f32 is returned unchanged: moving it would hide a
/// fault.
pub fn draw_in(value: f64, range: [f64; 2]) -> f64 {
    let [low, high] = range;
    if value < low - BEYOND_BOUND || value > high + BEYOND_BOUND {
        return value;
    }
    value.clamp(low, high)
}

/// Rounds a value inside `range` like [`round`], but inward if the nearest multiple is beyond a
/// bound. A value outside is rounded like any other.
pub fn round_inward(value: f64, decimals: u32, range: [f64; 2]) -> f64 {
    let [low, high] = range;
    if !(low..=high).contains(&value) {
        return round(value, decimals);
    }
    let scale = 10f64.powi(decimals.cast_signed());
    let mut steps = (value * scale).round();
    // A reader of the decimals gets this quotient, so it is the one to compare.
    if steps / scale > high {
        steps -= 1.0;
    } else if steps / scale < low {
        steps += 1.0;
    }
    steps / scale + 0.0
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn minus_zero_is_zero() {
        assert_eq!(round(-1e-9, 5).to_string(), "0");
        assert_eq!(
            round_inward(draw_in(1e-9, [-1.0, 0.0]), 6, [-1.0, 0.0]).to_string(),
            "0"
        );
    }

    #[test]
    fn rounding_does_not_leave_a_bound_between_decimals() {
        let high = 145.0f64.to_radians(); // 2.530727415...
        assert_eq!(round_inward(high, 6, [0.0, high]).to_string(), "2.530727");
        let low = (-20.0f64).to_radians(); // -0.3490658503...
        assert_eq!(round_inward(low, 6, [low, 1.0]).to_string(), "-0.349065");
    }

    #[test]
    fn a_value_outside_its_range_is_unchanged() {
        assert_eq!(
            round_inward(draw_in(1.01, [0.0, 1.0]), 6, [0.0, 1.0]).to_string(),
            "1.01"
        );
    }

    proptest! {
        #[test]
        fn values_inside_before_f32_are_inside_after_writing(
            low in -3.2f64..0.0, width in 0.01f64..3.0, part in 0.0f64..=1.0, pick in 0u8..4,
        ) {
            let range = [low, low + width];
            let exact = match pick { 0 => range[0], 1 => range[1], _ => low + part * width };
            let written = format!("{:.6}", round_inward(draw_in(f64::from(exact as f32), range), 6, range));
            let read: f64 = written.parse().unwrap();
            prop_assert!(range[0] <= read && read <= range[1], "{} not in {:?}", read, range);
            prop_assert!((read - exact).abs() < 2e-6);
        }
    }
}
