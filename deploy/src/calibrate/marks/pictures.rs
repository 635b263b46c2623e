//! One still image per camera, as captured. It is decoded here, because browsers treat tags and colours differently.
//! Videos are turned as in their containers, everywhere in Farfield. An image that is tagged as turned is refused: the
//! orientation of the camera's other images is unknown.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, anyhow, bail, ensure};
use farfield_calibration::adjustment::CameraState;
use farfield_calibration::alignment::ClickedFile;
use farfield_edge::picture::Picture;
use farfield_edge::source::{FrameContent, open_video_alone};
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::metadata::Orientation;
use image::{DynamicImage, ImageDecoder as _, ImageEncoder as _, ImageReader, Limits, RgbImage};

use crate::calibrate::board::sharpness;
use crate::calibrate::lenses::Lens;
use crate::init::recordings;
use crate::init::recordings::{entries, is_image, is_video};
use crate::recording_checks::print_format;

/// Limit for the cameras: their images are in memory.
const MOST_PICTURES: usize = 64;
/// Longest side of an image, pixels.
const LONGEST_SIDE_PX: u32 = 16_384;
/// Memory limit for decoding an image, bytes.
const MOST_BYTES: u64 = 1 << 30;
/// Span of a video in which the sharpest image is searched, seconds.
const SEARCHED_S: f64 = 1.0;
/// Latest start in a video, seconds.
const LATEST_S: f64 = 86_400.0;

/// The image of a camera.
pub(super) struct StillPicture {
    pub(super) name: String,
    path: PathBuf,
    size_px: [u32; 2],
    /// The whole image as PNG.
    png: Vec<u8>,
}

/// The image of a camera, with its lens if known.
pub(super) struct MarkedPicture {
    pub(super) name: String,
    /// File name.
    pub(super) file: String,
    pub(super) size_px: [u32; 2],
    pub(super) png: Vec<u8>,
    pub(super) lens: Option<CameraState>,
}

impl MarkedPicture {
    /// # Errors
    /// When the lens belongs to another image size.
    pub(super) fn new(picture: StillPicture, lens: Option<&Lens>) -> anyhow::Result<Self> {
        let [w, h] = picture.size_px;
        if let Some(lens) = lens {
            let [lens_w, lens_h] = lens.size_px;
            let remedy = if [lens_h, lens_w] == picture.size_px {
                "it is turned on its side: save it as the camera records"
            } else {
                "give an image as the camera records it, not cut or made smaller"
            };
            ensure!(
                lens.size_px == picture.size_px,
                "{}: found an image of {w}x{h}, expected {lens_w}x{lens_h} as in the lens of camera `{}`: {remedy}",
                picture.path.display(),
                picture.name
            );
        }
        let file = picture.path.file_name().unwrap_or_default();
        Ok(Self {
            file: file.to_string_lossy().into_owned(),
            name: picture.name,
            size_px: picture.size_px,
            png: picture.png,
            lens: lens.map(|it| CameraState::at_origin(it.intrinsics, it.model)),
        })
    }
}

/// Reads the images at `paths` and in folders, each with the name of its file.
///
/// # Errors
/// Other files, two images of one camera, too many.
pub(super) fn read_all(paths: &[PathBuf], from_s: f64) -> anyhow::Result<Vec<StillPicture>> {
    ensure!(
        (0.0..=LATEST_S).contains(&from_s),
        "--from-s: found {from_s}, expected 0 to {LATEST_S} seconds"
    );
    let paths = files(paths)?;
    ensure!(
        paths.len() <= MOST_PICTURES,
        "found {} images, expected one of each camera and at most {MOST_PICTURES}",
        paths.len()
    );
    let mut pictures: Vec<StillPicture> = Vec::new();
    for path in paths {
        let picture = still(&path, from_s)?;
        if let Some(other) = pictures.iter().find(|it| it.name == picture.name) {
            bail!(
                "{} and {}: both belong to camera `{}`: give only one, or rename one",
                other.path.display(),
                path.display(),
                picture.name
            );
        }
        pictures.push(picture);
    }
    Ok(pictures)
}

