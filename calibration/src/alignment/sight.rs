//! Clicks, places and lengths as residuals of a similarity.

use farfield_proto::court::LineShape;
use nalgebra::{Matrix2, Vector2, Vector3};

use super::marks::{ClickedPoint, FoundPlace, Known, Marks, camera, meeting};
use super::similarity::Similarity;
use crate::adjustment::CameraState;

/// Least slope of a ray that meets the floor.
const LEAST_SLOPE: f64 = 1e-6;

/// One click, place, point or length, with its name.
#[derive(Debug, Clone)]
pub(super) struct Seen {
    pub(super) name: String,
    pub(super) what: What,
}

#[derive(Debug, Clone)]
pub(super) enum What {
    /// Index of the camera, distorted pixel, direction in the world of the cameras, and the known position.
    Click {
        camera: usize,
        px: [f64; 2],
        direction: Vector3<f64>,
        known: Known,
    },
    /// A place in the world of the cameras, and in the venue.
    Place(Vector3<f64>, Vector3<f64>),
    /// A point of the floor in the world of the cameras, and its standard deviation in the same units.
    Floor(Vector3<f64>, f64),
    /// Both ends in the world of the cameras, the length in metres, and its standard deviation in units of the cameras.
    Length([Vector3<f64>; 2], f64, f64),
}

impl Seen {
    pub(super) fn camera(&self) -> Option<usize> {
        match &self.what {
            What::Click { camera, .. } => Some(*camera),
            _ => None,
        }
    }

    /// The number of informative entries of its residual.
    pub(super) fn rows(&self) -> f64 {
        match &self.what {
            What::Click { known, .. } => known.rows(),
            What::Place(..) => 3.0,
            What::Floor(..) | What::Length(..) => 1.0,
        }
    }
}

/// All observations of a fit.
pub(super) struct Sights<'a> {
    pub(super) seen: Vec<Seen>,
    pub(super) cameras: &'a [(String, CameraState)],
    folds: Vec<f64>,
    click_sigma_px: f64,
    place_sigma_m: f64,
}

impl<'a> Sights<'a> {
    pub(super) fn new(
        marks: &Marks,
        places: &[FoundPlace],
        cameras: &'a [(String, CameraState)],
    ) -> Result<Self, String> {
        let mut seen = Vec::new();
        for mark in &marks.known {
            for (name, px) in &mark.clicks {
                let state = camera(cameras, name)?;
                let index = cameras
                    .iter()
                    .position(|(other, _)| other == name)
                    .unwrap_or(0);
                let bearing = state.bearing(*px, state.fold_radius()).ok_or_else(|| {
                    format!(
                        "{}: camera `{name}` draws nothing at ({}, {})",
                        mark.name, px[0], px[1]
                    )
                })?;
                seen.push(Seen {
                    name: mark.name.clone(),
                    what: What::Click {
                        camera: index,
                        px: *px,
                        direction: state.camera_from_world.inverse() * bearing,
                        known: mark.known,
                    },
                });
            }
        }
        for (name, found, known) in places {
            let what = What::Place(*found, *known);
            seen.push(Seen {
                name: name.clone(),
                what,
            });
        }
        for point in &marks.floor {
            let (at, sigma) = met(cameras, point, marks.click_sigma_px)?;
            let what = What::Floor(at, sigma);
            seen.push(Seen {
                name: point.name.clone(),
                what,
            });
        }
        for length in &marks.lengths {
            let [a, b] = &length.ends;
            let (first, second) = (
                met(cameras, a, marks.click_sigma_px)?,
                met(cameras, b, marks.click_sigma_px)?,
            );
            let sigma = libm::hypot(first.1, second.1);
            seen.push(Seen {
                name: format!("{} to {}", a.name, b.name),
                what: What::Length([first.0, second.0], length.length_m, sigma),
            });
        }
        Ok(Self {
            seen,
            cameras,
            folds: cameras
                .iter()
                .map(|(_, state)| state.fold_radius())
                .collect(),
            click_sigma_px: marks.click_sigma_px,
            place_sigma_m: marks.place_sigma_m,
        })
    }

