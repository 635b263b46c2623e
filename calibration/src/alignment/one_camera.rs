//! The pose of one camera from the clicks in its picture alone. It is shown while clicking, so that a wrong corner is visible
//! at once. The result of a calibration is [`super::fit_marks`] of all cameras together.

use farfield_proto::court::{Court, LineShape, PlacedCourt};
use nalgebra::{Isometry3, Vector2, Vector3};

use super::mark_fit::{MarkResidual, fit_marks};
use super::marks::{Known, KnownMark, MarkFreedom, Marks};
use crate::adjustment::CameraState;
use crate::board::{PoseError, pose_from_points};

/// Least number of marks at known places for a pose.
pub const LEAST_MARKS: usize = 4;
/// Longest piece of a line that is drawn straight, metres: lenses bend lines.
const PIECE_M: f64 = 0.5;
/// Lines are drawn up to this far beyond the picture, relative to its longer side.
const BEYOND: f64 = 0.25;
/// A rotated court fits as well if its residual is at most this multiple of the other one.
const AS_GOOD: f64 = 1.5;
/// Residuals below this are treated as this, pixels.
const CLICK_PX: f64 = 0.5;

/// Whether the court fits after half a turn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum HalfTurn {
    /// It fits as well after half a turn about its middle: the user decides which end is which.
    FitsAsWell,
    /// Other clicks rule it out.
    RuledOut,
}

/// The pose of a camera from its own marks.
#[derive(Debug, Clone, PartialEq)]
pub struct OneCameraFit {
    /// The camera in the venue.
    pub state: CameraState,
    /// The residual of each click, in the order of the marks.
    pub residuals: Vec<MarkResidual>,
    /// Root of the mean squared residual without outliers, pixels.
    pub rms_px: f64,
    /// The reason why the marks contradict each other; then all of them are fitted as well as possible.
    pub contradiction: Option<String>,
    /// Whether a second pose fits too: marks on one plane that look small.
    pub is_ambiguous: bool,
    /// Whether it is below the floor: left and right, or two marks, were swapped.
    pub is_under_floor: bool,
    /// Whether the court fits after half a turn.
    pub half_turn: HalfTurn,
}

/// The reason why there is no pose.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum OneCameraError {
    /// Too few marks, lines not counted.
    #[error(
        "found {found} marks at known places, expected {LEAST_MARKS}; marks on lines are used in addition"
    )]
    TooFew {
        /// The number of marks.
        found: usize,
    },
    /// All on one line.
    #[error("all marks are on one line, expected one off the line")]
    OnALine,
    /// No pose fits.
    #[error("no position of the camera fits these marks: {0}")]
    None(String),
}

/// The pose of the camera `name` with the lens of `lens` from its own clicks in `marks`.
///
/// # Errors
/// [`OneCameraError`].
pub fn fit_one_camera(
    marks: &Marks,
    name: &str,
    lens: &CameraState,
) -> Result<OneCameraFit, OneCameraError> {
    let (points, pixels) = places_of(marks, name);
    if points.len() < LEAST_MARKS {
        return Err(OneCameraError::TooFew {
            found: points.len(),
        });
    }
    let model = lens.lens();
    let pose = pose_from_points(&lens.intrinsics, &model, &points, &pixels);
    let pose = pose.map_err(|error| match error {
        PoseError::OnALine => OneCameraError::OnALine,
        other => OneCameraError::None(other.to_string()),
    })?;
    let half_turn = half_turn(marks, name, lens);
    let cameras = [(name.to_owned(), at_origin(lens))];
    let fitted = match fit_marks(marks, &[], &cameras, MarkFreedom::Rigid) {
        Ok(fitted) => fitted,
        // Fit all of them as well as possible: the picture shows which one is wrong.
        Err(contradiction) => {
            let state = state_at(lens, &pose.camera_from_world);
            return Ok(OneCameraFit {
                residuals: residuals(marks, name, &state),
                rms_px: pose.rms_px,
                contradiction: Some(contradiction),
                is_ambiguous: false,
                is_under_floor: state.center_w.z < 0.0,
                half_turn,
                state,
            });
        }
    };
    let [(_, found)] = cameras;
    let state = fitted.venue_from_found.apply_to_camera(&found);
    let good = fitted.residuals.iter().filter(|it| !it.is_outlier);
    let squares: Vec<f64> = good.filter_map(|it| it.px).map(|px| px * px).collect();
    Ok(OneCameraFit {
        rms_px: (squares.iter().sum::<f64>() / squares.len().max(1) as f64).sqrt(),
        contradiction: None,
        is_ambiguous: pose.is_ambiguous && fitted.outliers().next().is_none(),
        is_under_floor: state.center_w.z < 0.0,
        half_turn,
        residuals: fitted.residuals,
        state,
    })
}

