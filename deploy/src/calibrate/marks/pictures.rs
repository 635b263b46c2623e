//! One still picture per camera, as the lens drew it: decoded here, because each browser does with tags and colours what it
//! likes. Videos are turned as their container says, in all of Farfield; of a picture that is tagged as turned nobody knows
//! which way up the camera's others are, and it is refused.

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
use crate::init::rate;
use crate::init::recordings::{entries, is_picture, is_video};
use crate::recorded_formats::say_format;

/// Most cameras of one sitting: their pictures are held in memory.
const MOST_PICTURES: usize = 64;
/// Longest side of a picture, pixels.
const LONGEST_SIDE_PX: u32 = 16_384;
/// Most memory for a picture while it is decoded, bytes.
const MOST_BYTES: u64 = 1 << 30;
/// How long the sharpest picture of a video is looked for.
const LOOKED_S: f64 = 1.0;
/// Latest second of a video at which a picture may be taken.
const LATEST_S: f64 = 86_400.0;

/// A camera's picture.
pub(super) struct StillPicture {
    /// The camera's name.
    pub(super) name: String,
    path: PathBuf,
    size_px: [u32; 2],
    /// All of it, as PNG.
    png: Vec<u8>,
}

/// A camera's picture, and the lens that drew it where that is known.
pub(super) struct MarkedPicture {
    pub(super) name: String,
    /// What the file is called.
    pub(super) file: String,
    pub(super) size_px: [u32; 2],
    pub(super) png: Vec<u8>,
    pub(super) lens: Option<CameraState>,
}