    /// The middle of the known positions, venue.
    pub(super) fn middle(&self) -> Vector3<f64> {
        let known = self.seen.iter().filter_map(|seen| match &seen.what {
            What::Click {
                known: Known::Place(at),
                ..
            } => Some(Vector3::from(*at)),
            What::Click {
                known: Known::OnLine(LineShape::Segment { from_m, to_m }),
                ..
            } => Some(Vector3::new(
                0.5 * (from_m[0] + to_m[0]),
                0.5 * (from_m[1] + to_m[1]),
                0.0,
            )),
            What::Place(_, known) => Some(*known),
            _ => None,
        });
        let (sum, count) = known.fold((Vector3::zeros(), 0.0), |(sum, count), at| {
            (sum + at, count + 1.0)
        });
        if count > 0.0 { sum / count } else { sum }
    }

    /// The residual of `seen` and its standard deviation: pixels for a click, otherwise metres; `None` if nothing is projected.
    pub(super) fn residual(&self, seen: &Seen, venue: &Similarity) -> Option<(Vector3<f64>, f64)> {
        match &seen.what {
            What::Click {
                camera,
                px,
                direction,
                known,
            } => {
                let (_, state) = self.cameras.get(*camera)?;
                let origin = venue.apply(&state.center_w);
                let at = seen_place(known, &origin, &(venue.rotation * direction))?;
                let found = venue.rotation.inverse() * (at - venue.shift) / venue.scale;
                let drawn = state.project(&found, *self.folds.get(*camera)?)?;
                let depth_m = (at - origin).norm();
                let of_place_px = self.place_sigma_m * state.intrinsics.fx_px / depth_m;
                let off = drawn - Vector2::from(*px);
                Some((off.push(0.0), libm::hypot(self.click_sigma_px, of_place_px)))
            }
            What::Place(found, known) => Some((venue.apply(found) - known, self.place_sigma_m)),
            What::Floor(found, sigma) => {
                let height = venue.apply(found).z;
                let sigma_m = libm::hypot(self.place_sigma_m, venue.scale * sigma);
                Some((Vector3::new(height, 0.0, 0.0), sigma_m))
            }
            What::Length([a, b], length_m, sigma) => {
                let off = venue.scale * (a - b).norm() - length_m;
                let sigma_m = libm::hypot(self.place_sigma_m, venue.scale * sigma);
                Some((Vector3::new(off, 0.0, 0.0), sigma_m))
            }
        }
    }
}

/// Size of a pixel in the venue at the clicked position, metres.
pub(super) fn across_m(seen: &Seen, state: &CameraState, venue: &Similarity) -> f64 {
    let origin = venue.apply(&state.center_w);
    let at = match &seen.what {
        What::Click {
            direction, known, ..
        } => seen_place(known, &origin, &(venue.rotation * direction)),
        _ => None,
    };
    at.map_or(0.0, |at| (at - origin).norm() / state.intrinsics.fx_px)
}

/// The point of `known` on the ray, or nearest to it.
fn seen_place(
    known: &Known,
    origin: &Vector3<f64>,
    direction: &Vector3<f64>,
) -> Option<Vector3<f64>> {
    match known {
        Known::Place(at) => Some(Vector3::from(*at)),
        Known::OnLine(LineShape::Segment { from_m, to_m }) => {
            let [a, b] = [from_m, to_m].map(|p| Vector3::new(p[0], p[1], 0.0));
            let along = (b - a).try_normalize(1e-12)?;
            // The point of the line nearest to the ray: (a + s along - origin - t direction) is perpendicular to both.
            let c = along.dot(direction);
            let from = origin - a;
            let matrix = Matrix2::new(1.0, -c, c, -1.0);
            let right = Vector2::new(along.dot(&from), direction.dot(&from));
            let solved = matrix.try_inverse()? * right;
            Some(a + along * solved.x)
        }
        Known::OnLine(LineShape::Arc { .. }) => {
            let t = -origin.z / direction.z;
            let meets = direction.z.abs() > LEAST_SLOPE && t > 0.0;
            meets.then(|| known.nearest(&(origin + direction * t)))
        }
    }
}

/// The intersection of the clicks of a point, and its standard deviation, in units of the cameras.
pub(super) fn met(
    cameras: &[(String, CameraState)],
    point: &ClickedPoint,
    click_sigma_px: f64,
) -> Result<(Vector3<f64>, f64), String> {
    let at = meeting(cameras, &point.clicks, &point.name)?;
    let mut most = 0.0f64;
    for (name, _) in &point.clicks {
        let state = camera(cameras, name)?;
        most = most.max(click_sigma_px * (at - state.center_w).norm() / state.intrinsics.fx_px);
    }
    Ok((at, most))
}
