//! Recordings and their replays: identical, with other parameters, of finished, torn and old files; and timing by
//! `farfield bench RECORDING`.

use std::collections::BTreeSet;
use std::fs;
use std::io::{ErrorKind, Read as _, Write as _};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use farfield_edge::ring::record::{Label, records};
use farfield_fusion::recording::reader::{AnySet, Recording};
use farfield_proto::message::PatchSet;
use farfield_proto::tick::Tick;
use farfield_proto::wire::{self, OLDEST_READ, VERSION};
use farfield_sim::keypoint_venue::KeypointVenue;
use serde_json::Value;

use crate::data::checkout;
use crate::farfield::{FinishedCommand, command, farfield, poses, run};

fn venue() -> PathBuf {
    checkout().join("examples/walk/venue.toml")
}

/// The sample in `dir`, with chunks so short that a run of half a second has several.
fn short_chunks(dir: &Path) -> PathBuf {
    let folder = dir.join("walk");
    fs::create_dir_all(&folder).unwrap();
    for entry in fs::read_dir(checkout().join("examples/walk")).unwrap() {
        let from = entry.unwrap().path();
        fs::copy(&from, folder.join(from.file_name().unwrap())).unwrap();
    }
    let venue = folder.join("venue.toml");
    let text = fs::read_to_string(&venue).unwrap() + "\n[tuning]\nrecording.chunk_s = 0.05\n";
    fs::write(&venue, text).unwrap();
    venue
}

/// Runs and records the sample; returns the recording and the folder of results.
fn recorded(dir: &Path, more: &[&str]) -> (PathBuf, PathBuf) {
    let out = dir.join("run");
    run(&short_chunks(dir), &out, &[&["--record"], more].concat());
    (out.join("recording.mcap"), out)
}

fn replay(file: &Path, out: &Path, more: &[&str]) -> FinishedCommand {
    let args = [
        "replay",
        file.to_str().unwrap(),
        "--out",
        out.to_str().unwrap(),
    ];
    farfield(&[&args[..], more].concat())
}

/// Replays a recording and returns the report in JSON.
pub(crate) fn replayed(file: &Path, out: &Path, more: &[&str]) -> serde_json::Value {
    let finished = replay(file, out, &[more, &["--json"]].concat());
    assert_eq!(finished.code, 0, "{}\n{}", finished.stdout, finished.stderr);
    serde_json::from_str(&finished.stdout).unwrap()
}

fn bytes(out: &Path) -> Vec<u8> {
    fs::read(out.join("poses.jsonl")).unwrap()
}

#[test]
fn a_lockstep_run_is_replayed_bit_for_bit() {
    let dir = tempfile::tempdir().unwrap();
    let (file, out) = recorded(dir.path(), &[]);
    let again = dir.path().join("again");
    let report = replayed(&file, &again, &[]);
    assert!(bytes(&out) == bytes(&again), "poses.jsonl differs");
    assert!(report["replay"]["same_ticks"].as_u64().unwrap() > 0);
    for count in [
        "different_ticks",
        "missing_sets",
        "undecided_ticks",
        "unreadable",
        "lost",
    ] {
        assert_eq!(report["replay"][count], 0, "{count}");
    }
    assert_eq!(report["replay"]["file_whole"], true);
    // All patches were used in the run, so that matching by place gives the same.
    let late = dir.path().join("late");
    let report = replayed(&file, &late, &["--late"]);
    assert_eq!(report["replay"]["nobodys_patches"], 0);
    assert!(
        bytes(&out) == bytes(&late),
        "poses.jsonl differs with --late"
    );
}

/// Nodes that end with their test.
struct RecordedNodes(Vec<(String, Child)>);

impl Drop for RecordedNodes {
    fn drop(&mut self) {
        for (_, child) in &mut self.0 {
            // The process may have ended already.
            drop(child.kill());
            drop(child.wait());
        }
    }
}

/// Files and endpoints of nodes that run live.
struct LiveNodes<'a> {
    venue: PathBuf,
    dir: &'a Path,
    listen: String,
    connect: String,
}

