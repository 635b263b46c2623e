//! Storage format of a video's pictures: fields, dynamic range, pixel shape and rotation. It
//! determines the filters for reading and the remarks for the operator.

use farfield_proto::finding::{Advice, Severity};

use crate::picture::ColourMatrix;

/// Pixels whose aspect differs from 1 by more than this are not square; containers round.
const SQUARE: f64 = 0.01;
/// Tolerance for rotations by whole quarters, degrees.
const QUARTER_OFF_DEG: f64 = 1.0;
/// Paper white of HDR pictures, candela per square metre (ITU-R BT.2408, 2.1). It becomes white.
const WHITE_NITS: u32 = 203;

/// The field of an interlaced picture that was captured first.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FieldOrder {
    /// Lines 1, 3, 5 and so on.
    TopFirst,
    /// Lines 2, 4, 6 and so on.
    BottomFirst,
}

impl FieldOrder {
    /// Parses ffprobe's name by the field that is shown first; `None` for progressive pictures and
    /// if unknown.
    pub fn parse(text: &str) -> Option<Self> {
        match text {
            "tt" | "bt" => Some(Self::TopFirst),
            "bb" | "tb" => Some(Self::BottomFirst),
            _ => None,
        }
    }
}

/// Transfer function of high dynamic range. Without conversion such pictures are pale.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum HdrTransfer {
    /// Hybrid log-gamma, used by phones and broadcasters.
    Hlg,
    /// Perceptual quantiser: HDR10, Dolby Vision.
    Pq,
}

impl HdrTransfer {
    /// ffmpeg's name.
    fn name(self) -> &'static str {
        match self {
            Self::Hlg => "arib-std-b67",
            Self::Pq => "smpte2084",
        }
    }

    /// Parses ffmpeg's name; `None` for other transfer functions.
    pub fn parse(text: &str) -> Option<Self> {
        [Self::Hlg, Self::Pq]
            .into_iter()
            .find(|it| it.name() == text)
    }

    /// The filters that convert it to standard dynamic range.
    fn tone_map(self) -> String {
        format!(
            "zscale=tin={}:pin=bt2020:min=bt2020nc:t=linear:npl={WHITE_NITS},format=gbrpf32le,zscale=p=bt709,\
             tonemap=mobius:desat=0,zscale=t=bt709:m=bt709:r=tv,format=yuv420p",
            self.name()
        )
    }
}

/// Storage format of a video's pictures. The default needs no remark: progressive, standard dynamic
/// range, square pixels.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct VideoFormat {
    /// For interlaced pictures.
    pub field_order: Option<FieldOrder>,
    /// For pictures of high dynamic range.
    pub hdr: Option<HdrTransfer>,
    /// Whether ffmpeg has the filter to convert high dynamic range.
    pub can_tone_map: bool,
    /// Width to height of a pixel, if not square.
    pub pixel_aspect: Option<[u32; 2]>,
    /// Rotation applied in decoding, degrees.
    pub rotation_deg: f64,
    /// Whether the pictures are RGB.
    pub is_rgb: bool,
    /// The colour matrix of other pictures.
    pub matrix: ColourMatrix,
}

impl VideoFormat {
    /// Parses ffprobe's pixel aspect, such as `4:3`; `None` for square pixels and if unknown.
    pub fn parse_aspect(text: &str) -> Option<[u32; 2]> {
        let (width, height) = text.split_once(':')?;
        let aspect: [u32; 2] = [width.parse().ok()?, height.parse().ok()?];
        let ratio = f64::from(aspect[0]) / f64::from(aspect[1]);
        (ratio.is_finite() && ratio > 0.0 && (ratio - 1.0).abs() > SQUARE).then_some(aspect)
    }

    /// Whether ffmpeg's pixel format `pixels` is RGB.
    pub fn parse_rgb(pixels: &str) -> bool {
        let names = ["rgb", "bgr", "gbr", "pal8", "bayer"];
        names.iter().any(|name| pixels.contains(name))
    }