/// A camera with the lens of `lens` at a pose.
fn state_at(lens: &CameraState, camera_from_world: &Isometry3<f64>) -> CameraState {
    CameraState {
        camera_from_world: camera_from_world.rotation,
        center_w: camera_from_world.inverse().translation.vector,
        ..*lens
    }
}

fn at_origin(lens: &CameraState) -> CameraState {
    CameraState::at_origin(lens.intrinsics, lens.lens())
}

/// Marks at known places, and their pixels in the camera.
fn places_of(marks: &Marks, name: &str) -> (Vec<[f64; 3]>, Vec<[f64; 2]>) {
    let clicked = marks.known.iter().flat_map(|mark| {
        let own = mark.clicks.iter().filter(|(camera, _)| camera == name);
        own.filter_map(|(_, px)| match mark.known {
            Known::Place(at_m) => Some((at_m, *px)),
            Known::OnLine(_) => None,
        })
    });
    clicked.unzip()
}

/// The residual of each click for the camera `state`.
fn residuals(marks: &Marks, name: &str, state: &CameraState) -> Vec<MarkResidual> {
    let fold = state.fold_radius();
    let mut all = Vec::new();
    for mark in &marks.known {
        for (_, px) in mark.clicks.iter().filter(|(camera, _)| camera == name) {
            let at = match mark.known {
                Known::Place(at_m) => Some(Vector3::from(at_m)),
                // The point of the line that the click sees.
                Known::OnLine(_) => state.bearing(*px, fold).and_then(|bearing| {
                    let ray = state.camera_from_world.inverse() * bearing;
                    let t = -state.center_w.z / ray.z;
                    (t > 0.0 && t.is_finite())
                        .then(|| mark.known.nearest(&(state.center_w + ray * t)))
                }),
            };
            let drawn = at.and_then(|at| Some((state.project(&at, fold)?, at)));
            let (off_px, m) = drawn.map_or((f64::INFINITY, f64::INFINITY), |(drawn, at)| {
                let off_px = (drawn - Vector2::from(*px)).norm();
                let across = (at - state.center_w).norm() / state.intrinsics.fx_px;
                (off_px, off_px * across)
            });
            all.push(MarkResidual {
                name: mark.name.clone(),
                camera: Some(name.to_owned()),
                px: Some(off_px),
                m,
                sigmas: off_px / marks.click_sigma_px,
                is_outlier: false,
            });
        }
    }
    all
}

/// A court looks the same from both ends: checks whether other clicks distinguish them.
fn half_turn(marks: &Marks, name: &str, lens: &CameraState) -> HalfTurn {
    let Some(court) = &marks.court else {
        return HalfTurn::RuledOut;
    };
    let is_of_court =
        |mark: &&KnownMark| court.mark(&mark.name).is_some() || court.line(&mark.name).is_some();
    let of_court = marks.known.iter().filter(is_of_court).count();
    if of_court == 0 {
        return HalfTurn::RuledOut;
    }
    if of_court == marks.known.len() {
        return HalfTurn::FitsAsWell;
    }
    let mut turned = marks.clone();
    for mark in &mut turned.known {
        if is_of_court(&&*mark) {
            mark.known = turned_by_half(mark.known);
        }
    }
    let rms_px = |marks: &Marks| {
        let (points, pixels) = places_of(marks, name);
        let model = lens.lens();
        let pose = pose_from_points(&lens.intrinsics, &model, &points, &pixels);
        let pose_in_venue = pose.ok()?.camera_from_world;
        // Lines count too: they may be the only clicks on the court.
        let left = residuals(marks, name, &state_at(lens, &pose_in_venue));
        let squares = left.iter().filter_map(|it| it.px).map(|px| px * px);
        let rms_px = (squares.sum::<f64>() / left.len().max(1) as f64).sqrt();
        rms_px.is_finite().then_some(rms_px)
    };
    let own_px = rms_px(marks).unwrap_or(f64::INFINITY);
    if rms_px(&turned).is_some_and(|turned_px| turned_px <= AS_GOOD * own_px.max(CLICK_PX)) {
        HalfTurn::FitsAsWell
    } else {
        HalfTurn::RuledOut
    }
}

