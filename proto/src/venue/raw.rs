//! The venue file as parsed, before the checks.

use std::collections::BTreeMap;

use serde::Deserialize;

use super::inference::RawInference;
use super::parameters::{
    BirthUser, BoxUser, LinkUser, RangeOfMotionUser, RecordingUser, SmoothingUser, TuningTables,
};
use super::source::RawSource;

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawVenue {
    pub(super) name: String,
    pub(super) rate_hz: f64,
    #[serde(default)]
    pub(super) first_tick: i64,
    pub(super) calibration: String,
    pub(super) network: Option<String>,
    pub(super) detector: Option<String>,
    pub(super) keypoints: Option<String>,
    #[serde(default)]
    pub(super) inference: RawInference,
    #[serde(default)]
    pub(super) fusion: RawFusion,
    #[serde(default)]
    pub(super) security: RawSecurity,
    pub(super) field: Option<RawField>,
    #[serde(default)]
    pub(super) viewpoint: Vec<RawViewpoint>,
    #[serde(default)]
    pub(super) person: Vec<RawPerson>,
    #[serde(default)]
    pub(super) stream: Vec<RawStream>,
    #[serde(default)]
    pub(super) subject: Vec<RawSubject>,
    #[serde(default)]
    pub(super) smoothing: SmoothingUser,
    #[serde(default)]
    pub(super) range_of_motion: RangeOfMotionUser,
    #[serde(default)]
    pub(super) boxes: BoxUser,
    #[serde(default)]
    pub(super) births: BirthUser,
    #[serde(default)]
    pub(super) link: LinkUser,
    #[serde(default)]
    pub(super) recording: RecordingUser,
    #[serde(default)]
    pub(super) tuning: TuningTables,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct RawFusion {
    pub(super) listen: Vec<String>,
    pub(super) connect: Vec<String>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct RawSecurity {
    pub(super) certificates: Option<String>,
    pub(super) allow_plaintext: bool,
    pub(super) pictures: bool,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawField {
    pub(super) min_m: Option<[f64; 3]>,
    pub(super) max_m: Option<[f64; 3]>,
    pub(super) floor_m: Option<f64>,
    pub(super) court: Option<String>,
    pub(super) court_size_m: Option<[f64; 2]>,
    pub(super) court_centre_m: Option<[f64; 2]>,
    pub(super) court_turn_deg: Option<f64>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawViewpoint {
    pub(super) name: String,
    pub(super) providers: Option<Vec<String>>,
    #[serde(default)]
    pub(super) camera: Vec<RawCamera>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawCamera {
    pub(super) name: String,
    pub(super) source: RawSource,
    pub(super) tick_from: Option<String>,
    pub(super) capture_delay_ms: Option<f64>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawPerson {
    pub(super) tick: i64,
    pub(super) keypoints_m: BTreeMap<String, [f64; 3]>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawStream {
    pub(super) to: String,
    pub(super) address: Option<String>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawSubject {
    pub(super) profile: Option<String>,
    pub(super) name: Option<String>,
    pub(super) stature_m: Option<f64>,
}
