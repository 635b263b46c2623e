//! Observations as they are kept in a file: what one camera's maps hold at one tick, in image pixels.

use std::sync::Arc;

use farfield_proto::camera::CameraModel;
use nalgebra::Vector2;
use serde::{Deserialize, Serialize};

use super::observe::{ImagedPerson, KeypointPeaks, MapObservation, SimulatedPeak};
use super::streams::N_KEYPOINTS;

/// Highest peak that is read: a mirrored one may be higher than the true one, which is at most 1.
const MAX_HEIGHT: f32 = 16.0;

/// What one camera's maps hold at one tick, apart from the camera. Places are f32: what is painted
/// from it differs from the original by at most a step of a cell's value here and there.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct KeptMapObservation {
    people: Vec<KeptPerson>,
    noise: f32,
    noise_key: u64,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct KeptPerson {
    person: u16,
    torso_px: [f32; 2],
    neck_px: [f32; 2],
    keypoints: [KeptEvidence; N_KEYPOINTS],
}

#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
struct KeptEvidence {
    own: Option<KeptPeak>,
    mirrored: Option<KeptPeak>,
    leaked: Option<KeptPeak>,
    in_the_open: bool,
}

/// Undistorted pixels and height.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
struct KeptPeak([f32; 3]);

impl KeptMapObservation {
    /// What is kept of `observation`.
    pub fn new(observation: &MapObservation) -> Self {
        Self {
            people: observation.people.iter().map(KeptPerson::new).collect(),
            noise: observation.noise as f32,
            noise_key: observation.noise_key,
        }
    }

    /// Checks every number.
    ///
    /// # Errors
    /// In a few words, what no observation can hold.
    pub fn check(&self) -> Result<(), &'static str> {
        if !(0.0..=1.0).contains(&self.noise) {
            return Err("noise outside 0 to 1");
        }
        self.people
            .iter()
            .try_for_each(|person| person.restore().map(drop))
    }

    /// The maps that `camera` saw, `capture_offset_us` after the tick's time.
    ///
    /// # Errors
    /// In a few words, what no observation can hold.
    pub fn restore(
        &self,
        camera: &Arc<CameraModel>,
        capture_offset_us: i32,
    ) -> Result<MapObservation, &'static str> {
        if !(0.0..=1.0).contains(&self.noise) {
            return Err("noise outside 0 to 1");
        }
        let people: Result<_, _> = self.people.iter().map(KeptPerson::restore).collect();
        Ok(MapObservation {
            camera: Arc::clone(camera),
            capture_offset_us,
            people: people?,
            noise: f64::from(self.noise),
            noise_key: self.noise_key,
        })
    }
}

impl KeptPerson {
    fn new(seen: &ImagedPerson) -> Self {
        Self {
            person: seen.person as u16,
            torso_px: kept_px(seen.torso_px),
            neck_px: kept_px(seen.neck_px),
            keypoints: seen.keypoints.map(|evidence| KeptEvidence {
                own: evidence.own.map(KeptPeak::new),
                mirrored: evidence.mirrored.map(KeptPeak::new),
                leaked: evidence.leaked.map(KeptPeak::new),
                in_the_open: evidence.in_the_open,
            }),
        }
    }

    fn restore(&self) -> Result<ImagedPerson, &'static str> {
        let mut keypoints = [KeypointPeaks::default(); N_KEYPOINTS];
        for (evidence, kept) in keypoints.iter_mut().zip(&self.keypoints) {
            let restore = |peak: Option<KeptPeak>| peak.map(KeptPeak::restore).transpose();
            *evidence = KeypointPeaks {
                own: restore(kept.own)?,
                mirrored: restore(kept.mirrored)?,
                leaked: restore(kept.leaked)?,
                in_the_open: kept.in_the_open,
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

impl KeptPeak {
    fn new(peak: SimulatedPeak) -> Self {
        let [x, y] = kept_px(peak.at_px);
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

fn kept_px(px: Vector2<f64>) -> [f32; 2] {
    [px.x as f32, px.y as f32]
}

fn restored_px(px: [f32; 2]) -> Result<Vector2<f64>, &'static str> {
    if px.iter().all(|v| v.is_finite()) {
        Ok(Vector2::from(px.map(f64::from)))
    } else {
        Err("a place that is not finite")
    }
}
