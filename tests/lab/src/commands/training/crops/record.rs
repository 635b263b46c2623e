//! One crop with its keypoints.

use std::ops::Range;

use farfield_edge::crop::{Cropper, PixelFormat};
use farfield_fusion::body::skeleton::Joint;
use farfield_proto::frames::Point;
use farfield_proto::keypoints::COCO17;
use farfield_proto::model_card::{Channels, NetworkInput, Normalize};
use farfield_sim::motion::Clip;
use nalgebra::Point3;
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

use super::INPUT_PX;
use super::moment;
use super::viewing::{self, Viewing};
use crate::commands::training::people::{Person, TrainingMoment};
use crate::commands::training::photo::{self, Occluder};
use crate::commands::training::scenery::Scenery;

/// The mean of `ImageNet`, as bytes.
const MEAN: [f32; 3] = [123.675, 116.28, 103.53];

/// Blur of images, pixels.
const BLUR_PX: Range<f32> = 0.3..1.6;

/// Visibility of a keypoint.
#[derive(Debug, Clone, Copy)]
pub(crate) enum KeypointState {
    /// Not in the crop.
    Outside = 0,
    /// In the crop, but behind something or outside the image.
    Hidden = 1,
    /// Visible.
    Visible = 2,
}

/// One crop with its keypoints.
///
/// The record is the crop's pixels, rows of RGB bytes (pixels outside the image have the mean of the network's
/// normalisation), then 17 keypoints in COCO's order: x, y (input pixels, the centre of the first one at 0) and a
/// [state](KeypointState), as little-endian 32-bit floats.
pub(crate) struct CropRecord {
    pixels: Vec<u8>,
    keypoints: [(f32, f32, KeypointState); COCO17.len()],
}

impl CropRecord {
    /// Draws crop `number` of a set, independent of all others.
    pub(crate) fn make(clips: &[Clip], scenery: &Scenery, seed: u64, number: u64) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        rng.set_stream(number);
        loop {
            let moment = moment::draw(clips, &mut rng);
            let main = &moment.people[0];
            let seen = viewing::draw(&main.joints_m, main.build.stature_m, &mut rng);
            if let Some(viewing) = seen {
                return Self::photograph(&moment, scenery, &viewing, &mut rng);
            }
        }
    }

    fn photograph(
        moment: &TrainingMoment,
        scenery: &Scenery,
        viewing: &Viewing,
        rng: &mut ChaCha8Rng,
    ) -> Self {
        let size_px = viewing.camera.size_px();
        let occluders: Vec<Occluder> = if rng.random_bool(0.2) {
            let many = rng.random_range(1..3);
            (0..many).map(|_| Occluder::draw(size_px, rng)).collect()
        } else {
            Vec::new()
        };
        let mut picture = scenery.paint(moment, &viewing.camera, rng);
        for occluder in &occluders {
            occluder.paint(&mut picture);
        }
        let picture = photo::taken(picture, BLUR_PX, rng).into();
        let [width, height] = INPUT_PX;
        let mut planes = vec![0.0; 3 * width * height];
        Cropper::default().crop(&picture, None, &viewing.crop, &format(), &mut planes);
        let pixels = (0..3 * width * height)
            .map(|i| (planes[i % 3 * width * height + i / 3] + MEAN[i % 3]).round() as u8)
            .collect();
        let keypoints = std::array::from_fn(|k| keypoint(k, &moment.people, viewing, &occluders));
        Self { pixels, keypoints }
    }

    pub(crate) fn bytes(&self) -> Vec<u8> {
        let mut bytes = self.pixels.clone();
        for &(x, y, state) in &self.keypoints {
            for value in [x, y, f32::from(state as u8)] {
                bytes.extend_from_slice(&value.to_le_bytes());
            }
        }
        bytes
    }
}

/// Pixels minus the mean, so that unknown pixels (0) differ from black.
fn format() -> PixelFormat {
    let input = NetworkInput {
        name: String::new(),
        width: INPUT_PX[0] as u32,
        height: INPUT_PX[1] as u32,
        channels: Channels::Rgb,
        letterbox: None,
        pad: None,
    };
    let normalize = Normalize {
        scale: 1.0,
        mean: MEAN,
        std: [1.0; 3],
    };
    PixelFormat::new(&input, &normalize)
}

/// Keypoint `k` of the first person.
fn keypoint(
    k: usize,
    people: &[Person],
    viewing: &Viewing,
    occluders: &[Occluder],
) -> (f32, f32, KeypointState) {
    let joint = Joint::from_name(COCO17[k]).expect("COCO's keypoints are joints");
    let at_m = people[0].joints_m[joint as usize];
    let Some(px) = viewing.camera.project(Point::new(Point3::from(at_m))) else {
        return (0.0, 0.0, KeypointState::Outside);
    };
    let input = viewing.crop.input(px);
    let [width, height] = INPUT_PX.map(|side| side as f64 - 0.5);
    if !(-0.5..width).contains(&input.x) || !(-0.5..height).contains(&input.y) {
        return (input.x as f32, input.y as f32, KeypointState::Outside);
    }
    let eye_m = viewing.camera.center().coordinates_m().coords;
    let is_hidden = !viewing.camera.sees(px)
        || occluders
            .iter()
            .any(|o| o.covers(px.x() as f32, px.y() as f32))
        || people.iter().enumerate().any(|(n, person)| {
            let own = (n == 0).then_some(k);
            person.volume.covers(&eye_m, &at_m, own)
        });
    let state = if is_hidden {
        KeypointState::Hidden
    } else {
        KeypointState::Visible
    };
    (input.x as f32, input.y as f32, state)
}
