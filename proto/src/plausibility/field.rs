//! Checks that people fit into the field: a new person is followed only if the middle of the body
//! is inside it.

use crate::venue::Venue;

use super::{Cause, Finding, Severity};

/// The middle of a standing body, between hips and shoulders, is at 0.9 to 1.2 m. A field with a
/// lower top above its floor excludes tall people, metres; only people who sit, kneel or lie are
/// found then.
const LOW_M: f64 = 1.2;
/// Narrowest field, metres: a treadmill has 0.45.
const NARROW_M: f64 = 0.4;
/// Widest field, metres: a stadium with its stands has 300.
const WIDE_M: f64 = 500.0;

/// Findings about the size of the venue's field.
pub(super) fn findings(venue: &Venue) -> Vec<Finding> {
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
