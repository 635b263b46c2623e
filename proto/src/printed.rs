//! Numbers as text for people; a value that rounds to zero has no minus sign.

/// `value` with this number of decimals.
pub fn fixed(value: f64, decimals: usize) -> String {
    let text = format!("{value:.decimals$}");
    match text.strip_prefix('-') {
        Some(rest) if is_zero(rest) => rest.to_owned(),
        _ => text,
    }
}

/// As [`fixed`], with a sign; zero has a plus.
pub fn signed(value: f64, decimals: usize) -> String {
    let text = fixed(value, decimals);
    if text.starts_with('-') || !value.is_finite() {
        text
    } else {
        format!("+{text}")
    }
}

fn is_zero(digits: &str) -> bool {
    digits.bytes().all(|b| b == b'0' || b == b'.')
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_that_round_to_zero_have_no_minus() {
        for (value, expected) in [
            (-0.04, ["0.0", "+0.0"]),
            (-0.0, ["0.0", "+0.0"]),
            (0.04, ["0.0", "+0.0"]),
            (-0.06, ["-0.1", "-0.1"]),
            (12.34, ["12.3", "+12.3"]),
            (f64::NAN, ["NaN", "NaN"]),
            (f64::NEG_INFINITY, ["-inf", "-inf"]),
        ] {
            assert_eq!([fixed(value, 1), signed(value, 1)], expected);
        }
        assert_eq!([fixed(-0.4, 0), fixed(-0.5001, 0)], ["0", "-1"]);
    }
}
