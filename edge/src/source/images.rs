//! Image sequences: `dir/%06d.png`, PNG or JPEG.
//!
//! The pattern is that of ffmpeg's `image2`: one `%d` or `%0Nd` in the file name. The lowest number
//! found is the first frame and gets the venue's `first_tick`. The numbers must have no gaps.
//! Orientation tags (EXIF) are ignored, as calibration tools do.

use std::io;
use std::ops::Range;
use std::path::{Path, PathBuf};

use farfield_proto::tick::Tick;
use image::{ImageReader, RgbImage};

use super::queue::{Prefetch, Sender, WhenFull};
use super::{ExpectedSource, Frame, FrameContent, FrameSource, SourceError, SourceInfo};

/// Largest zero padding: more digits do not fit 64 bits.
const MAX_DIGITS: usize = 19;

pub(super) fn probe(path: &Path, expected: &ExpectedSource) -> Result<SourceInfo, SourceError> {
    let (pattern, numbers) = find(path, expected)?;
    for number in numbers.clone() {
        let path = pattern.file(number);
        let size = reader(&path).and_then(|found| found.into_dimensions().map_err(decode_problem));
        let (width, height) = size.map_err(|problem| unreadable(expected, &path, &problem))?;
        at_file(expected, &path).check_size([width, height])?;
    }
    Ok(SourceInfo {
        ticks: Some(expected.ticks(numbers.end - numbers.start)?),
        size_px: Some(expected.size_px),
        ..SourceInfo::default()
    })
}

pub(super) fn open(
    path: &Path,
    expected: ExpectedSource,
    from: Tick,
) -> Result<ImageSource, SourceError> {
    let (pattern, numbers) = find(path, &expected)?;
    let skip = expected.skip(&expected.ticks(numbers.end - numbers.start)?, from)?;
    let numbers = numbers.start + skip..numbers.end;
    let frames = numbers.end - numbers.start;
    let at = expected.at.clone();
    let prefetch = Prefetch::spawn(WhenFull::Wait, move |sender| {
        decode_all(&pattern, numbers, from, &expected, &sender);
    })
    .map_err(|problem| SourceError::Unreadable {
        at: at.clone(),
        problem: problem.to_string(),
    })?;
    Ok(ImageSource {
        prefetch,
        at,
        frames,
        read: 0,
        failed: false,
    })
}

/// Reads an image sequence tick by tick.
#[derive(Debug)]
pub(super) struct ImageSource {
    prefetch: Prefetch,
    at: super::SourceOrigin,
    frames: u64,
    read: u64,
    failed: bool,
}

impl FrameSource for ImageSource {
    fn next_frame(&mut self) -> Result<Option<Frame>, SourceError> {
        match self.prefetch.pop() {
            Some(frame) => {
                self.read += 1;
                self.failed |= frame.is_err();
                frame.map(Some)
            }
            None if self.read == self.frames || self.failed => Ok(None),
            None => Err(SourceError::Ended {
                at: self.at.clone(),
                read: self.read,
                expected: Some(self.frames),
                tool_output: String::new(),
            }),
        }
    }
}

fn decode_all(
    pattern: &FilePattern,
    numbers: Range<u64>,
    from: Tick,
    expected: &ExpectedSource,
    sender: &Sender,
) {
    for (number, tick) in numbers.zip(from.0..) {
        let frame = decode(&pattern.file(number), expected).map(|image| Frame {
            tick: Tick(tick),
            capture_offset_us: 0,
            content: FrameContent::Image(image.into()),
        });
        let failed = frame.is_err();
        if !sender.push(frame) || failed {
            return;
        }
    }
}

fn decode(path: &Path, expected: &ExpectedSource) -> Result<RgbImage, SourceError> {
    let image = reader(path)
        .and_then(|found| found.decode().map_err(decode_problem))
        .map_err(|problem| unreadable(expected, path, &problem))?
        .into_rgb8();
    at_file(expected, path).check_size([image.width(), image.height()])?;
    Ok(image)
}

fn reader(path: &Path) -> io::Result<ImageReader<io::BufReader<std::fs::File>>> {
    ImageReader::open(path)?.with_guessed_format()
}

fn decode_problem(problem: image::ImageError) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, problem)
}

fn at_file(expected: &ExpectedSource, path: &Path) -> ExpectedSource {
    let mut expected = expected.clone();
    expected.at.place = path.display().to_string();
    expected
}

fn unreadable(expected: &ExpectedSource, path: &Path, problem: &io::Error) -> SourceError {
    SourceError::Unreadable {
        at: at_file(expected, path).at,
        problem: problem.to_string(),
    }
}

