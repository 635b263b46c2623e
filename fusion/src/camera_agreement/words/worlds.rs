//! Cameras that were not all calibrated in one world.

use super::super::report::FloorAxis;

pub(super) fn doubled(cameras: &[String], apart_m: f64) -> (String, String) {
    (
        format!(
            "people are followed twice: cameras {} show them {apart_m:.2} m from where the others do",
            cameras.join(", ")
        ),
        "the two groups were calibrated with other origins, or a direction was measured too short, or their recorders began at \
         two instants: calibrate all together, or cut their videos alike"
            .to_owned(),
    )
}

pub(super) fn axis_scale(x_over_y: f64, wrong: Option<FloorAxis>) -> (String, String) {
    let points = "(units, and the points of a court that is not of the size that was given)";
    let of_one = |axis: &str, other: &str, factor: f64| {
        (
            format!(
                "lengths along {axis} of the calibration are {factor:.2} times what they should be: those along {other} are right, and feet \
                 are on the floor once those along {axis} are mended"
            ),
            format!(
                "measure the places that the calibration was laid on again along {axis}, and calibrate with them {points}"
            ),
        )
    };
    match wrong {
        Some(FloorAxis::X) => of_one("x", "y", x_over_y),
        Some(FloorAxis::Y) => of_one("y", "x", 1.0 / x_over_y),
        None => (
            format!(
                "lengths along x and along y of the calibration have not the same scale: those along x are {x_over_y:.2} times those along \
                 y, and which of the two are wrong nothing tells"
            ),
            format!(
                "measure the places that the calibration was laid on again, in both directions, and calibrate with them {points}"
            ),
        ),
    }
}

pub(super) fn two_origins(cameras: &[String], apart_m: f64) -> (String, String) {
    (
        format!(
            "cameras {} show everybody {apart_m:.2} m from where the others do, all alike",
            cameras.join(", ")
        ),
        "the two groups were calibrated with other origins: calibrate all together".to_owned(),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn which_axis_is_wrong_is_said_where_that_is_known_with_by_how_much_lengths_along_it_are() {
        let (found, remedy) = axis_scale(1.11, Some(FloorAxis::Y));
        assert!(
            found.starts_with(
                "lengths along y of the calibration are 0.90 times what they should be"
            ),
            "{found}"
        );
        assert!(remedy.contains("again along y"), "{remedy}");
        let (found, remedy) = axis_scale(1.11, None);
        assert!(
            found.contains("those along x are 1.11 times those along y"),
            "{found}"
        );
        assert!(remedy.contains("in both directions"), "{remedy}");
    }
}
