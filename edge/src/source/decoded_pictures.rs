//! The pictures that ffmpeg writes to its pipe, in the video's own coding if possible. YUV4MPEG2
//! has one header with size and layout; RGB videos come as binary PPM files with a size each.
//!
//! The decoded size is checked, with a phone's rotation applied. Two halves of pictures are never
//! joined, and a partial last picture is detected.

use std::io::{BufRead, Read as _};

use image::RgbImage;

use crate::picture::{BufferPool, ColourCoding, ColourMatrix, Picture, YuvLayout, YuvPicture};

/// Layouts that [`PictureReader`] reads, as ffmpeg's filter `format` takes them. ffmpeg converts
/// only other layouts.
pub(super) const YUV_FORMATS: &str =
    "format=pix_fmts=yuv420p|yuvj420p|yuv422p|yuvj422p|yuv444p|yuvj444p|gray";

/// Longest line of a header, bytes.
const MAX_LINE_BYTES: u64 = 256;

/// Why a picture could not be read from the pipe.
#[derive(Debug, PartialEq)]
pub(super) enum PictureError {
    /// The width and height differ from the expected ones.
    Size([u32; 2]),
    /// The data are no pictures.
    Foreign,
}

/// Reads pictures of one size.
pub(super) struct PictureReader<R> {
    reader: R,
    size_px: [u32; 2],
    /// The header of the stream, once read.
    stream: Option<YuvStream>,
    pool: BufferPool,
}

/// The common properties of all pictures of a stream.
#[derive(Debug, Clone, Copy, PartialEq)]
struct YuvStream {
    size_px: [u32; 2],
    layout: YuvLayout,
    is_full_range: bool,
}

impl<R: BufRead> PictureReader<R> {
    /// A reader of pictures with this size.
    pub(super) fn new(reader: R, size_px: [u32; 2]) -> Self {
        Self {
            reader,
            size_px,
            stream: None,
            pool: BufferPool::default(),
        }
    }

    /// The next picture, with its colours decoded by `matrix`. `None` at the end, also if the last
    /// picture is partial; a caller that counts frames then finds one too few.
    pub(super) fn next(&mut self, matrix: ColourMatrix) -> Result<Option<Picture>, PictureError> {
        let Some(mut line) = self.line() else {
            return Ok(None);
        };
        if line == "P6" {
            return self.ppm();
        }
        if self.stream.is_none() {
            let stream = YuvStream::parse(&line).ok_or(PictureError::Foreign)?;
            if stream.size_px != self.size_px {
                return Err(PictureError::Size(stream.size_px));
            }
            self.stream = Some(stream);
            match self.line() {
                Some(next) => line = next,
                None => return Ok(None),
            }
        }
        // Parameters may follow; ffmpeg writes none.
        let is_frame = line.split(' ').next() == Some("FRAME");
        let (Some(stream), true) = (self.stream, is_frame) else {
            return Err(PictureError::Foreign);
        };
        let n_bytes = stream.layout.n_bytes(stream.size_px);
        let bytes = self.pool.read(&mut self.reader, n_bytes);
        let coding = ColourCoding {
            matrix,
            is_full_range: stream.is_full_range,
        };
        let picture = YuvPicture::new(stream.size_px, stream.layout, coding, bytes);
        Ok(picture.map(Picture::Yuv))
    }

    /// Reads the rest of a PPM picture after its first line.
    fn ppm(&mut self) -> Result<Option<Picture>, PictureError> {
        let (Some(size), Some(depth)) = (self.line(), self.line()) else {
            return Ok(None);
        };
        let found_px = size
            .split_once(' ')
            .and_then(|(w, h)| Some([w.parse().ok()?, h.parse().ok()?]));
        let found_px = found_px.filter(|_| depth == "255");
        let found_px = found_px.ok_or(PictureError::Foreign)?;
        if found_px != self.size_px {
            return Err(PictureError::Size(found_px));
        }
        let [width, height] = self.size_px;
        let n_bytes = width as usize * height as usize * 3;
        let mut rgb = Vec::with_capacity(n_bytes);
        // A read error ends the pictures like the end of the pipe.
        let mut bytes = (&mut self.reader).take(n_bytes as u64);
        bytes.read_to_end(&mut rgb).ok();
        Ok(RgbImage::from_raw(width, height, rgb).map(Picture::Rgb))
    }

    /// A line of a header; `None` at the end of the pipe.
    fn line(&mut self) -> Option<String> {
        let mut line = Vec::new();
        let mut reader = (&mut self.reader).take(MAX_LINE_BYTES);
        let n = reader.read_until(b'\n', &mut line).ok()?;
        (n > 0).then(|| String::from_utf8_lossy(line.trim_ascii_end()).into_owned())
    }
}

