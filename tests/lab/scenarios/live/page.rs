//! The page of a live run: what a browser receives, and the actions of an operator.

use std::io::{Read as _, Write as _};
use std::net::TcpStream;
use std::path::Path;
use std::process::Command;
use std::time::Duration;

use farfield_lab::live_venue::NodeProcess;
use farfield_node::clock;
use serde_json::{Value, json};
use tokio_tungstenite::tungstenite::client::IntoClientRequest as _;
use tokio_tungstenite::tungstenite::{Message, WebSocket, client};

use super::stage::{LiveStage, PEOPLE};

/// Far above what a loaded machine takes for anything that a test waits for.
const PATIENCE: Duration = Duration::from_mins(1);

/// A client of the page; with a token it may act.
struct Page {
    socket: WebSocket<TcpStream>,
    requests: u64,
}

/// Address and token of a page.
struct Address {
    authority: String,
    token: String,
}

impl Address {
    /// The address that fusion has printed.
    fn printed_by(stage: &LiveStage) -> Self {
        let output = stage.live.fusion.as_ref().unwrap().output();
        Self::in_output(&output)
    }

    fn in_output(output: &str) -> Self {
        let address = output.split_whitespace().find_map(|word| {
            let (authority, token) = word.strip_prefix("http://")?.split_once("/#token=")?;
            Some(Self {
                authority: authority.to_owned(),
                token: token.to_owned(),
            })
        });
        address.unwrap_or_else(|| panic!("no address of a page in:\n{output}"))
    }

    /// Status line and body of an answer.
    fn get(&self, path: &str, host: &str) -> (String, String) {
        let mut socket = TcpStream::connect(&self.authority).unwrap();
        socket.set_read_timeout(Some(PATIENCE)).unwrap();
        let request = format!("GET {path} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n");
        socket.write_all(request.as_bytes()).unwrap();
        let mut answer = Vec::new();
        socket.read_to_end(&mut answer).unwrap();
        let answer = String::from_utf8_lossy(&answer).into_owned();
        let (head, body) = answer.split_once("\r\n\r\n").unwrap();
        (head.lines().next().unwrap().to_owned(), body.to_owned())
    }

    fn open(&self, token: Option<&str>) -> Page {
        let url = format!("ws://{}/ws/json", self.authority);
        let mut request = url.into_client_request().unwrap();
        if let Some(token) = token {
            let value = format!("Bearer {token}").parse().unwrap();
            request.headers_mut().insert("Authorization", value);
        }
        let socket = TcpStream::connect(&self.authority).unwrap();
        socket.set_read_timeout(Some(PATIENCE)).unwrap();
        let (socket, _) = client(request, socket).unwrap();
        Page {
            socket,
            requests: 0,
        }
    }
}

impl Page {
    /// The next message that meets the condition.
    fn wait(&mut self, what: &str, condition: impl Fn(&Value) -> bool) -> Value {
        let until = clock::now() + PATIENCE;
        let mut last = Value::Null;
        while clock::now() < until {
            let Message::Text(text) = self.socket.read().unwrap() else {
                continue;
            };
            let value: Value = serde_json::from_str(&text).unwrap();
            if condition(&value) {
                return value;
            }
            if value["type"] != "tick" {
                last = value;
            }
        }
        panic!("{what}: not within {PATIENCE:?}; the last but ticks: {last}");
    }

    /// Sends a request and returns its answer.
    fn ask(&mut self, mut message: Value) -> Value {
        self.requests += 1;
        let number = self.requests;
        message["request"] = json!(number);
        self.socket
            .send(Message::text(message.to_string()))
            .unwrap();
        self.wait("an answer", |it| {
            it["type"] == "answer" && it["request"] == number
        })
    }

    /// The recording of the next status whose recording meets the condition.
    fn recording(&mut self, what: &str, condition: impl Fn(&Value) -> bool) -> Value {
        let is_status = |it: &Value| it["type"] == "status" && condition(&it["recording"]);
        self.wait(what, is_status)["recording"].clone()
    }
}

