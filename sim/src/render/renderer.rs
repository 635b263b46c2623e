//! Paints one camera of a scene at any time.

use std::sync::Arc;

use farfield_edge::crop::CropGeometry;
use image::RgbImage;
use nalgebra::Vector3;

use super::backdrop::Backdrop;
use super::figure::{Figure, Print};
use super::grain;
use super::paint::{Shot, paint};
use super::place::Surroundings;
use super::sensor::Sensor;
use super::view::CameraView;
use crate::body::{BodyPart, Build, Cone, Volume};
use crate::scene::{BALL_RADIUS_M, Scene, ViewpointMask};

/// Reflectance of the ball.
const BALL: [f32; 3] = [0.85, 0.55, 0.1];

/// Settings of rendering.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RenderSettings {
    /// Exposure time, seconds, centred on the time of a picture.
    pub shutter_s: f64,
    /// Positions of the people during the exposure, from 1.
    pub moments: usize,
    /// Rays per pixel where people are, from 1; spread over the moments.
    pub samples: usize,
    /// Scale of the sensor's noise, 0 for none.
    pub noise: f32,
}

impl Default for RenderSettings {
    /// An exposure of 4 ms, and four rays a pixel.
    fn default() -> Self {
        Self {
            shutter_s: 0.004,
            moments: 4,
            samples: 4,
            noise: 1.0,
        }
    }
}

/// Paints the pictures of one camera of a scene. Mirrors are not painted.
#[derive(Debug)]
pub struct Renderer {
    scene: Arc<Scene>,
    camera: usize,
    settings: RenderSettings,
    surroundings: Surroundings,
    view: CameraView,
    backdrop: Backdrop,
    sensor: Sensor,
    builds: Vec<Build>,
    /// The posters that face the camera.
    prints: Vec<Print>,
    /// The camera's viewpoint as a bit.
    viewpoint: ViewpointMask,
}

impl Renderer {
    /// A renderer for camera `camera` of the scene. It paints the backdrop, which takes about a
    /// second. `None` for an unknown camera.
    pub fn new(scene: Arc<Scene>, camera: usize, settings: RenderSettings) -> Option<Self> {
        let model = scene.cameras().get(camera)?;
        let eyes: Vec<_> = scene
            .cameras()
            .iter()
            .map(|c| c.center().coordinates_m().coords)
            .collect();
        let surroundings = Surroundings::new(scene.size_m(), &eyes, scene.seed());
        let view = CameraView::of_camera(model);
        let mut backdrop = Backdrop::new(&view, &surroundings, settings.samples.max(1));
        let sensor = Sensor::from_seed(grain::hash(scene.seed()) ^ camera as u64, settings.noise);
        backdrop.expose(&sensor);
        let builds = scene
            .people()
            .iter()
            .map(|p| Build::from_seed(p.stature_m, p.build_seed))
            .collect();
        let eye_m = model.center().coordinates_m().coords;
        let prints = scene.posters().iter().map(Print::new);
        let prints = prints.filter(|print| print.faces(&eye_m)).collect();
        let mut viewpoints = scene.viewpoints().iter();
        let viewpoint = viewpoints.position(|v| v.cameras.contains(&camera))?;
        Some(Self {
            prints,
            viewpoint: 1 << viewpoint,
            scene,
            camera,
            settings,
            surroundings,
            view,
            backdrop,
            sensor,
            builds,
        })
    }

    /// The picture whose exposure is centred on `time_s`: distorted pixels, full size.
    pub fn render(&self, time_s: f64) -> RgbImage {
        self.paint(&self.view, &self.backdrop, time_s)
    }

    /// The content of [`Self::render`], resampled to a network's input without painting the rest.
    /// `None` for an unknown camera, which is impossible after [`Self::new`].
    pub fn render_crop(&self, time_s: f64, geometry: &CropGeometry) -> Option<RgbImage> {
        let view = CameraView::of_crop(self.scene.cameras().get(self.camera)?, geometry);
        let backdrop = Backdrop::new(&view, &self.surroundings, 2);
        Some(self.paint(&view, &backdrop, time_s))
    }

    fn paint(&self, view: &CameraView, backdrop: &Backdrop, time_s: f64) -> RgbImage {
        let figures = self.figures(time_s);
        // Microseconds distinguish any two ticks.
        let moment = (time_s * 1e6).round() as i64 as u64;
        paint(&Shot {
            view,
            backdrop,
            light: self.surroundings.light(),
            figures: &figures,
            samples: self.settings.samples,
            sensor: &self.sensor,
            noise_seed: grain::hash(self.scene.seed() ^ grain::hash(moment)) ^ self.camera as u64,
        })
    }