impl YuvStream {
    /// Parses a header such as `YUV4MPEG2 W96 H64 F30:1 Ip A1:1 C420jpeg XYSCSS=420JPEG
    /// XCOLORRANGE=LIMITED`.
    fn parse(line: &str) -> Option<Self> {
        let mut words = line.split(' ');
        if words.next() != Some("YUV4MPEG2") {
            return None;
        }
        let mut size_px = [0, 0];
        // The defaults of a stream without these parameters.
        let mut layout = YuvLayout::Planar([2, 2]);
        let mut is_full_range = false;
        for word in words {
            match word.split_at_checked(1)? {
                ("W", width) => size_px[0] = width.parse().ok()?,
                ("H", height) => size_px[1] = height.parse().ok()?,
                ("C", "mono") => layout = YuvLayout::Grey,
                ("C", "420" | "420jpeg" | "420mpeg2" | "420paldv") => {
                    layout = YuvLayout::Planar([2, 2]);
                }
                ("C", "422") => layout = YuvLayout::Planar([2, 1]),
                ("C", "444") => layout = YuvLayout::Planar([1, 1]),
                ("C", _) => return None,
                ("X", "COLORRANGE=FULL") => is_full_range = true,
                _ => {}
            }
        }
        (!size_px.contains(&0)).then_some(Self {
            size_px,
            layout,
            is_full_range,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn all(bytes: &[u8]) -> Vec<Result<Option<Picture>, PictureError>> {
        let mut reader = PictureReader::new(bytes, [2, 1]);
        let mut found = Vec::new();
        while found.last().is_none_or(|it| matches!(it, Ok(Some(_)))) {
            found.push(reader.next(ColourMatrix::Bt709));
        }
        found
    }

    #[test]
    fn pictures_are_read_up_to_the_last_complete_one() {
        let found = all(b"P6\n2 1\n255\nabcdefP6\n2 1\n255\nghijklP6\n2 1\n255\nmno");
        let rgb = |bytes: &[u8; 6]| {
            let image = RgbImage::from_raw(2, 1, bytes.to_vec());
            Ok(image.map(Picture::Rgb))
        };
        assert_eq!(found, [rgb(b"abcdef"), rgb(b"ghijkl"), Ok(None)]);
        let found = all(
            b"YUV4MPEG2 W2 H1 F30:1 C420jpeg XCOLORRANGE=FULL\nFRAME\nyyuvFRAME\nYYUVFRAME\nyyu",
        );
        let yuv = |bytes: &[u8; 4]| {
            let coding = ColourCoding {
                matrix: ColourMatrix::Bt709,
                is_full_range: true,
            };
            let layout = YuvLayout::Planar([2, 2]);
            let picture = YuvPicture::new([2, 1], layout, coding, bytes.to_vec().into());
            Ok(picture.map(Picture::Yuv))
        };
        assert_eq!(found, [yuv(b"yyuv"), yuv(b"YYUV"), Ok(None)]);
        assert_eq!(all(b"YUV4MPEG2 W2 H1 Cmono\n"), [Ok(None)]);
    }

    #[test]
    fn another_size_or_other_bytes_are_refused() {
        let refused = |bytes: &[u8]| all(bytes).pop().unwrap().unwrap_err();
        let large = PictureError::Size([4_000_000_000; 2]);
        assert_eq!(refused(b"P6\n4000000000 4000000000\n255\n"), large);
        assert_eq!(
            refused(b"YUV4MPEG2 W4000000000 H4000000000\nFRAME\n"),
            large
        );
        for foreign in [
            &b"P6\n2\n255\nabcdef"[..],
            &[0; 1000],
            b"YUV4MPEG2 W2\nFRAME\nyyuv",
            b"YUV4MPEG2 W2 H1 C420p10\nFRAME\n",
            b"YUV4MPEG2 W2 H1\nFRAMEyyuv",
            b"YUV4MPEG2 W2 H1\nFRAME\nyyuvyyuv\n",
            b"FRAME\nyyuv",
        ] {
            assert_eq!(refused(foreign), PictureError::Foreign, "{foreign:?}");
        }
    }

    #[test]
    fn layouts_are_read_from_the_header() {
        let of = |text: &str| {
            let line = format!("YUV4MPEG2 W4 H2 F5:1 Ip A1:1 {text}");
            YuvStream::parse(&line).map(|it| (it.layout, it.is_full_range))
        };
        assert_eq!(of("Cmono"), Some((YuvLayout::Grey, false)));
        let planar = |px, full| Some((YuvLayout::Planar(px), full));
        assert_eq!(
            of("C420mpeg2 XYSCSS=420MPEG2 XCOLORRANGE=LIMITED"),
            planar([2, 2], false)
        );
        assert_eq!(of("C422 XCOLORRANGE=FULL"), planar([2, 1], true));
        assert_eq!(of("C444"), planar([1, 1], false));
        assert_eq!(of("C411"), None);
    }
}
