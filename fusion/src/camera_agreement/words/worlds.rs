//! Cameras that were not all calibrated in one world.

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

pub(super) fn axis_scale(x_over_y: f64) -> (String, String) {
    (
        format!(
            "lengths along x and along y of the calibration have not the same scale: those along x are {x_over_y:.2} times as long beside \
             those along y as they should be"
        ),
        "measure the places that the calibration was laid on again, in both directions, and calibrate with them (units, and the points of a \
         court that is not of the size that was given)"
            .to_owned(),
    )
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
