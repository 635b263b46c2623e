//! One node of a venue as a child process.

use std::collections::VecDeque;
use std::io::{self, BufRead as _, BufReader, Read};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use serde_json::Value;

use super::vitals::Vitals;

/// Lines of its standard error that are kept, the newest.
const KEPT_LINES: usize = 200;
/// Between two looks at whether something has happened.
const PAUSE: Duration = Duration::from_millis(10);
/// How long the last words of a node that has ended are waited for: what it started may hold its output open.
const LAST_WORDS: Duration = Duration::from_secs(10);

/// A running node; killed when dropped.
#[derive(Debug)]
pub struct NodeProcess {
    name: String,
    child: Child,
    heard: Arc<Mutex<NodeOutput>>,
    listening: Vec<JoinHandle<()>>,
}

/// What a node has said.
#[derive(Debug, Default)]
struct NodeOutput {
    /// The newest lines of its standard error, and of what it has reported in words.
    said: VecDeque<String>,
    /// The newest tick that it reported, and the persons at it.
    newest: Option<(i64, usize)>,
    /// Ticks that it reported.
    ticks: u64,
}

impl NodeProcess {
    /// Starts `command`, a managed node: it reports in JSON on its standard output and leaves when its
    /// standard input closes.
    ///
    /// # Errors
    /// It cannot be started.
    pub fn start(name: &str, mut command: Command) -> io::Result<Self> {
        command
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped());
        let mut child = command.spawn()?;
        let heard = Arc::new(Mutex::new(NodeOutput::default()));
        let mut listening = Vec::new();
        if let Some(stderr) = child.stderr.take() {
            listening.push(listen(stderr, Arc::clone(&heard), NodeOutput::said)?);
        }
        if let Some(stdout) = child.stdout.take() {
            listening.push(listen(stdout, Arc::clone(&heard), |heard, line| {
                heard.reported(&line);
            })?);
        }
        Ok(Self {
            name: name.to_owned(),
            child,
            heard,
            listening,
        })
    }

    /// Its name in the venue.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Its process.
    pub fn pid(&self) -> u32 {
        self.child.id()
    }

    /// What it takes; `None` once it has ended.
    pub fn vitals(&self) -> Option<Vitals> {
        Vitals::of(self.pid())
    }

    /// The newest tick that it has reported, and how many persons were there.
    pub fn newest(&self) -> Option<(i64, usize)> {
        self.heard().newest
    }

    /// How many ticks it has reported.
    pub fn ticks(&self) -> u64 {
        self.heard().ticks
    }

    /// The newest lines of its standard error, and of what it has reported in words.
    pub fn said(&self) -> String {
        let heard = self.heard();
        heard
            .said
            .iter()
            .flat_map(|line| [line.as_str(), "\n"])
            .collect()
    }

    /// Ends it at once, as a power cut would.
    ///
    /// # Errors
    /// What the system says.
    pub fn kill(mut self) -> io::Result<()> {
        self.child.kill()?;
        self.child.wait().map(drop)
    }

    /// Asks it to leave.
    pub fn close(&mut self) {
        drop(self.child.stdin.take());
    }

    /// Waits until it has ended by itself and all that it said is heard; `None` when it has not within `patience`.
    ///
    /// # Errors
    /// What the system says.
    pub fn wait(&mut self, patience: Duration) -> io::Result<Option<ExitStatus>> {
        for _ in 0..patience.as_millis() / PAUSE.as_millis() {
            if let Some(status) = self.child.try_wait()? {
                self.hear_last_words();
                return Ok(Some(status));
            }
            thread::sleep(PAUSE);
        }
        self.child.try_wait()
    }

    /// A process has ended before what it wrote last is read.
    fn hear_last_words(&self) {
        for _ in 0..LAST_WORDS.as_millis() / PAUSE.as_millis() {
            if self.listening.iter().all(JoinHandle::is_finished) {
                return;
            }
            thread::sleep(PAUSE);
        }
    }

    fn heard(&self) -> MutexGuard<'_, NodeOutput> {
        // A panic elsewhere leaves whole lines behind.
        self.heard.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Drop for NodeProcess {
    fn drop(&mut self) {
        // Ended already when all went well.
        drop(self.child.kill());
        drop(self.child.wait());
    }
}

impl NodeOutput {
    fn said(&mut self, line: String) {
        if self.said.len() == KEPT_LINES {
            self.said.pop_front();
        }
        self.said.push_back(line);
    }

    fn reported(&mut self, line: &str) {
        let report: Value = serde_json::from_str(line).unwrap_or_default();
        let tick = &report["tick"];
        if let (Some(number), Some(persons)) = (tick["tick"].as_i64(), tick["persons"].as_u64()) {
            self.newest = Some((number, usize::try_from(persons).unwrap_or(usize::MAX)));
            self.ticks += 1;
        }
        // What its parent would tell the operator.
        for line in report["said"].as_array().into_iter().flatten() {
            self.said(line.as_str().unwrap_or_default().to_owned());
        }
    }
}

/// Reads lines until the other end closes.
fn listen(
    from: impl Read + Send + 'static,
    heard: Arc<Mutex<NodeOutput>>,
    take: impl Fn(&mut NodeOutput, String) + Send + 'static,
) -> io::Result<JoinHandle<()>> {
    let lines = BufReader::new(from).lines();
    let work = move || {
        for line in lines.map_while(Result::ok) {
            take(
                &mut heard.lock().unwrap_or_else(PoisonError::into_inner),
                line,
            );
        }
    };
    thread::Builder::new().name("listen".to_owned()).spawn(work)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Far above what a loaded machine takes to start a shell.
    const PATIENCE: Duration = Duration::from_mins(1);

    fn shell(script: &str) -> NodeProcess {
        let mut command = Command::new("sh");
        command.args(["-c", script]);
        NodeProcess::start("shell", command).unwrap()
    }

    #[test]
    fn a_node_is_heard_and_leaves_when_asked() {
        let script =
            r#"echo hello >&2; echo '{"tick":{"tick":7,"persons":2,"bytes":0}}'; read x; exit 3"#;
        let mut node = shell(script);
        while node.newest().is_none() || node.output().is_empty() {
            thread::sleep(PAUSE);
        }
        assert_eq!((node.newest(), node.ticks()), (Some((7, 2)), 1));
        assert_eq!(node.output(), "hello\n");
        assert!(node.vitals().is_some());
        node.close();
        let status = node.wait(PATIENCE).unwrap().unwrap();
        assert_eq!(status.code(), Some(3));
    }

    #[test]
    fn all_that_a_node_said_is_heard_once_it_has_ended() {
        let mut node = shell("seq 150 >&2");
        assert!(node.wait(PATIENCE).unwrap().unwrap().success());
        assert!(node.output().ends_with("149\n150\n"), "{}", node.output());
    }

    #[test]
    fn a_killed_node_leaves_nothing_behind() {
        let node = shell("read x");
        let pid = node.pid();
        node.kill().unwrap();
        assert_eq!(Vitals::of(pid), None);
    }
}
