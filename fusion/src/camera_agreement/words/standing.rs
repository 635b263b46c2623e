//! Sentences about how tall people are, and about the floor on which they stand.

/// Mean stature of adults, metres.
const ADULT_M: f64 = 1.7;
/// Statures that differ by less are written as one number, metres.
const SAME_STATURE_M: f64 = 0.01;

fn range([low_m, high_m]: [f64; 2]) -> String {
    if high_m - low_m < SAME_STATURE_M {
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
    } else if high_m - low_m < SAME_STATURE_M {
        format!("everybody is {stature_m:.2} m tall")
    } else {
        let statures = range([low_m, high_m]);
        format!("everybody is {statures} tall ({people} people)")
    };
    let unless = match (stature_m < ADULT_M, people) {
        (true, 1) => "unless this is a child",
        (true, _) => "unless all of them are children",
        (false, 1) => "unless this person is so tall",
        (false, _) => "unless all of them are so tall",
    };
    (
        found,
        format!(
            "{unless}: is the calibration in metres? Scale its translations (of adults by about {:.2}), or calibrate with an object of \
             known size; the venue file can state who is expected, by `[[subject]]` with `stature_m`",
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
    let [found, named] = [range_m, expected_m].map(range);
    (
        format!("everybody is {found} tall, but the subjects of the venue file are {named}"),
        format!(
            "if these are the same people, scale the translations of the calibration by about {:.2}; otherwise correct `stature_m` of each \
             `[[subject]]`",
            0.5 * (short_m + tall_m) / stature_m.max(0.01)
        ),
    )
}

pub(super) fn world_tilted(degrees: f64) -> (String, String) {
    (
        format!(
            "the floor and the people on it are tilted by {degrees:.1} degrees: z of the calibration is not up"
        ),
        "align the calibration again, with z up: by the floor, or by marked places in `farfield calibrate ... --marks`"
            .to_owned(),
    )
}

pub(super) fn floor_height(above_m: f64, floor_m: f64) -> (String, String) {
    let feet_m = floor_m + above_m;
    let (found, first) = if above_m < 0.0 {
        let found = format!("everybody who stands is {:.2} m under the floor", -above_m);
        (found, "")
    } else {
        let found = format!("all feet are {above_m:.2} m above the floor");
        (
            found,
            "if people stand on a stage or a treadmill, hang or jump, this is correct; otherwise ",
        )
    };
    (
        format!("{found} (at z = {feet_m:.2} m, `floor_m` is {floor_m:.2} m)"),
        format!(
            "{first}set `[field] floor_m` of the venue to the height at which people stand (`min_m` no higher); if it is right, check \
             the origin of the calibration, and also the focal lengths if people are too large or too small"
        ),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_statures_are_written_once() {
        let (found, remedy) = scale_of_subjects(1.76, [1.76, 1.76], [1.5, 1.5]);
        assert_eq!(
            found,
            "everybody is 1.76 m tall, but the subjects of the venue file are 1.50 m"
        );
        assert!(remedy.contains("by about 0.85"), "{remedy}");
        let (found, _) = scale_of_subjects(1.76, [1.7, 1.8], [1.5, 1.55]);
        assert_eq!(
            found,
            "everybody is 1.70 to 1.80 m tall, but the subjects of the venue file are 1.50 to 1.55 m"
        );
    }
}
