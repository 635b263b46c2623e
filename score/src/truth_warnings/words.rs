//! Describes a reading of the truth as what the truth seems to be, so that the user can undo it.

use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};

use super::comparison::{NameMap, PARTS, Reading, TickMap};
use super::similarity::Similarity;

const AXES: [&str; 3] = ["x", "y", "z"];
/// Least cosine between an axis and a world axis at which they count as the same: 8 degrees.
const ALONG: f64 = 0.99;
/// A scale this near to that of a unit is that unit's.
const UNIT_SHARE: f64 = 0.02;
/// Bound on the rounding of parts that change nothing: radians, and a share of a scale.
const NEGLIGIBLE: f64 = 1e-6;
/// Turn that a fit adds to a pure mirror image, radians.
const MIRROR_ASKEW_RAD: f64 = 0.05;
/// Rounds to zero at two decimals.
const ROUNDED_AWAY: f64 = 0.005;

/// Words that follow "the truth seems".
pub(super) fn in_words(reading: &Reading) -> String {
    let mut parts: Vec<String> = tick_words(reading.ticks).into_iter().collect();
    parts.extend(name_words(reading.names));
    let place = place_words(&reading.place);
    if !place.is_empty() {
        parts.push(format!("to be {}", listed(&place)));
    }
    listed(&parts)
}

fn name_words(names: NameMap) -> Option<String> {
    match names {
        NameMap::Unchanged => None,
        NameMap::SidesExchanged => Some("to have left and right exchanged".to_owned()),
        NameMap::PartsExchanged(parts) => {
            let [one, other] = parts.map(|part| PARTS[part]);
            Some(format!("to have {one} and {other} exchanged"))
        }
    }
}

fn tick_words(ticks: TickMap) -> Option<String> {
    match ticks {
        TickMap::After(0) => None,
        TickMap::After(ticks) => {
            let which = if ticks < 0 { "later" } else { "earlier" };
            let n = ticks.unsigned_abs();
            let s = if n == 1 { "" } else { "s" };
            Some(format!("to be {n} tick{s} {which}"))
        }
        TickMap::TwoToOne(_) => Some("to count two ticks where the poses count one".to_owned()),
        TickMap::OneToTwo(_) => Some("to count one tick where the poses count two".to_owned()),
    }
}

/// The inverse of `place`: the truth relative to the poses.
///
/// ```text
///   q = f (Q p + d),   Q = Rᵀ, f = 1 / s, d = -Rᵀ t
/// ```
fn place_words(place: &Similarity) -> Vec<String> {
    let turn = place.turn.transpose();
    let mut parts = turn_words(&turn);
    parts.extend(shift_words(-(turn * place.shift_m)));
    parts.extend(scale_words(place.scale.recip()));
    parts
}

fn turn_words(turn: &Matrix3<f64>) -> Vec<String> {
    if turn.determinant() > 0.0 {
        return rotation_words(turn).into_iter().collect();
    }
    // A mirror along any axis plus a rotation: the one with the smallest rotation is reported.
    let options = [0, 1, 2].map(|axis| {
        let mut rotation = *turn;
        rotation.column_mut(axis).neg_mut();
        (AXES[axis], rotation)
    });
    let angle_rad = |rotation: &Matrix3<f64>| quaternion(rotation).angle();
    let least = options
        .into_iter()
        .min_by(|a, b| angle_rad(&a.1).total_cmp(&angle_rad(&b.1)));
    let mirrored = least.map(|(axis, rotation)| {
        let parts = [
            Some(format!("mirrored along {axis}")),
            rotation_words(&rotation).filter(|_| angle_rad(&rotation) > MIRROR_ASKEW_RAD),
        ];
        parts.into_iter().flatten().collect()
    });
    mirrored.unwrap_or_default()
}

fn quaternion(rotation: &Matrix3<f64>) -> UnitQuaternion<f64> {
    UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(*rotation))
}

fn rotation_words(rotation: &Matrix3<f64>) -> Option<String> {
    let (axis, angle_rad) = quaternion(rotation).axis_angle()?;
    if angle_rad < NEGLIGIBLE {
        return None;
    }
    let degrees = angle_rad.to_degrees();
    let main = axis.iamax();
    if axis[main].abs() > ALONG {
        let degrees = degrees * axis[main].signum();
        let digits = usize::from(degrees.abs() < 10.0);
        let name = AXES[main];
        return Some(format!("turned by {degrees:.digits$} degrees about {name}"));
    }
    if let Some(names) = other_axes(rotation) {
        return Some(format!(
            "in other axes (its x, y, z are the poses' {names})"
        ));
    }
    let [x, y, z] = [axis.x, axis.y, axis.z].map(rounded);
    Some(format!(
        "turned by {degrees:.0} degrees about ({x:.2}, {y:.2}, {z:.2})"
    ))
}

