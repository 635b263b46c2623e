//! `lab training-crops`: rendered crops of people with their keypoints, to train and measure the embedded pose network.
//! [`CropRecord`] describes the records.

use std::f64::consts::{PI, TAU};
use std::ops::Range;

use farfield_edge::crop::{CropGeometry, CropShape, Cropper, PixelFormat, enclosing_upright};
use farfield_fusion::body::skeleton::{Joint, Joints};
use farfield_fusion::boxes::{BoxShape, Boxes};
use farfield_node::process::NodeError;
use farfield_proto::bounding_box::BoundingBox;
use farfield_proto::camera::CameraModel;
use farfield_proto::frames::Point;
use farfield_proto::id::CameraIndex;
use farfield_proto::keypoints::COCO17;
use farfield_proto::model_card::{CellToInput, Channels, NetworkInput, Normalize};
use farfield_proto::venue::parameters::BoxParameters;
use farfield_sim::body::Build;
use farfield_sim::motion::Clip;
use nalgebra::{Point3, Vector3};
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

use super::{SetArgs, TrainingSet};
use crate::commands::training::camera::{camera, eye_around, log_uniform, looking};
use crate::commands::training::people::{Person, Scenery, TrainingMoment};
use crate::commands::training::photo::{self, Occluder};

/// Width and height of the network's input, pixels.
const INPUT_PX: [usize; 2] = [160, 224];

/// Arguments of `lab training-crops`.
#[derive(Debug, clap::Args)]
pub(in crate::commands) struct CropsArgs {
    #[command(flatten)]
    set: SetArgs,
}

/// Writes the crops.
///
/// # Errors
/// A clip is missing or wrong, or a file cannot be written.
pub(in crate::commands) fn write(args: &CropsArgs) -> Result<(), NodeError> {
    let set = TrainingSet {
        name: "crops",
        shard: 1000,
        record: |clips, scenery, seed, number| {
            CropRecord::make(clips, scenery, seed, number).bytes()
        },
    };
    set.write(&args.set)
}

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
/// The record is the crop's pixels as rows of RGB bytes, then 17 keypoints in COCO's order. Pixels outside the image have the
/// mean of the network's normalisation. A keypoint is x, y (input pixels, the centre of the first one at 0) and a
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
            let moment = draw_moment(clips, &mut rng);
            let main = &moment.people[0];
            let seen = draw_viewing(&main.joints_m, main.build.stature_m, &mut rng);
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

/// Share of crops at any rotation.
const ANY_ROTATION: f64 = 0.15;
/// Share of crops that stay upright although the person does not, as crops of the lower body do.
const UPRIGHT: f64 = 0.4;
/// Share of crops cut by the edge of the image.
const TRUNCATED: f64 = 0.2;
/// The image is this much larger than the box.
const AROUND: f64 = 1.1;

/// A camera whose image just contains the crop, or a part of it if the edge cuts the crop.
pub(crate) struct Viewing {
    pub(crate) camera: CameraModel,
    pub(crate) crop: CropGeometry,
}

/// Draws a camera that faces a person; `None` if the person is not visible.
fn draw_viewing(joints_m: &Joints, stature_m: f64, rng: &mut ChaCha8Rng) -> Option<Viewing> {
    let middle = joints_m.iter().sum::<Vector3<f64>>() / joints_m.len() as f64;
    let distance_m: f64 = log_uniform(3.0..40.0, rng);
    let highest_m = f64::min(12.0, 1.2 + 0.8 * distance_m);
    let eye = eye_around(middle, distance_m, highest_m, rng);
    // Height of the person in the image: as many small ones as large ones.
    let tall_px: f64 = log_uniform(40.0..320.0, rng);
    let focal_px = tall_px * (middle - eye).norm() / stature_m;
    let axes = looking(eye, middle, rng);
    let camera = camera(focal_px, [0.0, 0.0], [1 << 15, 1 << 15], axes, eye)?;
    let b = jittered(box_of(&camera, joints_m, rng)?, rng);
    let [left, top, right, bottom] = window(&b, rng);
    let size_px = [right - left, bottom - top].map(|side| side.round().max(8.0) as u32);
    let camera = super::camera::camera(focal_px, [-left, -top], size_px, axes, eye)?;
    let b = BoundingBox {
        center_px: [b.center_px[0] - left as f32, b.center_px[1] - top as f32],
        ..b
    };
    let shape = CropShape {
        input_px: INPUT_PX,
        cells: INPUT_PX.map(|side| side as u16 / 4),
        cell_to_input: CellToInput {
            scale: 4.0,
            offset: 1.5,
        },
    };
    let crop = CropGeometry::new(&b, shape)?;
    Some(Viewing { camera, crop })
}

