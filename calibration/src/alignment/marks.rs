//! What was clicked in pictures, and what is known of it: marks and lines of a court, places, the floor, lengths.

use nalgebra::Vector3;

use super::click::Click;
use farfield_proto::court::{Court, LineShape};

/// Where something that was clicked is known to be.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Known {
    /// At one place, venue, metres.
    Place([f64; 3]),
    /// Somewhere on a line of the floor; beyond its ends too.
    OnLine(LineShape),
}

/// Something that is known, and where cameras saw it.
#[derive(Debug, Clone, PartialEq)]
pub struct KnownMark {
    /// Its name.
    pub name: String,
    /// Where it is.
    pub known: Known,
    /// Where it was clicked; one camera is enough.
    pub clicks: Vec<Click>,
}

/// A point that was clicked, and of which nothing is known by itself.
#[derive(Debug, Clone, PartialEq)]
pub struct ClickedPoint {
    /// Its name.
    pub name: String,
    /// Where it was clicked: two cameras or more.
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

/// All that was clicked.
#[derive(Debug, Clone, PartialEq)]
pub struct Marks {
    /// The court whose marks or lines were clicked: the venue is laid out as it is.
    pub court: Option<Court>,
    /// What is known to be somewhere.
    pub known: Vec<KnownMark>,
    /// Points on the floor.
    pub floor: Vec<ClickedPoint>,
    /// Lengths.
    pub lengths: Vec<ClickedLength>,
    /// Standard deviation of a click along each axis, pixels.
    pub click_sigma_px: f64,
    /// Standard deviation of a known place along each axis, metres.
    pub place_sigma_m: f64,
}

impl Marks {
    /// The cameras in which something was clicked; some more than once.
    pub fn cameras(&self) -> impl Iterator<Item = &str> {
        let known = self.known.iter().map(|it| &it.clicks);
        let ends = self.lengths.iter().flat_map(|it| &it.ends);
        let points = self.floor.iter().chain(ends).map(|it| &it.clicks);
        let clicks = known.chain(points).flatten();
        clicks.map(|(camera, _)| camera.as_str())
    }

    /// What remains of it without the cameras `names`.
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
    /// The place of it that is nearest to `near`, venue, metres.
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

/// What may be changed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MarkFreedom {
    /// Place, turn and size.
    Similarity,
    /// Place and turn: the cameras are in metres already.
    Rigid,
}

/// A place that was found, and is known: its name, where it is in the world of the cameras, and in the venue.
pub type FoundPlace = (String, Vector3<f64>, Vector3<f64>);
