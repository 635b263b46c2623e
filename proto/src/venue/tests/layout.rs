//! Fields that have moved, in files and in recordings.

use std::path::Path;

use proptest::prelude::*;
use toml::{Table, Value};

use super::super::layout::{LAYOUT, name_in_ticks, translated};
use super::super::parameters::{Audience, PARAMETERS, Parameter, Parameters, find};
use super::super::*;
use super::{VENUE, calibration, check, parse};

/// What stands in the venue of these tests where parameters may stand.
const TUNED: &str = "[tuning]\nlattice.half_width_m = 0.3";

#[test]
fn a_field_that_moved_is_refused_with_the_place_where_it_is_now() {
    check(
        TUNED,
        "[births]\nflat_m = 0.05",
        "34: `births.flat_m`: it is now `[tuning] births.flat_m`",
    );
    check(
        TUNED,
        "[smoothing]\ndelay_ms = 100.0\ncutoff_hz = 2.0\n[ik]\niterations = 12",
        "35: `smoothing.cutoff_hz`: it is now `[tuning] smoothing.cutoff_hz` (2 fields of this file have moved so)",
    );
    check(
        TUNED,
        "[contact]",
        "33: `contact`: it is now `[tuning] contact`",
    );
}

#[test]
fn a_users_field_is_refused_under_tuning() {
    check(
        TUNED,
        "[tuning]\nbirths.flat_m = 0.05\nbirths.coast_s = 2.0",
        "35: `tuning.births.coast_s`: `coast_s` is a user's field: write it in `[births]`",
    );
}

#[test]
fn an_unknown_field_of_a_table_is_answered_with_the_place_of_the_nearest() {
    check(
        TUNED,
        "[smoothing]\ncutof_hz = 2.0",
        "34: `smoothing.cutof_hz`: unknown field `cutof_hz`, did you mean `[tuning] smoothing.cutoff_hz`?",
    );
    check(
        TUNED,
        "[tuning]\nbirths.coasts_s = 2.0",
        "34: `tuning.births.coasts_s`: unknown field `coasts_s`, did you mean `[births] coast_s`?",
    );
}

/// The venue of these tests as layout 1 had it, with `parameters` in their tables.
fn in_layout_1(parameters: &str) -> String {
    VENUE.replace(TUNED, parameters)
}

#[test]
fn a_recorded_venue_of_the_old_layout_is_read_as_it_was_meant() {
    let old = in_layout_1(
        "[security]\ncertificates = \"certs\"\npictures = true\n[lattice]\nhalf_width_m = 0.31\n\
         [births]\nflat_m = 0.05\ncoast_s = 2.5\n[contact]\n[prediction]\npredictor = \"paper\"\n",
    );
    let path = Path::new("hall.mcap/venue.toml");
    let venue = Venue::parse_recorded(&old, path, calibration(), 1).unwrap();
    let mut expected = Parameters::default();
    expected.lattice.half_width_m = 0.31;
    expected.births.flat_m = 0.05;
    expected.births.coast_s = 2.5;
    expected.prediction.predictor = parameters::Predictor::Paper;
    assert_eq!(venue.parameters, expected);
    assert_eq!(
        venue.security.certificates.as_deref(),
        Some(Path::new("hall.mcap/certs"))
    );
    assert!(!venue.security.pictures);
    // It is known by the text that was recorded, and is otherwise the venue that it would be today.
    let today = Venue::parse(VENUE, path, calibration()).unwrap();
    assert_eq!(
        (&venue.cameras, &venue.given_persons, &venue.field),
        (&today.cameras, &today.given_persons, &today.field)
    );
    assert_ne!(venue.hashes, today.hashes);
    assert!(parse(&old).is_err());
}

#[test]
fn a_recorded_venue_of_todays_layout_is_read_as_it_stands() {
    let path = Path::new("venues/hall.toml");
    let recorded = Venue::parse_recorded(VENUE, path, calibration(), LAYOUT).unwrap();
    assert_eq!(recorded, parse(VENUE).unwrap());
    let refused = Venue::parse_recorded(VENUE, path, calibration(), LAYOUT + 1).unwrap_err();
    assert_eq!(
        refused.to_string(),
        "venues/hall.toml: it has layout 3 of venue files, and this version reads layouts 1 to 2"
    );
}

