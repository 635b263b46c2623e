//! People given by hand, and expected people.

use std::path::Path;

use super::{VENUE, check, parse};
use crate::venue::KnownBy;

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

fn with_subjects(text: &str) -> String {
    VENUE.replace("[tuning]", &format!("{text}\n[tuning]"))
}

#[test]
fn a_subject_is_a_profile_or_a_name_and_a_stature() {
    let text = with_subjects(
        "[[subject]]\nprofile = \"subjects/anna.toml\"\n[[subject]]\nname = \"Bo\"\nstature_m = 1.9",
    );
    let venue = parse(&text).unwrap();
    let known: Vec<&KnownBy> = venue.subjects.iter().map(|it| &it.known_by).collect();
    let profile = KnownBy::Profile(Path::new("venues/subjects/anna.toml").to_owned());
    let stature = KnownBy::Stature {
        name: "Bo".to_owned(),
        stature_m: 1.9,
    };
    assert_eq!(known, [&profile, &stature]);
    let message = venue.subjects[0].error("found it").to_string();
    assert_eq!(
        message,
        "venues/hall.toml:34: `subject[0].profile`: found it"
    );
}

#[test]
fn an_impossible_subject_is_refused_with_line_and_field() {
    for (text, expected) in [
        ("[[subject]]\n", "`subject[0]`: expected `profile` alone"),
        (
            "[[subject]]\nprofile = \"a.toml\"\nname = \"Bo\"",
            "`subject[0]`: expected `profile` alone, or `name` and `stature_m`",
        ),
        (
            "[[subject]]\nprofile = \"\"",
            "34: `subject[0].profile`: found \"\", expected the name of a file",
        ),
        (
            "[[subject]]\nname = \"\"\nstature_m = 1.8",
            "34: `subject[0].name`: found none",
        ),
        (
            "[[subject]]\nname = \"\\u202eBo\"\nstature_m = 1.8",
            "34: `subject[0].name`: found \"\\u{202e}Bo\"",
        ),
        (
            "[[subject]]\nname = \"Bo\"\nstature_m = 190",
            "`subject[0].stature_m`:",
        ),
        (
            "[[subject]]\nname = \"Bo\"\nstature_m = 1.8\n[[subject]]\nname = \"Bo\"\nstature_m = 1.9",
            "37: `subject[1].name`: found a second time",
        ),
        (
            "[[subject]]\nprofile = \"a.toml\"\n[[subject]]\nprofile = \"a.toml\"",
            "36: `subject[1].profile`: found a second time",
        ),
        (
            "[[subject]]\nheight_m = 1.8",
            "34: `subject[0].height_m`: unknown field",
        ),
    ] {
        let message = parse(&with_subjects(text)).unwrap_err().to_string();
        assert!(message.contains(expected), "{message}\n{expected}");
    }
    let many = (0..257).map(|i| format!("[[subject]]\nprofile = \"{i}.toml\"\n"));
    let many = parse(&with_subjects(&many.collect::<String>()));
    let message = many.unwrap_err().to_string();
    assert!(
        message.contains("`subject`: found 257, expected at most 256"),
        "{message}"
    );
}
