//! Nodes that are stopped, killed, started twice, or whose output is not read: each ends soon, reports why, and leaves only
//! results.

use std::fs::{self, File};
use std::io::{BufRead as _, BufReader, Read as _};
use std::net::TcpListener;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use crate::data::checkout;
use crate::farfield::{command, finish};

/// Longest time until an idle node ends.
const SOON: Duration = Duration::from_secs(5);
/// Far above what a loaded machine takes to start the nodes of the sample.
const PATIENCE: Duration = Duration::from_mins(1);

/// Pause between two polls.
const PAUSE: Duration = Duration::from_millis(10);

/// A child process that ends with its test.
struct StoppableNode(Child);

impl Drop for StoppableNode {
    fn drop(&mut self) {
        // The process may have ended already.
        drop(self.0.kill());
        drop(self.0.wait());
    }
}

fn venue() -> PathBuf {
    checkout().join("examples/walk/venue.toml")
}

fn start(args: &[&str], out: Option<&Path>) -> StoppableNode {
    let mut command = command();
    command.arg(args[0]).arg(venue()).args(&args[1..]);
    if let Some(out) = out {
        command.arg("--out").arg(out);
    }
    command.stdout(Stdio::null()).stderr(Stdio::piped());
    StoppableNode(command.spawn().unwrap())
}

fn start_edge(viewpoint: &str, endpoint: &str) -> StoppableNode {
    start(
        &["edge", "--viewpoint", viewpoint, "--connect", endpoint],
        None,
    )
}

fn free_endpoint() -> String {
    let free = TcpListener::bind("127.0.0.1:0").unwrap();
    format!("tcp/{}", free.local_addr().unwrap())
}

fn signal(name: &str, pid: u32) {
    let kill = Command::new("kill").args([name, &pid.to_string()]).status();
    assert!(kill.unwrap().success(), "kill {name} {pid}");
}

/// Polls until there is an answer, at most for `patience`.
fn wait_for<T>(what: &str, patience: Duration, mut ask: impl FnMut() -> Option<T>) -> T {
    for _ in 0..patience.as_millis() / PAUSE.as_millis() {
        if let Some(answer) = ask() {
            return answer;
        }
        std::thread::sleep(PAUSE);
    }
    panic!("{what}: not within {patience:?}");
}

/// Waits for the end of a node. Returns its exit code and standard error.
fn end(node: &mut StoppableNode, patience: Duration) -> (Option<i32>, String) {
    let status = wait_for("the end of a node", patience, || node.0.try_wait().unwrap());
    let mut output = String::new();
    let stderr = node.0.stderr.as_mut().unwrap();
    stderr.read_to_string(&mut output).unwrap();
    assert!(!output.contains("panicked"), "{output}");
    (status.code(), output)
}

/// The children of a process: pid and kind of node.
fn children(parent: u32) -> Vec<(u32, String)> {
    let child = |entry: std::io::Result<fs::DirEntry>| {
        let pid: u32 = entry.ok()?.file_name().to_str()?.parse().ok()?;
        // "pid (name) state parent ...", where the name may contain any character and ends with the last bracket.
        let stat = fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
        let of: u32 = stat.rsplit_once(") ")?.1.split(' ').nth(1)?.parse().ok()?;
        let line = fs::read_to_string(format!("/proc/{pid}/cmdline")).ok()?;
        (of == parent).then(|| (pid, line.split('\0').nth(1).unwrap_or_default().to_owned()))
    };
    fs::read_dir("/proc").unwrap().filter_map(child).collect()
}

fn is_there(pid: u32) -> bool {
    // A zombie has ended but was not reaped yet.
    fs::read_to_string(format!("/proc/{pid}/stat")).is_ok_and(|stat| !stat.contains(") Z "))
}

fn names(folder: &Path) -> Vec<String> {
    let Ok(entries) = fs::read_dir(folder) else {
        return Vec::new();
    };
    let name = |entry: std::io::Result<fs::DirEntry>| entry.unwrap().file_name();
    entries
        .map(|entry| name(entry).into_string().unwrap())
        .collect()
}

#[test]
fn an_edge_without_fusion_reports_it_and_ends_at_a_signal() {
    for name in ["-TERM", "-INT"] {
        let endpoint = free_endpoint();
        let mut edge = start_edge("north-east", &endpoint);
        let mut line = String::new();
        let stderr = edge.0.stderr.take().unwrap();
        let mut stderr = BufReader::new(stderr);
        stderr.read_line(&mut line).unwrap();
        assert_eq!(
            line,
            format!("north-east: waiting for fusion at {endpoint} (no node listens there)\n")
        );
        signal(name, edge.0.id());
        let status = wait_for("the edge's end", SOON, || edge.0.try_wait().unwrap());
        assert_eq!(status.code(), Some(130));
    }
}

