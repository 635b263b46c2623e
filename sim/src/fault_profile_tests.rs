//! Fault profiles are parsed, and errors name the field.

use std::path::Path;

use farfield_proto::toml_file::{FileError, TomlFile};

use super::*;

#[derive(Debug, Deserialize)]
struct File {
    faults: FaultProfile,
}

fn read(text: &str) -> Result<FaultProfile, FileError> {
    let file = TomlFile::parse(text, Path::new("scene.toml")).unwrap();
    file.read::<File>().map(|file| file.faults)
}

fn refusal(text: &str) -> String {
    read(text).unwrap_err().to_string()
}

#[test]
fn a_profile_is_read_by_its_name() {
    let standard = read("[faults]\nprofile = \"standard\"\n").unwrap();
    assert_eq!(standard, FaultProfile::standard());
    let none = read("[faults]\nprofile = \"none\"\n").unwrap();
    assert_eq!(none, FaultProfile::none());
    assert_eq!(read("[faults]\n").unwrap(), none);
}

#[test]
fn a_single_fault_overrides_the_profile() {
    let text = "[faults]\nprofile = \"standard\"\nhidden = false\nbias = { share_of_sigma = 0.6 }\nfree_running = true\n";
    let expected = FaultProfile {
        hidden: None,
        bias: Some(Bias {
            share_of_sigma: 0.6,
            time_constant_s: 2.0,
        }),
        free_running: true,
        ..FaultProfile::standard()
    };
    assert_eq!(read(text).unwrap(), expected);
}

#[test]
fn without_a_profile_only_named_faults_are_active() {
    let text = "[faults]\njitter = true\n[faults.missing]\nshare = 0.5\nburst_s = 1\n";
    let expected = FaultProfile {
        jitter: Some(Jitter::default()),
        missing: Some(Missing {
            share: 0.5,
            burst_s: 1.0,
        }),
        ..FaultProfile::none()
    };
    assert_eq!(read(text).unwrap(), expected);
}

#[test]
fn a_written_profile_is_read_back() {
    let changed = FaultProfile {
        mirror: None,
        free_running: true,
        ..FaultProfile::standard()
    };
    for profile in [changed, FaultProfile::none()] {
        let table = toml::to_string(&profile).unwrap();
        assert_eq!(toml::from_str::<FaultProfile>(&table).unwrap(), profile);
    }
}

#[test]
fn an_unknown_name_is_refused_with_the_nearest_name() {
    assert_eq!(
        refusal("[faults]\nhiden = false\n"),
        "scene.toml:2: `faults.hiden`: unknown field `hiden`, did you mean `hidden`?"
    );
    assert_eq!(
        refusal("[faults]\nprofile = \"standart\"\n"),
        "scene.toml:2: `faults.profile`: unknown value `standart`, did you mean `standard`?"
    );
    let message = refusal("[faults]\nbias = { share_of_sgma = 1 }\n");
    assert!(
        message.contains("did you mean `share_of_sigma`?"),
        "{message}"
    );
}

#[test]
fn a_number_out_of_its_range_is_refused_with_its_line() {
    let message = refusal("[faults]\nprofile = \"none\"\nmissing = { share = 1.5 }\n");
    assert!(
        message.starts_with("scene.toml:3: `faults.missing"),
        "{message}"
    );
    assert!(message.contains("`share`"), "{message}");
    for wrong in [
        "bias = { share_of_sigma = nan }",
        "mirror = { height = [0.8, 0.3] }",
        "hidden = 3",
        "leak = { burst_s = -1 }",
    ] {
        assert!(refusal(&format!("[faults]\n{wrong}\n")).starts_with("scene.toml:2"));
    }
}
