//! Nodes without a key, with the wrong key, or with requests beyond their rights: over real QUIC sockets, while honest
//! nodes work undisturbed.

mod keys;
mod words;

use std::net::UdpSocket;
use std::path::{Path, PathBuf};
use std::process::{Child, Stdio};
use std::time::Duration;

use farfield_proto::id::ViewpointIndex;
use farfield_proto::message::health::NodeHealth;
use farfield_proto::message::{PoseSet, Status};
use farfield_proto::transport::{EdgeTransport, Identity};
use farfield_proto::wire;
use tempfile::TempDir;
use tokio::time::timeout;
use zenoh::sample::Locality;
use zenoh::{Session, Wait as _};

use crate::data::checkout;
use crate::farfield::{command, farfield, finish, poses, run};

/// Far above what a loaded machine takes: a test that waits as long has failed.
const PATIENCE: Duration = Duration::from_mins(1);
/// How long a stranger tries to connect.
const TRY: Duration = Duration::from_secs(8);
const TICKS: &str = "0..40";
const VIEWPOINTS: [&str; 4] = ["north-east", "north-west", "south-west", "south-east"];

/// The walking venue with its own keys.
struct SecuredHall {
    folder: TempDir,
    endpoint: String,
}

impl SecuredHall {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        for entry in checkout().join("examples/walk").read_dir().unwrap() {
            let path = entry.unwrap().path();
            std::fs::copy(&path, folder.path().join(path.file_name().unwrap())).unwrap();
        }
        let venue = folder.path().join("venue.toml");
        let text = std::fs::read_to_string(&venue).unwrap();
        let secured = text.replacen(
            "[field]",
            "[security]\ncertificates = \"certs\"\n\n[field]",
            1,
        );
        std::fs::write(&venue, secured).unwrap();
        let free = UdpSocket::bind("127.0.0.1:0").unwrap();
        let endpoint = format!("quic/{}", free.local_addr().unwrap());
        let hall = Self { folder, endpoint };
        hall.certs("certs");
        hall
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Creates an authority and its keys in `out`.
    fn certs(&self, out: &str) {
        let words = [
            "certs".into(),
            self.path("venue.toml"),
            "--out".into(),
            self.path(out),
        ];
        let made = farfield(&[&words[..], &["--node".into(), "screen".into()]].concat());
        assert_eq!(made.code, 0, "{}", made.stderr);
    }

    fn identity(&self, folder: &str, node: &str) -> Identity {
        Identity::in_folder(&self.path(folder), node)
    }

    fn fusion(&self, out: &str) -> SecuredNode {
        let mut command = command();
        command.arg("fusion").arg(self.path("venue.toml"));
        command.args(["--listen", &self.endpoint, "--ticks", TICKS, "--out"]);
        SecuredNode::start(command.arg(self.path(out)))
    }

    fn edge(&self, venue: &Path, viewpoint: &str, more: &[&str]) -> SecuredNode {
        let mut command = command();
        command
            .arg("edge")
            .arg(venue)
            .args(["--viewpoint", viewpoint]);
        SecuredNode::start(command.args(["--connect", &self.endpoint]).args(more))
    }
}

/// A child process that ends with its test.
struct SecuredNode(Option<Child>);

impl SecuredNode {
    fn start(command: &mut std::process::Command) -> Self {
        // Standard input stays open as long as the child runs.
        let child = command
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn();
        Self(Some(child.unwrap()))
    }

    /// Waits for its end. Returns the exit code and standard error.
    fn end(mut self) -> (i32, String) {
        let finished = finish(&self.0.take().unwrap().wait_with_output().unwrap());
        (finished.code, finished.stderr)
    }
}

impl Drop for SecuredNode {
    fn drop(&mut self) {
        if let Some(child) = &mut self.0 {
            // The child may have ended already.
            drop(child.kill());
            drop(child.wait());
        }
    }
}

/// Opens a session with fusion; `None` if it is refused. Blocks its thread.
fn enter_blocking(
    hall: &SecuredHall,
    identity: &Identity,
    change: &[(&str, String)],
    patience: Duration,
) -> Option<Session> {
    zenoh::open(config_of(hall, identity, change, patience))
        .wait()
        .ok()
}

/// [`enter_blocking`] on a thread of its own.
async fn enter(
    hall: &SecuredHall,
    identity: &Identity,
    change: &[(&str, String)],
    patience: Duration,
) -> Option<Session> {
    let config = config_of(hall, identity, change, patience);
    let open = tokio::task::spawn_blocking(|| zenoh::open(config).wait());
    open.await.unwrap().ok()
}