/// The pattern and the range of numbers found for it.
fn find(path: &Path, expected: &ExpectedSource) -> Result<(FilePattern, Range<u64>), SourceError> {
    let wrong = |problem: String| SourceError::Pattern {
        at: expected.at.clone(),
        problem,
    };
    let pattern = FilePattern::parse(path).map_err(wrong)?;
    let mut numbers = pattern.numbers().map_err(|problem| SourceError::NotThere {
        at: expected.at.clone(),
        problem: format!("{}: {problem}", pattern.folder.display()),
    })?;
    numbers.sort_unstable();
    if let Some(pair) = numbers.windows(2).find(|pair| pair[1] - pair[0] > 1) {
        let (before, after) = (pair[0], pair[1]);
        return Err(SourceError::Gap {
            at: expected.at.clone(),
            before,
            after,
        });
    }
    match (numbers.first(), numbers.last()) {
        (Some(&first), Some(&last)) => Ok((pattern, first..last + 1)),
        _ => Err(wrong("no file fits the pattern".to_owned())),
    }
}

/// `folder/prefix%0Ndsuffix`.
#[derive(Debug, PartialEq)]
struct FilePattern {
    folder: PathBuf,
    prefix: String,
    digits: usize,
    suffix: String,
}

impl FilePattern {
    fn parse(path: &Path) -> Result<Self, String> {
        let name = path
            .file_name()
            .and_then(|name| name.to_str())
            .unwrap_or_default();
        let expected = "expected a file name with one number, such as `%06d.png`";
        let (prefix, rest) = name
            .split_once('%')
            .ok_or_else(|| format!("found `{name}`, {expected}"))?;
        let (digits, suffix) = rest
            .split_once('d')
            .ok_or_else(|| format!("found `{name}`, {expected}"))?;
        let digits = match digits.strip_prefix('0') {
            None if digits.is_empty() => Some(1),
            None => None,
            Some(n) => n.parse().ok().filter(|n| (1..=MAX_DIGITS).contains(n)),
        };
        match digits {
            Some(digits) if !suffix.contains('%') => Ok(Self {
                folder: path.parent().map(Path::to_owned).unwrap_or_default(),
                prefix: prefix.to_owned(),
                digits,
                suffix: suffix.to_owned(),
            }),
            _ => Err(format!("found `{name}`, {expected}")),
        }
    }

    fn name(&self, number: u64) -> String {
        format!(
            "{}{number:0width$}{}",
            self.prefix,
            self.suffix,
            width = self.digits
        )
    }

    fn file(&self, number: u64) -> PathBuf {
        self.folder.join(self.name(number))
    }

    /// The numbers of the files that match the pattern, in no order.
    fn numbers(&self) -> io::Result<Vec<u64>> {
        let here = Path::new(".");
        let folder = if self.folder.as_os_str().is_empty() {
            here
        } else {
            &self.folder
        };
        let mut numbers = Vec::new();
        for entry in std::fs::read_dir(folder)? {
            let name = entry?.file_name();
            let number = name
                .to_str()
                .and_then(|name| name.strip_prefix(&self.prefix)?.strip_suffix(&self.suffix))
                .filter(|digits| digits.bytes().all(|b| b.is_ascii_digit()))
                .and_then(|digits| digits.parse::<u64>().ok())
                // The end of a range is one after the last number.
                .filter(|&number| number < u64::MAX && *self.name(number) == *name);
            numbers.extend(number);
        }
        Ok(numbers)
    }
}

#[cfg(test)]
mod tests {
    use farfield_proto::venue::TickFrom;

    use super::super::SourceOrigin;
    use super::*;

    fn expected(size_px: [u32; 2]) -> ExpectedSource {
        ExpectedSource {
            at: SourceOrigin {
                camera: "left".to_owned(),
                place: "seq/%04d.png".to_owned(),
            },
            size_px,
            rate_hz: 60.0,
            first_tick: Tick(10),
            keypoints: 17,
            tick_from: TickFrom::Clock,
        }
    }