fn files_of(folder: &Path, ending: &str) -> Vec<String> {
    let files = std::fs::read_dir(folder).unwrap();
    let files = files.map(|entry| entry.unwrap().path().to_str().unwrap().to_owned());
    let mut files: Vec<String> = files.filter(|path| path.ends_with(ending)).collect();
    files.sort();
    files
}

/// Runs a command: whether it succeeded, and its output.
fn farfield(words: &[&str]) -> (bool, String) {
    let program = env!("CARGO_BIN_EXE_lab");
    let output = Command::new(program).args(words).output().unwrap();
    let text = [output.stdout, output.stderr].concat();
    (
        output.status.success(),
        String::from_utf8_lossy(&text).into_owned(),
    )
}

#[test]
fn a_browser_gets_the_page_and_the_people_of_a_live_run() {
    let mut stage = LiveStage::prepare(&[], "");
    let out = stage.out("first");
    stage.start_with(&out, &["--page=127.0.0.1:0"]);
    let address = Address::printed_by(&stage);
    let (status, body) = address.get("/", &address.authority);
    assert!(status.contains(" 200 "), "{status}");
    assert!(body.contains("<script"), "{body}");
    let (status, _) = address.get("/api/venue", "stranger.example");
    assert!(status.contains(" 421 "), "another host: {status}");
    let (_, venue) = address.get("/api/venue", &address.authority);
    let venue: Value = serde_json::from_str(&venue).unwrap();
    assert_eq!(venue["venue"], "stage");
    assert_eq!(venue["mode"], "live");
    assert_eq!(venue["cameras"].as_array().unwrap().len(), 8);
    let mut page = address.open(None);
    let ids = stage.ids();
    let tick = page.wait("all people on the page", |it| {
        let persons = it["persons"].as_array();
        it["type"] == "tick" && persons.is_some_and(|persons| persons.len() == PEOPLE)
    });
    for person in tick["persons"].as_array().unwrap() {
        let id = person["id"].as_u64().unwrap();
        assert!(ids.contains(&u32::try_from(id).unwrap()), "{id}, {ids:?}");
    }
    // A killed edge raises an alarm.
    stage.live.edges[0].take().unwrap().kill().unwrap();
    let status = page.wait("an alarm about the edge", |it| {
        let alarms = it["alarms"].as_array();
        alarms.is_some_and(|alarms| alarms.iter().any(|alarm| alarm["severity"] == "failed"))
    });
    assert!(!status["alarms"][0]["remedy"].as_str().unwrap().is_empty());
    stage.finish("first");
}

