//! What is told of how tall people are and of the floor on which they stand.

/// What adults are tall on average, metres.
const ADULT_M: f64 = 1.7;
/// Statures that differ by less are written as one, metres.
const SAME_M: f64 = 0.01;

/// The lowest and the highest of some statures.
fn between([low_m, high_m]: [f64; 2]) -> String {
    if high_m - low_m < SAME_M {
        format!("{low_m:.2} m")
    } else {
        format!("{low_m:.2} to {high_m:.2} m")
    }
}

pub(super) fn world_scale(
    stature_m: f64,
    people: usize,
    [low_m, high_m]: [f64; 2],
) -> (String, String) {
    let found = if people == 1 {
        format!("the one person who was measured is {stature_m:.2} m tall")
    } else if high_m - low_m < SAME_M {
        format!("everybody is {stature_m:.2} m tall")
    } else {
        let statures = between([low_m, high_m]);
        format!("everybody is {statures} tall ({people} people)")
    };
    let unless = match (stature_m < ADULT_M, people) {
        (true, 1) => "unless this is a child",
        (true, _) => "unless all of them are children",
        (false, 1) => "unless this person is",
        (false, _) => "unless all of them are",
    };
    (
        found,
        format!(
            "{unless}: is the calibration in metres? Scale its translations (of adults by about {:.2}), or calibrate with an object of \
             known size; who is to come can be said by `[[subject]]` with `stature_m`",
            ADULT_M / stature_m.max(0.01)
        ),
    )
}

pub(super) fn scale_of_subjects(
    stature_m: f64,
    range_m: [f64; 2],
    expected_m: [f64; 2],
) -> (String, String) {
    let [short_m, tall_m] = expected_m;
    let [found, named] = [range_m, expected_m].map(between);
    (
        format!("everybody is {found} tall, and those whom the venue names are {named}"),
        format!(
            "if they are the ones, scale the translations of the calibration by about {:.2}; else mend `stature_m` of each `[[subject]]`",
            0.5 * (short_m + tall_m) / stature_m.max(0.01)
        ),
    )
}

pub(super) fn world_tilted(degrees: f64) -> (String, String) {
    (
        format!(
            "the floor on which people stand is tilted by {degrees:.1} degrees, and so are they: z of the calibration is not up"
        ),
        "align the calibration anew, with z up: by the floor or by places in `farfield calibrate ... --marks`"
            .to_owned(),
    )
}

pub(super) fn floor_height(above_m: f64, floor_m: f64) -> (String, String) {
    let feet_m = floor_m + above_m;
    let (found, first) = if above_m < 0.0 {
        let found = format!("everybody who stands is {:.2} m under the floor", -above_m);
        (found, "")
    } else {
        let found = format!("nobody stands on the floor: all feet are {above_m:.2} m above it");
        (
            found,
            "if people stand on a stage or a treadmill, hang or jump, that is so; else ",
        )
    };
    (
        format!("{found} (at z = {feet_m:.2} m, `floor_m` is {floor_m:.2} m)"),
        format!(
            "{first}set `[field] floor_m` of the venue to where people stand (`min_m` no higher); if it is right, look at the \
             origin of the calibration, and, where people are too large or too small as well, at the focal lengths"
        ),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_stature_is_not_written_as_two() {
        let (found, remedy) = scale_of_subjects(1.76, [1.76, 1.76], [1.5, 1.5]);
        assert_eq!(
            found,
            "everybody is 1.76 m tall, and those whom the venue names are 1.50 m"
        );
        assert!(remedy.contains("by about 0.85"), "{remedy}");
        let (found, _) = scale_of_subjects(1.76, [1.7, 1.8], [1.5, 1.55]);
        assert_eq!(
            found,
            "everybody is 1.70 to 1.80 m tall, and those whom the venue names are 1.50 to 1.55 m"
        );
    }
}
