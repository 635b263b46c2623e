//! `farfield run --live` without an end: its status command, and edits by `farfield people`.

use std::fs::OpenOptions;
use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::{Arc, Mutex};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use farfield_lab::live_venue::NodeProcess;
use farfield_node::clock;
use serde_json::Value;
use tempfile::TempDir;
use tokio_tungstenite::tungstenite::{Message, client};

use super::stage::{PEOPLE, write_venue};
use crate::farfield::{FinishedCommand, command, farfield};

/// Far above what a loaded machine takes for anything that a test waits for.
const PATIENCE: Duration = Duration::from_secs(90);
/// Pause between two polls, each of which starts a process.
const PAUSE: Duration = Duration::from_millis(300);

/// `farfield run --live` of a venue without an end, with a recording and a stream.
struct LiveRun {
    child: Child,
    output: Arc<Mutex<String>>,
    reader: Option<JoinHandle<()>>,
    out: PathBuf,
    _folder: TempDir,
}

impl LiveRun {
    fn start() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let venue = write_venue(folder.path(), &[], "");
        let out = folder.path().join("out");
        let mut run = command();
        run.arg("run").arg(&venue).args(["--live", "--record"]);
        run.arg("--stream=websocket=127.0.0.1:0");
        run.arg("--out").arg(&out);
        run.stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut child = run.spawn().unwrap();
        let output = Arc::new(Mutex::new(String::new()));
        let (edge_link, stderr) = (Arc::clone(&output), child.stderr.take().unwrap());
        let reader = thread::spawn(move || {
            for line in BufReader::new(stderr).lines().map_while(Result::ok) {
                *edge_link.lock().unwrap() += &(line + "\n");
            }
        });
        Self {
            child,
            output,
            reader: Some(reader),
            out,
            _folder: folder,
        }
    }

    /// The output on standard error so far.
    fn output(&self) -> String {
        self.output.lock().unwrap().clone()
    }

    /// Polls until there is an answer.
    fn wait<T>(&self, what: &str, mut ask: impl FnMut() -> Option<T>) -> T {
        let until = clock::now() + PATIENCE;
        while clock::now() < until {
            if let Some(answer) = ask() {
                return answer;
            }
            thread::sleep(PAUSE);
        }
        panic!("{what}: not within {PATIENCE:?}\n{}", self.output());
    }

    /// Waits until a person has that name in the stream.
    fn wait_for_name(&self, name: &str) {
        let stream = self.wait("the stream is reported", || {
            let output = self.output();
            let (_, at) = output.split_once("stream websocket waits for clients at ")?;
            let (address, _) = at.split_once('\n')?;
            Some(address.to_owned())
        });
        let socket = TcpStream::connect(&stream).unwrap();
        socket.set_read_timeout(Some(PATIENCE)).unwrap();
        let (mut socket, _) = client(format!("ws://{stream}/"), socket).unwrap();
        let until = clock::now() + PATIENCE;
        while clock::now() < until {
            let Message::Text(text) = socket.read().unwrap() else {
                continue;
            };
            let tick: Value = serde_json::from_str(&text).unwrap();
            let mut persons = tick["persons"].as_array().into_iter().flatten();
            if persons.any(|person| person["name"] == name) {
                return;
            }
        }
        panic!("{name}: not within {PATIENCE:?}\n{}", self.output());
    }

    /// Interrupts the run as Ctrl-C does. Returns the exit code and standard output.
    fn interrupt(&mut self) -> (Option<i32>, String) {
        let id = self.child.id().to_string();
        let kill = Command::new("kill").args(["-INT", &id]).status();
        assert!(kill.unwrap().success());
        let mut stdout = String::new();
        let printed = self.child.stdout.as_mut().unwrap();
        printed.read_to_string(&mut stdout).unwrap();
        let code = self.child.wait().unwrap().code();
        self.reader.take().unwrap().join().unwrap();
        (code, stdout)
    }
}

impl Drop for LiveRun {
    fn drop(&mut self) {
        // The process may have ended already.
        drop(self.child.kill());
        drop(self.child.wait());
    }
}

fn people(run: &Path, words: &[&str]) -> FinishedCommand {
    farfield(&[&["people", run.to_str().unwrap()], words].concat())
}

/// All people in the list; `None` if the command fails.
fn listed(run: &Path) -> Option<Vec<Value>> {
    let listed = people(run, &["--json"]);
    (listed.code == 0).then(|| {
        let read: Value = serde_json::from_str(&listed.stdout).unwrap();
        read["people"].as_array().unwrap().clone()
    })
}