/// Files, and the images and videos in folders.
fn files(paths: &[PathBuf]) -> anyhow::Result<Vec<PathBuf>> {
    let mut all = Vec::new();
    for path in paths {
        if !path.is_dir() {
            all.push(path.clone());
            continue;
        }
        let inside = entries(path)?;
        let before = all.len();
        let is_one = |it: &PathBuf| it.is_file() && (is_image(it) || is_video(it));
        all.extend(inside.into_iter().filter(is_one));
        ensure!(
            all.len() > before,
            "{}: found no image in it, expected JPEG or PNG files, or videos, named after the cameras",
            path.display()
        );
    }
    Ok(all)
}

fn still(path: &Path, from_s: f64) -> anyhow::Result<StillPicture> {
    let shown = || path.display().to_string();
    let name = path.file_stem().and_then(|it| it.to_str());
    let name =
        name.ok_or_else(|| anyhow!("{}: expected a file named after its camera", shown()))?;
    ClickedFile::check_name(name)
        .map_err(|problem| anyhow!("{}: {problem}: rename the file after its camera", shown()))?;
    let picture = if is_video(path) {
        image_of_video(path, from_s)?
    } else {
        let (picture, orientation) = image_of_file(path)
            .with_context(|| format!("{}: expected a JPEG or PNG image, or a video", shown()))?;
        ensure!(
            orientation == Orientation::NoTransforms,
            "{0}: found an image that is tagged as turned ({orientation:?}), expected pixels in the orientation of the camera's videos: \
             give a video, or turn the pixels (magick mogrify -auto-orient {0})",
            shown()
        );
        picture
    };
    Ok(StillPicture {
        name: name.to_owned(),
        path: path.to_owned(),
        size_px: [picture.width(), picture.height()],
        png: png(&picture).with_context(shown)?,
    })
}

/// The image as stored, and its orientation tag.
fn image_of_file(path: &Path) -> anyhow::Result<(RgbImage, Orientation)> {
    let mut reader = ImageReader::open(path)?.with_guessed_format()?;
    let mut limits = Limits::default();
    limits.max_image_width = Some(LONGEST_SIDE_PX);
    limits.max_image_height = Some(LONGEST_SIDE_PX);
    limits.max_alloc = Some(MOST_BYTES);
    reader.limits(limits);
    let mut decoder = reader.into_decoder()?;
    let bytes = decoder.total_bytes();
    ensure!(
        bytes <= MOST_BYTES,
        "found {bytes} bytes of pixels, expected at most {MOST_BYTES}"
    );
    let orientation = decoder.orientation()?;
    Ok((
        DynamicImage::from_decoder(decoder)?.into_rgb8(),
        orientation,
    ))
}

/// The sharpest image of the second from `from_s` on, if the video is that long.
fn image_of_video(path: &Path, from_s: f64) -> anyhow::Result<RgbImage> {
    let shown = path.display();
    let (info, mut source) = open_video_alone(path)?;
    print_format(&shown.to_string(), &info);
    let rate_hz = recordings::rough_rate(info.rate_hz);
    let first = (from_s * rate_hz) as u64;
    let searched = (SEARCHED_S * rate_hz).ceil() as u64;
    let mut sharpest: Option<(f64, Picture)> = None;
    let mut number = 0;
    while number < first + searched
        && let Some(frame) = source.next_frame()?
    {
        let FrameContent::Image(picture) = frame.content else {
            bail!("{shown}: found no images");
        };
        if number >= first {
            let sharpness = sharpness(&picture.to_grey());
            if sharpest.as_ref().is_none_or(|(most, _)| sharpness > *most) {
                sharpest = Some((sharpness, picture));
            }
        }
        number += 1;
    }
    let found = sharpest.map(|(_, picture)| picture.into_rgb());
    found.ok_or_else(|| {
        anyhow!("{shown}: found {number} images, expected some after {from_s} s (--from-s)")
    })
}