impl LiveNodes<'_> {
    /// Starts all nodes, live and recorded in `live.mcap`; fusion is the last.
    fn live(&self) -> RecordedNodes {
        let mut nodes = RecordedNodes(Vec::new());
        let mut start = |name: &str, mut command: Command| {
            let child = command.stdin(Stdio::piped()).stdout(Stdio::null());
            nodes.0.push((name.to_owned(), child.spawn().unwrap()));
        };
        for viewpoint in ["north-east", "north-west", "south-west", "south-east"] {
            let mut edge = command();
            edge.arg("edge").arg(&self.venue);
            edge.args([
                "--viewpoint",
                viewpoint,
                "--connect",
                &self.connect,
                "--ring",
            ]);
            edge.arg(self.dir.join("ring").join(viewpoint));
            start(viewpoint, edge);
        }
        let mut fusion = command();
        fusion.arg("fusion").arg(&self.venue);
        fusion.args(["--live", "--listen", &self.listen, "--record"]);
        fusion.arg(self.dir.join("live.mcap"));
        fusion.arg("--out").arg(self.dir.join("live"));
        start("fusion", fusion);
        nodes
    }
}

/// Starts all nodes of the sample, live and recorded in `dir`.
fn live(dir: &Path) -> RecordedNodes {
    let free = TcpListener::bind("127.0.0.1:0").unwrap();
    let endpoint = format!("tcp/{}", free.local_addr().unwrap());
    drop(free);
    let live_nodes = LiveNodes {
        venue: short_chunks(dir),
        dir,
        listen: endpoint.clone(),
        connect: endpoint,
    };
    live_nodes.live()
}

#[test]
fn a_live_run_is_replayed_bit_for_bit() {
    let dir = tempfile::tempdir().unwrap();
    let mut nodes = live(dir.path());
    for (name, child) in nodes.0.iter_mut().rev() {
        assert!(child.wait().unwrap().success(), "{name} did not end well");
    }
    let again = dir.path().join("again");
    let report = replayed(&dir.path().join("live.mcap"), &again, &[]);
    let live = bytes(&dir.path().join("live"));
    assert!(
        !live.is_empty() && live == bytes(&again),
        "poses.jsonl differs"
    );
    assert!(report["replay"]["same_ticks"].as_u64().unwrap() > 0);
    for count in ["different_ticks", "missing_sets", "undecided_ticks"] {
        assert_eq!(report["replay"][count], 0, "{count}");
    }
}

#[test]
fn a_killed_fusion_leaves_a_recording_that_can_be_replayed() {
    let dir = tempfile::tempdir().unwrap();
    let mut nodes = live(dir.path());
    let file = dir.path().join("live.mcap");
    let poses = dir.path().join("live/poses.jsonl.tmp");
    for _ in 0..6000 {
        // People are tracked, and some chunks are written.
        if fs::metadata(&poses).is_ok_and(|m| m.len() > 50_000) {
            break;
        }
        std::thread::sleep(Duration::from_millis(10));
    }
    let (_, fusion) = nodes.0.last_mut().unwrap();
    fusion.kill().unwrap();
    fusion.wait().unwrap();
    let again = dir.path().join("again");
    let report = replayed(&file, &again, &[]);
    assert_eq!(report["replay"]["file_whole"], false);
    let ticks = report["ticks"]["done"].as_u64().unwrap();
    assert!(ticks > 0);
    // Messages of the last tick may be in the chunk that was lost.
    assert_eq!(report["replay"]["different_ticks"], 0);
    assert!(report["replay"]["same_ticks"].as_u64().unwrap() + 1 >= ticks);
}

#[test]
fn a_replay_with_other_parameters_differs() {
    let dir = tempfile::tempdir().unwrap();
    let (file, out) = recorded(dir.path(), &[]);
    let people = |report: &serde_json::Value| report["people"].as_array().unwrap().len();
    let expected = {
        let text = fs::read_to_string(out.join("summary.json")).unwrap();
        people(&serde_json::from_str(&text).unwrap())
    };
    for (name, more) in [
        (
            "set",
            &[
                "--set",
                "smoothing.cutoff_hz=0.5",
                "--set",
                "births.confirm_s=0.1",
            ][..],
        ),
        ("smooth", &["--smooth"]),
    ] {
        let other = dir.path().join(name);
        let report = replayed(&file, &other, more);
        assert_eq!(people(&report), expected, "{name}");
        assert!(bytes(&out) != bytes(&other), "{name} changes nothing");
        assert!(!poses(&other).is_empty());
    }
    let wrong = replay(
        &file,
        &dir.path().join("wrong"),
        &["--set", "smoothing.cutof_hz=3"],
    );
    assert_eq!(wrong.code, 2);
    assert!(wrong.stderr.contains("cutoff_hz"), "{}", wrong.stderr);
}

