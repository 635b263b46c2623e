//! A random camera and the people in its image.

use std::f64::consts::TAU;

use farfield_proto::camera::CameraModel;
use farfield_proto::frames::{Pixel, Point};
use farfield_sim::body::{BodyPart, Build, Cone};
use farfield_sim::motion::Clip;
use nalgebra::Vector3;
use rand::RngExt as _;
use rand_chacha::ChaCha8Rng;

use super::FRAME_PX;
use crate::commands::training::camera::{camera, eye_around, log_uniform, looking};
use crate::commands::training::people::{Person, TrainingMoment};

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
pub(crate) fn draw(clips: &[Clip], rng: &mut ChaCha8Rng) -> Option<FrameGlance> {
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
