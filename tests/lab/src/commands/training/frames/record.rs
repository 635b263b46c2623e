//! One image with the boxes of its people.

use std::ops::Range;

use farfield_proto::camera::CameraModel;
use farfield_proto::frames::Point;
use farfield_sim::motion::Clip;
use image::{Rgb, RgbImage};
use nalgebra::{Point3, Vector3};
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

use super::FRAME_PX;
use super::glance::{self, FrameGlance};
use crate::commands::training::people::Person;
use crate::commands::training::photo::{self, Occluder};
use crate::commands::training::scenery::Scenery;

/// Boxes of a record.
const MOST: usize = 16;
/// Value of pixels outside the image.
const PAD: u8 = 114;
/// Share of images that end inside the frame, like those of another aspect.
const PADDED: f64 = 0.15;
/// Blur of images, pixels: less than of crops, since frames are whole images scaled down.
const BLUR_PX: Range<f32> = 0.2..0.9;
/// Least side of a box, pixels.
const LEAST_PX: f64 = 2.0;

/// An image and the boxes of its people.
///
/// The record is the image's pixels, rows of RGB bytes (pixels outside the image have the value of the detector's `pad`),
/// then [`MOST`] boxes: left, top, right, bottom (pixels, 0 at the outer edge of the first one; cut at the edges of the
/// image) and the visible share of the body, as little-endian 32-bit floats. Unused boxes have a share of -1.
pub(crate) struct FrameRecord {
    picture: RgbImage,
    boxes: Vec<[f32; 5]>,
}

impl FrameRecord {
    /// Draws image `number` of a set, independent of all others.
    pub(crate) fn make(clips: &[Clip], scenery: &Scenery, seed: u64, number: u64) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        rng.set_stream(number);
        loop {
            if let Some(glance) = glance::draw(clips, &mut rng) {
                return Self::photograph(&glance, scenery, &mut rng);
            }
        }
    }

    fn photograph(glance: &FrameGlance, scenery: &Scenery, rng: &mut ChaCha8Rng) -> Self {
        let occluders: Vec<Occluder> = if rng.random_bool(0.15) {
            vec![Occluder::draw(FRAME_PX, rng)]
        } else {
            Vec::new()
        };
        let mut picture = scenery.paint(&glance.moment, &glance.camera, rng);
        for occluder in &occluders {
            occluder.paint(&mut picture);
        }
        let mut picture = photo::taken(picture, BLUR_PX, rng);
        let mut end_px = FRAME_PX;
        if rng.random_bool(PADDED) {
            let side = usize::from(rng.random_bool(0.5));
            end_px[side] = (f64::from(end_px[side]) * rng.random_range(0.4..1.0)) as u32;
            for (x, y, pixel) in picture.enumerate_pixels_mut() {
                if x >= end_px[0] || y >= end_px[1] {
                    *pixel = Rgb([PAD; 3]);
                }
            }
        }
        let people = &glance.moment.people;
        let boxes = (0..people.len())
            .filter_map(|n| box_of(n, people, &glance.camera, &occluders, end_px))
            .collect();
        Self { picture, boxes }
    }

    pub(crate) fn bytes(&self) -> Vec<u8> {
        let mut bytes = self.picture.as_raw().clone();
        let unused = [0.0, 0.0, 0.0, 0.0, -1.0];
        for value in (0..MOST).flat_map(|n| self.boxes.get(n).copied().unwrap_or(unused)) {
            bytes.extend_from_slice(&value.to_le_bytes());
        }
        bytes
    }
}

/// The box of person `n` inside the image and the visible share of the body; `None` outside.
fn box_of(
    n: usize,
    people: &[Person],
    camera: &CameraModel,
    occluders: &[Occluder],
    end_px: [u32; 2],
) -> Option<[f32; 5]> {
    let person = &people[n];
    let axes = camera.camera_from_world().isometry();
    let focal_px = camera.intrinsics().fx_px;
    let mut around = [
        f64::INFINITY,
        f64::INFINITY,
        f64::NEG_INFINITY,
        f64::NEG_INFINITY,
    ];
    for cone in &person.volume.cones {
        for (end_m, reach_m) in [
            (cone.origin_m, cone.reach_m[0]),
            (cone.tip_m, cone.reach_m[1]),
        ] {
            let depth_m = (axes * Point3::from(end_m)).z;
            let px = camera.project(Point::new(Point3::from(end_m)))?;
            let reach_px = focal_px * reach_m / depth_m;
            let [l, t, r, b] = around;
            around = [
                l.min(px.x() + 0.5 - reach_px),
                t.min(px.y() + 0.5 - reach_px),
                r.max(px.x() + 0.5 + reach_px),
                b.max(px.y() + 0.5 + reach_px),
            ];
        }
    }
    let [width, height] = end_px.map(f64::from);
    let [l, t, r, b] = around;
    let (l, r) = (l.clamp(0.0, width), r.clamp(0.0, width));
    let (t, b) = (t.clamp(0.0, height), b.clamp(0.0, height));
    if r - l < LEAST_PX || b - t < LEAST_PX {
        return None;
    }
    let eye_m = camera.center().coordinates_m().coords;
    let is_seen = |at_m: &&Vector3<f64>| {
        let Some(px) = camera.project(Point::new(Point3::from(**at_m))) else {
            return false;
        };
        let inside =
            px.x() > -0.5 && px.x() < width - 0.5 && px.y() > -0.5 && px.y() < height - 0.5;
        let behind = people
            .iter()
            .enumerate()
            .any(|(other, p)| other != n && p.volume.covers(&eye_m, at_m, None));
        let (x, y) = (px.x() as f32, px.y() as f32);
        inside && !behind && !occluders.iter().any(|o| o.covers(x, y))
    };
    let seen = person.joints_m.iter().filter(is_seen).count() as f32;
    let share = seen / person.joints_m.len() as f32;
    Some([l as f32, t as f32, r as f32, b as f32, share])
}
