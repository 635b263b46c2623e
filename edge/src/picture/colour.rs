//! Conversion of a video's luma and chroma to RGB: ITU-R BT.601, BT.709 and BT.2020.

/// The weights of red, green and blue in luma.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ColourMatrix {
    /// BT.601. Also for videos without a stated matrix, as in ffmpeg.
    #[default]
    Bt601,
    /// BT.709, used by most HD videos.
    Bt709,
    /// BT.2020 with constant or non-constant luminance.
    Bt2020,
}

impl ColourMatrix {
    /// Parses the name in ffmpeg and ffprobe.
    pub fn parse(text: &str) -> Self {
        match text {
            "bt709" => Self::Bt709,
            "bt2020nc" | "bt2020c" => Self::Bt2020,
            _ => Self::Bt601,
        }
    }

    /// Weights of red and blue in luma.
    fn shares(self) -> [f32; 2] {
        match self {
            Self::Bt601 => [0.299, 0.114],
            Self::Bt709 => [0.2126, 0.0722],
            Self::Bt2020 => [0.2627, 0.0593],
        }
    }
}

/// Interpretation of a picture's values.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ColourCoding {
    /// The colour matrix.
    pub matrix: ColourMatrix,
    /// Whether black is 0 and white 255; else 16 and 235.
    pub is_full_range: bool,
}

impl ColourCoding {
    /// Black is 0 and white 255.
    pub const FULL_RANGE: Self = Self {
        matrix: ColourMatrix::Bt601,
        is_full_range: true,
    };

    /// Brightness (0 black to 255 white, and beyond) is (value - offset) x gain.
    pub(crate) fn brightness(self) -> [f32; 2] {
        if self.is_full_range {
            [0.0, 1.0]
        } else {
            [16.0, 255.0 / 219.0]
        }
    }

    pub(crate) fn to_rgb(self) -> YuvToRgb {
        let [red, blue] = self.matrix.shares();
        let green = 1.0 - red - blue;
        let [offset, gain] = self.brightness();
        let colour_gain = if self.is_full_range {
            1.0
        } else {
            255.0 / 224.0
        };
        YuvToRgb {
            offset,
            gain,
            red_of_v: 2.0 * (1.0 - red) * colour_gain,
            green_of_u: -2.0 * blue * (1.0 - blue) / green * colour_gain,
            green_of_v: -2.0 * red * (1.0 - red) / green * colour_gain,
            blue_of_u: 2.0 * (1.0 - blue) * colour_gain,
        }
    }
}

/// The coefficients of one coding.
#[derive(Debug, Clone, Copy)]
pub(crate) struct YuvToRgb {
    offset: f32,
    gain: f32,
    red_of_v: f32,
    green_of_u: f32,
    green_of_v: f32,
    blue_of_u: f32,
}

impl YuvToRgb {
    /// Red, green, blue, 0 to 255, from stored luma and chroma.
    #[inline]
    pub(crate) fn rgb(&self, y: f32, u: f32, v: f32) -> [f32; 3] {
        let y = (y - self.offset) * self.gain;
        let (u, v) = (u - 128.0, v - 128.0);
        let red = y + self.red_of_v * v;
        let green = y + self.green_of_u * u + self.green_of_v * v;
        let blue = y + self.blue_of_u * u;
        [
            red.clamp(0.0, 255.0),
            green.clamp(0.0, 255.0),
            blue.clamp(0.0, 255.0),
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rgb(matrix: ColourMatrix, is_full_range: bool, yuv: [f32; 3]) -> [i32; 3] {
        let coding = ColourCoding {
            matrix,
            is_full_range,
        };
        let [y, u, v] = yuv;
        coding.to_rgb().rgb(y, u, v).map(|it| it.round() as i32)
    }

    #[test]
    fn black_white_and_pure_colours_match_the_standards() {
        for matrix in [
            ColourMatrix::Bt601,
            ColourMatrix::Bt709,
            ColourMatrix::Bt2020,
        ] {
            assert_eq!(rgb(matrix, false, [16.0, 128.0, 128.0]), [0; 3]);
            assert_eq!(rgb(matrix, false, [235.0, 128.0, 128.0]), [255; 3]);
            assert_eq!(rgb(matrix, true, [0.0, 128.0, 128.0]), [0; 3]);
            assert_eq!(rgb(matrix, true, [255.0, 128.0, 128.0]), [255; 3]);
        }
        // Red at full strength: BT.601 and BT.709, limited range.
        let near = |found: [i32; 3], expected: [i32; 3]| {
            let apart = found.iter().zip(expected).map(|(a, b)| (a - b).abs());
            assert!(apart.max().unwrap() <= 1, "{found:?}, not {expected:?}");
        };
        near(
            rgb(ColourMatrix::Bt601, false, [81.0, 90.0, 240.0]),
            [254, 0, 0],
        );
        near(
            rgb(ColourMatrix::Bt709, false, [63.0, 102.0, 240.0]),
            [255, 0, 0],
        );
    }

    #[test]
    fn names_of_matrices_in_ffmpeg_are_known() {
        assert_eq!(ColourMatrix::parse("bt709"), ColourMatrix::Bt709);
        assert_eq!(ColourMatrix::parse("bt2020nc"), ColourMatrix::Bt2020);
        for other in ["smpte170m", "bt470bg", "unknown", ""] {
            assert_eq!(ColourMatrix::parse(other), ColourMatrix::Bt601);
        }
    }
}
