//! Checks camera positions: heights, distances, units of length.

use std::collections::BTreeMap;

use crate::venue::Field;

use super::{Cause, Finding, Severity, Sight};

/// Largest depth below the floor, from the choice of the world's origin, of a camera that stands on
/// it, metres.
const FLOOR_TOLERANCE_M: f64 = 0.2;
/// Largest depth of a stage or pit, metres.
const DEEPEST_M: f64 = 5.0;
/// Heights of cameras, metres: the roof of a large hall, and the limit of any building.
const HIGH_M: f64 = 60.0;
const HIGHEST_M: f64 = 200.0;
/// Lowest tripod, metres.
const LOW_M: f64 = 0.2;
/// If the cameras have this height, one on the floor is suspect, metres.
const USUAL_HEIGHT_M: f64 = 1.0;
/// Smallest venue, metres; and the limit below which it is impossible.
const NARROW_M: f64 = 0.5;
const POINT_M: f64 = 0.02;
/// Few venues are wider, metres.
const WIDE_M: f64 = 300.0;
/// Cameras of two viewpoints closer than this are at one place, metres.
const SAME_PLACE_M: f64 = 0.01;
/// Cameras of one viewpoint closer than this have the same numbers, metres.
const COPIED_M: f64 = 1e-6;
/// Largest distance between cameras at one corner, metres: masts, trusses and camera boxes are
/// smaller.
const ONE_CORNER_M: f64 = 3.0;
/// Cosine of an angle of about 0.2 degrees: the same orientation.
const ALIKE: f64 = 0.999_99;
/// Margin of the default field around the cameras, metres.
const MARGIN_M: f64 = 5.0;

/// Beyond this distance, poses in 32 bit numbers have steps of 1 mm, metres.
pub const FAR_ORIGIN_M: f64 = 8192.0;

/// The step of poses at this distance from the origin, millimetres: a 32 bit number has 24 bits for
/// its value.
pub fn pose_step_mm(away_m: f64) -> f64 {
    libm::exp2(libm::floor(libm::log2(away_m.max(1.0))) - 23.0) * 1e3
}

/// Whether all cameras are far from the origin.
pub(super) fn origin(sights: &[Sight]) -> Option<Finding> {
    let away_m = |sight: &Sight| {
        let [x, y, z] = sight.center_m;
        (x * x + y * y + z * z).sqrt()
    };
    let nearest_m = sights.iter().map(away_m).fold(f64::INFINITY, f64::min);
    let at = sights
        .first()?
        .center_m
        .map(|it| (it / 10.0).round() * 10.0);
    (nearest_m > FAR_ORIGIN_M).then(|| Finding {
        camera: None,
        cause: Cause::FarOrigin,
        severity: Severity::Doubtful,
        found: format!(
            "the cameras stand {:.0} km from the origin: poses come in steps of {:.1} mm there",
            nearest_m / 1e3,
            pose_step_mm(nearest_m)
        ),
        expected: "an origin near the cameras".to_owned(),
        remedy: format!(
            "subtract one, z being the height of the floor: `farfield calibrate convert FILE --origin {:.0},{:.0},{:.0} --out DIR`, and from `[field]` as well",
            at[0], at[1], at[2]
        ),
    })
}

fn of_camera(sight: &Sight, cause: Cause, severity: Severity, found: String) -> Finding {
    let (expected, remedy) = match cause {
        Cause::UnderFloor => (
            "one above the floor",
            "z is up and 0 on the floor: check the sign of `translation`, and which point is the origin of the calibration",
        ),
        _ => (
            "0.2 to 60 m",
            "`translation` is in metres, world to camera: the camera stands at -R' t; a height above the sea is subtracted by \
             `farfield calibrate convert FILE --origin 0,0,Z --out DIR`",
        ),
    };
    Finding {
        camera: Some(sight.name.clone()),
        cause,
        severity,
        found,
        expected: expected.to_owned(),
        remedy: remedy.to_owned(),
    }
}

pub(super) fn heights(sights: &[Sight], field: &Field) -> Vec<Finding> {
    // Cameras that film a stage may be lower than it.
    let floor_m = field.floor_m.min(0.0);
    let height_m = |sight: &Sight| sight.center_m[2] - floor_m;
    let below = sights
        .iter()
        .filter(|it| height_m(it) < -FLOOR_TOLERANCE_M)
        .count();
    let mut sorted: Vec<f64> = sights.iter().map(height_m).collect();
    sorted.sort_unstable_by(f64::total_cmp);
    let usual_m = sorted.get(sorted.len() / 2).copied().unwrap_or(0.0);
    let judge = |sight: &Sight| {
        let h_m = height_m(sight);
        if h_m < -FLOOR_TOLERANCE_M {
            let is_wrong = h_m < -DEEPEST_M || 2 * below > sights.len();
            let severity = if is_wrong {
                Severity::Wrong
            } else {
                Severity::Doubtful
            };
            let found = format!("it stands {:.2} m under the floor", -h_m);
            Some(of_camera(sight, Cause::UnderFloor, severity, found))
        } else if h_m > HIGH_M {
            let severity = if h_m > HIGHEST_M {
                Severity::Wrong
            } else {
                Severity::Doubtful
            };
            let found = format!("it hangs {h_m:.0} m above the floor");
            Some(of_camera(sight, Cause::Height, severity, found))
        } else if h_m < LOW_M && usual_m > USUAL_HEIGHT_M {
            let found = format!("it stands {h_m:.2} m above the floor");
            Some(of_camera(sight, Cause::Height, Severity::Doubtful, found))
        } else {
            None
        }
    };
    sights.iter().filter_map(judge).collect()
}

