//! Fields into which people do not fit.

use super::*;

/// What is said of the hall with a field from `min_m` to `max_m` that names no floor.
fn with_field(min_m: [f64; 3], max_m: [f64; 3]) -> Vec<Finding> {
    let mut venue = venue(&hall(), 4);
    (venue.field.min_m, venue.field.max_m) = (min_m, max_m);
    venue.field.floor_m = 0.0_f64.clamp(min_m[2], max_m[2]);
    let findings = of_venue(&venue).into_iter();
    findings.filter(|it| it.cause == Cause::FieldSize).collect()
}

#[test]
fn a_field_that_ends_under_peoples_hips_or_leaves_out_the_tall_is_doubted() {
    let cases = [
        // Under the floor, a typing mistake, as high as hips, above heads.
        ([-3.3, -1.0], "0.00 m above its floor (z = -1.00 m)"),
        (
            [-0.3, 0.25],
            "0.25 m above its floor (z = 0.00 m), at max_m[2] = 0.25 m",
        ),
        ([-0.3, 1.0], "1.00 m above its floor"),
        ([1.5, 2.4], "0.90 m above its floor (z = 1.50 m)"),
    ];
    for ([low_m, high_m], words) in cases {
        let said = with_field([-5.0, -3.0, low_m], [5.0, 3.0, high_m]);
        assert_eq!(said.len(), 1, "{low_m} {high_m}: {said:?}");
        assert_eq!(said[0].severity, Severity::Doubtful, "{said:?}");
        assert!(said[0].found.contains(words), "{said:?}");
        assert!(said[0].remedy.contains("floor_m"), "{said:?}");
    }
}

#[test]
fn a_field_in_millimetres_and_a_narrow_one_are_doubted() {
    let wide = with_field([-4000.0, -3000.0, -300.0], [4000.0, 3000.0, 2400.0]);
    assert_eq!(wide.len(), 1, "{wide:?}");
    assert!(wide[0].found.contains("8000 m by 6000 m"), "{wide:?}");
    assert!(wide[0].remedy.contains("millimetres by 0.001"), "{wide:?}");
    let narrow = with_field([-0.15, -3.0, -0.3], [0.15, 3.0, 2.4]);
    assert_eq!(narrow.len(), 1, "{narrow:?}");
    assert!(narrow[0].found.contains("0.30 m by 6.00 m"), "{narrow:?}");
}

#[test]
fn fields_of_a_treadmill_a_stage_and_a_stadium_give_no_word() {
    assert_eq!(with_field([-0.225, -1.0, -0.1], [0.225, 1.0, 2.2]), []);
    assert_eq!(with_field([-5.0, -3.0, 0.9], [5.0, 3.0, 3.5]), []);
    assert_eq!(with_field([-150.0, -110.0, -0.5], [150.0, 110.0, 2.6]), []);
}