#[test]
fn a_recording_is_started_and_stopped_from_the_page() {
    let mut stage = LiveStage::prepare(&[], "");
    let out = stage.out("first");
    stage.start_with(&out, &["--page=127.0.0.1:0"]);
    stage.run_for(2.0);
    let address = Address::printed_by(&stage);
    let mut stranger = address.open(None);
    let refused = stranger.ask(json!({"do": "start_recording"}));
    assert_eq!(refused["ok"], false, "without a token: {refused}");
    let mut page = address.open(Some(&address.token));
    let early = page.ask(json!({"do": "stop_recording"}));
    assert_eq!(early["ok"], false, "there is none: {early}");

    let ids: Vec<u32> = stage.ids().into_iter().collect();
    let named = json!({"do": "name_person", "person": ids[0], "name": "Anna"});
    assert_eq!(page.ask(named)["ok"], true);
    let started = page.ask(json!({"do": "start_recording"}));
    assert_eq!(started["ok"], true, "{started}");
    let running = page.recording("it runs", |it| {
        it["running"] == true && it["bytes"].as_u64() > Some(10_000)
    });
    let name = running["text"].as_str().unwrap();
    assert!(name.starts_with("stage_"), "{name}");
    let twice = page.ask(json!({"do": "start_recording"}));
    let error = twice["error"].as_str().unwrap();
    assert!(error.contains(name), "the recording runs already: {error}");
    stage.run_for(3.0);
    let stopped = page.ask(json!({"do": "stop_recording"}));
    assert_eq!(stopped["ok"], true, "{stopped}");
    page.recording("it is whole", |it| it["running"] == false);

    // The next recording is another file. A recording that is not stopped is finished with the run.
    let started = page.ask(json!({"do": "start_recording"}));
    assert_eq!(started["ok"], true, "{started}");
    stage.run_for(1.0);
    stage.finish("first");
    let recordings = files_of(&out, ".mcap");
    assert_eq!(recordings.len(), 2, "{recordings:?}");

    for (i, recording) in recordings.iter().enumerate() {
        let solved = stage.out(&format!("solved{i}"));
        let (is_done, output) = farfield(&["replay", recording, "--out", solved.to_str().unwrap()]);
        assert!(is_done, "{output}");
        assert!(output.contains("in the middle of a run"), "{output}");
        assert!(!output.contains("cut off"), "{output}");
        // The second recording is shorter than a detection pass, so it has no people.
        let expected = if i == 0 { ids.as_slice() } else { &[] };
        let poses = std::fs::read_to_string(solved.join("poses.jsonl")).unwrap();
        for id in expected {
            let person = format!("\"person\":{id},");
            assert!(poses.contains(&person), "{id} was not recognised\n{output}");
        }
        // New people could have the same ids by chance.
        let summary = std::fs::read_to_string(solved.join("summary.json")).unwrap();
        let summary: Value = serde_json::from_str(&summary).unwrap();
        let recognised = summary["events"]["recognise"].as_u64().unwrap_or(0);
        assert!(
            recognised >= expected.len() as u64,
            "people recognised: {}",
            summary["events"]
        );
    }
    let (is_done, people) = farfield(&["people", &recordings[0]]);
    assert!(is_done && people.contains("Anna"), "{people}");

    check_page(&ids, &["view", &recordings[0], "--at=127.0.0.1:0"]);
    let out = stage.out("viewed");
    let to = out.to_str().unwrap();
    let words = ["replay", &recordings[0], "--page=127.0.0.1:0", "--out", to];
    let output = check_page(&ids, &words);
    assert!(out.join("summary.json").is_file(), "{output}");
}

/// Checks that a command serves a page with all of `ids` until it is interrupted; returns its output.
fn check_page(ids: &[u32], words: &[&str]) -> String {
    let mut command = Command::new(env!("CARGO_BIN_EXE_lab"));
    command.args(words);
    let mut shown = NodeProcess::start("page", command).unwrap();
    let until = clock::now() + PATIENCE;
    while !shown.output().contains("Ctrl-C") {
        assert!(clock::now() < until, "{words:?}: {}", shown.output());
        if shown.output().contains("#token=") && words[0] == "replay" {
            // The page works while the replay runs.
            break;
        }
        std::thread::sleep(Duration::from_millis(20));
    }
    let mut page = Address::in_output(&shown.output()).open(None);
    page.wait("all people", |it| {
        let persons = it["persons"].as_array().into_iter().flatten();
        let there: Vec<u64> = persons.filter_map(|person| person["id"].as_u64()).collect();
        ids.iter().all(|id| there.contains(&u64::from(*id)))
    });
    while !shown.output().contains("Ctrl-C") {
        assert!(clock::now() < until, "{words:?}: {}", shown.output());
        std::thread::sleep(Duration::from_millis(20));
    }
    let pid = shown.pid().to_string();
    assert!(
        Command::new("kill")
            .args(["-INT", &pid])
            .status()
            .unwrap()
            .success()
    );
    let status = shown.wait(PATIENCE).unwrap();
    assert!(
        status.is_some_and(|status| status.success()),
        "{status:?}: {}",
        shown.output()
    );
    shown.output()
}
