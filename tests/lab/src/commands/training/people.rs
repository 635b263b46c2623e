//! People in postures of clips with the things around them, and their images in random surroundings.

use std::f64::consts::{PI, TAU};

use farfield_fusion::body::skeleton::Joints;
use farfield_proto::camera::CameraModel;
use farfield_sim::body::{Build, Color, Cone, Volume};
use farfield_sim::motion::{Clip, Posture};
use farfield_sim::render::{Backdrop, CameraView, Figure, Sensor, Shot, Surroundings, paint};
use image::RgbImage;
use nalgebra::{Rotation3, Unit, Vector3};
use rand::RngExt as _;
use rand_chacha::ChaCha8Rng;

/// Share of postures that are mixed from two clips.
const MIXED: f64 = 0.25;
/// Share of people rotated as a whole, since no clip shows every way to be upside down.
const TURNED_OVER: f64 = 0.12;
/// Largest relative change of bone lengths.
const OWN_LENGTHS: f64 = 0.07;

/// One person of an image.
pub(crate) struct Person {
    /// World, metres.
    pub(crate) joints_m: Joints,
    pub(crate) volume: Volume,
    pub(crate) build: Build,
}

impl Person {
    /// A person in a posture of one of `clips`, with the pelvis above `place`, dressed in `kit` if given.
    pub(crate) fn draw(
        clips: &[Clip],
        place: Vector3<f64>,
        kit: Option<&Build>,
        rng: &mut ChaCha8Rng,
    ) -> Self {
        let stature_m = rng.random_range(1.5..2.0);
        let build = Build::from_seed(stature_m, rng.random());
        let build = match kit {
            Some(kit) => build.in_kit_of(kit),
            None => build,
        };
        let joints_m = joints(clips, stature_m, place, rng);
        Self {
            volume: Volume::new(&joints_m, &build),
            joints_m,
            build,
        }
    }
}

/// People and things at one moment.
pub(crate) struct TrainingMoment {
    pub(crate) people: Vec<Person>,
    /// Balls and posts.
    pub(crate) things: Vec<(Color, Cone)>,
    /// Size of the field around the origin, metres.
    pub(crate) field_m: [f64; 2],
}

/// A posture with its pelvis above `place`.
fn joints(clips: &[Clip], stature_m: f64, place: Vector3<f64>, rng: &mut ChaCha8Rng) -> Joints {
    let clip = &clips[rng.random_range(0..clips.len())];
    let mut posture = at_random(clip, rng);
    if rng.random_bool(MIXED) {
        let other = &clips[rng.random_range(0..clips.len())];
        posture = posture.blend(&at_random(other, rng), rng.random_range(0.0..1.0));
    }
    let lengths = clip.mean_lengths();
    let own = lengths.map(|length| length * rng.random_range(1.0 - OWN_LENGTHS..1.0 + OWN_LENGTHS));
    let mut joints = posture
        .with_mean_lengths(&lengths, &own)
        .moved(rng.random_range(0.0..TAU), Vector3::zeros())
        .scaled(stature_m);
    let pelvis = joints[0];
    if rng.random_bool(TURNED_OVER) {
        let bearing = rng.random_range(0.0..TAU);
        let axis = Unit::new_normalize(Vector3::new(bearing.cos(), bearing.sin(), 0.0));
        let turn = Rotation3::from_axis_angle(&axis, rng.random_range(-PI..PI));
        joints = joints.map(|joint| turn * (joint - pelvis) + pelvis);
        let lowest = joints.iter().fold(f64::INFINITY, |low, j| low.min(j.z));
        let lift = Vector3::z() * (rng.random_range(0.02..0.3) - lowest);
        joints = joints.map(|joint| joint + lift);
    }
    joints.map(|joint| joint + place - Vector3::new(pelvis.x, pelvis.y, 0.0))
}

fn at_random(clip: &Clip, rng: &mut ChaCha8Rng) -> Posture {
    clip.posture(rng.random_range(0.0..=clip.duration_s()))
}

/// Number of sensors; each has a table of noise that takes longer to make than an image.
const SENSORS: u64 = 96;

/// Images with more pixels get fewer rays per pixel.
const MANY_PX: u32 = 200 * 250;

/// Sensors for the images.
pub(crate) struct Scenery {
    sensors: Vec<Sensor>,
}

impl Scenery {
    /// Sensors drawn from `seed`.
    pub(crate) fn new(seed: u64) -> Self {
        let sensors = (0..SENSORS)
            .map(|n| Sensor::from_seed(seed.wrapping_mul(SENSORS) + n, 1.0))
            .collect();
        Self { sensors }
    }

    /// The image of the people in `camera`, in random surroundings.
    pub(crate) fn paint(
        &self,
        moment: &TrainingMoment,
        camera: &CameraModel,
        rng: &mut ChaCha8Rng,
    ) -> RgbImage {
        let eye_m = camera.center().coordinates_m().coords;
        let surroundings = Surroundings::new(moment.field_m, &[eye_m], rng.random());
        let view = CameraView::of_camera(camera);
        let people = moment.people.iter().map(|person| Figure::Person {
            build: &person.build,
            moments: vec![person.volume.clone()],
        });
        let things = moment.things.iter().map(|(color, cone)| Figure::Thing {
            color: *color,
            moments: vec![vec![cone.clone()]],
        });
        let figures: Vec<_> = people.chain(things).collect();
        // Images larger than the crop are averaged by the crop.
        let [width, height] = camera.size_px();
        let samples = if width * height > MANY_PX { 1 } else { 2 };
        paint(&Shot {
            view: &view,
            backdrop: &Backdrop::new(&view, &surroundings, samples),
            light: surroundings.light(),
            figures: &figures,
            samples: 1 + samples,
            sensor: &self.sensors[rng.random_range(0..self.sensors.len())],
            noise_seed: rng.random(),
        })
    }
}
