//! Edges that go and come, and one that does not belong; and the table that shows it.

use std::fs;
use std::io::{BufRead as _, BufReader};
use std::process::Stdio;

use farfield_node::files::load_venue;
use farfield_proto::message::agreement::{AgreementOfCamera, AgreementVerdict};
use farfield_proto::transport::FUSION;

use super::stage::{LiveStage, heard};
use crate::farfield::{command, farfield};

#[test]
fn an_edge_that_is_killed_is_missed_and_joins_again_by_itself() {
    let mut stage = LiveStage::open();
    let (before, ids) = (stage.takes(), stage.ids());
    let edge = stage.live.edges[0].take().unwrap();
    let viewpoint = edge.name().to_owned();
    edge.kill().unwrap();
    stage.wait("the edge is missed", |seen| {
        heard(seen, &viewpoint).is_some_and(|edge| !edge.live)
    });
    stage.go_on(1.0);
    assert_eq!(stage.ids(), ids, "three viewpoints are enough");
    stage.live.start_edges().unwrap();
    stage.wait("the edge is back", |seen| {
        heard(seen, &viewpoint).is_some_and(|edge| edge.live && edge.bytes_per_s > 0)
    });
    stage.go_on(1.0);
    assert_eq!(stage.ids(), ids);
    before.assert_flat(&stage.takes());
}

#[test]
fn an_edge_of_another_calibration_is_refused_by_name_and_the_others_go_on() {
    let mut stage = LiveStage::prepare(&[], "");
    let elsewhere = stage.folder.path().join("elsewhere");
    fs::create_dir(&elsewhere).unwrap();
    for entry in fs::read_dir(stage.folder.path()).unwrap() {
        let path = entry.unwrap().path();
        if path.is_file() {
            fs::copy(&path, elsewhere.join(path.file_name().unwrap())).unwrap();
        }
    }
    let calibration = elsewhere.join("calibration.toml");
    let text = fs::read_to_string(&calibration).unwrap();
    // Every focal length is a little off.
    let changed = text.replace("matrix = [[", "matrix = [[1");
    assert_ne!(text, changed);
    fs::write(&calibration, changed).unwrap();
    let other = elsewhere.join("venue.toml");
    stage.live.start_edge(0, Some(&other), &[]).unwrap();
    let viewpoint = stage.live.edges[0].as_ref().unwrap().name().to_owned();
    stage.start();
    stage.wait("the edge is refused", |seen| {
        let refused = heard(seen, &viewpoint).and_then(|edge| edge.refused.as_ref());
        refused.is_some_and(|why| why.contains("calibration"))
    });
    stage.go_on(1.0);
}

#[test]
fn the_status_shows_a_row_for_every_node_and_fails_when_one_is_missing_or_nobody_answers() {
    let mut stage = LiveStage::open();
    let venue = stage.folder.path().join("venue.toml");
    let endpoint = stage.live.endpoint();
    let words = ["status", venue.to_str().unwrap(), "--connect", &endpoint];
    let show = |more: &[&str]| farfield(&[&words, more].concat());
    let names: Vec<String> = stage
        .live
        .nodes()
        .map(|node| node.name().to_owned())
        .collect();
    let shown = show(&[]);
    assert_eq!(shown.code, 0, "{}\n{}", shown.stdout, shown.stderr);
    println!("{}", shown.stdout);
    let rows = shown.stdout.lines().skip(1);
    let rows: Vec<&str> = rows.take_while(|row| !row.is_empty()).collect();
    assert_eq!(rows.len(), names.len(), "{}", shown.stdout);
    for name in &names {
        let row = rows.iter().find(|row| row.starts_with(&format!("{name} ")));
        let row = row.unwrap_or_else(|| panic!("{name}: {}", shown.stdout));
        assert!(
            row.contains("live") && row.contains(env!("CARGO_PKG_VERSION")),
            "{row}"
        );
    }
    assert!(!shown.stdout.contains('\u{1b}'), "it pipes");

    let doctor = farfield(&["doctor", venue.to_str().unwrap(), "--connect", &endpoint]);
    let version = env!("CARGO_PKG_VERSION");
    let same = format!("run farfield {version}, as this machine: ");
    let said = doctor
        .stdout
        .lines()
        .find_map(|line| Some(line.split_once(&same)?.1));
    let mut said: Vec<&str> = said.unwrap_or_default().split(", ").collect();
    let mut expected: Vec<&str> = names.iter().map(String::as_str).collect();
    said.sort_unstable();
    expected.sort_unstable();
    assert_eq!(said, expected, "{}", doctor.stdout);

    let mut watching = command()
        .args(words)
        .args(["--watch", "--json"])
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let lines = BufReader::new(watching.stdout.take().unwrap()).lines();
    for line in lines.take(2) {
        let state: serde_json::Value = serde_json::from_str(&line.unwrap()).unwrap();
        let fusion = &state["nodes"][0];
        assert_eq!(
            (&fusion["node"], &fusion["state"]),
            (&"fusion".into(), &"live".into())
        );
        assert!(fusion["delay_ms"][0].as_f64().unwrap() > 0.0, "{fusion}");
        assert_eq!(state["nodes"][1]["cameras"][0]["health"], "works");
    }
    watching.kill().unwrap();
    watching.wait().unwrap();

    let edge = stage.live.edges[0].take().unwrap();
    let name = edge.name().to_owned();
    edge.kill().unwrap();
    stage.wait("the edge is missed", |seen| {
        heard(seen, &name).is_some_and(|edge| !edge.live)
    });
    let shown = show(&[]);
    assert_eq!(shown.code, 1, "{}", shown.stdout);
    assert!(shown.stdout.contains("RED"), "{}", shown.stdout);
    assert!(
        shown.stderr.contains(&format!("{name} (")),
        "{}",
        shown.stderr
    );

    stage.live.fusion.take().unwrap().kill().unwrap();
    let shown = show(&[]);
    assert_eq!(shown.code, 1, "{}", shown.stderr);
    for word in ["nobody answers", &endpoint, "whether fusion runs"] {
        assert!(shown.stderr.contains(word), "{word}: {}", shown.stderr);
    }
}

#[test]
fn the_status_says_of_every_camera_how_it_agrees_with_the_others() {
    let stage = LiveStage::open();
    let venue = stage.folder.path().join("venue.toml");
    let cameras = load_venue(&venue).unwrap().cameras;
    let agrees = |it: &AgreementOfCamera| it.agreement.verdict == AgreementVerdict::Agrees;
    stage.wait("fusion says that all cameras agree", |seen| {
        let known = seen.statuses.get(FUSION).map(|status| &status.agreement);
        known.is_some_and(|known| known.len() == cameras.len() && known.iter().all(agrees))
    });
    let endpoint = stage.live.endpoint();
    let shown = farfield(&["status", venue.to_str().unwrap(), "--connect", &endpoint]);
    assert_eq!(shown.code, 0, "{}\n{}", shown.stdout, shown.stderr);
    for camera in &cameras {
        let name = camera.model.name();
        let line = shown.stdout.lines().find(|line| {
            let words = line.strip_prefix("camera ");
            words.is_some_and(|words| words.split(' ').next() == Some(name))
        });
        let line = line.unwrap_or_else(|| panic!("{name}: {}", shown.stdout));
        assert!(line.contains("agrees with the others: "), "{line}");
    }
}
