//! Edits of a run that goes on: `farfield people` makes them, its streams follow them, and one that cannot be read is told.

use std::fs::OpenOptions;
use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::{Arc, Mutex};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use farfield_node::clock;
use serde_json::Value;
use tempfile::TempDir;
use tokio_tungstenite::tungstenite::{Message, client};

use super::stage::{PEOPLE, write_venue};
use crate::farfield::{FinishedCommand, command, farfield};

/// Far above what a loaded machine takes for anything that is waited for.
const PATIENCE: Duration = Duration::from_secs(90);
/// Between two looks, each a process.
const PAUSE: Duration = Duration::from_millis(300);

/// `farfield run --live` of a venue without an end, with a recording and a stream.
struct LiveRun {
    child: Child,
    said: Arc<Mutex<String>>,
    listener: Option<JoinHandle<()>>,
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
        let said = Arc::new(Mutex::new(String::new()));
        let (heard, stderr) = (Arc::clone(&said), child.stderr.take().unwrap());
        let listener = thread::spawn(move || {
            for line in BufReader::new(stderr).lines().map_while(Result::ok) {
                *heard.lock().unwrap() += &(line + "\n");
            }
        });
        Self {
            child,
            said,
            listener: Some(listener),
            out,
            _folder: folder,
        }
    }

    /// What it has said on standard error.
    fn said(&self) -> String {
        self.said.lock().unwrap().clone()
    }

    /// Asks again and again until there is an answer.
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

    /// Waits until the stream calls somebody by that name.
    fn wait_for_name(&self, name: &str) {
        let stream = self.wait("the stream is told", || {
            let said = self.output();
            let (_, at) = said.split_once("stream websocket waits for clients at ")?;
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

    /// Ends it as Ctrl-C does; its exit code, and what it says on standard output.
    fn interrupt(&mut self) -> (Option<i32>, String) {
        let id = self.child.id().to_string();
        let kill = Command::new("kill").args(["-INT", &id]).status();
        assert!(kill.unwrap().success());
        let mut stdout = String::new();
        let printed = self.child.stdout.as_mut().unwrap();
        printed.read_to_string(&mut stdout).unwrap();
        let code = self.child.wait().unwrap().code();
        self.listener.take().unwrap().join().unwrap();
        (code, stdout)
    }
}

impl Drop for LiveRun {
    fn drop(&mut self) {
        // Ended already when all went well.
        drop(self.child.kill());
        drop(self.child.wait());
    }
}

fn people(of: &Path, words: &[&str]) -> FinishedCommand {
    farfield(&[&["people", of.to_str().unwrap()], words].concat())
}

/// Everybody who is listed; `None` where that is refused.
fn listed(of: &Path) -> Option<Vec<Value>> {
    let listed = people(of, &["--json"]);
    (listed.code == 0).then(|| {
        let read: Value = serde_json::from_str(&listed.stdout).unwrap();
        read["people"].as_array().unwrap().clone()
    })
}

#[test]
fn edits_of_a_run_that_goes_on_reach_its_stream_and_one_that_cannot_be_read_is_told() {
    let mut run = LiveRun::start();
    let everybody = run.wait("everybody is listed", || {
        listed(&run.out).filter(|people| people.len() >= PEOPLE)
    });
    let person = &everybody[0];
    assert!(person["ticks"].as_u64() > Some(0) && person["seconds"].is_null());
    let id = person["person"].to_string();

    let named = people(&run.out, &["name", &id, "Anna"]);
    assert_eq!(named.code, 0, "{}", named.stderr);
    assert!(named.stderr.contains("its run goes on"), "{}", named.stderr);
    run.wait_for_name("Anna");

    // The list of the recording is another one, to which nobody listens live.
    let recording = run.out.join("recording.mcap");
    let named = run.wait("the person is in the recording", || {
        let named = people(&recording, &["name", &id, "Bo"]);
        (named.code == 0).then_some(named)
    });
    let elsewhere = format!("`farfield people {} ...` edits what", run.out.display());
    assert!(named.stderr.contains(&elsewhere), "{}", named.stderr);
    assert!(!named.stderr.contains("cut off"), "{}", named.stderr);

    let edits = run.out.join("edits.jsonl");
    let mut edits = OpenOptions::new().append(true).open(edits).unwrap();
    let wrong = r#"{"at":"2026-03-01T18:00:00Z","edit":"frobnicate","person":1}"#;
    writeln!(edits, "{wrong}").unwrap();
    let told = "fusion: edits are left as they were: ";
    run.wait("the wrong edit is told", || {
        run.output().contains(told).then_some(())
    });

    let (code, stdout) = run.interrupt();
    let said = run.output();
    println!("{said}{stdout}");
    assert_eq!(code, Some(130), "{said}");
    assert_eq!(said.matches(told).count(), 1, "{said}");
    let found = "edits.jsonl:2: `edit`: found \"frobnicate\"";
    assert!(said.contains(found), "{said}");
    // There is no end, of which nothing is said as if there were one.
    assert!(
        said.contains(" ticks/s") && !said.contains(" left, "),
        "{said}"
    );
    assert!(
        stdout.contains(" ticks from ") && !stdout.contains("cut short"),
        "{stdout}"
    );
}
