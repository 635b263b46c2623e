//! Fields that do not fit people.

use super::*;

/// The findings for the hall with a field from `min_m` to `max_m` without a floor.
fn with_field(min_m: [f64; 3], max_m: [f64; 3]) -> Vec<Finding> {
    let mut venue = venue(&hall(), 4);
    (venue.field.min_m, venue.field.max_m) = (min_m, max_m);
    venue.field.floor_m = 0.0_f64.clamp(min_m[2], max_m[2]);
    let findings = of_venue(&venue).into_iter();
    findings.filter(|it| it.cause == Cause::FieldSize).collect()
}

#[test]
fn a_field_too_low_for_standing_people_is_suspect() {
    let cases = [
        // Below the floor, a typing mistake, as high as hips, above heads.
        ([-3.3, -1.0], "0.00 m above its floor (z = -1.00 m)"),
        (
            [-0.3, 0.25],
            "0.25 m above its floor (z = 0.00 m), at max_m[2] = 0.25 m",
        ),
        ([-0.3, 1.0], "1.00 m above its floor"),
        ([1.5, 2.4], "0.90 m above its floor (z = 1.50 m)"),
    ];
    for ([low_m, high_m], words) in cases {
        let found = with_field([-5.0, -3.0, low_m], [5.0, 3.0, high_m]);
        assert_eq!(found.len(), 1, "{low_m} {high_m}: {found:?}");
        assert_eq!(found[0].severity, Severity::Doubtful, "{found:?}");
        assert!(found[0].found.contains(words), "{found:?}");
        assert!(found[0].remedy.contains("floor_m"), "{found:?}");
    }
}

#[test]
fn a_field_in_millimetres_and_a_narrow_one_are_suspect() {
    let wide = with_field([-4000.0, -3000.0, -300.0], [4000.0, 3000.0, 2400.0]);
    assert_eq!(wide.len(), 1, "{wide:?}");
    assert!(wide[0].found.contains("8000 m by 6000 m"), "{wide:?}");
    assert!(wide[0].remedy.contains("millimetres by 0.001"), "{wide:?}");
    let narrow = with_field([-0.15, -3.0, -0.3], [0.15, 3.0, 2.4]);
    assert_eq!(narrow.len(), 1, "{narrow:?}");
    assert!(narrow[0].found.contains("0.30 m by 6.00 m"), "{narrow:?}");
}

#[test]
fn fields_of_treadmill_stage_and_stadium_have_no_findings() {
    assert_eq!(with_field([-0.225, -1.0, -0.1], [0.225, 1.0, 2.2]), []);
    assert_eq!(with_field([-5.0, -3.0, 0.9], [5.0, 3.0, 3.5]), []);
    assert_eq!(with_field([-150.0, -110.0, -0.5], [150.0, 110.0, 2.6]), []);
}
