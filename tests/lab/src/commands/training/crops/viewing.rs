//! The camera and its crop.

use std::f64::consts::PI;

use farfield_edge::crop::{CropGeometry, CropShape, enclosing_upright};
use farfield_fusion::body::skeleton::Joints;
use farfield_fusion::boxes::{BoxShape, Boxes};
use farfield_proto::bounding_box::BoundingBox;
use farfield_proto::camera::CameraModel;
use farfield_proto::id::CameraIndex;
use farfield_proto::model_card::CellToInput;
use farfield_proto::venue::parameters::{BoxParameters, LatticeParameters};
use nalgebra::Vector3;
use rand::RngExt as _;
use rand_chacha::ChaCha8Rng;

use super::INPUT_PX;
use crate::commands::training::camera::{camera, eye_around, log_uniform, looking};

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
pub(crate) fn draw(joints_m: &Joints, stature_m: f64, rng: &mut ChaCha8Rng) -> Option<Viewing> {
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
    let camera = super::super::camera::camera(focal_px, [-left, -top], size_px, axes, eye)?;
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
        lattice_half_width_m: LatticeParameters::default().half_width_m,
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
