//! The cameras, people and objects of a scene file, and its tables as in TOML.

use std::path::PathBuf;

use serde::Deserialize;
use serde::de::IgnoredAny;

use crate::fault_profile::FaultProfile;

/// The origin of a scene's cameras.
#[derive(Debug, Clone)]
pub enum CameraSource {
    /// Generated for the field.
    Generated(GeneratedCameras),
    /// A calibration file and its viewpoints, as in a venue.
    Calibrated {
        /// The calibration file.
        calibration: PathBuf,
        /// Name of every viewpoint, with the names of its cameras.
        viewpoints: Vec<(String, Vec<String>)>,
    },
}

/// The table `[cameras]`.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GeneratedCameras {
    /// Number of viewpoints: corners first, then evenly along the edge.
    pub viewpoints: usize,
    /// Cameras per viewpoint; together they cover the field.
    pub per_viewpoint: usize,
    /// Height of the cameras above the floor, metres.
    #[serde(default = "default_height_m")]
    pub height_m: f64,
    /// Distance of the cameras from the edge of the field, metres.
    #[serde(default = "default_setback_m")]
    pub setback_m: f64,
    /// Width and height of the images, pixels.
    #[serde(default = "default_size_px")]
    pub size_px: [u32; 2],
    /// k1 to k4 of OpenCV's fisheye model; `None` for ordinary lenses.
    #[serde(default)]
    pub fisheye: Option<[f64; 4]>,
    /// Names of the viewpoints with `fisheye` lenses; `None`: all.
    #[serde(default)]
    pub fisheye_viewpoints: Option<Vec<String>>,
}

impl GeneratedCameras {
    /// The fisheye coefficients of the viewpoint `name`; `None` for ordinary lenses.
    pub fn fisheye_of(&self, name: &str) -> Option<[f64; 4]> {
        let named = |names: &Vec<String>| names.iter().any(|it| it == name);
        self.fisheye
            .filter(|_| self.fisheye_viewpoints.as_ref().is_none_or(named))
    }
}

/// One person.
#[derive(Debug, Clone)]
pub struct PersonEntry {
    /// Name, unique in the scene.
    pub name: String,
    /// Motion clips in playing order.
    pub clips: Vec<PathBuf>,
    /// Duration of the blend from one clip into the next, seconds.
    pub blend_s: f64,
    /// Position of the pelvis at the start, metres.
    pub at_m: [f64; 2],
    /// Heading at the start, from +x towards +y, radians.
    pub heading_rad: f64,
    /// Stature, metres.
    pub height_m: f64,
    /// Whether the person is turned back into the field.
    pub keep_inside: bool,
    /// People of one group share their clips' coordinate frame.
    pub group: Option<String>,
    /// Time of the first appearance, seconds.
    pub enter_s: f64,
    /// End of the presence, seconds.
    pub leave_s: f64,
    /// The path to walk; `None`: the clips' own motion.
    pub path: Option<PathEntry>,
    /// Names of the only viewpoints that see the person, as behind glass; `None`: all.
    pub seen_by: Option<Vec<String>>,
}

/// A path, walked to its end and back again, repeatedly.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PathEntry {
    /// Corners, metres on the floor.
    pub points_m: Vec<[f64; 2]>,
    /// Speed along the path, metres per second; at 0 the person stands at the first point.
    pub speed_m_s: f64,
}

/// A mirror in the file.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MirrorEntry {
    /// The lower right corner for a viewer in front of the mirror, metres on the floor.
    pub from_m: [f64; 2],
    /// The lower left corner, metres on the floor.
    pub to_m: [f64; 2],
    /// Height above the floor, metres.
    pub height_m: f64,
}

/// A poster in the file, before its clip is read.
#[derive(Debug, Clone)]
pub struct PosterEntry {
    /// Position of the pelvis, metres on the floor.
    pub at_m: [f64; 2],
    /// Direction of the printed side, from +x towards +y, radians.
    pub heading_rad: f64,
    /// Stature of the printed person, metres.
    pub height_m: f64,
    /// The motion clip of the printed posture.
    pub clip: PathBuf,
    /// Time in the clip, seconds.
    pub time_s: f64,
}

/// One person or all people, hidden from all but some viewpoints for a while.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LostEntry {
    /// Name of the person; `None`: all people.
    pub person: Option<String>,
    /// Start, seconds.
    pub from_s: f64,
    /// End, seconds.
    pub until_s: f64,
    /// The viewpoints that still see the person.
    #[serde(default)]
    pub except: Vec<String>,
}

fn default_height_m() -> f64 {
    2.5
}

fn default_setback_m() -> f64 {
    1.5
}

fn default_size_px() -> [u32; 2] {
    [1920, 1200]
}

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