    /// The colour matrix after [`Self::filters`].
    pub fn matrix_read(&self) -> ColourMatrix {
        match self.tone_map() {
            Some(_) => ColourMatrix::Bt709,
            None => self.matrix,
        }
    }

    fn tone_map(&self) -> Option<String> {
        self.hdr
            .filter(|_| self.can_tone_map)
            .map(HdrTransfer::tone_map)
    }

    /// Remarks for the operator on pictures stored at `rate_hz`.
    pub fn remarks(&self, rate_hz: Option<f64>) -> Vec<Advice> {
        let each = [
            self.fields_remark(rate_hz),
            self.hdr_remark(),
            self.pixels_remark(),
            self.turn_remark(),
        ];
        each.into_iter().flatten().collect()
    }

    fn fields_remark(&self, rate_hz: Option<f64>) -> Option<Advice> {
        let first = match self.field_order? {
            FieldOrder::TopFirst => "top",
            FieldOrder::BottomFirst => "bottom",
        };
        let (read, fields) = match rate_hz.map(rounded) {
            Some(hz) => (
                format!("{} fields a second, read as {hz} pictures", 2.0 * hz),
                format!("{}", 2.0 * hz),
            ),
            None => (
                "two fields a picture, read as one".to_owned(),
                "the rate of the fields".to_owned(),
            ),
        };
        Some(Advice {
            problem: format!("is interlaced, {first} field first: {read}"),
            remedy: format!(
                "to use every field: `ffmpeg -i IN -vf bwdif=mode=send_field OUT` for all cameras, and `rate_hz` = {fields}"
            ),
            severity: Severity::Doubtful,
        })
    }

    fn hdr_remark(&self) -> Option<Advice> {
        let hdr = self.hdr?;
        let name = match hdr {
            HdrTransfer::Hlg => "HLG",
            HdrTransfer::Pq => "PQ",
        };
        let command = format!("`ffmpeg -i IN -vf {} OUT`", hdr.tone_map());
        let (read, remedy) = if self.can_tone_map {
            (
                "tone-mapped as it is read",
                format!("to read it faster: {command}"),
            )
        } else {
            (
                "read as it is, so pale, because this ffmpeg has no filter `zscale`",
                format!("with an ffmpeg that has it: {command}"),
            )
        };
        Some(Advice {
            problem: format!("has high dynamic range ({name}): {read}"),
            remedy,
            severity: if self.can_tone_map {
                Severity::Note
            } else {
                Severity::Doubtful
            },
        })
    }

    fn pixels_remark(&self) -> Option<Advice> {
        let [width, height] = self.pixel_aspect?;
        Some(Advice {
            problem: format!(
                "has pixels that are not square, {width} wide to {height} high: read as they are stored"
            ),
            remedy: "calibrate with pictures that are stored alike; square pixels: \
                     `ffmpeg -i IN -vf scale=iw*sar:ih,setsar=1 OUT`"
                .to_owned(),
            severity: Severity::Note,
        })
    }

    /// A quarter turn shows in the size; half a turn shows nowhere.
    fn turn_remark(&self) -> Option<Advice> {
        let turned_deg = self.rotation_deg.rem_euclid(360.0);
        let off_deg = (turned_deg / 90.0 - (turned_deg / 90.0).round()).abs() * 90.0;
        let by = if (turned_deg - 180.0).abs() < QUARTER_OFF_DEG {
            "half a turn".to_owned()
        } else if off_deg > QUARTER_OFF_DEG {
            format!("{turned_deg:.0} degrees")
        } else {
            return None;
        };
        Some(Advice {
            problem: format!("is turned by {by} when it is read, by its rotation tag"),
            remedy: "check the picture: if it is upside down, remove the tag (`ffmpeg -i IN -c copy -metadata:s:v rotate=0 OUT`, \
                     from ffmpeg 6 on `ffmpeg -display_rotation 0 -i IN -c copy OUT`); calibrate with pictures that are \
                     turned alike"
                .to_owned(),
            severity: Severity::Doubtful,
        })
    }