pub(super) fn distances(sights: &[Sight]) -> Vec<Finding> {
    let mut found = same_places(sights);
    if found.iter().any(Finding::is_wrong) {
        return found;
    }
    // In too small a unit separate cameras seem to be at one place; in too large a one those of a
    // mast seem far apart.
    match units(sights) {
        Some(finding) if found.is_empty() || finding.is_wrong() => vec![finding],
        _ => {
            found.extend(scattered_viewpoints(sights));
            found
        }
    }
}

fn distance_m(a: &Sight, b: &Sight) -> f64 {
    let [x, y, z] = [0, 1, 2].map(|i| a.center_m[i] - b.center_m[i]);
    (x * x + y * y + z * z).sqrt()
}

fn same_places(sights: &[Sight]) -> Vec<Finding> {
    let mut findings = Vec::new();
    for (i, b) in sights.iter().enumerate() {
        let Some(a) = sights[..i].iter().find(|a| distance_m(a, b) < SAME_PLACE_M) else {
            continue;
        };
        let cosine = |u: [f64; 3], v: [f64; 3]| u[0] * v[0] + u[1] * v[1] + u[2] * v[2];
        let is_alike = cosine(a.forward, b.forward) > ALIKE && cosine(a.right, b.right) > ALIKE;
        // Cameras of one viewpoint may share a mast.
        let (severity, how) = match (is_alike, a.viewpoint == b.viewpoint) {
            (false, true) => continue,
            (true, false) => (
                Severity::Wrong,
                "at the same place, with the same orientation, as",
            ),
            // Twins on one mast have the same orientation, but never the same numbers.
            (true, true) if distance_m(a, b) > COPIED_M => continue,
            (true, true) => (
                Severity::Doubtful,
                "at the same place, with the same orientation, as",
            ),
            (false, false) => (Severity::Doubtful, "at the same place as"),
        };
        findings.push(Finding {
            camera: Some(b.name.clone()),
            cause: Cause::SamePlace,
            severity,
            found: format!("it stands {how} `{}`", a.name),
            expected: "places that differ".to_owned(),
            remedy: "check whether the table of one was copied to the other, or never calibrated"
                .to_owned(),
        });
    }
    findings
}

/// Cameras of one viewpoint that are far apart: for each such viewpoint the two with the largest
/// distance.
fn scattered_viewpoints(sights: &[Sight]) -> Vec<Finding> {
    // A single viewpoint has the same finding and remedy.
    if !viewpoints_differ(sights) {
        return Vec::new();
    }
    let mut farthest: BTreeMap<usize, (f64, &Sight, &Sight)> = BTreeMap::new();
    for (i, b) in sights.iter().enumerate() {
        for a in sights[..i].iter().filter(|a| a.viewpoint == b.viewpoint) {
            let pair = (distance_m(a, b), a, b);
            let known = farthest.entry(b.viewpoint).or_insert(pair);
            if pair.0 > known.0 {
                *known = pair;
            }
        }
    }
    let scattered = farthest.into_values().filter(|it| it.0 > ONE_CORNER_M);
    let finding = |(apart_m, a, b): (f64, &Sight, &Sight)| Finding {
        camera: Some(b.name.clone()),
        cause: Cause::ViewpointApart,
        severity: Severity::Doubtful,
        found: format!(
            "it stands {apart_m:.1} m from `{}`, in one viewpoint with it",
            a.name
        ),
        expected: format!(
            "at most {ONE_CORNER_M:.0} m: a viewpoint is one corner with the cameras of its edge, of which one is used for each person"
        ),
        remedy: "give each of the two a `[[viewpoint]]` of its own".to_owned(),
    };
    scattered.map(finding).collect()
}

fn viewpoints_differ(sights: &[Sight]) -> bool {
    sights.iter().any(|it| it.viewpoint != sights[0].viewpoint)
}

/// Whether the lengths are metres.
fn units(sights: &[Sight]) -> Option<Finding> {
    let pairs = |i: usize| sights[..i].iter().map(move |a| distance_m(a, &sights[i]));
    let widest_m = (1..sights.len()).flat_map(pairs).fold(0.0, f64::max);
    if !viewpoints_differ(sights) || (NARROW_M..=WIDE_M).contains(&widest_m) {
        return None;
    }
    let severity = if widest_m < POINT_M {
        Severity::Wrong
    } else {
        Severity::Doubtful
    };
    let remedy = if widest_m < NARROW_M {
        "`translation` is in metres; if the calibration counts in squares of its board, multiply by a square's length"
    } else {
        "`translation` is in metres: multiply centimetres by 0.01, millimetres by 0.001"
    };
    Some(Finding {
        camera: None,
        cause: Cause::Units,
        severity,
        found: format!("all cameras are within {widest_m:.2} m of each other"),
        expected: format!("a venue {NARROW_M} to {WIDE_M} m wide"),
        remedy: remedy.to_owned(),
    })
}

/// The default field of a venue with these cameras.
pub(super) fn around(sights: &[Sight], heights: &Field) -> Field {
    let mut field = *heights;
    for axis in 0..2 {
        let along = || sights.iter().map(|it| it.center_m[axis]);
        field.min_m[axis] = along().fold(f64::INFINITY, f64::min) - MARGIN_M;
        field.max_m[axis] = along().fold(f64::NEG_INFINITY, f64::max) + MARGIN_M;
    }
    field
}
