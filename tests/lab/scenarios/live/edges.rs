//! Edges that go and come, and one that does not belong.

use std::fs;

use super::stage::{LiveStage, heard};

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
