//! How the cameras of a venue agree, as fusion finds it.

use serde::{Deserialize, Serialize};

use super::live::MAX_EDGES;
use crate::id::CameraIndex;
use crate::printed::signed;
use crate::wire::MAX_CAMERAS;

/// Most cameras in one status: all that a venue may have.
pub const MAX_AGREEMENTS: usize = MAX_EDGES * MAX_CAMERAS;

/// How one camera agrees with the others.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct CameraAgreement {
    /// What is to be thought of it.
    pub verdict: AgreementVerdict,
    /// Keypoints that were compared with those of other cameras.
    pub keypoints: u64,
    /// How far its lines of sight pass those of the camera that it agrees with best, millimetres: the median; `None`
    /// where nothing could be compared, or most lines would meet behind a camera.
    pub distance_mm: Option<f32>,
    /// The same in its picture, pixels.
    pub distance_px: Option<f32>,
    /// By how many ticks its pictures are late (negative: early) against those of the others; `None` where nothing
    /// moved enough to tell.
    pub late_ticks: Option<f32>,
}

/// What is to be thought of a camera.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum AgreementVerdict {
    /// Nothing could be compared.
    #[default]
    Unknown,
    /// It shows what the others show.
    Agrees,
    /// It does not.
    Disagrees,
}

/// How a camera of the venue agrees, in fusion's status.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct AgreementOfCamera {
    /// Which.
    pub camera: CameraIndex,
    /// How.
    pub agreement: CameraAgreement,
}

impl CameraAgreement {
    /// Whether anything is known of it.
    pub fn is_known(&self) -> bool {
        self.keypoints > 0 || self.verdict != AgreementVerdict::Unknown
    }

    /// It in a few words, for people.
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
/// What is wrong, in a few words.
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
        Err("a number that is none")
    }
}
