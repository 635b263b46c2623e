//! What a scene file says of each camera, person and thing.

use std::path::PathBuf;

use serde::Deserialize;

/// Where the cameras of a scene come from.
#[derive(Debug, Clone)]
pub enum CameraSource {
    /// Made for the field.
    Generated(GeneratedCameras),
    /// A calibration file and who stands where, as in a venue.
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
    /// Cameras of each viewpoint; together they cover the field.
    pub per_viewpoint: usize,
    /// Height of the cameras above the floor, metres.
    #[serde(default = "default_height_m")]
    pub height_m: f64,
    /// How far outside the field's edge they stand, metres.
    #[serde(default = "default_setback_m")]
    pub setback_m: f64,
    /// Width and height of their images, pixels.
    #[serde(default = "default_size_px")]
    pub size_px: [u32; 2],
    /// k1 to k4 of OpenCV's fisheye model, where they have such lenses.
    #[serde(default)]
    pub fisheye: Option<[f64; 4]>,
    /// Names of the viewpoints whose cameras have `fisheye` lenses; all of them where it is left out.
    #[serde(default)]
    pub fisheye_viewpoints: Option<Vec<String>>,
}

impl GeneratedCameras {
    /// The coefficients of the fisheyes of the viewpoint `name`; `None` where its cameras have ordinary lenses.
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
    /// Motion clips in the order in which they are played.
    pub clips: Vec<PathBuf>,
    /// How long one clip blends into the next, seconds.
    pub blend_s: f64,
    /// Where the pelvis is at first, metres.
    pub at_m: [f64; 2],
    /// Where it faces at first, from +x towards +y, radians.
    pub heading_rad: f64,
    /// Stature, metres.
    pub height_m: f64,
    /// Whether its way is turned back into the field.
    pub keep_inside: bool,
    /// People of one group share their clips' coordinate frame.
    pub group: Option<String>,
    /// When it appears, seconds.
    pub enter_s: f64,
    /// When it is gone, seconds.
    pub leave_s: f64,
    /// What it walks along instead of the clip's own way.
    pub path: Option<PathEntry>,
    /// Names of the only viewpoints that see it, as behind glass; `None`: all.
    pub seen_by: Option<Vec<String>>,
}

/// A path, walked to its end and back again.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PathEntry {
    /// Corners, metres on the floor.
    pub points_m: Vec<[f64; 2]>,
    /// Speed along it, metres per second; 0 stands at the first point.
    pub speed_m_s: f64,
}

/// A mirror as it is written.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MirrorEntry {
    /// The lower corner on the right of whoever looks into it, metres on the floor.
    pub from_m: [f64; 2],
    /// The one on the left.
    pub to_m: [f64; 2],
    /// How high it reaches from the floor, metres.
    pub height_m: f64,
}

/// A poster as it is written, its clip not yet read.
#[derive(Debug, Clone)]
pub struct PosterEntry {
    /// Where the pelvis is, metres on the floor.
    pub at_m: [f64; 2],
    /// Where the picture faces, from +x towards +y, radians.
    pub heading_rad: f64,
    /// Stature of who is in it, metres.
    pub height_m: f64,
    /// The motion clip that it is taken from.
    pub clip: PathBuf,
    /// When in the clip, seconds.
    pub time_s: f64,
}

/// A person, or everybody, lost to all but some viewpoints, as it is written.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LostEntry {
    /// Name of the person; everybody where it is left out.
    pub person: Option<String>,
    /// From when, seconds.
    pub from_s: f64,
    /// Until when, seconds.
    pub until_s: f64,
    /// The viewpoints that see the person all the same.
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
