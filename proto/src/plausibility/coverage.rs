//! Checks of the field: every camera sees a part, two viewpoints most of it, and people fit into
//! it.

use std::collections::BTreeSet;

use nalgebra::Point3;

use super::{Cause, Finding, Severity, Sight, places};
use crate::frames::Point;
use crate::venue::{Field, Venue};

/// Sample points along either side of the field.
const SIDE: u32 = 25;
/// Sample heights above the floor, metres: feet to heads.
const HEIGHTS_M: [f64; 4] = [0.0, 0.7, 1.4, 2.0];
/// A smaller share of a configured field in two viewpoints is reported.
const LITTLE: f64 = 0.1;
/// Corners that differ by less are the same, metres.
const SAME_M: f64 = 1e-6;

/// The visible part of the field, from the floor to 2 m, ignoring bodies and walls.
#[derive(Debug, Clone, PartialEq)]
pub struct Coverage {
    /// Per camera, in the venue's order: the share of the field that it sees.
    pub of_camera: Vec<f64>,
    /// The share seen by two or more viewpoints.
    pub by_two: f64,
}

/// Evaluates a grid of points over the field. Cost: about 2,500 projections per camera.
pub fn coverage(venue: &Venue) -> Coverage {
    let points = points(&venue.field);
    let mut counts = vec![0_usize; venue.cameras.len()];
    let mut by_two = 0_usize;
    for &p_m in &points {
        let mut viewpoints = BTreeSet::new();
        for (camera, count) in venue.cameras.iter().zip(&mut counts) {
            let p_w = Point::new(Point3::from(p_m));
            if camera
                .model
                .project(p_w)
                .is_some_and(|px| camera.model.sees(px))
            {
                *count += 1;
                viewpoints.insert(camera.viewpoint.0);
            }
        }
        by_two += usize::from(viewpoints.len() >= 2);
    }
    let share = |count: usize| count as f64 / points.len() as f64;
    Coverage {
        of_camera: counts.into_iter().map(share).collect(),
        by_two: share(by_two),
    }
}

fn points(field: &Field) -> Vec<[f64; 3]> {
    let along = |axis: usize, i: u32| {
        let share = (f64::from(i) + 0.5) / f64::from(SIDE);
        field.min_m[axis] + share * (field.max_m[axis] - field.min_m[axis])
    };
    let mut points = Vec::new();
    for height_m in HEIGHTS_M {
        for i in 0..SIDE {
            for j in 0..SIDE {
                points.push([along(0, i), along(1, j), field.floor_m + height_m]);
            }
        }
    }
    points
}

pub(super) fn findings(venue: &Venue, seen: &Coverage) -> Vec<Finding> {
    let mut findings = Vec::new();
    for (camera, &share) in venue.cameras.iter().zip(&seen.of_camera) {
        if share == 0.0 {
            findings.push(Finding {
                camera: Some(camera.model.name().to_owned()),
                cause: Cause::LooksAway,
                severity: Severity::Doubtful,
                found: if camera.model.lens().is_fisheye() {
                    "it sees no point of the field within the 120 degrees of view of a fisheye that are used"
                } else {
                    "it sees no point of the field"
                }
                .to_owned(),
                expected: format!("a part of {}", words(&venue.field)),
                remedy: "check its `rotation` and `translation` (world to camera, radians, metres), or `[field]`"
                    .to_owned(),
            });
        }
    }
    if let Some(finding) = of_viewpoints(venue) {
        findings.push(finding);
    } else if seen.by_two == 0.0 || seen.by_two < LITTLE && is_stated(venue) {
        let severity = if seen.by_two == 0.0 {
            Severity::Wrong
        } else {
            Severity::Doubtful
        };
        findings.push(Finding {
            camera: None,
            cause: Cause::FieldUnseen,
            severity,
            found: format!("two viewpoints see {:.0} % of the field", (100.0 * seen.by_two).ceil()),
            expected: format!("most of {}", words(&venue.field)),
            remedy: "set `[field]` to where people are, or check where the cameras point (`farfield check` draws it)"
                .to_owned(),
        });
    }
    findings
}

/// Reports a single viewpoint: it detects no new people, and people given by hand are soon lost.
pub fn of_viewpoints(venue: &Venue) -> Option<Finding> {
    if venue.viewpoints.len() > 1 {
        return None;
    }
    Some(Finding {
        camera: None,
        cause: Cause::OneViewpoint,
        severity: if venue.given_persons.is_empty() {
            Severity::Wrong
        } else {
            Severity::Doubtful
        },
        found: "there is one viewpoint".to_owned(),
        expected: "two or more: one alone cannot measure how far away a person is".to_owned(),
        remedy: "give each of the separate cameras its own `[[viewpoint]]`".to_owned(),
    })
}

/// Whether the field was configured: a default field extends far behind the cameras.
fn is_stated(venue: &Venue) -> bool {
    let sights: Vec<Sight> = venue.cameras.iter().map(Sight::from_camera).collect();
    let made = places::around(&sights, &venue.field);
    let field = &venue.field;
    let sides = field.min_m.iter().chain(&field.max_m);
    let mut both = sides.zip(made.min_m.iter().chain(&made.max_m));
    both.any(|(a, b)| (a - b).abs() > SAME_M)
}

/// The field as text for an operator.
fn words(field: &Field) -> String {
    let [x0, y0, _] = field.min_m;
    let [x1, y1, _] = field.max_m;
    format!("the field, x {x0:.1} to {x1:.1} m and y {y0:.1} to {y1:.1} m, from its floor to 2 m")
}

/// The middle of a standing body, between hips and shoulders, is at 0.9 to 1.2 m. A field with a
/// lower top above its floor excludes tall people, metres; only people who sit, kneel or lie are
/// found then.
const LOW_M: f64 = 1.2;
/// Narrowest field, metres: a treadmill has 0.45.
const NARROW_M: f64 = 0.4;
/// Widest field, metres: a stadium with its stands has 300.
const WIDE_M: f64 = 500.0;

/// Findings about the size of the venue's field.
pub(super) fn field_size(venue: &Venue) -> Vec<Finding> {
    let field = &venue.field;
    let of = |found, expected: &str, remedy: &str| Finding {
        camera: None,
        cause: Cause::FieldSize,
        severity: Severity::Doubtful,
        found,
        expected: expected.to_owned(),
        remedy: remedy.to_owned(),
    };
    let mut findings = Vec::new();
    let [length_m, width_m] = [0, 1].map(|axis| field.max_m[axis] - field.min_m[axis]);
    if length_m.max(width_m) > WIDE_M {
        findings.push(of(
            format!("`[field]` is {length_m:.0} m by {width_m:.0} m"),
            "at most 500 m",
            "`min_m` and `max_m` are in metres: multiply centimetres by 0.01, millimetres by 0.001",
        ));
    } else if length_m.min(width_m) < NARROW_M {
        findings.push(of(
            format!("`[field]` is {length_m:.2} m by {width_m:.2} m"),
            "0.4 m or more both ways",
            "set `[field]` min_m and max_m to where people are, in metres",
        ));
    }
    let top_m = field.max_m[2] - field.floor_m;
    if top_m < LOW_M {
        findings.push(of(
            format!(
                "`[field]` ends {top_m:.2} m above its floor (z = {:.2} m), at max_m[2] = {:.2} m",
                field.floor_m, field.max_m[2]
            ),
            "room for people who stand, 2 m or more",
            "set `[field]` floor_m to the height of the floor in the calibration (0 in most), min_m[2] a little below it and \
             max_m[2] 2.5 m above it",
        ));
    }
    findings
}