/// The axes of the poses that the axes of the truth coincide with, if they are permuted.
fn other_axes(rotation: &Matrix3<f64>) -> Option<String> {
    let mut names = Vec::new();
    for row in rotation.row_iter() {
        let at = row.iter().position(|entry| entry.abs() > ALONG)?;
        let sign = if row[at] < 0.0 { "-" } else { "" };
        names.push(format!("{sign}{}", AXES[at]));
    }
    let are_others = names != AXES;
    are_others.then(|| names.join(", "))
}

fn shift_words(shift_m: Vector3<f64>) -> Option<String> {
    let [x, y, z] = [shift_m.x, shift_m.y, shift_m.z].map(rounded);
    (shift_m.amax() >= ROUNDED_AWAY).then(|| format!("shifted by ({x:.2}, {y:.2}, {z:.2}) m"))
}

fn scale_words(scale: f64) -> Option<String> {
    let is_about = |unit: f64| (scale / unit - 1.0).abs() < UNIT_SHARE;
    if is_about(1000.0) {
        return Some("in millimetres".to_owned());
    }
    if is_about(100.0) {
        return Some("in centimetres".to_owned());
    }
    let digits = if is_about(1.0) || scale < 0.1 {
        4
    } else if scale < 10.0 {
        2
    } else {
        0
    };
    ((scale - 1.0).abs() > NEGLIGIBLE).then(|| format!("scaled by {scale:.digits$}"))
}

/// Avoids a minus zero at two decimals.
fn rounded(value: f64) -> f64 {
    if value.abs() < ROUNDED_AWAY {
        0.0
    } else {
        value
    }
}

/// Joins with commas, and "and" before the last.
fn listed(parts: &[String]) -> String {
    match parts {
        [] => String::new(),
        [only] => only.clone(),
        [before @ .., last] => format!("{} and {last}", before.join(", ")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The words for a truth that maps each point of the poses by this similarity.
    fn words(turn: Matrix3<f64>, shift_m: Vector3<f64>, scale: f64) -> String {
        let inverse = turn.transpose();
        in_words(&Reading {
            place: Similarity {
                scale: scale.recip(),
                turn: inverse,
                shift_m: -(inverse * shift_m),
            },
            ..Reading::unchanged()
        })
    }

    #[test]
    fn only_the_parts_that_change_something_are_reported() {
        let (same, nowhere) = (Matrix3::identity(), Vector3::zeros());
        let quarter = Matrix3::new(0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0);
        assert_eq!(words(same, nowhere, 1.0), "");
        assert_eq!(words(same, nowhere, 0.9), "to be scaled by 0.90");
        assert_eq!(words(same, nowhere, 998.0), "to be in millimetres");
        assert_eq!(
            words(same, Vector3::new(0.2, -0.001, 0.0), 1.0),
            "to be shifted by (0.20, 0.00, 0.00) m"
        );
        assert_eq!(
            words(quarter, nowhere, 1.0),
            "to be turned by 90 degrees about z"
        );
        assert_eq!(
            words(quarter, Vector3::new(0.004, -0.001, 0.0), 1.0),
            "to be turned by 90 degrees about z"
        );
        assert_eq!(
            words(quarter.transpose(), Vector3::new(0.0, 0.0, 1.0), 0.5),
            "to be turned by -90 degrees about z, shifted by (0.00, 0.00, 1.00) m and scaled by 0.50"
        );
    }

    #[test]
    fn a_mirror_is_reported_along_the_axis_with_the_smallest_turn() {
        let mirrored = Matrix3::from_diagonal(&Vector3::new(1.0, -1.0, 1.0));
        let words = words(mirrored, Vector3::zeros(), 1.0);
        assert_eq!(words, "to be mirrored along y");
    }

    #[test]
    fn permuted_axes_are_reported_by_name() {
        // y up, as in graphics programs: x = y of the poses, y = z, z = x.
        let y_up = Matrix3::new(0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0);
        assert_eq!(
            words(y_up, Vector3::zeros(), 1.0),
            "to be in other axes (its x, y, z are the poses' y, z, x)"
        );
    }

    #[test]
    fn ticks_and_sides_are_reported() {
        let words = |ticks, names| {
            in_words(&Reading {
                ticks,
                names,
                ..Reading::unchanged()
            })
        };
        let (named, exchanged) = (NameMap::Unchanged, NameMap::SidesExchanged);
        assert_eq!(words(TickMap::After(-5), named), "to be 5 ticks later");
        assert_eq!(words(TickMap::After(1), named), "to be 1 tick earlier");
        assert_eq!(
            words(TickMap::After(0), exchanged),
            "to have left and right exchanged"
        );
    }
}
