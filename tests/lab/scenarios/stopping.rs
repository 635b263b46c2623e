//! Nodes that are stopped, killed, started twice or not listened to: each leaves soon, says why, and
//! leaves nothing behind but results.

use std::fs::{self, File};
use std::io::{BufRead as _, BufReader, Read as _};
use std::net::TcpListener;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use crate::data::checkout;
use crate::farfield::{command, finish};

/// How soon a node leaves that has nothing to finish.
const SOON: Duration = Duration::from_secs(5);
/// Far above what a loaded machine takes to start the nodes of the sample.
const PATIENCE: Duration = Duration::from_mins(1);

/// Between two looks.
const PAUSE: Duration = Duration::from_millis(10);

/// A child that does not outlive its test.
struct StoppableNode(Child);

impl Drop for StoppableNode {
    fn drop(&mut self) {
        // Ended already when all went well.
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

/// Asks again and again until there is an answer, `patience` long.
fn wait_for<T>(what: &str, patience: Duration, mut ask: impl FnMut() -> Option<T>) -> T {
    for _ in 0..patience.as_millis() / PAUSE.as_millis() {
        if let Some(answer) = ask() {
            return answer;
        }
        std::thread::sleep(PAUSE);
    }
    panic!("{what}: not within {patience:?}");
}

/// Exit code and standard error of a node that ends within `patience`.
fn end(node: &mut StoppableNode, patience: Duration) -> (Option<i32>, String) {
    let status = wait_for("the end of a node", patience, || node.0.try_wait().unwrap());
    let mut said = String::new();
    let stderr = node.0.stderr.as_mut().unwrap();
    stderr.read_to_string(&mut said).unwrap();
    assert!(!said.contains("panicked"), "{said}");
    (status.code(), said)
}

/// The children of a process: pid and kind of node.
fn children(parent: u32) -> Vec<(u32, String)> {
    let child = |entry: std::io::Result<fs::DirEntry>| {
        let pid: u32 = entry.ok()?.file_name().to_str()?.parse().ok()?;
        // "pid (name) state parent ...", and the name may hold anything but ends with the last bracket.
        let stat = fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
        let of: u32 = stat.rsplit_once(") ")?.1.split(' ').nth(1)?.parse().ok()?;
        let line = fs::read_to_string(format!("/proc/{pid}/cmdline")).ok()?;
        (of == parent).then(|| (pid, line.split('\0').nth(1).unwrap_or_default().to_owned()))
    };
    fs::read_dir("/proc").unwrap().filter_map(child).collect()
}

fn is_there(pid: u32) -> bool {
    // A zombie has ended; whoever inherited it has not looked yet.
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
fn an_edge_without_a_fusion_says_so_and_leaves_when_told() {
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
fn an_edge_without_a_fusion_leaves_with_its_parent() {
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
fn a_fusion_that_somebody_else_ends_fails_the_run_which_leaves_nothing_unfinished() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out");
    let mut run = start(&["run", "--overlay"], Some(&out));
    let fusion = wait_for("fusion", PATIENCE, || {
        let nodes = children(run.0.id());
        nodes.iter().find(|(_, kind)| kind == "fusion").map(|n| n.0)
    });
    signal("-TERM", fusion);
    let (code, said) = end(&mut run, PATIENCE);
    assert_eq!(code, Some(1), "{said}");
    assert!(said.contains("fusion") && said.contains("signal"), "{said}");
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
    let (code, said) = end(&mut second, PATIENCE);
    assert_eq!(code, Some(2), "{said}");
    assert!(said.contains("not empty"), "{said}");
    let (code, said) = end(&mut first, PATIENCE);
    assert_eq!(code, Some(0), "{said}");
    assert!(!out.join("run.lock").exists());
}

#[test]
fn a_result_that_cannot_be_printed_is_a_failure_unless_its_reader_has_gone() {
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
    let (code, said) = end(&mut run(full.into(), "full"), PATIENCE);
    assert_eq!(code, Some(1), "{said}");
    assert!(said.contains("standard output"), "{said}");
    let mut unheard = run(Stdio::piped(), "unheard");
    drop(unheard.0.stdout.take());
    let (code, said) = end(&mut unheard, PATIENCE);
    assert_eq!(code, Some(0), "{said}");
}

#[test]
fn a_wrong_endpoint_is_refused_and_a_taken_port_named() {
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
    let (code, said) = end(&mut fusion, PATIENCE);
    assert_eq!(code, Some(2), "{said}");
    assert!(
        said.contains("two nodes have the name north-east"),
        "{said}"
    );
    assert!(!out.exists(), "a run that never began has left {out:?}");
}