/// A value that differs from the default, and is in its range.
fn another(parameter: &parameters::Parameter) -> Value {
    let default = Parameters::default();
    let value = default.values().find(|(p, _)| *p == parameter).unwrap().1;
    match (value, parameter.range) {
        // What a box turns back at is at most what it turns at.
        (Some(Value::Float(v)), Some(range)) if parameter.name == "rotate_from_deg" => {
            Value::Float(f64::midpoint(v, range.max))
        }
        (Some(Value::Float(v)), Some(range)) => Value::Float(f64::midpoint(v, range.min)),
        (Some(Value::Integer(v)), _) => Value::Integer(v + 1),
        (Some(Value::Boolean(v)), _) => Value::Boolean(!v),
        _ => (*parameter.words.last().unwrap_or(&"small")).into(),
    }
}

proptest! {
    #[test]
    fn every_field_of_layout_1_means_what_it_meant(which in any::<prop::sample::Index>()) {
        let same = |p: &&Parameter| p.audience == Audience::Tuning && name_in_ticks(p).is_none();
        let tuning: Vec<_> = PARAMETERS.iter().filter(same).collect();
        let parameter = *which.get(&tuning);
        let value = another(parameter);
        let old = in_layout_1(&format!("[{}]\n{} = {value}\n", parameter.table, parameter.name));
        let venue = Venue::parse_recorded(&old, Path::new("v.toml"), calibration(), 1).unwrap();
        for ((p, found), (_, default)) in venue.parameters.values().zip(Parameters::default().values()) {
            let expected = if p == parameter { Some(value.clone()) } else { default };
            prop_assert_eq!(found, expected, "{}", p);
        }
        // And said in a file of today it is refused with the one place where it is understood.
        let refused = parse(&old).unwrap_err().to_string();
        let now = format!("`[tuning] {}.{}`", parameter.table, parameter.name);
        prop_assert!(refused.contains(&now), "{}", refused);
    }

    #[test]
    fn ticks_of_layout_1_are_the_seconds_of_as_many_ticks(
        confirm in 1i64..100_000, again in 0i64..100_000, rate_hz in 30i32..1000,
    ) {
        let old = format!("[births]\nconfirm_ticks = {confirm}\nlook_again_ticks = {again}\n");
        let rate = format!("rate_hz = {rate_hz}");
        let old = in_layout_1(&old).replace("rate_hz = 60.0", &rate);
        let venue = Venue::parse_recorded(&old, Path::new("v.toml"), calibration(), 1).unwrap();
        let births = &venue.parameters.births;
        let rate_hz = venue.rate_hz;
        prop_assert_eq!(births.confirm_ticks(rate_hz), confirm);
        prop_assert_eq!(births.look_again_ticks(rate_hz), again);
    }
}

#[test]
fn a_field_in_ticks_is_refused_with_the_one_in_seconds() {
    for (text, place) in [
        ("[births]\nconfirm_ticks = 6", "births.confirm_ticks"),
        (
            "[tuning]\nbirths.confirm_ticks = 6",
            "tuning.births.confirm_ticks",
        ),
    ] {
        let said = "it is now `[tuning] births.confirm_s`, in seconds";
        check(TUNED, text, &format!("34: `{place}`: {said}"));
    }
}

#[test]
fn a_translation_changes_nothing_but_places() {
    let old = in_layout_1("[births]\nflat_m = 0.1\n");
    let new = translated(&old, Path::new("v.toml"), 1).unwrap();
    let (mut old, mut new): (Table, Table) = (old.parse().unwrap(), new.parse().unwrap());
    assert_eq!(old.remove("births").unwrap()["flat_m"], Value::Float(0.1));
    assert_eq!(
        new.remove("tuning").unwrap()["births"]["flat_m"],
        Value::Float(0.1)
    );
    assert_eq!(old, new);
    assert_eq!(
        find("births.flat_m").unwrap().keys(),
        ["tuning", "births", "flat_m"]
    );
}