    /// The filters before and after frames are counted. Deinterlacing needs the neighbouring
    /// frames; the other filters need one frame.
    pub fn filters(&self) -> [Option<String>; 2] {
        // Half a turn is applied first and exchanges odd and even lines.
        let is_upside_down = (self.rotation_deg.rem_euclid(360.0) - 180.0).abs() < QUARTER_OFF_DEG;
        let whole = self.field_order.map(|first| {
            let is_top = (first == FieldOrder::TopFirst) != is_upside_down;
            let parity = if is_top { "tff" } else { "bff" };
            format!("bwdif=mode=send_frame:parity={parity}")
        });
        [whole, self.tone_map()]
    }
}

/// A rate with at most three decimals.
fn rounded(rate_hz: f64) -> f64 {
    (rate_hz * 1000.0).round() / 1000.0
}

#[cfg(test)]
mod tests {
    use super::*;

    fn remarks_of(format: VideoFormat) -> Vec<(String, bool)> {
        let remarks = format.remarks(Some(25.0)).into_iter();
        remarks
            .map(|it| {
                (
                    format!("{}; {}", it.problem, it.remedy),
                    it.severity == Severity::Doubtful,
                )
            })
            .collect()
    }

    #[test]
    fn ordinary_pictures_need_no_remark_and_no_filter() {
        for rotation_deg in [0.0, 90.0, -90.0, 270.0, 360.0] {
            let format = VideoFormat {
                rotation_deg,
                ..VideoFormat::default()
            };
            assert_eq!(remarks_of(format), []);
            assert_eq!(format.filters(), [None, None]);
        }
        for text in ["1:1", "0:1", "N/A", "", "1215:1216", "1:0"] {
            assert_eq!(VideoFormat::parse_aspect(text), None, "{text}");
        }
        assert_eq!(VideoFormat::parse_aspect("4:3"), Some([4, 3]));
    }

    #[test]
    fn half_a_turn_swaps_the_order_of_fields() {
        let parity = |order: &str, rotation_deg: f64| {
            let format = VideoFormat {
                field_order: FieldOrder::parse(order),
                rotation_deg,
                ..VideoFormat::default()
            };
            let [whole, _] = format.filters();
            whole.map(|it| it[it.len() - 3..].to_owned())
        };
        let words = |word: &str| Some(word.to_owned());
        assert_eq!(parity("tt", 0.0), words("tff"));
        assert_eq!(parity("bt", 0.0), words("tff"));
        assert_eq!(parity("tb", 0.0), words("bff"));
        assert_eq!(parity("tt", -180.0), words("bff"));
        assert_eq!(parity("progressive", 0.0), None);
        assert_eq!(parity("unknown", 0.0), None);
    }

    #[test]
    fn each_property_is_reported_with_its_treatment() {
        let mut format = VideoFormat {
            field_order: Some(FieldOrder::TopFirst),
            ..VideoFormat::default()
        };
        let (words, is_warning) = remarks_of(format).remove(0);
        assert!(
            is_warning
                && words
                    .starts_with("is interlaced, top field first: 50 fields a second, read as 25")
                && words.ends_with("`rate_hz` = 50"),
            "{words}"
        );
        format = VideoFormat {
            hdr: HdrTransfer::parse("arib-std-b67"),
            pixel_aspect: Some([4, 3]),
            rotation_deg: 180.0,
            ..VideoFormat::default()
        };
        let remarks = remarks_of(format);
        for ((words, is_warning), (start, warns)) in remarks.iter().zip([
            ("has high dynamic range (HLG): read as it is", true),
            ("has pixels that are not square, 4 wide to 3 high", false),
            ("is turned by half a turn", true),
        ]) {
            assert!(words.starts_with(start) && *is_warning == warns, "{words}");
        }
        assert_eq!((remarks.len(), format.filters()), (3, [None, None]));
        format.can_tone_map = true;
        let (words, is_warning) = remarks_of(format).remove(0);
        let [_, filter] = format.filters();
        assert!(!is_warning && words.contains(&filter.unwrap()), "{words}");
    }
}
