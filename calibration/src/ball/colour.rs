//! Colours by hue, saturation and value, and a lookup table of a range of them.

use std::str::FromStr;

/// A range of colours. Source of hue, saturation and value: Smith 1978, "Color gamut transform pairs", on sRGB bytes without
/// linearisation, as in picture editors.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ColourRange {
    /// From and to, degrees, 0 to 360; if `from` is larger the range goes through red: `[350, 20]`.
    pub hue_deg: [f64; 2],
    /// Least and most, 0 (grey) to 1.
    pub saturation: [f64; 2],
    /// Least and most, 0 (black) to 1.
    pub value: [f64; 2],
}

/// Range of hue to either side of a given colour, degrees.
const HUE_ABOUT_DEG: f64 = 16.0;
/// Least saturation, share of that of the given colour.
const LEAST_SATURATION: f64 = 0.55;
/// Least value, share of that of the given colour.
const LEAST_VALUE: f64 = 0.35;
/// Saturation below which a colour is white or grey, and its hue is noise.
const GREY: f64 = 0.2;
/// Greatest saturation of a white or grey ball.
const MOST_GREY: f64 = 0.3;
/// Least saturation of a strong colour: skin and wood are below it.
const SATURATED: f64 = 0.55;
/// Least value of a strong colour.
const NOT_DARK: f64 = 0.25;

/// Levels of a channel in the table: its 32 KiB stay in the first-level cache.
const LEVELS: usize = 32;
const SHIFT: u32 = 3;

impl ColourRange {
    /// The colours of a ball of colour `rgb` in light and shade: hue within 16 degrees, at least 0.55 of its saturation and 0.35
    /// of its value. For white and grey (saturation below 0.2): any hue, saturation up to 0.3.
    pub fn about(rgb: [u8; 3]) -> Self {
        let [hue, saturation, value] = hsv(rgb);
        if saturation < GREY {
            return Self {
                hue_deg: [0.0, 360.0],
                saturation: [0.0, MOST_GREY],
                value: [LEAST_VALUE * value, 1.0],
            };
        }
        let turn = |deg: f64| if deg < 0.0 { deg + 360.0 } else { deg % 360.0 };
        Self {
            hue_deg: [turn(hue - HUE_ABOUT_DEG), turn(hue + HUE_ABOUT_DEG)],
            saturation: [LEAST_SATURATION * saturation, 1.0],
            value: [LEAST_VALUE * value, 1.0],
        }
    }

    /// Any strong colour: for a first pass when the ball's colour is unknown.
    pub fn saturated() -> Self {
        Self {
            hue_deg: [0.0, 360.0],
            saturation: [SATURATED, 1.0],
            value: [NOT_DARK, 1.0],
        }
    }

    /// True if `rgb` is in the range.
    pub fn contains(&self, rgb: [u8; 3]) -> bool {
        let [hue, saturation, value] = hsv(rgb);
        let [from, to] = self.hue_deg;
        let has_hue = if from <= to {
            (from..=to).contains(&hue)
        } else {
            hue >= from || hue <= to
        };
        has_hue
            && (self.saturation[0]..=self.saturation[1]).contains(&saturation)
            && (self.value[0]..=self.value[1]).contains(&value)
    }

    /// True if all numbers are within their limits and in order.
    pub(super) fn is_sound(&self) -> bool {
        let is_range = |[low, high]: [f64; 2], most: f64| low >= 0.0 && low <= high && high <= most;
        let hues = self.hue_deg.iter().all(|h| (0.0..=360.0).contains(h));
        hues && is_range(self.saturation, 1.0) && is_range(self.value, 1.0)
    }
}

/// Parses `#rrggbb` with similar colours ([`ColourRange::about`]), or `HUE-HUE,SAT-SAT,VALUE-VALUE` in degrees and percent,
/// for example `20-45,60-100,30-100`.
impl FromStr for ColourRange {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || {
            format!(
                "found `{text}`, expected a colour as #rrggbb, or ranges of hue (degrees), saturation and value (percent) as \
                 20-45,60-100,30-100"
            )
        };
        if let Some(digits) = text.trim().strip_prefix('#') {
            let is_hex = digits.len() == 6 && digits.bytes().all(|b| b.is_ascii_hexdigit());
            let number = u32::from_str_radix(digits, 16).ok().filter(|_| is_hex);
            let [_, r, g, b] = number.ok_or_else(wrong)?.to_be_bytes();
            return Ok(Self::about([r, g, b]));
        }
        let ranges: Option<Vec<[f64; 2]>> = text
            .split(',')
            .map(|range| {
                let (low, high) = range.split_once('-')?;
                Some([low.trim().parse().ok()?, high.trim().parse().ok()?])
            })
            .collect();
        let percent = |range: [f64; 2]| range.map(|v| v / 100.0);
        match ranges.as_deref() {
            Some([hue_deg, saturation, value]) => Some(Self {
                hue_deg: *hue_deg,
                saturation: percent(*saturation),
                value: percent(*value),
            })
            .filter(Self::is_sound)
            .ok_or_else(wrong),
            _ => Err(wrong()),
        }
    }
}

