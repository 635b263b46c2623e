//! People given by hand.

use super::{VENUE, check, parse};

#[test]
fn a_person_given_by_hand_must_show_a_body() {
    // Regression: no body could be fitted to such a person, who was missing without an error.
    check(
        ", nose = [0.0, 0.3, 1.6]",
        "",
        "31: `person[0].keypoints_m`: found 4, expected at least 5 keypoints",
    );
    check(
        "right_shoulder",
        "right_ear",
        "31: `person[0].keypoints_m`: found neither both shoulders nor both hips, expected `left_shoulder` and `right_shoulder`, or `left_hip` and `right_hip`",
    );
    let hips = VENUE
        .replace("right_shoulder", "right_ear")
        .replace("left_knee", "right_hip");
    assert_eq!(parse(&hips).unwrap().given_persons[0].keypoints_m.len(), 5);
}

#[test]
fn without_a_network_the_names_given_by_hand_are_those_of_coco() {
    let text = "name = \"k\"\nrate_hz = 20\ncalibration = \"c.toml\"\n[[viewpoint]]\nname = \"v\"\n\
        [[viewpoint.camera]]\nname = \"south\"\nsource = { kind = \"keypoints\", path = \"k.jsonl\" }\n\
        [[person]]\ntick = 0\n[person.keypoints_m]\nleft_sholder = [0, 0, 1.4]\n";
    let refused = parse(text).unwrap_err().to_string();
    assert_eq!(
        refused,
        "venues/hall.toml:12: `person[0].keypoints_m.left_sholder`: unknown keypoint `left_sholder`, did you mean `left_shoulder`?"
    );
}

#[test]
fn a_person_given_by_hand_has_the_size_of_a_body() {
    // Regression: a person given in millimetres was never tracked, without an error.
    check(
        "[0.0, 0.3, 1.6]",
        "[0.0, 0.3, 1600.0]",
        "31: `person[0].keypoints_m`: found keypoints up to 1599.50 m apart, expected those of one body, 0.15 to 3 m: metres, in the world of the calibration",
    );
}

#[test]
fn a_person_given_by_hand_is_in_or_near_the_field() {
    // Regression: a person given elsewhere was dropped at the first tick, without an error.
    let at = |y: &str, nose_y: &str| {
        let moved = VENUE.replace(", 0.2, ", &format!(", {y}, "));
        parse(&moved.replace("0.3, 1.6]", &format!("{nose_y}, 1.6]")))
    };
    let refused = at("50.2", "50.3").unwrap_err().to_string();
    assert_eq!(
        refused,
        "venues/hall.toml:31: `person[0].keypoints_m`: found a body around (-0.02, 50.22, 1.16) m, expected one inside the field, \
         [-12.0, -8.0, 0.0] to [12.0, 8.0, 2.5], or up to 1 m outside it (`births.outside_field_m`)"
    );
    assert!(at("8.5", "8.6").is_ok());
}