    /// All people at the moments of the exposure. A person who enters or leaves meanwhile is
    /// present for all of it or none of it.
    fn figures(&self, time_s: f64) -> Vec<Figure<'_>> {
        let n = self.settings.moments.max(1);
        let times: Vec<f64> = (0..n)
            .map(|i| time_s + self.settings.shutter_s * ((i as f64 + 0.5) / n as f64 - 0.5))
            .collect();
        let mut figures: Vec<_> = self
            .builds
            .iter()
            .enumerate()
            .filter_map(|(person, build)| {
                if self.scene.seen_by(person, time_s) & self.viewpoint == 0 {
                    return None;
                }
                let now = self.scene.person_at(person, time_s)?;
                let at = |&t: &f64| {
                    let truth = self.scene.person_at(person, t);
                    Volume::new(truth.as_ref().map_or(&now.joints_m, |p| &p.joints_m), build)
                };
                Some(Figure::Person {
                    build,
                    moments: times.iter().map(at).collect(),
                })
            })
            .collect();
        figures.extend(self.prints.iter().map(Figure::Print));
        let balls: Option<Vec<_>> = times
            .iter()
            .map(|&t| Some(vec![ball(self.scene.ball_at(t)?)]))
            .collect();
        figures.extend(balls.map(|moments| Figure::Thing {
            color: BALL,
            moments,
        }));
        figures
    }
}

fn ball(center_m: Vector3<f64>) -> Cone {
    Cone::round(BodyPart::Thing, [center_m; 2], [BALL_RADIUS_M; 2])
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::embedded::CLIPS;
    use crate::motion::Clip;

    /// The pictures of two opposite viewpoints at 0 s and 1 s, of a field with `added`.
    fn pictures(added: &str) -> [[RgbImage; 2]; 2] {
        let text = format!(
            "rate_hz = 60\nseconds = 2\nsize_m = [5, 5]\n\
             [cameras]\nviewpoints = 2\nper_viewpoint = 1\nsize_px = [240, 150]\n{added}"
        );
        let idle = CLIPS.iter().find(|(name, _)| *name == "idle").unwrap();
        let clip = &mut |path: &Path| Ok(Arc::new(Clip::parse(idle.1, path)?));
        let scene = Arc::new(Scene::parse(&text, Path::new("a.toml"), clip).unwrap());
        let settings = RenderSettings {
            noise: 0.0,
            ..RenderSettings::default()
        };
        ["north-east", "south-west"].map(|name| {
            let mut viewpoints = scene.viewpoints().iter();
            let camera = viewpoints.find(|v| v.name == name).unwrap().cameras[0];
            let renderer = Renderer::new(Arc::clone(&scene), camera, settings).unwrap();
            [0.0, 1.0].map(|time_s| renderer.render(time_s))
        })
    }

    fn differing(a: &RgbImage, b: &RgbImage) -> usize {
        a.pixels().zip(b.pixels()).filter(|(a, b)| a != b).count()
    }

    #[test]
    fn a_poster_is_visible_from_the_front_and_never_changes() {
        let empty = pictures("");
        // It faces north-east.
        let poster = "[[poster]]\nat_m = [0, 0]\nheading_rad = 0.785\nheight_m = 1.8\n\
                      clip = \"idle.bvh\"\n";
        let [before, behind] = pictures(poster);
        let painted = differing(&before[0], &empty[0][0]);
        assert!(painted > 200, "{painted} pixels");
        assert_eq!(differing(&before[0], &before[1]), 0);
        assert_eq!(differing(&behind[0], &empty[1][0]), 0);
    }

    #[test]
    fn a_lost_person_is_painted_only_for_the_exceptions() {
        let person = "[[person]]\nname = \"1\"\nclips = [\"idle.bvh\"]\nheight_m = 1.8\n\
                      [[lost]]\nperson = \"1\"\nfrom_s = 0.5\nuntil_s = 2\n\
                      except = [\"north-east\"]\n";
        let (seen, empty) = (pictures(person), pictures(""));
        for (second, expected) in [[true, true], [true, false]].into_iter().enumerate() {
            let is_painted = [0, 1].map(|v| differing(&seen[v][second], &empty[v][second]) > 200);
            assert_eq!(is_painted, expected, "at {second} s");
        }
    }
}
