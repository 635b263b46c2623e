//! The map of the field that a calibration covers: its extent, the number of cameras that see each cell, and the accuracy.

use super::finding::finding;
use super::{CameraReport, Cause, FieldCamera, FieldCell, FieldGrid, Finding, field_map};
use farfield_proto::court::Court;
use farfield_proto::order_statistics::percentile;

/// Standard deviation of a sight on the map, pixels: a fixed value, so that maps can be compared.
pub const FIELD_SIGHT_PX: f64 = 1.0;
/// Height of the map over the floor if people walk there, metres.
const BODY_M: f64 = 1.0;
/// Largest height of a person, metres.
const MOST_BODY_M: f64 = 3.0;
/// Most cells along the longer side of the field.
const MOST_ALONG: f64 = 40.0;
/// Sides of a cell, metres; the first that gives few enough cells is used.
const STEPS_M: [f64; 10] = [0.1, 0.2, 0.25, 0.5, 1.0, 2.0, 2.5, 5.0, 10.0, 25.0];
/// Share of the places at each end of an axis that are ignored as outliers.
const STRAY: f64 = 0.01;
/// Share of the field seen by fewer than two cameras above which there is a finding.
const BLIND: f64 = 0.02;

/// The accuracy of a calibration over the field.
#[derive(Debug, Clone, PartialEq)]
pub struct FieldReport {
    /// The court that is part of it; `None` if the field is only where people or the point were.
    pub court: Option<Court>,
    /// Side of a cell, metres.
    pub step_m: f64,
    /// Height of the map over the floor, metres.
    pub height_m: f64,
    /// Standard deviation of the sights of the map, pixels.
    pub sight_sigma_px: f64,
    /// The cells of the field.
    pub cells: Vec<FieldCell>,
}

impl FieldReport {
    /// The field is the hull of `places_m`, where the point or people were (without outliers), of `known_m`, and of the whole
    /// `court`. All are in the venue, and so are `cameras`. `None` if there is no field, or the uncertainty of all cameras is
    /// unknown.
    pub(crate) fn new(
        cameras: &[FieldCamera],
        places_m: impl IntoIterator<Item = [f64; 3]>,
        known_m: impl IntoIterator<Item = [f64; 3]>,
        court: Option<&Court>,
    ) -> Option<Self> {
        let known = |it: &&FieldCamera| {
            it.position_sigma_m.is_finite() && it.rotation_sigma_rad.is_finite()
        };
        let cameras: Vec<FieldCamera> = cameras.iter().filter(known).copied().collect();
        let is_number = |at: &[f64; 3]| at.iter().all(|v| v.is_finite());
        let mut places: Vec<[f64; 3]> = places_m.into_iter().filter(is_number).collect();
        let ends = [0, 1].map(|axis| ends(&places, axis));
        let [[least_x, most_x], [least_y, most_y]] = [ends[0]?, ends[1]?];
        places.retain(|at| {
            (least_x..=most_x).contains(&at[0]) && (least_y..=most_y).contains(&at[1])
        });
        let mut heights: Vec<f64> = places.iter().map(|at| at[2]).collect();
        heights.sort_by(f64::total_cmp);
        let middle_m = percentile(&heights, 0.5)?;
        places.extend(known_m.into_iter().filter(is_number));
        places.extend(court.into_iter().flat_map(corners_m));
        let span = |axis: usize| {
            let along = places.iter().map(|at| at[axis]);
            let least = along.clone().fold(f64::INFINITY, f64::min);
            [least, along.fold(f64::NEG_INFINITY, f64::max)]
        };
        let [[least_x, most_x], [least_y, most_y]] = [span(0), span(1)];
        let is_of_people = (-MOST_BODY_M..MOST_BODY_M).contains(&middle_m);
        let extent_m = (most_x - least_x).max(most_y - least_y);
        let is_fine = |step: &f64| extent_m / step <= MOST_ALONG;
        let step_m = STEPS_M.into_iter().find(is_fine)?;
        let down = |v: f64| libm::floor(v / step_m) * step_m;
        let up = |v: f64| libm::ceil(v / step_m) * step_m;
        let grid = FieldGrid {
            from_m: [down(least_x), down(least_y)],
            to_m: [up(most_x), up(most_y)],
            step_m,
            height_m: if is_of_people { BODY_M } else { middle_m },
        };
        let hull = hull(places.iter().map(|at| [at[0], at[1]]).collect());
        let mut cells = field_map(&cameras, &grid, FIELD_SIGHT_PX).ok()?;
        cells.retain(|cell| is_inside(&hull, [cell.position_m[0], cell.position_m[1]]));
        (!cells.is_empty() && !cameras.is_empty()).then(|| Self {
            court: court.cloned(),
            step_m,
            height_m: grid.height_m,
            sight_sigma_px: FIELD_SIGHT_PX,
            cells,
        })
    }

