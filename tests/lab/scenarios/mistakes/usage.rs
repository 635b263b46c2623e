//! Mistakes on the command line, with results, truths, recordings and keys.

use std::fs;

use super::input::millimetres;
use super::{Mistake, change_lines, change_ticks, check_mistakes, keep_lines, nothing, write};
use crate::farfield::{command, finish};

fn usage(what: &'static str, words: &'static str, expected: &'static [&'static str]) -> Mistake {
    Mistake {
        what,
        make: nothing,
        words,
        code: 2,
        expected,
    }
}

#[test]
fn a_wrong_command_line_is_refused_with_the_expected_form() {
    check_mistakes(&[
        usage("no venue", "run", &["<VENUE>"]),
        usage(
            "no command",
            "venue.toml",
            &["unrecognized subcommand", "venue.toml"],
        ),
        usage("a command that is misspelt", "evalute a b", &["evalute"]),
        usage(
            "an option of another program",
            "run venue.toml --outdir out",
            &["--outdir", "--out"],
        ),
        usage(
            "ticks the wrong way round",
            "run venue.toml --out out --ticks 90..30",
            &["90..30", "A below B"],
        ),
        usage(
            "ticks as in Python",
            "run venue.toml --out out --ticks 0:30",
            &["0:30", "300..900"],
        ),
        usage(
            "more ticks than there are",
            "run venue.toml --out out --ticks 0..500",
            &["0..500", "0..120"],
        ),
        usage(
            "a picture of a tick that is not there",
            "run venue.toml --out out --overlay 500",
            &["500", "0..120"],
        ),
        usage(
            "a picture of no tick",
            "run venue.toml --out out --overlay 3,x",
            &["`x`"],
        ),
        usage(
            "results where others are",
            "run venue.toml --out good",
            &["good", "not empty"],
        ),
        usage(
            "a recording nowhere",
            "run venue.toml --out out --record no/such/a.mcap",
            &["no/such"],
        ),
        usage(
            "a folder of recordings where a file is",
            "run venue.toml --out out --record truth.jsonl/",
            &["truth.jsonl is a file", "expected a folder"],
        ),
        usage(
            "a drawing over the truth",
            "evaluate good/poses.jsonl truth.jsonl --plot ./good/../truth.jsonl",
            &["--plot", "truth.jsonl"],
        ),
        usage(
            "an endpoint without a protocol",
            "fusion venue.toml --listen 127.0.0.1:7447",
            &["--listen", "quic/"],
        ),
        usage(
            "a kind of recording that does not exist",
            "simulate s.toml --out out --as video",
            &["videos"],
        ),
        usage(
            "a shell that does not exist",
            "completions dos",
            &["dos", "bash"],
        ),
    ]);
}

#[test]
fn poses_and_truths_that_do_not_match_are_reported() {
    let mistake = |what, make, words, code, expected| Mistake {
        what,
        make,
        words,
        code,
        expected,
    };
    check_mistakes(&[
        mistake(
            "the truth of other ticks",
            |f| change_ticks(f, "truth.jsonl", 5000),
            "evaluate good/poses.jsonl truth.jsonl",
            2,
            &["ticks 0 to 119", "ticks 5000 to 5119"],
        ),
        mistake(
            "the truth of another hall",
            |f| {
                change_lines(f, "truth.jsonl", |line| {
                    for point in line["joints"].as_object_mut().unwrap().values_mut() {
                        point[0] = (point[0].as_f64().unwrap() + 40.0).into();
                    }
                    line.as_object_mut().unwrap().remove("keypoints");
                });
            },
            "evaluate good/poses.jsonl truth.jsonl",
            2,
            &["no place in common", " m from a true person"],
        ),
        mistake(
            "poses of the first ticks",
            |f| keep_lines(f, "good/poses.jsonl", 16),
            "evaluate good/poses.jsonl truth.jsonl",
            0,
            &["warning", "only 8 of the truth's 120 ticks"],
        ),
        mistake(
            "poses without people",
            |f| write(f, "empty.jsonl", ""),
            "evaluate empty.jsonl truth.jsonl",
            0,
            &["warning", "contain no people"],
        ),
        mistake(
            "truth and poses swapped",
            nothing,
            "evaluate truth.jsonl good/poses.jsonl",
            0,
            &["warning", "POSES, then TRUTH"],
        ),
        mistake(
            "poses against themselves",
            nothing,
            "evaluate good/poses.jsonl good/poses.jsonl",
            0,
            &["warning", "against itself"],
        ),
        mistake(
            "a TRC file",
            nothing,
            "evaluate good/poses_1.trc truth.jsonl",
            2,
            &["poses_1.trc:1", "not JSON"],
        ),
        mistake(
            "ticks without people",
            nothing,
            "evaluate good/poses.jsonl truth.jsonl --ticks 500..600",
            2,
            &["500..600"],
        ),
        mistake(
            "a rate of nothing",
            nothing,
            "evaluate good/poses.jsonl truth.jsonl --rate-hz 0",
            2,
            &["--rate-hz"],
        ),
    ]);
}