/// Session settings of a node with `identity` that gives up after `patience`.
fn config_of(
    hall: &SecuredHall,
    identity: &Identity,
    change: &[(&str, String)],
    patience: Duration,
) -> zenoh::Config {
    let connect = [hall.endpoint.clone()];
    let transport = EdgeTransport {
        venue: "walk",
        connect: &connect,
        identity: Some(identity),
    };
    let mut config = zenoh::Config::default();
    for (key, value) in transport.settings() {
        config.insert_json5(&key, &value).unwrap();
    }
    // Opening blocks its thread, so Zenoh itself must give up.
    let patience_ms = patience.as_millis().to_string();
    for (key, value) in [
        ("connect/timeout_ms", patience_ms.as_str()),
        ("connect/exit_on_failure", "true"),
    ] {
        config.insert_json5(key, value).unwrap();
    }
    for (key, value) in change {
        config.insert_json5(key, value).unwrap();
    }
    config
}

#[test]
fn a_venue_with_keys_gives_the_same_poses_as_without() {
    let hall = SecuredHall::new();
    let with = hall.path("with");
    run(&hall.path("venue.toml"), &with, &["--ticks", TICKS]);
    let without = hall.path("without");
    let open = checkout().join("examples/walk/venue.toml");
    run(&open, &without, &["--ticks", TICKS]);
    assert!(!poses(&with).is_empty());
    assert_eq!(poses(&with), poses(&without));
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn strangers_are_refused_and_honest_nodes_are_not_disturbed() {
    let hall = SecuredHall::new();
    hall.certs("elsewhere");
    let fusion = hall.fusion("out");

    // Proves that a node with a key can connect.
    let edge = enter(&hall, &hall.identity("certs", "north-east"), &[], PATIENCE).await;
    let edge = edge.expect("an honest key is accepted");

    // Without a certificate, but with the authority's.
    let bare = format!(
        "{{ root_ca_certificate: {:?}, enable_mtls: false }}",
        hall.path("certs/ca.pem").to_str().unwrap()
    );
    let own = hall.identity("certs", "north-east");
    let change = [("transport/link/tls", bare)];
    assert!(
        enter(&hall, &own, &change, TRY).await.is_none(),
        "no certificate"
    );
    // With a certificate of another venue's authority; trusts fusion's authority.
    let mut foreign = hall.identity("elsewhere", "north-east");
    foreign.authority = hall.path("certs/ca.pem");
    assert!(
        enter(&hall, &foreign, &[], TRY).await.is_none(),
        "a foreign certificate"
    );

    // With the key of edge north-east: acts as another edge and as fusion, and subscribes where only readers may.
    // Own publications arrive without fusion and are excluded.
    let subscribe = async |session: &Session, key: &'static str| {
        let subscriber = session.declare_subscriber(key);
        subscriber.allowed_origin(Locality::Remote).await.unwrap()
    };
    let box_of_another = subscribe(&edge, "walk/box/north-west").await;
    let poses_at_edge = subscribe(&edge, "walk/pose").await;
    let _token = edge
        .liveliness()
        .declare_token("walk/alive/unknown")
        .await
        .unwrap();
    // With a reader's key: subscribes, and publishes what it must not.
    let screen = enter(&hall, &hall.identity("certs", "screen"), &[], PATIENCE).await;
    let screen = screen.expect("a reader is accepted");
    let poses_at_screen = subscribe(&screen, "walk/pose").await;
    let statuses = subscribe(&screen, "walk/status/*").await;
    let lie = async {
        loop {
            // In lock-step one unreadable message, or a status of an unknown node, ends the run.
            for key in [
                "walk/patch/north-west",
                "walk/sighting/north-west",
                "walk/status/north-west",
                "walk/status/fusion",
                "walk/box/north-west",
            ] {
                edge.put(key, vec![0xff; 40]).await.unwrap();
                screen.put(key, vec![0xff; 40]).await.unwrap();
            }
            screen
                .put("walk/patch/north-east", vec![0xff; 40])
                .await
                .unwrap();
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
    };
    let honest = async {
        let venue = hall.path("venue.toml");
        let edges = VIEWPOINTS.map(|viewpoint| hall.edge(&venue, viewpoint, &[]));
        let ended = tokio::task::spawn_blocking(move || {
            let ended: Vec<_> = edges.into_iter().map(SecuredNode::end).collect();
            (ended, fusion.end())
        });
        timeout(PATIENCE, ended)
            .await
            .expect("honest nodes do not end")
            .unwrap()
    };
    let (edges, (code, stderr)) = tokio::select! {
        ended = honest => ended,
        () = lie => unreachable!("the loop has no end"),
    };
    assert_eq!(code, 0, "fusion: {stderr}");
    assert!(edges.iter().all(|(code, _)| *code == 0), "{edges:?}");
    assert!(
        stderr.contains("refused") && stderr.contains("walk/patch/north-west"),
        "{stderr}"
    );

    assert!(
        box_of_another.try_recv().unwrap().is_none(),
        "another's boxes"
    );
    assert!(
        poses_at_edge.try_recv().unwrap().is_none(),
        "poses, at an edge"
    );
    let pose = poses_at_screen
        .try_recv()
        .unwrap()
        .expect("a reader receives poses");
    let pose: PoseSet = wire::decode(&pose.payload().to_bytes()).unwrap();
    assert!(pose.tick.0 < 40);
    let status = statuses
        .try_recv()
        .unwrap()
        .expect("a reader receives statuses");
    let status: Status = wire::decode(&status.payload().to_bytes()).unwrap();
    assert!(!status.node.is_empty());

    let alone = hall.path("alone");
    run(&hall.path("venue.toml"), &alone, &["--ticks", TICKS]);
    assert_eq!(poses(&hall.path("out")), poses(&alone));
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_status_in_the_name_of_another_edge_is_refused() {
    let hall = SecuredHall::new();
    let fusion = hall.fusion("out");
    let edge = enter(&hall, &hall.identity("certs", "north-east"), &[], PATIENCE).await;
    let edge = edge.expect("an honest key is accepted");
    let lie = Status {
        release: String::new(),
        node: "north-west".to_owned(),
        process: 7,
        viewpoint: Some(ViewpointIndex(1)),
        ready: true,
        venue_hash: "v".to_owned(),
        calibration_hash: "c".to_owned(),
        network_hash: String::new(),
        backend: String::new(),
        ticks: None,
        tick: None,
        unreadable: 0,
        failure: None,
        stages: Vec::new(),
        live: None,
        health: NodeHealth::default(),
        agreement: Vec::new(),
    };
    let lie = async {
        loop {
            let bytes = wire::encode(&lie);
            edge.put("walk/status/north-east", bytes).await.unwrap();
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
    };
    // In lock-step one forbidden message ends the run, and the error contains its key.
    let end = timeout(PATIENCE, tokio::task::spawn_blocking(|| fusion.end()));
    let (code, stderr) = tokio::select! {
        ended = end => ended.expect("fusion does not end").unwrap(),
        () = lie => unreachable!("the loop has no end"),
    };
    assert_eq!(code, 1, "{stderr}");
    assert!(stderr.contains("walk/status/north-east"), "{stderr}");
}

#[test]
fn an_edge_with_only_a_key_gets_all_files_from_fusion() {
    let hall = SecuredHall::new();
    let fusion = hall.fusion("out");
    let far = tempfile::tempdir().unwrap();
    let venue = far.path().join("venue.toml");
    let certs = far.path().join("certs");
    std::fs::create_dir(&certs).unwrap();
    for file in [
        "certs/ca.pem",
        "certs/north-east.pem",
        "certs/north-east.key",
        "north-east.jsonl",
    ] {
        std::fs::copy(hall.path(file), far.path().join(file)).unwrap();
    }
    let fetch = ["--from-fusion", "--venue-name", "walk"];
    let mut edges = vec![hall.edge(&venue, "north-east", &fetch)];
    let here = hall.path("venue.toml");
    edges.extend(
        VIEWPOINTS[1..]
            .iter()
            .map(|viewpoint| hall.edge(&here, viewpoint, &[])),
    );
    for edge in edges {
        let (code, stderr) = edge.end();
        assert_eq!(code, 0, "{stderr}");
    }
    let (code, stderr) = fusion.end();
    assert_eq!(code, 0, "{stderr}");
    for file in ["venue.toml", "calibration.toml"] {
        let fetched = std::fs::read(far.path().join(file)).unwrap();
        assert_eq!(fetched, std::fs::read(hall.path(file)).unwrap(), "{file}");
    }
}

#[test]
fn the_remedy_for_another_calibration_is_the_option_from_fusion() {
    let hall = SecuredHall::new();
    let _fusion = hall.fusion("out");
    let other = SecuredHall::new();
    let path = other.path("calibration.toml");
    let text = std::fs::read_to_string(&path).unwrap();
    std::fs::write(&path, format!("{text}\n# by hand\n")).unwrap();
    std::fs::remove_dir_all(other.path("certs")).unwrap();
    std::fs::create_dir(other.path("certs")).unwrap();
    for file in [
        "certs/ca.pem",
        "certs/north-east.pem",
        "certs/north-east.key",
    ] {
        std::fs::copy(hall.path(file), other.path(file)).unwrap();
    }
    let (code, stderr) = hall
        .edge(&other.path("venue.toml"), "north-east", &[])
        .end();
    assert_eq!(code, 2, "{stderr}");
    assert!(stderr.contains("--from-fusion"), "{stderr}");
}

#[test]
fn without_keys_other_machines_need_the_option_allow_plaintext() {
    let venue = checkout().join("examples/walk/venue.toml");
    let venue = venue.to_str().unwrap();
    for words in [
        [
            "fusion",
            venue,
            "--listen",
            "tcp/0.0.0.0:0",
            "--ticks",
            TICKS,
        ]
        .as_slice(),
        &[
            "edge",
            venue,
            "--viewpoint",
            "north-east",
            "--connect",
            "udp/192.0.2.1:7447",
        ],
    ] {
        let refused = farfield(words);
        assert_eq!(refused.code, 2, "{}", refused.stderr);
        assert!(
            refused.stderr.contains("--allow-plaintext"),
            "{}",
            refused.stderr
        );
    }
}
