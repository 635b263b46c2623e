//! Clicks in pictures, the intersection of their lines of sight, and the facts known about them: marks and lines of a
//! court, places, the floor, lengths.

use farfield_proto::court::{Court, LineShape};
use nalgebra::Vector3;

use crate::adjustment::CameraState;
use crate::geometry::triangulate;

/// The name of a camera, and a distorted pixel in it.
pub type Click = (String, [f64; 2]);

/// Largest angle between a click and the point on which all clicks agree, radians.
const CLICK_RAD: f64 = 0.02;

pub(super) fn camera<'a>(
    cameras: &'a [(String, CameraState)],
    name: &str,
) -> Result<&'a CameraState, String> {
    let found = cameras.iter().find(|(other, _)| other == name);
    found.map(|(_, state)| state).ok_or_else(|| {
        let names: Vec<&str> = cameras.iter().map(|(name, _)| name.as_str()).collect();
        format!(
            "found camera `{name}`, expected one of {}",
            names.join(", ")
        )
    })
}

/// The point on which at least two of the clicks agree.
pub(super) fn meeting(
    cameras: &[(String, CameraState)],
    clicks: &[Click],
    what: &str,
) -> Result<Vector3<f64>, String> {
    let mut sights = Vec::new();
    for (name, px) in clicks {
        let state = camera(cameras, name)?;
        let bearing = state.bearing(*px, state.fold_radius()).ok_or_else(|| {
            format!(
                "{what}: the lens of camera `{name}` cannot produce ({}, {})",
                px[0], px[1]
            )
        })?;
        sights.push((state.center_w, state.camera_from_world.inverse() * bearing));
    }
    let (point, agreeing) = triangulate(&sights, CLICK_RAD).ok_or_else(|| {
        format!(
            "{what}: the lines of sight of its clicks in {} cameras do not meet, expected at least two that do",
            clicks.len()
        )
    })?;
    if agreeing.len() < sights.len() {
        let off = (0..sights.len())
            .find(|i| !agreeing.contains(i))
            .unwrap_or(0);
        let name = clicks.get(off).map_or("", |(name, _)| name.as_str());
        return Err(format!(
            "{what}: the line of sight of its click in camera `{name}` does not meet the others"
        ));
    }
    Ok(point)
}

/// The known position of a mark.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Known {
    /// A place in the venue, metres.
    Place([f64; 3]),
    /// A line of the floor, or its extension.
    OnLine(LineShape),
}

/// A mark at a known position, with its clicks.
#[derive(Debug, Clone, PartialEq)]
pub struct KnownMark {
    /// Its name.
    pub name: String,
    /// Its position.
    pub known: Known,
    /// Its clicks; one camera is enough.
    pub clicks: Vec<Click>,
}

/// A clicked point at an unknown position.
#[derive(Debug, Clone, PartialEq)]
pub struct ClickedPoint {
    /// Its name.
    pub name: String,
    /// Its clicks, in two or more cameras.
    pub clicks: Vec<Click>,
}

/// A length between two clicked points.
#[derive(Debug, Clone, PartialEq)]
pub struct ClickedLength {
    /// Its ends.
    pub ends: [ClickedPoint; 2],
    /// Metres.
    pub length_m: f64,
}

/// All clicks.
#[derive(Debug, Clone, PartialEq)]
pub struct Marks {
    /// The court whose marks or lines were clicked; it defines the axes of the venue.
    pub court: Option<Court>,
    /// Marks at known positions.
    pub known: Vec<KnownMark>,
    /// Points on the floor.
    pub floor: Vec<ClickedPoint>,
    /// Known lengths.
    pub lengths: Vec<ClickedLength>,
    /// Standard deviation of a click along each axis, pixels.
    pub click_sigma_px: f64,
    /// Standard deviation of a known place along each axis, metres.
    pub place_sigma_m: f64,
}

impl Marks {
    /// The cameras with clicks; a camera can occur more than once.
    pub fn cameras(&self) -> impl Iterator<Item = &str> {
        let known = self.known.iter().map(|it| &it.clicks);
        let ends = self.lengths.iter().flat_map(|it| &it.ends);
        let points = self.floor.iter().chain(ends).map(|it| &it.clicks);
        let clicks = known.chain(points).flatten();
        clicks.map(|(camera, _)| camera.as_str())
    }

    /// The marks without clicks in the cameras `names`.
    #[must_use]
    pub fn without(&self, names: &[&str]) -> Self {
        let mut left = self.clone();
        let keep = |clicks: &mut Vec<Click>| {
            clicks.retain(|(camera, _)| !names.contains(&camera.as_str()));
        };
        for mark in &mut left.known {
            keep(&mut mark.clicks);
        }
        for point in &mut left.floor {
            keep(&mut point.clicks);
        }
        for end in left.lengths.iter_mut().flat_map(|length| &mut length.ends) {
            keep(&mut end.clicks);
        }
        left.known.retain(|mark| !mark.clicks.is_empty());
        left.floor.retain(|point| point.clicks.len() >= 2);
        left.lengths
            .retain(|length| length.ends.iter().all(|end| end.clicks.len() >= 2));
        left
    }
}

impl Known {
    /// Its point nearest to `near`, venue, metres.
    pub(super) fn nearest(&self, near: &Vector3<f64>) -> Vector3<f64> {
        match self {
            Self::Place(at_m) => Vector3::from(*at_m),
            Self::OnLine(LineShape::Segment { from_m, to_m }) => {
                let [a, b] = [from_m, to_m].map(|p| Vector3::new(p[0], p[1], 0.0));
                let along = (b - a).normalize();
                a + along * along.dot(&(near - a))
            }
            Self::OnLine(LineShape::Arc {
                centre_m, radius_m, ..
            }) => {
                let centre = Vector3::new(centre_m[0], centre_m[1], 0.0);
                let arm = Vector3::new(near.x - centre.x, near.y - centre.y, 0.0);
                centre + arm.try_normalize(1e-12).unwrap_or_else(Vector3::x) * *radius_m
            }
        }
    }
}

/// The degrees of freedom of a fit to marks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MarkFreedom {
    /// Shift, rotation and scale.
    Similarity,
    /// Shift and rotation: the cameras are already in metres.
    Rigid,
}

/// A known place: its name, its position in the world of the cameras, and in the venue.
pub type FoundPlace = (String, Vector3<f64>, Vector3<f64>);
