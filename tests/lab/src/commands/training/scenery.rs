
use farfield_proto::camera::CameraModel;
use farfield_sim::render::{Backdrop, CameraView, Figure, Sensor, Shot, Surroundings, paint};
use image::RgbImage;
use rand::RngExt as _;
use rand_chacha::ChaCha8Rng;

use crate::commands::training::people::TrainingMoment;

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