/// The box that fusion would request, or another rotation that the network must handle.
fn box_of(camera: &CameraModel, joints_m: &Joints, rng: &mut ChaCha8Rng) -> Option<BoundingBox> {
    let shape = BoxShape {
        margin: 1.25,
        reach_m: 0.0,
        parameters: BoxParameters::default(),
    };
    let seen = Boxes::default().camera_box(CameraIndex(0), camera, (joints_m, joints_m), &shape);
    let b = seen?.bounding_box;
    let kind: f64 = rng.random_range(0.0..1.0);
    Some(if kind < ANY_ROTATION {
        BoundingBox {
            rotation_rad: rng.random_range(-PI..PI) as f32,
            ..enclosing_upright(&b)
        }
    } else if kind < ANY_ROTATION + UPRIGHT {
        enclosing_upright(&b)
    } else {
        b
    })
}

/// Adds the error of a prediction: the centre by up to 8 %, the size by up to 20 %, the rotation by 10 degrees.
fn jittered(b: BoundingBox, rng: &mut ChaCha8Rng) -> BoundingBox {
    let largest = b.size_px[0].max(b.size_px[1]);
    let size = rng.random_range(0.82..1.2);
    BoundingBox {
        center_px: b
            .center_px
            .map(|c| c + largest * rng.random_range(-0.08..0.08)),
        size_px: b.size_px.map(|s| s * size),
        rotation_rad: b.rotation_rad + rng.random_range(-0.17..0.17),
    }
}

/// The part of the image plane to paint: left, top, right, bottom, pixels.
fn window(b: &BoundingBox, rng: &mut ChaCha8Rng) -> [f64; 4] {
    let [width, height] = b.size_px.map(f64::from);
    // Like the crop: grown to the input's aspect, and rotated.
    let step = (width / INPUT_PX[0] as f64).max(height / INPUT_PX[1] as f64);
    let around = enclosing_upright(&BoundingBox {
        size_px: INPUT_PX.map(|side| (side as f64 * step * AROUND) as f32),
        ..*b
    });
    let [x, y] = around.center_px.map(f64::from);
    let [half_width, half_height] = around.size_px.map(|side| f64::from(side) / 2.0);
    let mut sides = [
        x - half_width,
        y - half_height,
        x + half_width,
        y + half_height,
    ];
    if rng.random_bool(TRUNCATED) {
        let side = rng.random_range(0..4);
        let extent = [half_width, half_height][side % 2] * 2.0;
        let cut = extent * rng.random_range(0.1..0.5);
        sides[side] += if side < 2 { cut } else { -cut };
    }
    sides.map(f64::round)
}

/// Draws a moment: the person of the crop comes first, then the others.
fn draw_moment(clips: &[Clip], rng: &mut ChaCha8Rng) -> TrainingMoment {
    let field_m = [rng.random_range(5.0..40.0), rng.random_range(4.0..25.0)];
    let middle = field_m.map(|side| rng.random_range(-0.5..0.5) * side);
    let others = match rng.random_range(0..100) {
        0..40 => 0,
        40..70 => 1,
        70..85 => 2,
        85..95 => 3,
        _ => 4,
    };
    let kit = Build::from_seed(1.75, rng.random());
    let in_kit = rng.random_bool(0.3);
    let mut people = Vec::with_capacity(1 + others);
    for n in 0..=others {
        let place = if n == 0 {
            Vector3::new(middle[0], middle[1], 0.0)
        } else {
            let (distance_m, bearing) = (rng.random_range(0.3..1.5), rng.random_range(0.0..TAU));
            Vector3::new(
                middle[0] + distance_m * f64::cos(bearing),
                middle[1] + distance_m * f64::sin(bearing),
                0.0,
            )
        };
        let kit = in_kit.then_some(&kit);
        people.push(Person::draw(clips, place, kit, rng));
    }
    TrainingMoment {
        people,
        things: Vec::new(),
        field_m,
    }
}
