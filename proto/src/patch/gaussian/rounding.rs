//! Rounding to integers, and powers, only with additions, products and selections. On a few numbers
//! at once these become vectors on every machine, and all machines get the same bits.

/// Added to a number from 0 to 2^22, this leaves the nearest integer in the lowest bits.
const WHOLE: f32 = 8_388_608.0;

/// `x`, or 0 if it is negative.
#[inline]
pub(super) const fn not_below_zero(x: f32) -> f32 {
    // Unlike `max`, this does not need the extra operations for NaN.
    if x > 0.0 { x } else { 0.0 }
}

/// The smaller of `x` and `most`.
#[inline]
pub(super) const fn at_most(most: f32, x: f32) -> f32 {
    if x < most { x } else { most }
}

/// The largest integer not above `x`, for `x` from 0 to 2^22.
#[inline]
pub(super) const fn floor(x: f32) -> f32 {
    let near = (x + WHOLE) - WHOLE;
    near - if near > x { 1.0 } else { 0.0 }
}

/// The smallest integer not below `x`, for `x` from 0 to 2^22.
#[inline]
pub(super) const fn ceil(x: f32) -> f32 {
    let near = (x + WHOLE) - WHOLE;
    near + if near < x { 1.0 } else { 0.0 }
}

/// [`floor`] as an integer.
#[inline]
pub(super) fn whole_below(x: f32) -> u32 {
    let near = x + WHOLE;
    (near.to_bits() - u32::from(near - WHOLE > x)) & 0x7f_ffff
}

/// `x` as an integer, for integral `x` from 0 to 2^22.
#[inline]
pub(super) const fn whole(x: f32) -> u32 {
    (x + WHOLE).to_bits() & 0x7f_ffff
}

/// The exponential of `x` with a relative error of 3e-7, clamped to 2^-126 to 2^126.
#[inline]
pub(super) fn exp(x: f32) -> f32 {
    exp2(x * std::f32::consts::LOG2_E)
}

/// 2 to the power of `x`, as [`exp`].
#[inline]
pub(super) const fn exp2(x: f32) -> f32 {
    let x = x.clamp(-126.0, 126.0);
    let above = floor(x + 128.5);
    let f = x - (above - 128.0);
    // Taylor series: the remainder is below 2e-7 from -1/2 to 1/2.
    let terms = [
        1.535_336_2e-4,
        1.339_887_4e-3,
        9.618_437e-3,
        5.550_332_5e-2,
        2.402_264_7e-1,
        6.931_472e-1,
        1.0,
    ];
    let (mut power, mut i) = (0.0, 0);
    while i < terms.len() {
        power = power * f + terms[i];
        i += 1;
    }
    // The exponent of single precision, from 1 on.
    power * f32::from_bits(whole(above - 1.0) << 23)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn powers_agree_with_the_library(x in -60.0f32..60.0) {
            let expected = libm::exp2(f64::from(x));
            prop_assert!((f64::from(exp2(x)) / expected - 1.0).abs() < 4e-7);
        }

        #[test]
        fn rounding_agrees_with_the_library(x in 0.0f32..1000.0, n in 0u16..1000) {
            for x in [x, n.into(), f32::from(n).next_up(), f32::from(n + 1).next_down()] {
                prop_assert_eq!(floor(x).to_bits(), libm::floorf(x).to_bits());
                prop_assert_eq!(ceil(x).to_bits(), libm::ceilf(x).to_bits());
                prop_assert_eq!([whole(floor(x)), whole_below(x)], [x as u32; 2]);
            }
        }
    }

    #[test]
    fn powers_are_clamped_to_single_precision() {
        let ends = [-126, 126].map(|n| libm::ldexpf(1.0, n).to_bits());
        assert_eq!([-1e9, 1e9].map(|x| exp2(x).to_bits()), ends);
    }
}