#[test]
fn a_torn_recording_is_replayed_to_its_last_finished_chunk() {
    let dir = tempfile::tempdir().unwrap();
    let (file, _) = recorded(dir.path(), &[]);
    let whole = fs::read(&file).unwrap();
    let torn = dir.path().join("torn.mcap");
    fs::write(&torn, &whole[..whole.len() * 7 / 10]).unwrap();
    let again = dir.path().join("again");
    let finished = replay(&torn, &again, &["--json"]);
    assert_eq!(finished.code, 0, "{}", finished.stderr);
    assert!(finished.stderr.contains("cut off"), "{}", finished.stderr);
    let report: serde_json::Value = serde_json::from_str(&finished.stdout).unwrap();
    let ticks = report["ticks"]["done"].as_u64().unwrap();
    assert!(ticks > 0);
    // Messages of the last tick may be in the chunk that was lost.
    assert_eq!(report["replay"]["different_ticks"], 0);
    assert!(report["replay"]["same_ticks"].as_u64().unwrap() + 1 >= ticks);
}

#[test]
fn other_files_are_refused_as_a_recording() {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("hostile.mcap");
    let out = dir.path().join("out");
    let missing = replay(&file, &out, &[]);
    assert_eq!(missing.code, 2, "{}", missing.stderr);
    assert!(
        missing.stderr.contains("hostile.mcap"),
        "{}",
        missing.stderr
    );
    let mut endless = b"\x89MCAP0\r\n\x06".to_vec();
    endless.extend_from_slice(&u64::MAX.to_le_bytes());
    for content in [&b"not MCAP at all"[..], b"\x89MCAP0\r\n", &endless] {
        fs::write(&file, content).unwrap();
        let refused = replay(&file, &out, &[]);
        assert_eq!(refused.code, 2, "{}", refused.stderr);
        assert!(
            refused.stderr.contains("hostile.mcap"),
            "{}",
            refused.stderr
        );
        assert!(!out.exists(), "nothing is made for it");
    }
}

#[test]
fn a_full_disk_ends_the_recording_only() {
    let dir = tempfile::tempdir().unwrap();
    let (file, unlimited) = recorded(dir.path(), &[]);
    let size = |path: &Path| fs::metadata(path).unwrap().len();
    let others = fs::read_dir(&unlimited).unwrap();
    let others = others.map(|entry| entry.unwrap().path());
    let largest = others
        .filter(|path| *path != file)
        .map(|path| size(&path))
        .max();
    let limit = largest.unwrap().midpoint(size(&file)) / 512;
    let out = dir.path().join("limited");
    // The limit of the file size acts like a full disk.
    let limited = format!("trap '' XFSZ; ulimit -f {limit}; exec \"$@\"");
    let finished = Command::new("sh")
        .args(["-c", &limited, "sh", env!("CARGO_BIN_EXE_lab"), "run"])
        .arg(short_chunks(dir.path()))
        .arg("--record")
        .arg("--out")
        .arg(&out)
        .stdin(Stdio::null())
        .output()
        .unwrap();
    let finished = crate::farfield::finish(&finished);
    assert_eq!(finished.code, 0, "{}\n{}", finished.stdout, finished.stderr);
    let has_message = |text: &str| text.contains("recording.mcap has ended");
    assert!(has_message(&finished.stdout), "{}", finished.stdout);
    let summary = fs::read_to_string(out.join("summary.json")).unwrap();
    let summary: serde_json::Value = serde_json::from_str(&summary).unwrap();
    let failure = &summary["timing"]["recording"]["failure"];
    assert!(failure.as_str().is_some_and(has_message), "{failure}");
    assert!(bytes(&out) == bytes(&unlimited), "the run went on");
    let report = replayed(&out.join("recording.mcap"), &dir.path().join("again"), &[]);
    assert_eq!(report["replay"]["file_whole"], false);
    assert!(report["replay"]["same_ticks"].as_u64().unwrap() > 0);
}

