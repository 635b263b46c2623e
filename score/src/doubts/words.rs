//! A reading of the truth as what the truth seems to be, so that somebody can undo it.

use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};

use super::comparison::{Names, PARTS, Reading, TickMap};
use super::similarity::Similarity;

const AXES: [&str; 3] = ["x", "y", "z"];
/// Cosine between an axis and one of the world's from which on they are the same: 8 degrees.
const ALONG: f64 = 0.99;
/// A scale this near to that of a unit is that unit's.
const UNIT_SHARE: f64 = 0.02;
/// What rounding leaves of parts that change nothing: radians, and a share of a scale.
const NOTHING: f64 = 1e-6;
/// By how much a fit leaves a plain mirror askew, radians.
const MIRROR_ASKEW_RAD: f64 = 0.05;
/// What rounds to nothing at two decimals.
const ROUNDED_AWAY: f64 = 0.005;

/// Words that follow "the truth seems".
pub(super) fn in_words(reading: &Reading) -> String {
    let mut said: Vec<String> = of_ticks(reading.ticks).into_iter().collect();
    said.extend(of_names(reading.names));
    let place = of_place(&reading.place);
    if !place.is_empty() {
        said.push(format!("to be {}", listed(&place)));
    }
    listed(&said)
}

fn of_names(names: Names) -> Option<String> {
    match names {
        Names::AsTheyAre => None,
        Names::SidesExchanged => Some("to have left and right exchanged".to_owned()),
        Names::PartsExchanged(parts) => {
            let [one, other] = parts.map(|part| PARTS[part]);
            Some(format!("to have {one} and {other} exchanged"))
        }
    }
}

fn of_ticks(ticks: TickMap) -> Option<String> {
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

/// What the truth is against the poses: the way back.
///
/// ```text
///   q = f (Q p + d),   Q = Rᵀ, f = 1 / s, d = -Rᵀ t
/// ```
fn of_place(place: &Similarity) -> Vec<String> {
    let turn = place.turn.transpose();
    let mut said = of_turn(&turn);
    said.extend(of_shift(-(turn * place.shift_m)));
    said.extend(of_scale(place.scale.recip()));
    said
}

fn of_turn(turn: &Matrix3<f64>) -> Vec<String> {
    if turn.determinant() > 0.0 {
        return of_rotation(turn).into_iter().collect();
    }
    // Of the three ways to see it the one with the least turn.
    let ways = [0, 1, 2].map(|axis| {
        let mut rotation = *turn;
        rotation.column_mut(axis).neg_mut();
        (AXES[axis], rotation)
    });
    let angle_rad = |rotation: &Matrix3<f64>| quaternion(rotation).angle();
    let least = ways
        .into_iter()
        .min_by(|a, b| angle_rad(&a.1).total_cmp(&angle_rad(&b.1)));
    let mirrored = least.map(|(axis, rotation)| {
        let said = [
            Some(format!("mirrored along {axis}")),
            of_rotation(&rotation).filter(|_| angle_rad(&rotation) > MIRROR_ASKEW_RAD),
        ];
        said.into_iter().flatten().collect()
    });
    mirrored.unwrap_or_default()
}

fn quaternion(rotation: &Matrix3<f64>) -> UnitQuaternion<f64> {
    UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(*rotation))
}

fn of_rotation(rotation: &Matrix3<f64>) -> Option<String> {
    let (axis, angle_rad) = quaternion(rotation).axis_angle()?;
    if angle_rad < NOTHING {
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

/// Which of the poses' axes those of the truth are, where they are any.
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

fn of_shift(shift_m: Vector3<f64>) -> Option<String> {
    let [x, y, z] = [shift_m.x, shift_m.y, shift_m.z].map(rounded);
    (shift_m.amax() >= ROUNDED_AWAY).then(|| format!("shifted by ({x:.2}, {y:.2}, {z:.2}) m"))
}

fn of_scale(scale: f64) -> Option<String> {
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
    ((scale - 1.0).abs() > NOTHING).then(|| format!("scaled by {scale:.digits$}"))
}

/// For two decimals, and never minus nothing.
fn rounded(value: f64) -> f64 {
    if value.abs() < ROUNDED_AWAY {
        0.0
    } else {
        value
    }
}

/// One after the other, "and" before the last.
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

    /// What is said of a truth that has `f(point)` for each point of the poses.
    fn said(turn: Matrix3<f64>, shift_m: Vector3<f64>, scale: f64) -> String {
        let way_back = turn.transpose();
        in_words(&Reading {
            place: Similarity {
                scale: scale.recip(),
                turn: way_back,
                shift_m: -(way_back * shift_m),
            },
            ..Reading::as_it_is()
        })
    }

    #[test]
    fn a_place_is_told_by_the_parts_that_change_something() {
        let (same, nowhere) = (Matrix3::identity(), Vector3::zeros());
        let quarter = Matrix3::new(0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0);
        assert_eq!(said(same, nowhere, 1.0), "");
        assert_eq!(said(same, nowhere, 0.9), "to be scaled by 0.90");
        assert_eq!(said(same, nowhere, 998.0), "to be in millimetres");
        assert_eq!(
            said(same, Vector3::new(0.2, -0.001, 0.0), 1.0),
            "to be shifted by (0.20, 0.00, 0.00) m"
        );
        assert_eq!(
            said(quarter, nowhere, 1.0),
            "to be turned by 90 degrees about z"
        );
        assert_eq!(
            said(quarter, Vector3::new(0.004, -0.001, 0.0), 1.0),
            "to be turned by 90 degrees about z"
        );
        assert_eq!(
            said(quarter.transpose(), Vector3::new(0.0, 0.0, 1.0), 0.5),
            "to be turned by -90 degrees about z, shifted by (0.00, 0.00, 1.00) m and scaled by 0.50"
        );
    }

    #[test]
    fn a_mirror_is_told_along_the_axis_that_leaves_the_least_turn() {
        let mirrored = Matrix3::from_diagonal(&Vector3::new(1.0, -1.0, 1.0));
        let said = said(mirrored, Vector3::zeros(), 1.0);
        assert_eq!(said, "to be mirrored along y");
    }

    #[test]
    fn axes_that_stand_for_others_are_told_by_name() {
        // y up, as graphics programs have it: x = y of the poses, y = z, z = x.
        let y_up = Matrix3::new(0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0);
        let said = said(y_up, Vector3::zeros(), 1.0);
        assert_eq!(
            said,
            "to be in other axes (its x, y, z are the poses' y, z, x)"
        );
    }

    #[test]
    fn ticks_and_sides_are_told_in_the_words_of_the_files() {
        let said = |ticks, names| {
            in_words(&Reading {
                ticks,
                names,
                ..Reading::as_it_is()
            })
        };
        let (named, exchanged) = (Names::AsTheyAre, Names::SidesExchanged);
        assert_eq!(said(TickMap::After(-5), named), "to be 5 ticks later");
        assert_eq!(said(TickMap::After(1), named), "to be 1 tick earlier");
        assert_eq!(
            said(TickMap::After(0), exchanged),
            "to have left and right exchanged"
        );
    }
}