#[test]
fn an_edge_without_fusion_ends_with_its_parent() {
    let mut edge = command();
    edge.arg("edge")
        .arg(venue())
        .args(["--managed", "--viewpoint", "north-east"]);
    edge.args(["--connect", &free_endpoint()])
        .stdin(Stdio::piped());
    let mut edge = StoppableNode(edge.stderr(Stdio::piped()).spawn().unwrap());
    drop(edge.0.stdin.take());
    assert_eq!(end(&mut edge, SOON).0, Some(130));
}

#[test]
fn no_node_outlives_a_killed_run() {
    let dir = tempfile::tempdir().unwrap();
    let run = start(&["run"], Some(&dir.path().join("out")));
    let nodes = wait_for("the edges", PATIENCE, || {
        let nodes = children(run.0.id());
        nodes
            .iter()
            .any(|(_, kind)| kind == "edge")
            .then_some(nodes)
    });
    signal("-KILL", run.0.id());
    for (pid, kind) in nodes {
        wait_for(&format!("the end of {kind}"), 2 * SOON, || {
            (!is_there(pid)).then_some(())
        });
    }
}

#[test]
fn a_run_whose_fusion_is_ended_fails_without_unfinished_files() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out");
    let mut run = start(&["run", "--overlay"], Some(&out));
    let fusion = wait_for("fusion", PATIENCE, || {
        let nodes = children(run.0.id());
        nodes.iter().find(|(_, kind)| kind == "fusion").map(|n| n.0)
    });
    signal("-TERM", fusion);
    let (code, output) = end(&mut run, PATIENCE);
    assert_eq!(code, Some(1), "{output}");
    assert!(
        output.contains("fusion") && output.contains("signal"),
        "{output}"
    );
    let left = names(&out);
    let unfinished = |name: &String| [".tmp", ".lock", ".png"].iter().any(|e| name.ends_with(e));
    assert!(!left.iter().any(unfinished), "{left:?}");
}

#[test]
fn two_runs_do_not_share_a_folder() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out");
    let mut first = start(&["run", "--ticks", "0..20"], Some(&out));
    wait_for("the first run", PATIENCE, || {
        out.join("run.lock").exists().then_some(())
    });
    let mut second = start(&["run", "--ticks", "0..20"], Some(&out));
    let (code, output) = end(&mut second, PATIENCE);
    assert_eq!(code, Some(2), "{output}");
    assert!(output.contains("not empty"), "{output}");
    let (code, output) = end(&mut first, PATIENCE);
    assert_eq!(code, Some(0), "{output}");
    assert!(!out.join("run.lock").exists());
}

#[test]
fn failing_output_fails_a_run_unless_the_reader_has_gone() {
    let dir = tempfile::tempdir().unwrap();
    let run = |stdout: Stdio, out: &str| {
        let mut run = command();
        run.arg("run")
            .arg(venue())
            .args(["--ticks", "0..5", "--out"]);
        run.arg(dir.path().join(out))
            .stdout(stdout)
            .stderr(Stdio::piped());
        StoppableNode(run.spawn().unwrap())
    };
    let full = File::options().write(true).open("/dev/full").unwrap();
    let (code, output) = end(&mut run(full.into(), "full"), PATIENCE);
    assert_eq!(code, Some(1), "{output}");
    assert!(output.contains("standard output"), "{output}");
    let mut unread = run(Stdio::piped(), "unread");
    drop(unread.0.stdout.take());
    let (code, output) = end(&mut unread, PATIENCE);
    assert_eq!(code, Some(0), "{output}");
}

#[test]
fn a_wrong_endpoint_and_a_used_port_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let fusion = |listen: &str| {
        let mut fusion = command();
        fusion
            .arg("fusion")
            .arg(venue())
            .args(["--listen", listen, "--out"]);
        finish(&fusion.arg(dir.path().join("out")).output().unwrap())
    };
    let wrong = fusion("garbage");
    assert_eq!(wrong.code, 2);
    assert_eq!(
        wrong.stderr,
        "error: `--listen`: found `garbage`, expected for example quic/0.0.0.0:7447\n"
    );
    let holder = TcpListener::bind("127.0.0.1:0").unwrap();
    let taken = fusion(&format!("tcp/{}", holder.local_addr().unwrap()));
    assert_eq!(taken.code, 1);
    assert!(
        taken.stderr.contains("choose another with --listen"),
        "{}",
        taken.stderr
    );
    assert!(!taken.stderr.contains(".rs:"), "{}", taken.stderr);
    assert!(!dir.path().join("out").exists());
}

#[test]
fn two_edges_of_one_viewpoint_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let endpoint = free_endpoint();
    let out = dir.path().join("out");
    let mut fusion = start(&["fusion", "--listen", &endpoint], Some(&out));
    let _edges = [(); 2].map(|()| start_edge("north-east", &endpoint));
    let (code, output) = end(&mut fusion, PATIENCE);
    assert_eq!(code, Some(2), "{output}");
    assert!(
        output.contains("two nodes have the name north-east"),
        "{output}"
    );
    assert!(!out.exists(), "a run that never began has left {out:?}");
}
