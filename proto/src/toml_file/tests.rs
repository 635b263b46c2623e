//! The errors of invalid TOML files.

use serde::Deserialize;

use super::*;

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
#[expect(dead_code, reason = "only the refusals matter")]
struct Hall {
    rate_hz: f64,
    #[serde(default)]
    room: Vec<Room>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
#[expect(dead_code, reason = "only the refusals matter")]
struct Room {
    name: String,
    size_m: [f64; 2],
}

fn refusal(text: &str) -> String {
    let file = TomlFile::parse(text, Path::new("hall.toml"));
    file.and_then(|file| file.read::<Hall>())
        .unwrap_err()
        .to_string()
}

#[test]
fn an_unknown_field_is_refused_with_the_nearest_name() {
    let message = refusal("rate_hz = 60\n[[room]]\nname = \"a\"\nsize = [1, 2]\n");
    assert_eq!(
        message,
        "hall.toml:4: `room[0].size`: unknown field `size`, did you mean `size_m`?"
    );
    let message = refusal("\nrate = 60\n");
    assert_eq!(
        message,
        "hall.toml:2: `rate`: unknown field `rate`, did you mean `rate_hz`?"
    );
    let message = refusal("\nspeed = 60\n");
    assert_eq!(
        message,
        "hall.toml:2: `speed`: unknown field `speed`, expected one of `rate_hz`, `room`"
    );
}

#[test]
fn only_similar_names_are_suggested() {
    let venue = ["name", "rate_hz", "calibration", "field", "first_tick"];
    for (name, expected) in [
        ("rate", Some("rate_hz")),
        ("Rate-Hz", Some("rate_hz")),
        ("rate_herz", Some("rate_hz")),
        ("first", Some("first_tick")),
        ("calibration_file", Some("calibration")),
        ("nmae", Some("name")),
        ("fiel", Some("field")),
        ("tick", None),
        ("game", Some("name")),
        ("fps", None),
        ("x", None),
        ("", None),
    ] {
        assert_eq!(nearest(name, &venue), expected, "{name}");
    }
}

#[test]
fn a_mistyped_field_is_named_with_its_line() {
    let message = refusal("rate_hz = 60\n[[room]]\nname = \"a\"\nsize_m = [1, \"x\"]\n");
    assert_eq!(
        message,
        "hall.toml:4: `room[0].size_m[1]`: found string \"x\", expected f64"
    );
}

#[test]
fn a_missing_field_is_named() {
    let message = refusal("rate_hz = 60\n[[room]]\nname = \"a\"\n");
    assert_eq!(
        message,
        "hall.toml:2: `room[0].size_m`: the field is missing"
    );
}

#[test]
fn broken_syntax_is_named_with_its_line() {
    assert!(refusal("rate_hz = 60\nroom = [\n").starts_with("hall.toml:"));
    assert!(refusal("rate_hz = 60\nroom == 3\n").starts_with("hall.toml:2: not valid TOML"));
}

#[test]
fn a_later_check_reports_the_line_of_its_field() {
    let text = "rate_hz = 60\n[[room]]\nname = \"a\"\n[[room]]\nname = \"a\"\nsize_m = [0,\n 1]\n";
    let file = TomlFile::parse(text, Path::new("hall.toml")).unwrap();
    let second = Place::field("room").index(1);
    assert_eq!(
        file.error(&second.key("name"), "twice").to_string(),
        "hall.toml:5: `room[1].name`: twice"
    );
    assert_eq!(
        file.error(&second.key("size_m").index(1), "x").line,
        Some(7)
    );
    assert_eq!(file.error(&second.key("absent"), "x").line, Some(4));
}
