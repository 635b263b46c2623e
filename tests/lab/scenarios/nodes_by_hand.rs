//! Nodes started one by one, as on several hosts.

use std::collections::BTreeSet;
use std::net::TcpListener;
use std::os::unix::net::UnixDatagram;
use std::process::{Child, Stdio};
use std::time::Duration;

use crate::data::checkout;
use crate::farfield::{command, poses};

struct NodesByHand(Vec<(String, Child)>);

impl Drop for NodesByHand {
    fn drop(&mut self) {
        for (_, child) in &mut self.0 {
            // The process may have ended already.
            drop(child.kill());
            drop(child.wait());
        }
    }
}

#[test]
fn edges_that_start_before_fusion_join_it_with_the_same_result() {
    let venue = checkout().join("examples/walk/venue.toml");
    let dir = tempfile::tempdir().unwrap();
    let free = TcpListener::bind("127.0.0.1:0").unwrap();
    let endpoint = format!("tcp/{}", free.local_addr().unwrap());
    drop(free);
    let mut nodes = NodesByHand(Vec::new());
    for viewpoint in ["north-east", "north-west", "south-west", "south-east"] {
        // Standard input stays open as long as the child runs: a node ends with its parent.
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

#[test]
fn an_edge_reports_start_state_and_watchdog_to_systemd() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("notify");
    let manager = UnixDatagram::bind(&path).unwrap();
    manager
        .set_read_timeout(Some(Duration::from_mins(1)))
        .unwrap();
    let edge = command()
        .arg("edge")
        .arg(checkout().join("examples/walk/venue.toml"))
        .args(["--viewpoint", "north-east"])
        // No process listens at this port.
        .args(["--connect", "tcp/127.0.0.1:9"])
        .env("NOTIFY_SOCKET", &path)
        .env("WATCHDOG_USEC", "400000")
        .stdin(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let _nodes = NodesByHand(vec![("north-east".to_owned(), edge)]);
    let mut messages = BTreeSet::new();
    let mut bytes = [0; 1024];
    while messages.len() < 3 {
        let length = manager.recv(&mut bytes).unwrap();
        let text = std::str::from_utf8(&bytes[..length]).unwrap().trim_end();
        messages.insert(text.to_owned());
    }
    let waits = "STATUS=north-east: waiting for fusion at tcp/127.0.0.1:9";
    let messages: Vec<&str> = messages.iter().map(String::as_str).collect();
    assert_eq!(messages[0], "READY=1");
    assert!(messages[1].starts_with(waits), "{}", messages[1]);
    assert_eq!(messages[2], "WATCHDOG=1");
}
