//! A small venue of kind `keypoints`: walkers seen by four cameras, written as the files that
//! `farfield run` reads, plus the truth.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use anyhow::Context as _;
use farfield_proto::camera::{CameraModel, Distortion, Intrinsics};
use farfield_proto::frames::Point;
use farfield_proto::keypoints::COCO17;
use nalgebra::Vector3;
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use serde_json::{Value, json};

use crate::look_at::look_at;
use crate::normal::box_muller;
use crate::scene::write::calibration_text;
use crate::walker::Walker;

/// The parameters of the simulation.
#[derive(Debug, Clone)]
pub struct KeypointVenue {
    /// Name of the venue.
    pub name: String,
    /// Rate, hertz.
    pub rate_hz: f64,
    /// Number of ticks.
    pub n_ticks: usize,
    /// The people.
    pub walkers: Vec<Walker>,
    /// One camera per viewpoint.
    pub cameras: Vec<CameraModel>,
    /// Standard deviation of a keypoint, pixels per axis.
    pub noise_px: f64,
    /// Share of keypoints that are not detected.
    pub missing: f64,
    /// Seed of every draw.
    pub seed: u64,
}

impl KeypointVenue {
    /// Two people on a hall floor of 8 m x 8 m, four cameras in the corners.
    ///
    /// # Errors
    /// Never for cameras as simple as these.
    pub fn two_walkers() -> anyhow::Result<Self> {
        let walkers = vec![
            Walker {
                center_m: [-0.6, 0.2],
                radius_m: 1.4,
                speed_m_s: 1.3,
                start_rad: 0.0,
                stature_m: 1.80,
            },
            Walker {
                center_m: [0.9, -0.3],
                radius_m: 1.1,
                speed_m_s: -1.1,
                start_rad: 2.0,
                stature_m: 1.66,
            },
        ];
        let cameras = four_corners(4.5, 2.6).context("the sample's own cameras")?;
        let name = "walk".to_owned();
        Ok(Self {
            name,
            rate_hz: 30.0,
            n_ticks: 120,
            walkers,
            cameras,
            noise_px: 2.0,
            missing: 0.03,
            seed: 7,
        })
    }

    /// Writes `venue.toml`, `calibration.toml`, one `.jsonl` per camera and `truth.jsonl` into
    /// `dir`.
    ///
    /// # Errors
    /// When a file cannot be written.
    pub fn write(&self, dir: &Path) -> anyhow::Result<()> {
        fs::create_dir_all(dir).with_context(|| format!("making {}", dir.display()))?;
        let write = |name: &str, text: String| {
            let path = dir.join(name);
            fs::write(&path, text).with_context(|| format!("writing {}", path.display()))
        };
        write("calibration.toml", self.calibration_text())?;
        write("venue.toml", self.venue_text())?;
        write("truth.jsonl", self.truth_text())?;
        for (index, camera) in self.cameras.iter().enumerate() {
            write(
                &format!("{}.jsonl", camera.name()),
                self.keypoints_text(index),
            )?;
        }
        Ok(())
    }

    fn venue_text(&self) -> String {
        let mut text = format!(
            "# People walking in a hall, seen by four cameras; a made-up recording of 2D keypoints.\n\
             name = \"{}\"\nrate_hz = {:.1}\ncalibration = \"calibration.toml\"\n\n\
             [field]\nmin_m = [-4.0, -4.0, -0.3]\nmax_m = [4.0, 4.0, 2.4]\n",
            self.name, self.rate_hz
        );
        for camera in &self.cameras {
            let name = camera.name();
            // Writing to a String cannot fail.
            let _infallible = write!(
                text,
                "\n[[viewpoint]]\nname = \"{name}\"\n[[viewpoint.camera]]\nname = \"{name}\"\n\
                 source = {{ kind = \"keypoints\", path = \"{name}.jsonl\" }}\n"
            );
        }
        text
    }

    /// The cameras in the calibration format.
    pub fn calibration_text(&self) -> String {
        calibration_text(&self.cameras)
    }