    /// A folder with one picture per number; the first byte of each picture is its number.
    fn folder(numbers: &[u8], pattern: impl Fn(u8) -> String) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        for &number in numbers {
            let image = RgbImage::from_pixel(8, 6, image::Rgb([number, 1, 2]));
            image.save(folder.path().join(pattern(number))).unwrap();
        }
        folder
    }

    fn shades(source: &mut impl FrameSource) -> Vec<(i64, u8)> {
        std::iter::from_fn(|| source.next_frame().unwrap())
            .map(|frame| match frame.content {
                FrameContent::Image(picture) => {
                    (frame.tick.0, picture.into_rgb().get_pixel(0, 0)[0])
                }
                FrameContent::Keypoints(_) | FrameContent::Painted(_) => {
                    panic!("an image was asked for")
                }
            })
            .collect()
    }

    #[test]
    fn the_lowest_number_is_the_first_tick() {
        let folder = folder(&[7, 8, 9], |n| format!("{n:04}.png"));
        std::fs::write(folder.path().join("notes.txt"), "no image").unwrap();
        let path = folder.path().join("%04d.png");
        let info = probe(&path, &expected([8, 6])).unwrap();
        assert_eq!(info.ticks, Some(Tick(10)..Tick(13)));
        let mut source = open(&path, expected([8, 6]), Tick(10)).unwrap();
        assert_eq!(shades(&mut source), [(10, 7), (11, 8), (12, 9)]);
        let mut source = open(&path, expected([8, 6]), Tick(12)).unwrap();
        assert_eq!(shades(&mut source), [(12, 9)]);
    }

    #[test]
    fn unpadded_numbers_are_in_numeric_order() {
        let folder = folder(&[9, 10, 11], |n| format!("f{n}.png"));
        let mut source = open(&folder.path().join("f%d.png"), expected([8, 6]), Tick(10)).unwrap();
        assert_eq!(shades(&mut source), [(10, 9), (11, 10), (12, 11)]);
    }

    #[test]
    fn a_jpeg_sequence_is_read() {
        let folder = folder(&[0, 1], |n| format!("{n}.jpg"));
        let mut source = open(&folder.path().join("%d.jpg"), expected([8, 6]), Tick(10)).unwrap();
        assert_eq!(shades(&mut source).len(), 2);
    }

    #[test]
    fn a_gap_is_reported_with_both_numbers() {
        let folder = folder(&[1, 2, 5], |n| format!("{n:04}.png"));
        let error = probe(&folder.path().join("%04d.png"), &expected([8, 6])).unwrap_err();
        let is_gap = matches!(
            error,
            SourceError::Gap {
                before: 2,
                after: 5,
                ..
            }
        );
        assert!(is_gap, "{error}");
    }

    #[test]
    fn a_picture_of_another_size_is_refused_by_name() {
        let folder = folder(&[1, 2], |n| format!("{n:04}.png"));
        RgbImage::new(6, 8)
            .save(folder.path().join("0002.png"))
            .unwrap();
        let error = probe(&folder.path().join("%04d.png"), &expected([8, 6])).unwrap_err();
        let SourceError::PixelSize {
            at,
            found_px,
            expected_px,
        } = error
        else {
            panic!("{error}")
        };
        assert!(at.place.ends_with("0002.png"), "{at}");
        assert_eq!((found_px, expected_px), ([6, 8], [8, 6]));
    }

    #[test]
    fn a_damaged_picture_ends_the_source_with_its_name() {
        let folder = folder(&[1, 2, 3], |n| format!("{n:04}.png"));
        let path = folder.path().join("0002.png");
        let bytes = std::fs::read(&path).unwrap();
        std::fs::write(&path, &bytes[..bytes.len() / 2]).unwrap();
        let mut source = open(&folder.path().join("%04d.png"), expected([8, 6]), Tick(10)).unwrap();
        assert!(source.next_frame().unwrap().is_some());
        let error = source.next_frame().unwrap_err().to_string();
        assert!(error.contains("0002.png"), "{error}");
        assert_eq!(source.next_frame(), Ok(None));
    }

    #[test]
    fn only_one_plain_number_makes_a_pattern() {
        for wrong in [
            "a.png",
            "%x.png",
            "%0d.png",
            "%6d.png",
            "%d_%d.png",
            "%020d.png",
            "%06",
            "",
        ] {
            assert!(FilePattern::parse(Path::new(wrong)).is_err(), "{wrong}");
        }
        let pattern = FilePattern::parse(Path::new("dir/f_%03d_x.png")).unwrap();
        assert_eq!(pattern.file(7), Path::new("dir/f_007_x.png"));
        assert_eq!(pattern.file(1234), Path::new("dir/f_1234_x.png"));
    }

    #[test]
    fn a_folder_that_is_absent_or_empty_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        assert!(matches!(
            probe(&folder.path().join("none/%d.png"), &expected([8, 6])),
            Err(SourceError::NotThere { .. })
        ));
        assert!(matches!(
            probe(&folder.path().join("%d.png"), &expected([8, 6])),
            Err(SourceError::Pattern { .. })
        ));
    }
}
