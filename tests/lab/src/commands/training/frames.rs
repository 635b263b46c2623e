//! `lab training-frames`: rendered images with the boxes of their people, to train and measure the embedded detector.
//! [`FrameRecord`] describes the records.

use std::f64::consts::TAU;
use std::ops::Range;

use farfield_node::process::NodeError;
use farfield_proto::camera::CameraModel;
use farfield_proto::frames::{Pixel, Point};
use farfield_sim::body::{BodyPart, Build, Cone};
use farfield_sim::motion::Clip;
use image::{Rgb, RgbImage};
use nalgebra::{Point3, Vector3};
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

use super::{SetArgs, TrainingSet};
use crate::commands::training::camera::{camera, eye_around, log_uniform, looking};
use crate::commands::training::people::{Person, Scenery, TrainingMoment};
use crate::commands::training::photo::{self, Occluder};

/// Width and height of an image, pixels: a part of the detector's input, which works since the network is convolutional.
const FRAME_PX: [u32; 2] = [320, 192];

/// Arguments of `lab training-frames`.
#[derive(Debug, clap::Args)]
pub(in crate::commands) struct FramesArgs {
    #[command(flatten)]
    set: SetArgs,
}

/// Writes the images.
///
/// # Errors
/// A clip is missing or wrong, or a file cannot be written.
pub(in crate::commands) fn write(args: &FramesArgs) -> Result<(), NodeError> {
    let set = TrainingSet {
        name: "frames",
        shard: 500,
        record: |clips, scenery, seed, number| {
            FrameRecord::make(clips, scenery, seed, number).bytes()
        },
    };
    set.write(&args.set)
}

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
            if let Some(glance) = draw_glance(clips, &mut rng) {
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

/// Share of images without people.
const EMPTY: f64 = 0.08;
/// Most people in an image besides the one that the camera faces.
const MOST_OTHERS: usize = 9;
/// Height of a person of 1.75 m where the camera faces, pixels.
const TALL_PX: std::ops::Range<f64> = 12.0..240.0;
/// Largest distance of a person from the camera, metres.
const FARTHEST_M: f64 = 200.0;

/// A moment, and the camera that shows it.
pub(crate) struct FrameGlance {
    pub(crate) moment: TrainingMoment,
    pub(crate) camera: CameraModel,
}

/// Draws one; `None` if there is no such camera.
fn draw_glance(clips: &[Clip], rng: &mut ChaCha8Rng) -> Option<FrameGlance> {
    let field_m = [rng.random_range(5.0..60.0), rng.random_range(4.0..40.0)];
    let [x, y] = field_m.map(|side| rng.random_range(-0.5..0.5) * side);
    let camera = aimed(Vector3::new(x, y, 0.9), rng)?;
    let kit = Build::from_seed(1.75, rng.random());
    let in_kit = rng.random_bool(0.3);
    let kit = in_kit.then_some(&kit);
    let mut people: Vec<Person> = Vec::new();
    if !rng.random_bool(EMPTY) {
        // The product favours few people.
        let others =
            rng.random_range(0..=MOST_OTHERS) * rng.random_range(0..=MOST_OTHERS) / MOST_OTHERS;
        people.push(Person::draw(clips, Vector3::new(x, y, 0.0), kit, rng));
        for _ in 0..others {
            let place = if rng.random_bool(0.4) {
                let near = rng.random_range(0..people.len());
                near_person(people[near].joints_m[0], rng)
            } else {
                let Some(place) = on_floor(&camera, rng) else {
                    continue;
                };
                place
            };
            people.push(Person::draw(clips, place, kit, rng));
        }
    }
    let things = rng.random_range(0..4_usize).saturating_sub(1);
    let things = (0..things)
        .filter_map(|_| {
            let place = on_floor(&camera, rng)?;
            Some((rng.random(), thing(place, rng)))
        })
        .collect();
    let moment = TrainingMoment {
        people,
        things,
        field_m,
    };
    Some(FrameGlance { moment, camera })
}

/// A camera that has `middle` somewhere in its image, or just outside.
fn aimed(middle: Vector3<f64>, rng: &mut ChaCha8Rng) -> Option<CameraModel> {
    let distance_m: f64 = log_uniform(2.5..120.0, rng);
    let highest_m = f64::min(15.0, 1.2 + 0.7 * distance_m);
    let eye = eye_around(middle, distance_m, highest_m, rng);
    let focal_px = log_uniform(TALL_PX, rng) * (middle - eye).norm() / 1.75;
    let axes = looking(eye, middle, rng);
    let wide = camera(focal_px, [0.0, 0.0], [1 << 15, 1 << 15], axes, eye)?;
    let at = wide.project(Point::new(middle.into()))?.vector_px();
    let [left, top] = [0, 1].map(|i| at[i] - rng.random_range(-0.1..1.1) * f64::from(FRAME_PX[i]));
    camera(focal_px, [-left, -top], FRAME_PX, axes, eye)
}

/// A random point on the floor in the image of the camera.
fn on_floor(camera: &CameraModel, rng: &mut ChaCha8Rng) -> Option<Vector3<f64>> {
    let [x, y] = FRAME_PX.map(|side| rng.random_range(-0.05..1.3) * f64::from(side));
    let k = camera.intrinsics();
    let px = Pixel::<farfield_proto::frames::Undistorted>::new(x, y);
    let ray_c = Vector3::new(
        (px.x() - k.cx_px) / k.fx_px,
        (px.y() - k.cy_px) / k.fy_px,
        1.0,
    );
    let ray = camera.camera_from_world().isometry().rotation.inverse() * ray_c;
    let eye = camera.center().coordinates_m().coords;
    let steps = -eye.z / ray.z;
    let path = ray * steps;
    (steps > 0.0 && path.norm() > 1.5 && path.norm() < FARTHEST_M).then(|| eye + path)
}

/// A random position near a person: from touching to a few steps away.
fn near_person(pelvis: Vector3<f64>, rng: &mut ChaCha8Rng) -> Vector3<f64> {
    let (distance_m, bearing) = (log_uniform(0.3..3.0, rng), rng.random_range(0.0..TAU));
    Vector3::new(
        pelvis.x + distance_m * f64::cos(bearing),
        pelvis.y + distance_m * f64::sin(bearing),
        0.0,
    )
}

/// A flying ball, or a post.
fn thing(place: Vector3<f64>, rng: &mut ChaCha8Rng) -> Cone {
    if rng.random_bool(0.6) {
        let at = place + Vector3::z() * rng.random_range(0.11..2.5);
        return Cone::round(BodyPart::Thing, [at; 2], [rng.random_range(0.09..0.13); 2]);
    }
    let top = place + Vector3::z() * rng.random_range(0.4..2.6);
    Cone::round(
        BodyPart::Thing,
        [place, top],
        [rng.random_range(0.03..0.2); 2],
    )
}
