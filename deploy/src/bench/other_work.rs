//! Work of an edge besides its network: decoding images, cutting crops, and encoding their maps.
use std::fmt;

use farfield_edge::crop::{CropGeometry, CropShape, Cropper, PixelFormat};
use farfield_edge::gaussian_maps::draw_peak;
use farfield_edge::picture::{ColourCoding, Picture, YuvLayout, YuvPicture};
use farfield_edge::source::{RecordedSources, SourceError, Sources as _};
use farfield_node::clock;
use farfield_proto::bounding_box::BoundingBox;
use farfield_proto::camera::CameraModel;
use farfield_proto::model_card::{HeatmapCard, PEAK_SIGMA_OF_WIDTH};
use farfield_proto::patch::{CompressionLevel, Encoder, Maps};
use farfield_proto::venue::{Source, Venue};
use serde::Serialize;

/// Number of images and crops that are timed.
const TIMED: u32 = 60;
/// Image size without a venue, pixels.
const SIZE_PX: [u32; 2] = [1920, 1200];
/// Height of a person relative to that of the image.
const PERSON_SHARE: f32 = 0.5;

/// The time of each kind of work.
#[derive(Debug, Serialize)]
pub(super) struct OtherWork {
    /// Width and height of the image that crops are cut from, pixels.
    /// Width and height of the picture that crops are cut from, pixels.
    size_px: [u32; 2],
    crop_ms: f64,
    /// For the maps of a crop, at the initial compression level of a live link.
    encoding_ms: f64,
    decoding: Option<Decoding>,
}

/// For the first recorded video of a venue.
#[derive(Debug, Serialize)]
struct Decoding {
    camera: String,
    picture_ms: f64,
}

impl OtherWork {
    /// Measures the times, with the videos and the image size of a venue if given.
    ///
    /// # Errors
    /// When the video cannot be read.
    pub(super) fn measured(card: &HeatmapCard, venue: Option<&Venue>) -> Result<Self, SourceError> {
        let camera = venue.and_then(|venue| venue.cameras.first());
        let camera = camera.map(|camera| &camera.model);
        let size_px = camera.map_or(SIZE_PX, CameraModel::size_px);
        Ok(Self {
            size_px,
            crop_ms: crop_ms(card, size_px, camera),
            encoding_ms: encoding_ms(card),
            decoding: match venue {
                Some(venue) => Decoding::measured(venue)?,
                None => None,
            },
        })
    }
}

/// For a slightly tilted person in the middle of a video image.
fn crop_ms(card: &HeatmapCard, size_px: [u32; 2], camera: Option<&CameraModel>) -> f64 {
    let layout = YuvLayout::Planar([2, 2]);
    let bytes = vec![128; layout.n_bytes(size_px)].into();
    let picture = YuvPicture::new(size_px, layout, ColourCoding::default(), bytes);
    let [width, height] = size_px.map(|side| side as f32);
    let person = BoundingBox {
        center_px: [width / 2.0, height / 2.0],
        size_px: [0.5 * PERSON_SHARE * height, PERSON_SHARE * height],
        rotation_rad: 0.1,
    };
    let shape = CropShape::of_card(card);
    let (Some(picture), Some(crop)) = (picture, CropGeometry::new(&person, shape)) else {
        return f64::NAN;
    };
    let picture = Picture::Yuv(picture);
    let format = PixelFormat::new(&card.input, &card.normalize);
    let mut input = vec![0.0; 3 * shape.input_px[0] * shape.input_px[1]];
    let mut cropper = Cropper::default();
    mean_ms(|| cropper.crop(&picture, camera, &crop, &format, &mut input))
}

/// For maps with one clear peak each.
fn encoding_ms(card: &HeatmapCard) -> f64 {
    let [width, height] = CropShape::of_card(card).cells.map(usize::from);
    let keypoints = card.output.keypoints.len();
    let mut maps = Maps::new(width, height, keypoints);
    for keypoint in 0..keypoints {
        let share = (keypoint as f64 + 0.5) / keypoints as f64;
        let peak = [0.5 * width as f64, share * height as f64];
        let sigma_cells = PEAK_SIGMA_OF_WIDTH * width as f64;
        draw_peak(maps.cells_mut(keypoint), width, peak, 0.9, sigma_cells);
    }
    let (mut encoder, mut bytes) = (Encoder::new(), Vec::new());
    mean_ms(|| encoder.encode_into(&maps, CompressionLevel::DEFAULT, &mut bytes))
}

/// Mean of `TIMED` runs, after one that is not counted.
fn mean_ms(mut work: impl FnMut()) -> f64 {
    work();
    let begun = clock::now();
    for _ in 0..TIMED {
        work();
    }
    clock::now().duration_since(begun).as_secs_f64() * 1000.0 / f64::from(TIMED)
}

impl Decoding {
    fn measured(venue: &Venue) -> Result<Option<Self>, SourceError> {
        let mut cameras = venue.cameras.iter();
        let Some(camera) = cameras.find(|it| matches!(it.source, Source::Video { .. })) else {
            return Ok(None);
        };
        let mut source = RecordedSources.open(camera, venue, venue.first_tick)?;
        // The first frame includes the start of the decoder.
        source.next_frame()?;
        let begun = clock::now();
        let mut pictures = 0;
        while pictures < TIMED && source.next_frame()?.is_some() {
            pictures += 1;
        }
        let took_s = clock::now().duration_since(begun).as_secs_f64();
        Ok(Some(Self {
            camera: camera.model.name().to_owned(),
            picture_ms: took_s * 1000.0 / f64::from(pictures.max(1)),
        }))
    }
}

impl fmt::Display for OtherWork {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [width, height] = self.size_px;
        writeln!(
            f,
            "\nbesides the network\n{:>7.2}  ms per crop, of an image of {width} x {height}",
            self.crop_ms
        )?;
        writeln!(
            f,
            "{:>7.2}  ms to encode the maps of a crop",
            self.encoding_ms
        )?;
        match &self.decoding {
            Some(Decoding { camera, picture_ms }) => {
                writeln!(f, "{picture_ms:>7.2}  ms to decode an image of {camera}")
            }
            None => Ok(()),
        }
    }
}
