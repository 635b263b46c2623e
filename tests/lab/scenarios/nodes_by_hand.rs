//! Nodes started one by one, as on several hosts.

use std::net::TcpListener;
use std::process::{Child, Stdio};

use crate::data::checkout;
use crate::farfield::{command, poses};

struct NodesByHand(Vec<(String, Child)>);

impl Drop for NodesByHand {
    fn drop(&mut self) {
        for (_, child) in &mut self.0 {
            // Ended already when all went well.
            drop(child.kill());
            drop(child.wait());
        }
    }
}

#[test]
fn edges_that_start_before_fusion_join_it_and_the_recording_is_the_same() {
    let venue = checkout().join("examples/walk/venue.toml");
    let dir = tempfile::tempdir().unwrap();
    let free = TcpListener::bind("127.0.0.1:0").unwrap();
    let endpoint = format!("tcp/{}", free.local_addr().unwrap());
    drop(free);
    let mut nodes = NodesByHand(Vec::new());
    for viewpoint in ["north-east", "north-west", "south-west", "south-east"] {
        // Standard input stays open for as long as the test holds the child: a node leaves with its parent.
        let child = command()
            .arg("edge")
            .arg(&venue)
            .args([
                "--viewpoint",
                viewpoint,
                "--connect",
                &endpoint,
                "--ticks",
                "0..40",
            ])
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .spawn()
            .unwrap();
        nodes.0.push((viewpoint.to_owned(), child));
    }
    let out = dir.path().join("by-hand");
    let fusion = command()
        .arg("fusion")
        .arg(&venue)
        .args(["--listen", &endpoint, "--ticks", "0..40", "--out"])
        .arg(&out)
        .stdin(Stdio::piped())
        .stdout(Stdio::null())
        .spawn()
        .unwrap();
    nodes.0.push(("fusion".to_owned(), fusion));
    for (name, child) in nodes.0.iter_mut().rev() {
        assert!(child.wait().unwrap().success(), "{name} did not end well");
    }
    let by_hand = poses(&out);
    let together = dir.path().join("together");
    crate::farfield::run(&venue, &together, &["--ticks", "0..40"]);
    assert!(!by_hand.is_empty());
    assert_eq!(by_hand, poses(&together));
}
