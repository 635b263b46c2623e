//! Expected people.

use std::path::Path;

use super::{VENUE, parse};
use crate::venue::KnownBy;

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
