//! The list of parameters agrees with everything generated from it.

use std::collections::BTreeSet;
use std::path::Path;

use proptest::prelude::*;
use toml::Table;

use super::super::layout::set;
use super::*;

/// The parameters in a text.
fn read(text: &str) -> Result<Parameters, FileError> {
    Parameters::read(&TomlFile::parse(text, Path::new("parameters.toml"))?)
}

/// A text with all of these parameters.
fn text(parameters: &Parameters) -> String {
    let mut root = Table::new();
    for (parameter, value) in parameters.values() {
        if let Some(value) = value {
            assert!(set(&mut root, &parameter.keys(), value));
        }
    }
    toml::to_string(&root).unwrap()
}

#[test]
fn every_default_is_in_its_range() {
    let file = TomlFile::parse("", Path::new("empty.toml")).unwrap();
    Parameters::default().check(&file).unwrap();
}

#[test]
fn the_sample_contains_all_users_parameters_with_defaults() {
    let sample = sample();
    assert_eq!(read(&sample).unwrap(), Parameters::default());
    let stated: Table = sample.parse().unwrap();
    for (parameter, value) in Parameters::default().values() {
        let table = stated.get(parameter.table).and_then(Value::as_table);
        let found = table.and_then(|table| table.get(parameter.name)).cloned();
        let expected = value.filter(|_| parameter.audience == Audience::User);
        assert_eq!(found, expected, "{parameter}");
        let shown = format!("\n# {} = ", parameter.name);
        let commented = parameter.audience == Audience::User && parameter.unset.is_some();
        assert_eq!(sample.contains(&shown), commented, "{parameter}");
    }
}

#[test]
fn commented_lines_of_the_sample_are_valid_settings() {
    for name in ["margin", "quality"] {
        let set = sample().replace(&format!("# {name} = "), &format!("{name} = "));
        assert_ne!(read(&set).unwrap(), Parameters::default(), "{name}");
    }
}

#[test]
fn twenty_one_parameters_belong_to_users() {
    let users = PARAMETERS.iter().filter(|p| p.audience == Audience::User);
    let users: BTreeSet<String> = users.map(ToString::to_string).collect();
    let expected = [
        "births.coast_s",
        "births.look_share",
        "births.one_view_s",
        "births.outside_field_m",
        "births.return_s",
        "births.sight_every_s",
        "births.tiles_per_look",
        "boxes.margin",
        "link.budget_bytes_per_s",
        "link.clock_bound_ms",
        "link.deadline_ms",
        "link.lockstep_timeout_s",
        "link.quality",
        "link.target_latency_ms",
        "range_of_motion.enabled",
        "range_of_motion.factor",
        "recording.fill_share",
        "recording.json_poses",
        "recording.retention_days",
        "recording.ring_mib",
        "smoothing.delay_ms",
    ];
    assert_eq!(users, expected.map(str::to_owned).into());
}

#[test]
fn every_parameter_is_described_once() {
    let mut names = BTreeSet::new();
    for parameter in PARAMETERS {
        assert!(names.insert(parameter.to_string()), "{parameter}");
        assert_eq!(find(&parameter.to_string()), Some(parameter));
        let sentence = parameter.sentence;
        assert!(
            sentence.ends_with('.') && !sentence.contains("  ") && !sentence.contains('\n'),
            "{sentence}"
        );
        assert!(TABLES.iter().any(|(table, _)| *table == parameter.table));
    }
    assert_eq!(find("births"), None);
    assert_eq!(find("births.flat"), None);
}

#[test]
fn every_parameter_has_a_range_named_values_or_a_description() {
    for (parameter, value) in Parameters::default().values() {
        let is_number = value.is_some_and(|v| v.is_float() || v.is_integer());
        let has_range = parameter.range.is_some();
        assert!(has_range || !is_number, "{parameter}");
        assert!(
            has_range || !parameter.words.is_empty() || parameter.unset.is_some(),
            "{parameter}"
        );
    }
}

#[test]
fn every_named_value_is_read_back() {
    for parameter in PARAMETERS.iter().filter(|p| !p.words.is_empty()) {
        for word in parameter.words {
            let value = match *word {
                "true" | "false" => Value::Boolean(*word == "true"),
                word => Value::String(word.to_owned()),
            };
            let mut root = Table::new();
            assert!(set(&mut root, &parameter.keys(), value.clone()));
            let parameters = read(&toml::to_string(&root).unwrap()).unwrap();
            let again = parameters.values().find(|(p, _)| *p == parameter);
            assert_eq!(again.unwrap().1, Some(value));
        }
    }
}

#[test]
fn a_parameter_out_of_range_is_refused_with_its_place() {
    let refused = |text: &str| {
        let file = TomlFile::parse(text, Path::new("hall.toml")).unwrap();
        let parameters = Parameters::read(&file).unwrap();
        parameters.check(&file).unwrap_err().to_string()
    };
    assert_eq!(
        refused("[births]\ncoast_s = -1.0\n"),
        "hall.toml:2: `births.coast_s`: found -1.0, expected a number from 0 to 3600"
    );
    assert_eq!(
        refused("[tuning]\nlattice.min_support = 0.1\nik.iterations = 0\n"),
        "hall.toml:3: `tuning.ik.iterations`: found 0.0, expected a number from 1 to 1000"
    );
}

#[test]
fn seconds_are_the_nearest_ticks() {
    let births = BirthParameters::default();
    for (rate_hz, ticks) in [
        (25.0, [5, 2]),
        (30.0, [6, 2]),
        (50.0, [10, 4]),
        (60.0, [12, 5]),
    ] {
        let found = [
            births.confirm_ticks(rate_hz),
            births.look_again_ticks(rate_hz),
        ];
        assert_eq!(found, ticks, "{rate_hz} Hz");
    }
    assert_eq!(births.confirm_ticks(1.0), 1);
    assert_eq!(births.look_again_ticks(1.0), 0);
}

proptest! {
    #[test]
    fn written_values_are_read_and_values_out_of_range_refused(
        which in any::<prop::sample::Index>(),
        share in 0.0_f64..=1.0,
        beyond in 1e-3_f64..1e3,
    ) {
        let numbers: Vec<&Parameter> = PARAMETERS.iter().filter(|p| p.range.is_some()).collect();
        let parameter = *which.get(&numbers);
        let Range { min, max, .. } = parameter.range.unwrap();
        let is_whole = matches!(
            Parameters::default().values().find(|(p, _)| *p == parameter).unwrap().1,
            Some(Value::Integer(_))
        );
        let with = |number: f64| {
            let value = if is_whole { Value::Integer(number as i64) } else { Value::Float(number) };
            let mut root = Table::new();
            assert!(set(&mut root, &parameter.keys(), value));
            toml::to_string(&root).unwrap()
        };
        let inside = with((min + share * (max - min)).min(max));
        let parameters = read(&inside).unwrap();
        prop_assert_eq!(&read(&text(&parameters)).unwrap(), &parameters);
        let file = TomlFile::parse(&inside, Path::new("hall.toml")).unwrap();
        // Two parameters may depend on each other, so that a value in its range can still be
        // refused.
        if parameter.table != "boxes" {
            prop_assert!(parameters.check(&file).is_ok());
        }
        let outside = with(max + beyond.max(1.0));
        let file = TomlFile::parse(&outside, Path::new("hall.toml")).unwrap();
        let refused = Parameters::read(&file).unwrap().check(&file).unwrap_err().to_string();
        prop_assert!(refused.contains(&parameter.keys().join(".")), "{}", refused);
    }
}