impl MarkedPicture {
    /// # Errors
    /// When the lens is of pictures of another size.
    pub(super) fn new(picture: StillPicture, lens: Option<&Lens>) -> anyhow::Result<Self> {
        let [w, h] = picture.size_px;
        if let Some(lens) = lens {
            let [lens_w, lens_h] = lens.size_px;
            let remedy = if [lens_h, lens_w] == picture.size_px {
                "it lies on its side: save it as the camera records"
            } else {
                "give a picture as the camera records, not cut or made smaller"
            };
            ensure!(
                lens.size_px == picture.size_px,
                "{}: found a picture of {w}x{h}, expected {lens_w}x{lens_h} as the lens of camera `{}`: {remedy}",
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

/// The pictures at `paths`, folders opened, each named by its file.
///
/// # Errors
/// What is no picture and no video, two of one camera, too many.
pub(super) fn of(paths: &[PathBuf], from_s: f64) -> anyhow::Result<Vec<StillPicture>> {
    ensure!(
        (0.0..=LATEST_S).contains(&from_s),
        "--from-s: found {from_s}, expected 0 to {LATEST_S} seconds"
    );
    let paths = files(paths)?;
    ensure!(
        paths.len() <= MOST_PICTURES,
        "found {} pictures, expected one of each camera and at most {MOST_PICTURES}",
        paths.len()
    );
    let mut pictures: Vec<StillPicture> = Vec::new();
    for path in paths {
        let picture = still(&path, from_s)?;
        if let Some(other) = pictures.iter().find(|it| it.name == picture.name) {
            bail!(
                "{} and {}: both are of camera `{}`: give one, or another name",
                other.path.display(),
                path.display(),
                picture.name
            );
        }
        pictures.push(picture);
    }
    Ok(pictures)
}

/// Files, and what pictures and videos are in folders.
fn files(paths: &[PathBuf]) -> anyhow::Result<Vec<PathBuf>> {
    let mut all = Vec::new();
    for path in paths {
        if !path.is_dir() {
            all.push(path.clone());
            continue;
        }
        let inside = entries(path)?;
        let before = all.len();
        let is_one = |it: &PathBuf| it.is_file() && (is_picture(it) || is_video(it));
        all.extend(inside.into_iter().filter(is_one));
        ensure!(
            all.len() > before,
            "{}: found no picture in it, expected JPEG or PNG files, or videos, called as the cameras",
            path.display()
        );
    }
    Ok(all)
}

fn still(path: &Path, from_s: f64) -> anyhow::Result<StillPicture> {
    let shown = || path.display().to_string();
    let name = path.file_stem().and_then(|it| it.to_str());
    let name = name.ok_or_else(|| anyhow!("{}: expected a file called as its camera", shown()))?;
    ClickedFile::check_name(name)
        .map_err(|problem| anyhow!("{}: {problem}: call the file as its camera", shown()))?;
    let picture = if is_video(path) {
        of_video(path, from_s)?
    } else {
        let (picture, orientation) = of_file(path)
            .with_context(|| format!("{}: expected a JPEG or PNG picture, or a video", shown()))?;
        ensure!(
            orientation == Orientation::NoTransforms,
            "{0}: found a picture that is tagged as turned ({orientation:?}), expected pixels that lie as those of the camera's videos: \
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

/// A picture as it is stored, and how it says that it is turned.
fn of_file(path: &Path) -> anyhow::Result<(RgbImage, Orientation)> {
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

/// The sharpest picture of the second from `from_s` on; of a video that ends before, of its last ones.
fn of_video(path: &Path, from_s: f64) -> anyhow::Result<RgbImage> {
    let shown = path.display();
    let (info, mut source) = open_video_alone(path)?;
    say_format(&shown.to_string(), &info);
    let rate_hz = rate::about(info.rate_hz);
    let first = (from_s * rate_hz) as u64;
    let looked = (LOOKED_S * rate_hz).ceil() as u64;
    let mut sharpest: Option<(f64, Picture)> = None;
    let mut number = 0;
    while number < first + looked
        && let Some(frame) = source.next_frame()?
    {
        let FrameContent::Image(picture) = frame.content else {
            bail!("{shown}: found no pictures");
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
        anyhow!("{shown}: found {number} pictures, expected some after {from_s} s (--from-s)")
    })
}

/// Quickly made rather than small: it goes no farther than this machine.
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
        match of(paths, 0.0) {
            Ok(_) => String::new(),
            Err(error) => format!("{error:#}"),
        }
    }

    #[test]
    fn pictures_are_named_by_their_files_and_keep_every_pixel() {
        let folder = tempfile::tempdir().unwrap();
        let drawn = RgbImage::from_fn(40, 30, |x, y| image::Rgb([x as u8, y as u8, 200]));
        drawn.save(folder.path().join("north.png")).unwrap();
        std::fs::write(folder.path().join("notes.txt"), "no picture").unwrap();
        let found = of(&[folder.path().to_owned()], 0.0).unwrap();
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
    fn what_is_no_picture_is_refused_by_name() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        std::fs::write(at("south.jpg"), "no picture").unwrap();
        let told = refused(&[at("south.jpg")]);
        assert!(
            told.contains("south.jpg: expected a JPEG or PNG picture"),
            "{told}"
        );
        assert!(refused(&[at("absent.png")]).contains("absent.png"));
        std::fs::create_dir(at("empty")).unwrap();
        assert!(refused(&[at("empty")]).contains("found no picture in it"));
        RgbImage::new(4, 4).save(at("a.png")).unwrap();
        RgbImage::new(4, 4).save(at("a.jpeg")).unwrap();
        let told = refused(&[at("a.png"), at("a.jpeg")]);
        assert!(told.contains("both are of camera `a`"), "{told}");
    }

    /// A JPEG with an EXIF segment that holds nothing but the orientation.
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
    fn a_picture_that_is_tagged_as_turned_is_refused_with_what_to_do() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("north.jpg");
        for orientation in [3, 6] {
            std::fs::write(&path, tagged(orientation)).unwrap();
            let told = refused(std::slice::from_ref(&path));
            assert!(
                told.contains("north.jpg: found a picture that is tagged as turned"),
                "{told}"
            );
            assert!(told.contains("-auto-orient"), "{told}");
        }
        std::fs::write(&path, tagged(1)).unwrap();
        assert_eq!(refused(std::slice::from_ref(&path)), "");
    }

    #[test]
    fn a_file_whose_name_no_camera_can_have_is_refused_before_it_is_decoded() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(format!("{}.png", "x".repeat(65)));
        let told = refused(&[path]);
        assert!(told.contains("call the file as its camera"), "{told}");
    }

    #[test]
    fn a_lens_of_another_size_is_refused_with_what_to_do() {
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
            let picture = of(std::slice::from_ref(&path), 0.0).unwrap().remove(0);
            let told = MarkedPicture::new(picture, Some(&lens(size_px)))
                .err()
                .unwrap();
            assert!(told.to_string().contains(expected), "{told}");
        }
    }
}