    /// Share of the field that at least `cameras` cameras see, 0 to 1.
    pub fn share_seen_by(&self, cameras: usize) -> f64 {
        let seen = self.cells.iter().filter(|cell| cell.cameras >= cameras);
        seen.count() as f64 / self.cells.len().max(1) as f64
    }

    /// The percentile `share` of the standard deviations of cells that have one, metres; `None` if none has one.
    pub fn sigma_m(&self, share: f64) -> Option<f64> {
        let mut sigmas: Vec<f64> = self.cells.iter().filter_map(|it| it.sigma_m).collect();
        sigmas.sort_by(f64::total_cmp);
        percentile(&sigmas, share)
    }

    /// The finding about parts of the field where nothing can be triangulated.
    pub(crate) fn finding(&self) -> Option<Finding> {
        let blind = self.cells.iter().filter(|cell| cell.cameras < 2);
        let blind: Vec<&FieldCell> = blind.collect();
        let share = blind.len() as f64 / self.cells.len().max(1) as f64;
        let middle = |axis: usize| {
            let sum: f64 = blind.iter().map(|cell| cell.position_m[axis]).sum();
            sum / blind.len().max(1) as f64
        };
        (share > BLIND).then(|| {
            finding(
                "",
                Cause::Coverage,
                false,
                format!(
                    "{:.0} % of the field is seen by fewer than two cameras, about ({:.1}, {:.1}) m",
                    100.0 * share,
                    middle(0),
                    middle(1)
                ),
                "two cameras or more everywhere",
                "turn a camera there, or leave that part out",
            )
        })
    }
}

/// A camera of the map in the venue, with its uncertainty.
pub(crate) fn field_camera(
    state: crate::adjustment::CameraState,
    size_px: [u32; 2],
    report: &CameraReport,
) -> FieldCamera {
    // The reported values are roots of sums over three axes.
    let per_axis = |sigma: f64| sigma / 3f64.sqrt();
    FieldCamera {
        state,
        size_px,
        position_sigma_m: per_axis(report.position_sigma_m),
        rotation_sigma_rad: per_axis(report.rotation_sigma_deg.to_radians()),
    }
}

/// The corners of a court in the venue.
fn corners_m(court: &Court) -> [[f64; 3]; 4] {
    let [x, y] = court.size_m.map(|side_m| 0.5 * side_m);
    [[-x, -y, 0.0], [x, -y, 0.0], [x, y, 0.0], [-x, y, 0.0]]
}

/// Smallest and largest coordinate along an axis, without outliers.
fn ends(places: &[[f64; 3]], axis: usize) -> Option<[f64; 2]> {
    let mut sorted: Vec<f64> = places.iter().map(|at| at[axis]).collect();
    sorted.sort_by(f64::total_cmp);
    Some([
        percentile(&sorted, STRAY)?,
        percentile(&sorted, 1.0 - STRAY)?,
    ])
}

/// Corners of the convex hull, counterclockwise (Andrew's monotone chain).
fn hull(mut places: Vec<[f64; 2]>) -> Vec<[f64; 2]> {
    places.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    let half = |places: &mut dyn Iterator<Item = &[f64; 2]>| {
        let mut corners: Vec<[f64; 2]> = Vec::new();
        for at in places {
            while let [.., a, b] = corners.as_slice()
                && turn(*a, *b, *at) <= 0.0
            {
                corners.pop();
            }
            corners.push(*at);
        }
        corners.pop();
        corners
    };
    let mut corners = half(&mut places.iter());
    corners.extend(half(&mut places.iter().rev()));
    corners
}

/// Positive if `c` is to the left of the line from `a` to `b`.
fn turn(a: [f64; 2], b: [f64; 2], c: [f64; 2]) -> f64 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

fn is_inside(hull: &[[f64; 2]], at: [f64; 2]) -> bool {
    let next = hull.iter().cycle().skip(1);
    hull.len() >= 3 && hull.iter().zip(next).all(|(a, b)| turn(*a, *b, at) >= 0.0)
}