    fn truth_text(&self) -> String {
        let mut text = String::new();
        for tick in 0..self.n_ticks {
            for (index, walker) in self.walkers.iter().enumerate() {
                let points = walker.points_m(tick as f64 / self.rate_hz);
                let rounded =
                    |v: &Vector3<f64>| json!(v.iter().map(|c| round(*c, 1e5)).collect::<Vec<_>>());
                let named = |keep: &dyn Fn(&str) -> bool| -> BTreeMap<&str, Value> {
                    points
                        .iter()
                        .filter(|(n, _)| keep(n))
                        .map(|(n, v)| (n.as_str(), rounded(v)))
                        .collect()
                };
                let line = json!({
                    "tick": tick,
                    "person": index + 1,
                    "joints": named(&|_| true),
                    "keypoints": named(&|n| COCO17.contains(&n)),
                });
                let _infallible = writeln!(text, "{line}");
            }
        }
        text
    }

    fn keypoints_text(&self, camera_index: usize) -> String {
        let mut rng = ChaCha8Rng::seed_from_u64(
            self.seed
                .wrapping_mul(1000)
                .wrapping_add(camera_index as u64),
        );
        let camera = &self.cameras[camera_index];
        let mut text = String::new();
        for tick in 0..self.n_ticks {
            let persons: Vec<Value> = self
                .walkers
                .iter()
                .map(|walker| {
                    let points = walker.points_m(tick as f64 / self.rate_hz);
                    let keypoints: Vec<Value> = COCO17
                        .iter()
                        .map(|n| self.candidate(camera, points[*n], &mut rng))
                        .collect();
                    json!({ "keypoints": keypoints })
                })
                .collect();
            let _infallible = writeln!(text, "{}", json!({ "tick": tick, "persons": persons }));
        }
        text
    }

    fn candidate(
        &self,
        camera: &CameraModel,
        point_m: Vector3<f64>,
        rng: &mut ChaCha8Rng,
    ) -> Value {
        // Always drawn, so that a hidden keypoint does not change later draws.
        let (missing, noise) = (rng.random::<f64>(), [gaussian(rng), gaussian(rng)]);
        let score = round(rng.random_range(0.6..0.95), 100.0);
        let seen = camera
            .project(Point::new(point_m.into()))
            .filter(|p| camera.sees(*p))
            .and_then(|p| camera.distort(p));
        match seen {
            Some(p) if missing >= self.missing => {
                json!([
                    round(p.x() + self.noise_px * noise[0], 10.0),
                    round(p.y() + self.noise_px * noise[1], 10.0),
                    score
                ])
            }
            _ => Value::Null,
        }
    }
}

/// Four cameras in the corners of a square that look at its middle at hip height.
fn four_corners(half_side_m: f64, height_m: f64) -> anyhow::Result<Vec<CameraModel>> {
    let corners = [
        ("north-east", 1.0, 1.0),
        ("north-west", -1.0, 1.0),
        ("south-west", -1.0, -1.0),
        ("south-east", 1.0, -1.0),
    ];
    let looks = corners.map(|(name, x, y)| {
        let eye = Vector3::new(x * half_side_m, y * half_side_m, height_m);
        let intrinsics = Intrinsics {
            fx_px: 1050.0,
            fy_px: 1050.0,
            cx_px: 959.5,
            cy_px: 599.5,
        };
        let distortion = Distortion {
            k1: -0.08,
            k2: 0.02,
            ..Distortion::default()
        };
        CameraModel::new(
            name,
            [1920, 1200],
            intrinsics,
            distortion,
            look_at(eye, Vector3::new(0.0, 0.0, 0.9)),
        )
    });
    looks
        .into_iter()
        .collect::<Result<_, _>>()
        .map_err(Into::into)
}

fn gaussian(rng: &mut ChaCha8Rng) -> f64 {
    let (u, v): (f64, f64) = (rng.random_range(1e-12..1.0), rng.random());
    box_muller(u, v, 1.0)[0]
}

fn round(value: f64, per_unit: f64) -> f64 {
    (value * per_unit).round() / per_unit
}