fn turned_by_half(known: Known) -> Known {
    let turned = |[x, y]: [f64; 2]| [-x, -y];
    match known {
        Known::Place([x, y, z]) => Known::Place([-x, -y, z]),
        Known::OnLine(LineShape::Segment { from_m, to_m }) => Known::OnLine(LineShape::Segment {
            from_m: turned(from_m),
            to_m: turned(to_m),
        }),
        Known::OnLine(LineShape::Arc {
            centre_m,
            radius_m,
            from_rad,
            by_rad,
        }) => Known::OnLine(LineShape::Arc {
            centre_m: turned(centre_m),
            radius_m,
            from_rad: from_rad + std::f64::consts::PI,
            by_rad,
        }),
    }
}

/// The lines of `court` as the camera `state` projects them into a picture of `size_px`: by name, in pieces, distorted pixels.
pub fn drawn_lines(
    court: &Court,
    state: &CameraState,
    size_px: [u32; 2],
) -> Vec<(String, Vec<Vec<[f64; 2]>>)> {
    let placed = PlacedCourt {
        court: court.clone(),
        centre_m: [0.0, 0.0],
        turn_rad: 0.0,
    };
    let view = View::new(state, size_px);
    let lines = court.lines.iter().map(|line| {
        let points = finely(&placed.points_m(&line.shape));
        let seen = points
            .iter()
            .map(|[x, y]| view.near_picture(&Vector3::new(*x, *y, 0.0)));
        let mut pieces: Vec<Vec<[f64; 2]>> = vec![Vec::new()];
        for px in seen {
            match (px, pieces.last_mut()) {
                (Some(px), Some(piece)) => piece.push(px),
                (None, Some(piece)) if !piece.is_empty() => pieces.push(Vec::new()),
                _ => {}
            }
        }
        pieces.retain(|piece| piece.len() > 1);
        (line.name.clone(), pieces)
    });
    lines.filter(|(_, pieces)| !pieces.is_empty()).collect()
}

/// The marks of `court` inside the picture of `size_px` of the camera `state`: by name, distorted pixels.
pub fn drawn_marks(
    court: &Court,
    state: &CameraState,
    size_px: [u32; 2],
) -> Vec<(String, [f64; 2])> {
    let view = View::new(state, size_px);
    let marks = court.marks.iter().filter_map(|mark| {
        let px = view.near_picture(&Vector3::from(mark.position_m))?;
        view.is_inside(px).then(|| (mark.name.clone(), px))
    });
    marks.collect()
}

/// `points` with more points between them, so that no piece is long.
fn finely(points: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let mut all = Vec::new();
    for pair in points.windows(2) {
        let [a, b] = pair else { continue };
        let pieces = (libm::hypot(b[0] - a[0], b[1] - a[1]) / PIECE_M)
            .ceil()
            .max(1.0);
        let between = (0..pieces as usize).map(|i| {
            let share = i as f64 / pieces;
            [0, 1].map(|axis| a[axis] + share * (b[axis] - a[axis]))
        });
        all.extend(between);
    }
    all.extend(points.last());
    all
}

/// A camera with the size of its picture.
struct View<'a> {
    state: &'a CameraState,
    fold: f64,
    size_px: [f64; 2],
}

impl<'a> View<'a> {
    fn new(state: &'a CameraState, size_px: [u32; 2]) -> Self {
        Self {
            state,
            fold: state.fold_radius(),
            size_px: size_px.map(f64::from),
        }
    }

    /// The pixel of a point, inside the picture or not far outside.
    fn near_picture(&self, at: &Vector3<f64>) -> Option<[f64; 2]> {
        let px = self.state.project(at, self.fold)?;
        let beyond = BEYOND * self.size_px[0].max(self.size_px[1]);
        let is_near = |axis: usize| (-beyond..self.size_px[axis] + beyond).contains(&px[axis]);
        (is_near(0) && is_near(1)).then(|| px.into())
    }

    fn is_inside(&self, px: [f64; 2]) -> bool {
        (0..2).all(|axis| (-0.5..self.size_px[axis] - 0.5).contains(&px[axis]))
    }
}