#[cfg(test)]
mod tests {
    use farfield_proto::camera::{Distortion, Intrinsics};
    use nalgebra::{UnitQuaternion, Vector3};

    use super::*;
    use crate::adjustment::CameraState;

    /// Two cameras 10 m over the floor that look straight down: x to the right, y of the picture to -y.
    fn from_above() -> Vec<FieldCamera> {
        let intrinsics = Intrinsics {
            fx_px: 1000.0,
            fy_px: 1000.0,
            cx_px: 959.5,
            cy_px: 599.5,
        };
        let down = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
        let each = [-2.0, 2.0].map(|x| FieldCamera {
            state: CameraState {
                camera_from_world: down,
                center_w: Vector3::new(x, 0.0, 10.0),
                ..CameraState::at_origin(intrinsics, Distortion::default())
            },
            size_px: [1920, 1200],
            position_sigma_m: 0.001,
            rotation_sigma_rad: 1e-5,
        });
        each.to_vec()
    }

    /// Places over a square, with a few outliers.
    fn walked(half_m: f64) -> Vec<[f64; 3]> {
        let line = |i: i32| half_m * (f64::from(i) / 20.0 - 1.0);
        let mut places: Vec<[f64; 3]> = (0..=40)
            .flat_map(|i| (0..=40).map(move |j| [line(i), line(j), 0.1]))
            .collect();
        places.extend([[300.0, 0.0, 0.1], [0.0, -500.0, 0.1], [f64::NAN, 0.0, 0.0]]);
        places
    }

    #[test]
    fn the_field_is_the_hull_of_the_places() {
        let found = FieldReport::new(&from_above(), walked(4.0), [], None).unwrap();
        assert!((found.step_m - 0.2).abs() < 1e-12 && (found.height_m - 1.0).abs() < 1e-12);
        assert!(
            found.cells.len() > 1400 && found.cells.len() <= 1600,
            "{}",
            found.cells.len()
        );
        assert!((found.share_seen_by(2) - 1.0).abs() < 1e-12 && found.finding().is_none());
        let worst_m = found.sigma_m(1.0).unwrap();
        assert!(worst_m > 0.01 && worst_m < 0.1, "{worst_m}");
    }

    #[test]
    fn a_court_belongs_to_the_field_as_a_whole() {
        let volleyball = Court::of("volleyball", None).unwrap();
        let walked_m = walked(4.0);
        let found = FieldReport::new(&from_above(), walked_m, [], Some(&volleyball)).unwrap();
        // 18 x 9 m; the two cameras share about 13 m.
        let area_m2 = found.cells.len() as f64 * found.step_m * found.step_m;
        assert!((area_m2 - 162.0).abs() < 20.0, "{area_m2}");
        let share = found.share_seen_by(2);
        assert!(share > 0.5 && share < 0.9, "{share}");
        assert_eq!(found.court.map(|it| it.name), Some("volleyball"));
    }

    #[test]
    fn parts_seen_by_fewer_than_two_cameras_cause_a_finding() {
        let found = FieldReport::new(&from_above(), walked(9.0), [], None).unwrap();
        assert!(found.share_seen_by(2) < 0.7);
        let finding = found.finding().unwrap();
        assert!(
            !finding.is_wrong() && finding.cause == Cause::Coverage,
            "{finding}"
        );
    }

    #[test]
    fn no_places_or_one_line_are_no_field() {
        assert!(FieldReport::new(&from_above(), Vec::new(), [], None).is_none());
        let line = (0..100).map(|i| [f64::from(i) * 0.1, 1.0, 0.0]);
        assert!(FieldReport::new(&from_above(), line, [], None).is_none());
        assert!(FieldReport::new(&[], walked(4.0), [], None).is_none());
    }

    #[test]
    fn a_hull_contains_its_points() {
        let places = vec![
            [0.0, 0.0],
            [4.0, 0.0],
            [4.0, 3.0],
            [0.0, 3.0],
            [2.0, 1.0],
            [2.0, 0.0],
        ];
        let corners = hull(places.clone());
        assert_eq!(corners.len(), 4);
        assert!(places.iter().all(|at| is_inside(&corners, *at)));
        assert!(!is_inside(&corners, [4.1, 1.0]) && !is_inside(&corners, [2.0, -0.1]));
    }
}