#[test]
fn a_recording_is_never_overwritten() {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("there.mcap");
    fs::write(&file, "mine").unwrap();
    let refused = farfield(&[
        "run",
        venue().to_str().unwrap(),
        "--record",
        file.to_str().unwrap(),
        "--out",
        dir.path().join("out").to_str().unwrap(),
    ]);
    assert_eq!(refused.code, 2, "{}", refused.stderr);
    assert!(refused.stderr.contains("there.mcap"), "{}", refused.stderr);
    assert_eq!(fs::read_to_string(&file).unwrap(), "mine");
}

/// Forwards connections to a port. While cut, it drops them and accepts no others.
struct Cable {
    endpoint: String,
    cut: Arc<AtomicBool>,
}

impl Cable {
    fn to(port: u16) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let endpoint = format!("tcp/{}", listener.local_addr().unwrap());
        let cut = Arc::<AtomicBool>::default();
        let is_cut = Arc::clone(&cut);
        std::thread::spawn(move || {
            for stream in listener.incoming().flatten() {
                if is_cut.load(Ordering::Relaxed) {
                    continue;
                }
                let Ok(far) = TcpStream::connect(("127.0.0.1", port)) else {
                    continue;
                };
                for (from, to) in [
                    (stream.try_clone().unwrap(), far.try_clone().unwrap()),
                    (far, stream),
                ] {
                    let is_cut = Arc::clone(&is_cut);
                    std::thread::spawn(move || pass(from, to, &is_cut));
                }
            }
        });
        Self { endpoint, cut }
    }
}

fn pass(mut from: TcpStream, mut to: TcpStream, is_cut: &AtomicBool) {
    let mut buffer = vec![0; 65_536];
    from.set_read_timeout(Some(Duration::from_millis(50)))
        .unwrap();
    while !is_cut.load(Ordering::Relaxed) {
        let n = match from.read(&mut buffer) {
            Ok(0) => break,
            Ok(n) => n,
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => 0,
            Err(_) => break,
        };
        if to.write_all(&buffer[..n]).is_err() {
            break;
        }
    }
    drop((from.shutdown(Shutdown::Both), to.shutdown(Shutdown::Both)));
}

/// All records in the rings below `folder`.
fn rings(folder: &Path) -> Vec<(Label, Vec<u8>)> {
    let mut all = Vec::new();
    for viewpoint in fs::read_dir(folder).unwrap() {
        for file in fs::read_dir(viewpoint.unwrap().path()).unwrap() {
            let segment = fs::read(file.unwrap().path()).unwrap();
            let (found, _) = records(&segment);
            all.extend(found.iter().map(|r| (r.label, r.message.to_vec())));
        }
    }
    all
}

#[test]
fn a_cut_of_five_seconds_leaves_no_hole_in_the_recording() {
    const TICKS: usize = 600;
    let dir = tempfile::tempdir().unwrap();
    let sample = KeypointVenue {
        n_ticks: TICKS,
        ..KeypointVenue::two_walkers().unwrap()
    };
    let folder = dir.path().join("venue");
    fs::create_dir(&folder).unwrap();
    sample.write(&folder).unwrap();
    let free = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = free.local_addr().unwrap().port();
    drop(free);
    let cable = Cable::to(port);
    let live_nodes = LiveNodes {
        venue: folder.join("venue.toml"),
        dir: dir.path(),
        listen: format!("tcp/127.0.0.1:{port}"),
        connect: cable.endpoint.clone(),
    };
    let mut nodes = live_nodes.live();
    let file = dir.path().join("live.mcap");
    for _ in 0..6000 {
        if fs::metadata(dir.path().join("live/poses.jsonl.tmp")).is_ok_and(|m| m.len() > 50_000) {
            break;
        }
        std::thread::sleep(Duration::from_millis(10));
    }
    cable.cut.store(true, Ordering::Relaxed);
    std::thread::sleep(Duration::from_secs(5));
    cable.cut.store(false, Ordering::Relaxed);
    let (_, fusion) = nodes.0.last_mut().unwrap();
    assert!(fusion.wait().unwrap().success());
    let summary = fs::read_to_string(dir.path().join("live/summary.json")).unwrap();
    let summary: serde_json::Value = serde_json::from_str(&summary).unwrap();
    let recording = &summary["timing"]["recording"];
    println!("a cut of 5 s: {recording}");
    let holes = recording["holes"].as_u64().unwrap();
    assert!(
        recording["filled"].as_u64().unwrap() > 4 * 4 * 30,
        "{recording}"
    );
    let mut recording = Recording::open(fs::File::open(&file).unwrap()).unwrap();
    let part = recording.sessions()[0].clone();
    let last = part.decisions.last().unwrap().tick;
    let ring_sets = rings(&dir.path().join("ring"));
    let of_session = ring_sets.iter().filter(|(l, _)| l.session == part.session);
    let made: BTreeSet<_> = of_session
        .filter_map(|(label, message)| {
            let set: PatchSet = wire::decode(message).ok()?;
            Some((set.viewpoint, label.tick))
        })
        .collect();
    // On a busy machine an edge may be too late for a tick and makes nothing for it.
    let viewpoints: BTreeSet<_> = made.iter().map(|(viewpoint, _)| *viewpoint).collect();
    let first = part.decisions[0].tick;
    let ticks = || (first.0..=last.0).map(Tick);
    let never_made = viewpoints
        .iter()
        .map(|v| ticks().filter(|t| !made.contains(&(*v, *t))).count())
        .sum::<usize>();
    println!("{never_made} ticks were never made");
    assert!(holes <= never_made as u64, "{holes} holes");
    let mut n_recorded = 0;
    for (label, message) in ring_sets {
        // A late edge may make sets after the last request for them.
        if label.session != part.session || label.tick + 60 > last {
            continue;
        }
        n_recorded += 1;
        let sets = recording.sets(part.session, label.tick).unwrap();
        let is_there = sets.iter().any(|set| match set {
            AnySet::Patches(set) => wire::encode(set) == message,
            AnySet::Sightings(set) => wire::encode(set) == message,
        });
        assert!(is_there, "{label:?} is not in the record");
    }
    println!("{n_recorded} sets were made, and are in the record");
    assert!(n_recorded > 0);
}