#[test]
fn edits_reach_the_stream_of_a_live_run_and_invalid_ones_are_reported() {
    let mut run = LiveRun::start();
    let all_people = run.wait("all people are listed", || {
        listed(&run.out).filter(|people| people.len() >= PEOPLE)
    });
    let person = &all_people[0];
    assert!(person["ticks"].as_u64() > Some(0) && person["seconds"].is_null());
    let id = person["person"].to_string();

    let named = people(&run.out, &["name", &id, "Anna"]);
    assert_eq!(named.code, 0, "{}", named.stderr);
    assert!(
        named.stderr.contains("still in progress"),
        "{}",
        named.stderr
    );
    run.wait_for_name("Anna");

    // The recording has its own list of edits, which the live run does not read.
    let recording = run.out.join("recording.mcap");
    let named = run.wait("the person is in the recording", || {
        let named = people(&recording, &["name", &id, "Bo"]);
        (named.code == 0).then_some(named)
    });
    let elsewhere = format!("`farfield people {} ...` edits the run", run.out.display());
    assert!(named.stderr.contains(&elsewhere), "{}", named.stderr);
    assert!(!named.stderr.contains("cut off"), "{}", named.stderr);

    let edits = run.out.join("edits.jsonl");
    let mut edits = OpenOptions::new().append(true).open(edits).unwrap();
    let wrong = r#"{"at":"2026-03-01T18:00:00Z","edit":"frobnicate","person":1}"#;
    writeln!(edits, "{wrong}").unwrap();
    let warning = "fusion: the last valid edits stay in use: ";
    run.wait("the wrong edit is reported", || {
        run.output().contains(warning).then_some(())
    });

    let (code, stdout) = run.interrupt();
    let output = run.output();
    println!("{output}{stdout}");
    assert_eq!(code, Some(130), "{output}");
    assert_eq!(output.matches(warning).count(), 1, "{output}");
    let error = "edits.jsonl:2: `edit`: found \"frobnicate\"";
    assert!(output.contains(error), "{output}");
    // The venue has no end, so there is no remaining time to show.
    assert!(
        output.contains(" ticks/s") && !output.contains(" left, "),
        "{output}"
    );
    assert!(
        stdout.contains(" ticks from ") && !stdout.contains("cut short"),
        "{stdout}"
    );
}

/// Arguments of the status command that a run has printed.
fn status_arguments(output: &str) -> Option<Vec<String>> {
    let line = output
        .lines()
        .find(|line| line.ends_with(" shows its nodes"))?;
    let command = line.split('`').nth(1)?;
    let words = command.strip_prefix("farfield ")?.split(' ');
    Some(words.map(str::to_owned).collect())
}

/// Symptom to prevent: `farfield status` did not find the run, since its port was not printed.
#[test]
fn the_status_command_that_a_live_run_prints_shows_its_nodes() {
    let folder = tempfile::tempdir().unwrap();
    let venue = write_venue(folder.path(), &[], "");
    let mut run = command();
    run.arg("run").arg(&venue).args(["--live", "--out"]);
    run.arg(folder.path().join("out"));
    let mut run = NodeProcess::start("run", run).unwrap();
    let until = clock::now() + PATIENCE;
    let words = loop {
        if let Some(words) = status_arguments(&run.output()) {
            break words;
        }
        assert!(clock::now() < until, "{}", run.output());
        std::thread::sleep(PAUSE);
    };
    let is_live = |shown: &str, node: &str| {
        let mut lines = shown.lines().filter(|line| line.starts_with(node));
        lines.any(|line| line.contains(" live "))
    };
    // The nodes start one after the other.
    loop {
        let shown = farfield(&words);
        let all = ["fusion ", "north-east ", "south-west "];
        if shown.code == 0 && all.iter().all(|node| is_live(&shown.stdout, node)) {
            break;
        }
        assert!(clock::now() < until, "{}\n{}", shown.stdout, shown.stderr);
        std::thread::sleep(PAUSE);
    }
    let id = run.pid().to_string();
    let interrupted = Command::new("kill").args(["-INT", &id]).status();
    assert!(interrupted.unwrap().success());
    let ended = run.wait(PATIENCE).unwrap();
    assert_eq!(
        ended.and_then(|status| status.code()),
        Some(130),
        "{}",
        run.output()
    );
}
