//! Stored observations: what the maps of one camera contain at one tick, in image pixels.

use std::sync::Arc;

use farfield_proto::camera::CameraModel;
use nalgebra::Vector2;
use serde::{Deserialize, Serialize};

use super::observe::{ImagedPerson, KeypointPeaks, MapObservation, SimulatedPeak};
use super::streams::N_KEYPOINTS;

/// Highest accepted peak: a mirrored peak may exceed the true one, which is at most 1.
const MAX_HEIGHT: f32 = 16.0;

/// The content of one camera's maps at one tick, without the camera.
///
/// Positions are f32: maps painted from it differ from the original by at most one step in some
/// cells.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StoredMapObservation {
    people: Vec<StoredPerson>,
    noise: f32,
    noise_key: u64,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct StoredPerson {
    person: u16,
    torso_px: [f32; 2],
    neck_px: [f32; 2],
    keypoints: [StoredEvidence; N_KEYPOINTS],
}

#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
struct StoredEvidence {
    own: Option<StoredPeak>,
    mirrored: Option<StoredPeak>,
    leaked: Option<StoredPeak>,
    in_the_open: bool,
}

/// Undistorted pixels and height.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
struct StoredPeak([f32; 3]);

impl StoredMapObservation {
    /// Stores `observation`.
    pub fn new(observation: &MapObservation) -> Self {
        Self {
            people: observation.people.iter().map(StoredPerson::new).collect(),
            noise: observation.noise as f32,
            noise_key: observation.noise_key,
        }
    }

    /// Checks every number.
    ///
    /// # Errors
    /// A short description of an impossible value.
    pub fn check(&self) -> Result<(), &'static str> {
        if !(0.0..=1.0).contains(&self.noise) {
            return Err("noise outside 0 to 1");
        }
        self.people
            .iter()
            .try_for_each(|person| person.restore().map(drop))
    }

    /// The maps that `camera` observed `capture_offset_us` after the time of the tick.
    ///
    /// # Errors
    /// A short description of an impossible value.
    pub fn restore(
        &self,
        camera: &Arc<CameraModel>,
        capture_offset_us: i32,
    ) -> Result<MapObservation, &'static str> {
        if !(0.0..=1.0).contains(&self.noise) {
            return Err("noise outside 0 to 1");
        }
        let people: Result<_, _> = self.people.iter().map(StoredPerson::restore).collect();
        Ok(MapObservation {
            camera: Arc::clone(camera),
            capture_offset_us,
            people: people?,
            noise: f64::from(self.noise),
            noise_key: self.noise_key,
        })
    }
}

impl StoredPerson {
    fn new(seen: &ImagedPerson) -> Self {
        Self {
            person: seen.person as u16,
            torso_px: stored_px(seen.torso_px),
            neck_px: stored_px(seen.neck_px),
            keypoints: seen.keypoints.map(|evidence| StoredEvidence {
                own: evidence.own.map(StoredPeak::new),
                mirrored: evidence.mirrored.map(StoredPeak::new),
                leaked: evidence.leaked.map(StoredPeak::new),
                in_the_open: evidence.in_the_open,
            }),
        }
    }

    fn restore(&self) -> Result<ImagedPerson, &'static str> {
        let mut keypoints = [KeypointPeaks::default(); N_KEYPOINTS];
        for (evidence, stored) in keypoints.iter_mut().zip(&self.keypoints) {
            let restore = |peak: Option<StoredPeak>| peak.map(StoredPeak::restore).transpose();
            *evidence = KeypointPeaks {
                own: restore(stored.own)?,
                mirrored: restore(stored.mirrored)?,
                leaked: restore(stored.leaked)?,
                in_the_open: stored.in_the_open,
            };
        }
        Ok(ImagedPerson {
            person: usize::from(self.person),
            torso_px: restored_px(self.torso_px)?,
            neck_px: restored_px(self.neck_px)?,
            keypoints,
        })
    }
}

impl StoredPeak {
    fn new(peak: SimulatedPeak) -> Self {
        let [x, y] = stored_px(peak.at_px);
        Self([x, y, peak.height as f32])
    }

    fn restore(self) -> Result<SimulatedPeak, &'static str> {
        let [x, y, height] = self.0;
        if !(0.0..=MAX_HEIGHT).contains(&height) {
            return Err("a peak of an impossible height");
        }
        Ok(SimulatedPeak {
            at_px: restored_px([x, y])?,
            height: f64::from(height),
        })
    }
}

fn stored_px(px: Vector2<f64>) -> [f32; 2] {
    [px.x as f32, px.y as f32]
}

fn restored_px(px: [f32; 2]) -> Result<Vector2<f64>, &'static str> {
    if px.iter().all(|v| v.is_finite()) {
        Ok(Vector2::from(px.map(f64::from)))
    } else {
        Err("a place that is not finite")
    }
}
