//! The agreement of a venue's cameras, as estimated by fusion.

use serde::{Deserialize, Serialize};

use super::live::MAX_EDGES;
use crate::id::CameraIndex;
use crate::printed::signed;
use crate::wire::MAX_CAMERAS;

/// Largest number of cameras in one status: the maximum of a venue.
pub const MAX_AGREEMENTS: usize = MAX_EDGES * MAX_CAMERAS;

/// The agreement of one camera with the others.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct CameraAgreement {
    /// The verdict.
    pub verdict: AgreementVerdict,
    /// Keypoints compared with those of other cameras.
    pub keypoints: u64,
    /// Median distance of its lines of sight from those of the camera with the best agreement,
    /// millimetres. `None` without comparisons, or if most lines would meet behind a camera.
    pub distance_mm: Option<f32>,
    /// The same in its picture, pixels.
    pub distance_px: Option<f32>,
    /// Delay of its pictures relative to the other cameras, ticks (negative: early); `None` without
    /// enough motion for an estimate.
    pub late_ticks: Option<f32>,
}

/// The verdict about a camera.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum AgreementVerdict {
    /// Nothing could be compared.
    #[default]
    Unknown,
    /// It agrees with the other cameras.
    Agrees,
    /// It contradicts them.
    Disagrees,
}

/// The agreement of one camera, in fusion's status.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct AgreementOfCamera {
    /// The camera.
    pub camera: CameraIndex,
    /// Its agreement.
    pub agreement: CameraAgreement,
}

impl CameraAgreement {
    /// Whether there is an estimate.
    pub fn is_known(&self) -> bool {
        self.keypoints > 0 || self.verdict != AgreementVerdict::Unknown
    }

    /// A short description for people.
    pub fn words(&self) -> String {
        let verdict = match self.verdict {
            AgreementVerdict::Unknown => "could not be compared",
            AgreementVerdict::Agrees => "agrees with the others",
            AgreementVerdict::Disagrees => "DISAGREES with the others",
        };
        let apart = match (self.distance_mm, self.distance_px) {
            (Some(mm), Some(px)) => format!(": {mm:.0} mm, {px:.0} px apart at the median"),
            _ => String::new(),
        };
        let late = self.late_ticks.filter(|late| late.abs() >= 0.05);
        let late = late.map_or_else(String::new, |late| {
            format!(", {} ticks late", signed(f64::from(late), 1))
        });
        format!("{verdict}{apart}{late}")
    }
}

/// Checks counts and numbers.
///
/// # Errors
/// A short description of the problem.
pub(super) fn check(cameras: &[AgreementOfCamera]) -> Result<(), &'static str> {
    if cameras.len() > MAX_AGREEMENTS {
        return Err("more cameras than a venue may have");
    }
    let numbers = cameras.iter().flat_map(|camera| {
        let it = camera.agreement;
        [it.distance_mm, it.distance_px, it.late_ticks]
    });
    if numbers.flatten().all(f32::is_finite) {
        Ok(())
    } else {
        Err("a number that is not finite")
    }
}
