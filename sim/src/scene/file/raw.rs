//! The tables of a scene file as in TOML.

use serde::Deserialize;
use serde::de::IgnoredAny;

use super::entries::{GeneratedCameras, LostEntry, MirrorEntry, PathEntry};
use crate::fault_profile::FaultProfile;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SceneTable {
    pub(super) rate_hz: f64,
    pub(super) seconds: f64,
    #[serde(default)]
    pub(super) seed: u64,
    pub(super) size_m: [f64; 2],
    #[serde(default)]
    pub(super) floor_m: f64,
    pub(super) cameras: Option<GeneratedCameras>,
    pub(super) calibration: Option<String>,
    #[serde(default)]
    pub(super) viewpoint: Vec<ViewpointTable>,
    #[serde(default)]
    pub(super) person: Vec<PersonTable>,
    #[serde(default)]
    pub(super) mirror: Vec<MirrorEntry>,
    #[serde(default)]
    pub(super) poster: Vec<PosterTable>,
    #[serde(default)]
    pub(super) lost: Vec<LostEntry>,
    pub(super) ball: Option<BallTable>,
    #[serde(default)]
    pub(super) faults: FaultProfile,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct ViewpointTable {
    pub(super) name: String,
    #[serde(default)]
    pub(super) camera: Vec<CameraTable>,
}

/// As in a venue file, but without a source, because a scene makes its own frames.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct CameraTable {
    pub(super) name: String,
    #[serde(default, rename = "source")]
    pub(super) _source: IgnoredAny,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct BallTable {}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct PersonTable {
    pub(super) name: String,
    pub(super) clips: Vec<String>,
    #[serde(default = "default_blend_s")]
    pub(super) blend_s: f64,
    #[serde(default)]
    pub(super) at_m: [f64; 2],
    #[serde(default)]
    pub(super) heading_rad: f64,
    pub(super) height_m: f64,
    #[serde(default = "default_keep_inside")]
    pub(super) keep_inside: bool,
    pub(super) group: Option<String>,
    #[serde(default)]
    pub(super) enter_s: f64,
    pub(super) leave_s: Option<f64>,
    pub(super) path: Option<PathEntry>,
    pub(super) seen_by: Option<Vec<String>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct PosterTable {
    pub(super) at_m: [f64; 2],
    pub(super) heading_rad: f64,
    pub(super) height_m: f64,
    pub(super) clip: String,
    #[serde(default)]
    pub(super) time_s: f64,
}

fn default_blend_s() -> f64 {
    0.3
}

fn default_keep_inside() -> bool {
    true
}