#[test]
fn wrong_requests_for_recordings_and_keys_are_refused() {
    check_mistakes(&[
        usage(
            "poses in place of a recording",
            "replay good/poses.jsonl --out out",
            &["poses.jsonl", "not an MCAP file"],
        ),
        usage(
            "a recording that is not there",
            "replay a.mcap --out out",
            &["a.mcap"],
        ),
        usage(
            "a parameter without its table",
            "replay good/recording.mcap --out out --set cutoff_hz=3",
            &["--set", "smoothing.cutoff_hz=3"],
        ),
        usage(
            "a parameter that is misspelt",
            "replay good/recording.mcap --out out --set smoothing.cutof_hz=3",
            &["did you mean `smoothing.cutoff_hz`"],
        ),
        usage(
            "a parameter in words",
            "replay good/recording.mcap --out out --set smoothing.cutoff_hz=fast",
            &["smoothing.cutoff_hz", "fast"],
        ),
        usage(
            "a fusion's folder of recordings where a file is",
            "fusion venue.toml --record good/poses.jsonl/deeper/",
            &["good/poses.jsonl is a file"],
        ),
        usage(
            "a recorder's folder where a file is",
            "record venue.toml --out good/poses.jsonl/",
            &["good/poses.jsonl is a file"],
        ),
        usage(
            "a picture of a tick that was not recorded",
            "replay good/recording.mcap --overlay=500",
            &["`--overlay` 500 is outside the ticks"],
        ),
        usage(
            "a calibration that is not there",
            "replay good/recording.mcap --out out --overlay --calibration no.toml",
            &["no.toml"],
        ),
        Mistake {
            what: "a calibration in millimetres",
            make: millimetres,
            words: "replay good/recording.mcap --out out --calibration calibration.toml",
            code: 2,
            expected: &["calibration.toml", "millimetres"],
        },
        usage(
            "a replay's page for everybody",
            "replay good/recording.mcap --out out --page=0.0.0.0:8080",
            &["--page", "loopback", "ssh -L"],
        ),
        usage(
            "a life that is not there",
            "replay good/recording.mcap --out out --session 5",
            &["--session", "5"],
        ),
        usage(
            "a key for an unknown node",
            "certs venue.toml --out keys --renew north",
            &["--renew", "found `north`"],
        ),
        usage(
            "keys for no time",
            "certs venue.toml --out keys --days 0",
            &["--days"],
        ),
        usage(
            "a host that is none",
            "certs venue.toml --out keys --host fusion_host:7447",
            &["--host", "without a port"],
        ),
    ]);
}

#[test]
fn an_invalid_log_filter_is_reported() {
    let mut run = command();
    run.args(["run", "nowhere.toml"])
        .env("RUST_LOG", "farfield=loud");
    let output = finish(&run.output().unwrap());
    assert!(
        output.stderr.contains("RUST_LOG: found `farfield=loud`"),
        "{}",
        output.stderr
    );
}

#[test]
fn errors_are_json_with_the_option_json() {
    for words in [
        "run nowhere.toml --json",
        "evaluate a.jsonl b.jsonl --json",
        "replay nowhere.mcap --json",
        "run --ticks 9..3 hall.toml --json",
        "bench --people 8 --json",
        "check nowhere.toml --json",
        "doctor nowhere.toml --json",
        "init nowhere --json",
        "status nowhere.toml --json",
    ] {
        let output = finish(&command().args(words.split(' ')).output().unwrap());
        assert_eq!(output.code, 2, "{words}: {}", output.stderr);
        let document: serde_json::Value = serde_json::from_str(&output.stdout)
            .unwrap_or_else(|error| panic!("{words}: {error}: {:?}", output.stdout));
        assert_eq!(document["exit_code"], 2, "{words}");
        let error = document["error"].as_str().unwrap();
        assert!(
            !error.is_empty() && !error.starts_with("error"),
            "{words}: {error}"
        );
        assert!(!output.stderr.is_empty(), "{words}: no message for people");
    }
}

#[test]
fn an_overlay_option_before_the_venue_does_not_take_it_as_value() {
    let folder = super::sample();
    let mut run = command();
    run.current_dir(folder.path());
    run.args([
        "run",
        "--overlay",
        "venue.toml",
        "--ticks",
        "0..30",
        "--out",
        "out",
    ]);
    let output = finish(&run.output().unwrap());
    assert_eq!(output.code, 0, "{}", output.stderr);
    let names = fs::read_dir(folder.path().join("out")).unwrap();
    let names: Vec<_> = names.map(|entry| entry.unwrap().file_name()).collect();
    assert!(
        names.iter().any(|name| name == "overlay_north-east_15.png"),
        "{names:?}"
    );
}

#[test]
fn a_parameter_that_was_set_is_used_and_written_to_the_results() {
    let folder = super::sample();
    let farfield = |words: &str| {
        let mut command = command();
        command.current_dir(folder.path()).args(words.split(' '));
        finish(&command.output().unwrap())
    };
    let output =
        farfield("run venue.toml --ticks 0..60 --out out --record --set births.confirm_s=0.9");
    assert_eq!(output.code, 0, "{}", output.stderr);
    let venue = fs::read_to_string(folder.path().join("out/venue.toml")).unwrap();
    assert!(venue.contains("confirm_s = 0.9"), "{venue}");
    let again = farfield("run out/venue.toml --ticks 0..60 --out again");
    assert_eq!(again.code, 0, "{}", again.stderr);
    let replayed = farfield("replay out/recording.mcap --out replayed");
    assert_eq!(replayed.code, 0, "{}", replayed.stderr);
    let poses = |out: &str| fs::read(folder.path().join(out).join("poses.jsonl")).unwrap();
    assert!(!poses("out").is_empty() && poses("out") == poses("again"));
    assert!(poses("out") == poses("replayed"));
    let refused = farfield("run venue.toml --out third --set births.confirm=0.9");
    assert_eq!(refused.code, 2);
    assert!(
        refused.stderr.contains("births.confirm_s"),
        "{}",
        refused.stderr
    );
}