#[test]
fn recordings_of_every_earlier_version_can_be_replayed() {
    for version in OLDEST_READ..VERSION {
        let file = checkout().join(format!("proto/golden/v{version}/recording.mcap"));
        let dir = tempfile::tempdir().unwrap();
        let out = dir.path().join("out");
        let report = replayed(&file, &out, &[]);
        assert_eq!(
            report["replay"]["unreadable"], 0,
            "version {version}: {report}"
        );
        assert_eq!(
            report["replay"]["missing_sets"], 0,
            "version {version}: {report}"
        );
        let text = std::fs::read_to_string(out.join("poses.jsonl")).unwrap();
        // Two people at each of 13 ticks.
        assert_eq!(text.lines().count(), 26, "version {version}");
        println!("a recording of version {version} is read and solved");
    }
}

#[test]
fn the_ticks_of_a_recording_are_timed_in_rounds() {
    let dir = tempfile::tempdir().unwrap();
    let (file, _) = recorded(dir.path(), &["--ticks", "0..90"]);
    let timed = farfield(&["bench", file.to_str().unwrap(), "--threads", "2", "--json"]);
    assert_eq!(timed.code, 0, "{}", timed.stderr);
    let report: Value = serde_json::from_str(&timed.stdout).unwrap();
    assert_eq!(report["rate_hz"], 30.0);
    let [run] = &report["runs"].as_array().unwrap()[..] else {
        panic!("one number of threads: {report}");
    };
    assert_eq!(
        [&run["viewpoints"], &run["people"], &run["threads"]],
        [4, 2, 2]
    );
    // Sixty ticks after the excluded ones, repeated to at least 300.
    assert_eq!([&run["ticks"], &run["rounds"]], [300, 5]);
    // Every round starts anew and finds the same people.
    assert_eq!(run["tracked"], 2);
    let [median, typical, most] =
        ["p50_ms", "typical_p99_ms", "max_ms"].map(|name| run[name].as_f64().unwrap());
    assert!(0.0 < median && median <= most && typical <= most, "{run}");
}

#[test]
fn a_recording_that_ends_during_detection_is_not_timed() {
    let dir = tempfile::tempdir().unwrap();
    let (file, _) = recorded(dir.path(), &["--ticks", "0..30"]);
    let timed = farfield(&["bench", file.to_str().unwrap()]);
    assert_eq!(timed.code, 2, "{}", timed.stderr);
    assert!(
        timed.stderr.contains("found at most 30 ticks"),
        "{}",
        timed.stderr
    );
    // The recording itself is finished.
    assert_eq!(replay(&file, &dir.path().join("again"), &[]).code, 0);
}