/// Hue (degrees, 0 to 360; 0 for greys), saturation and value (0 to 1) of an sRGB colour.
pub fn hsv(rgb: [u8; 3]) -> [f64; 3] {
    let [r, g, b] = rgb.map(f64::from);
    let most = r.max(g).max(b);
    let range = most - r.min(g).min(b);
    if range <= 0.0 {
        return [0.0, 0.0, most / 255.0];
    }
    // The compared numbers are copies, so that equality is exact.
    let sixth = if r >= most {
        (g - b) / range
    } else if g >= most {
        2.0 + (b - r) / range
    } else {
        4.0 + (r - g) / range
    };
    let turned = if sixth < 0.0 { sixth + 6.0 } else { sixth };
    [60.0 * turned, range / most, most / 255.0]
}

/// Lookup table of a range, by the upper five bits of each channel.
#[derive(Debug, Clone)]
pub(super) struct ColourTable {
    is_in: Vec<bool>,
}

impl ColourTable {
    pub(super) fn new(range: &ColourRange) -> Self {
        let level = |index: usize| ((index << SHIFT) + (1 << (SHIFT - 1))) as u8;
        let colours = (0..LEVELS * LEVELS * LEVELS).map(|index| {
            [
                level(index / (LEVELS * LEVELS)),
                level(index / LEVELS % LEVELS),
                level(index % LEVELS),
            ]
        });
        Self {
            is_in: colours.map(|rgb| range.contains(rgb)).collect(),
        }
    }

    pub(super) fn contains(&self, r: u8, g: u8, b: u8) -> bool {
        let [r, g, b] = [r, g, b].map(|c| usize::from(c >> SHIFT));
        let index = (r * LEVELS + g) * LEVELS + b;
        self.is_in.get(index).copied().unwrap_or(false)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hues_are_those_of_the_colour_wheel() {
        for (rgb, expected) in [
            ([255, 0, 0], [0.0, 1.0, 1.0]),
            ([0, 255, 0], [120.0, 1.0, 1.0]),
            ([0, 0, 255], [240.0, 1.0, 1.0]),
            ([255, 0, 255], [300.0, 1.0, 1.0]),
            ([255, 128, 0], [30.12, 1.0, 1.0]),
            ([51, 51, 51], [0.0, 0.0, 0.2]),
        ] {
            let found = hsv(rgb);
            for (a, b) in found.into_iter().zip(expected) {
                assert!((a - b).abs() < 0.01, "{rgb:?}: {found:?}");
            }
        }
    }

    #[test]
    fn a_range_may_go_through_red() {
        let red = ColourRange::about([230, 10, 20]);
        assert!(red.hue_deg[0] > red.hue_deg[1]);
        assert!(red.contains([230, 10, 20]) && red.contains([120, 5, 5]));
        assert!(!red.contains([230, 120, 20]) && !red.contains([120, 110, 115]));
        let table = ColourTable::new(&red);
        assert!(table.contains(230, 10, 20) && !table.contains(20, 10, 230));
    }

    #[test]
    fn a_white_ball_is_white_in_any_light() {
        let white = ColourRange::about([240, 238, 230]);
        for like in [
            [255, 255, 255],
            [200, 205, 215],
            [190, 180, 160],
            [110, 112, 110],
        ] {
            assert!(white.contains(like), "{like:?}");
        }
        for other in [[240, 120, 20], [230, 220, 40], [40, 120, 60], [20, 20, 20]] {
            assert!(!white.contains(other), "{other:?}");
        }
    }

    #[test]
    fn ranges_are_parsed_or_rejected() {
        let read: ColourRange = "20-45,60-100,30-100".parse().unwrap();
        assert!((read.hue_deg[1] - 45.0).abs() < 1e-12 && (read.saturation[0] - 0.6).abs() < 1e-12);
        assert_eq!("#ff8000".parse(), Ok(ColourRange::about([255, 128, 0])));
        for wrong in [
            "",
            "#ff80",
            "#+f8000",
            "20-45",
            "20-45,60-110,0-1",
            "a-b,1-2,3-4",
            "nan-3,1-2,3-4",
        ] {
            let error = wrong.parse::<ColourRange>().unwrap_err();
            assert!(error.contains("expected a colour as #rrggbb"), "{error}");
        }
    }
}