/// Encodes fast rather than small: the data stays on this machine.
fn png(picture: &RgbImage) -> anyhow::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    let encoder = PngEncoder::new_with_quality(&mut bytes, CompressionType::Fast, FilterType::Sub);
    encoder.write_image(
        picture.as_raw(),
        picture.width(),
        picture.height(),
        image::ExtendedColorType::Rgb8,
    )?;
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refused(paths: &[PathBuf]) -> String {
        match read_all(paths, 0.0) {
            Ok(_) => String::new(),
            Err(error) => format!("{error:#}"),
        }
    }

    #[test]
    fn images_are_named_after_their_files_and_keep_every_pixel() {
        let folder = tempfile::tempdir().unwrap();
        let drawn = RgbImage::from_fn(40, 30, |x, y| image::Rgb([x as u8, y as u8, 200]));
        drawn.save(folder.path().join("north.png")).unwrap();
        std::fs::write(folder.path().join("notes.txt"), "no picture").unwrap();
        let found = read_all(&[folder.path().to_owned()], 0.0).unwrap();
        assert_eq!(found.len(), 1);
        assert_eq!(
            (found[0].name.as_str(), found[0].size_px),
            ("north", [40, 30])
        );
        assert_eq!(
            image::load_from_memory(&found[0].png).unwrap().into_rgb8(),
            drawn
        );
    }

    #[test]
    fn invalid_images_are_refused_by_name() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        std::fs::write(at("south.jpg"), "no picture").unwrap();
        assert!(refused(&[at("south.jpg")]).contains("south.jpg: expected a JPEG"));
        assert!(refused(&[at("absent.png")]).contains("absent.png"));
        std::fs::create_dir(at("empty")).unwrap();
        assert!(refused(&[at("empty")]).contains("empty: found no image"));
        RgbImage::new(4, 4).save(at("a.png")).unwrap();
        RgbImage::new(4, 4).save(at("a.jpeg")).unwrap();
        let error = refused(&[at("a.png"), at("a.jpeg")]);
        assert!(error.contains("camera `a`"), "{error}");
    }

    /// A JPEG with an EXIF segment that contains only the orientation.
    fn tagged(orientation: u8) -> Vec<u8> {
        let mut jpeg = std::io::Cursor::new(Vec::new());
        RgbImage::new(8, 6)
            .write_to(&mut jpeg, image::ImageFormat::Jpeg)
            .unwrap();
        let jpeg = jpeg.into_inner();
        let mut exif = b"\xff\xe1\x00\x22Exif\0\0MM\x00\x2a\x00\x00\x00\x08\x00\x01".to_vec();
        exif.extend_from_slice(b"\x01\x12\x00\x03\x00\x00\x00\x01\x00");
        exif.extend_from_slice(&[orientation, 0, 0, 0, 0, 0, 0]);
        [&jpeg[..2], &exif, &jpeg[2..]].concat()
    }

    #[test]
    fn an_image_tagged_as_turned_is_refused_with_a_remedy() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("north.jpg");
        for orientation in [3, 6] {
            std::fs::write(&path, tagged(orientation)).unwrap();
            let error = refused(std::slice::from_ref(&path));
            assert!(error.contains("north.jpg: ") && error.contains("-auto-orient"));
        }
        std::fs::write(&path, tagged(1)).unwrap();
        assert_eq!(refused(std::slice::from_ref(&path)), "");
    }

    #[test]
    fn a_file_with_an_invalid_camera_name_is_refused_before_decoding() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(format!("{}.png", "x".repeat(65)));
        assert!(refused(&[path]).contains("rename the file"));
    }

    #[test]
    fn a_lens_of_another_size_is_refused_with_a_remedy() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        RgbImage::new(30, 40).save(&path).unwrap();
        let lens = |size_px| Lens {
            size_px,
            intrinsics: farfield_proto::camera::Intrinsics {
                fx_px: 30.0,
                fy_px: 30.0,
                cx_px: 15.0,
                cy_px: 20.0,
            },
            model: farfield_proto::camera::LensModel::ideal(),
        };
        for (size_px, expected) in [([60, 80], "made smaller"), ([40, 30], "on its side")] {
            let picture = read_all(std::slice::from_ref(&path), 0.0)
                .unwrap()
                .remove(0);
            let refused = MarkedPicture::new(picture, Some(&lens(size_px)));
            let error = refused.err().unwrap().to_string();
            assert!(error.contains(expected), "{error}");
        }
    }
}
