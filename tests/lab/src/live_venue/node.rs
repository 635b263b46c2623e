//! One node of a venue as a child process.

use std::collections::VecDeque;
use std::fs;
use std::io::{self, BufRead as _, BufReader, Read};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use serde_json::Value;

/// Number of newest lines of standard error that are kept.
const MAX_LINES: usize = 200;
/// Pause between two polls.
const PAUSE: Duration = Duration::from_millis(10);
/// Time limit for the last output of a node that has ended: a child of it may keep its output open.
const LAST_OUTPUT: Duration = Duration::from_secs(10);

/// A running node; killed when dropped.
#[derive(Debug)]
pub struct NodeProcess {
    name: String,
    child: Child,
    log: Arc<Mutex<NodeOutput>>,
    readers: Vec<JoinHandle<()>>,
}

/// Output of a node.
#[derive(Debug, Default)]
struct NodeOutput {
    /// The newest lines of its standard error, and of its reports in words.
    lines: VecDeque<String>,
    /// The newest reported tick, and its number of persons.
    newest: Option<(i64, usize)>,
    /// Number of reported ticks.
    ticks: u64,
}

impl NodeProcess {
    /// Starts `command`, a managed node: it reports in JSON on its standard output and ends when its standard input closes.
    ///
    /// # Errors
    /// It cannot be started.
    pub fn start(name: &str, mut command: Command) -> io::Result<Self> {
        command
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped());
        let mut child = command.spawn()?;
        let log = Arc::new(Mutex::new(NodeOutput::default()));
        let mut readers = Vec::new();
        if let Some(stderr) = child.stderr.take() {
            readers.push(read_lines(stderr, Arc::clone(&log), NodeOutput::push)?);
        }
        if let Some(stdout) = child.stdout.take() {
            readers.push(read_lines(stdout, Arc::clone(&log), |log, line| {
                log.reported(&line);
            })?);
        }
        Ok(Self {
            name: name.to_owned(),
            child,
            log,
            readers,
        })
    }

    /// Its name in the venue.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Its process id.
    pub fn pid(&self) -> u32 {
        self.child.id()
    }

    /// Its resources; `None` once it has ended.
    pub fn vitals(&self) -> Option<Vitals> {
        Vitals::read(self.pid())
    }

    /// The newest reported tick, and its number of persons.
    pub fn newest(&self) -> Option<(i64, usize)> {
        self.log().newest
    }

    /// Number of reported ticks.
    pub fn ticks(&self) -> u64 {
        self.log().ticks
    }

    /// The newest lines of its standard error, and of its reports in words.
    pub fn output(&self) -> String {
        let log = self.log();
        log.lines
            .iter()
            .flat_map(|line| [line.as_str(), "\n"])
            .collect()
    }

    /// Ends it at once, like a power cut.
    ///
    /// # Errors
    /// The system refuses.
    pub fn kill(mut self) -> io::Result<()> {
        self.child.kill()?;
        self.child.wait().map(drop)
    }

    /// Closes its standard input, which ends it.
    pub fn close(&mut self) {
        drop(self.child.stdin.take());
    }

    /// Waits until it has ended and all its output is read; `None` if it has not within `patience`.
    ///
    /// # Errors
    /// The system refuses.
    pub fn wait(&mut self, patience: Duration) -> io::Result<Option<ExitStatus>> {
        for _ in 0..patience.as_millis() / PAUSE.as_millis() {
            if let Some(status) = self.child.try_wait()? {
                self.wait_for_last_output();
                return Ok(Some(status));
            }
            thread::sleep(PAUSE);
        }
        self.child.try_wait()
    }

    /// A process can end before its last output is read.
    fn wait_for_last_output(&self) {
        for _ in 0..LAST_OUTPUT.as_millis() / PAUSE.as_millis() {
            if self.readers.iter().all(JoinHandle::is_finished) {
                return;
            }
            thread::sleep(PAUSE);
        }
    }

    fn log(&self) -> MutexGuard<'_, NodeOutput> {
        // A panic elsewhere leaves complete lines.
        self.log.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Drop for NodeProcess {
    fn drop(&mut self) {
        // The process may have ended already.
        drop(self.child.kill());
        drop(self.child.wait());
    }
}

impl NodeOutput {
    fn push(&mut self, line: String) {
        if self.lines.len() == MAX_LINES {
            self.lines.pop_front();
        }
        self.lines.push_back(line);
    }

    fn reported(&mut self, line: &str) {
        let report: Value = serde_json::from_str(line).unwrap_or_default();
        let tick = &report["tick"];
        if let (Some(number), Some(persons)) = (tick["tick"].as_i64(), tick["persons"].as_u64()) {
            self.newest = Some((number, usize::try_from(persons).unwrap_or(usize::MAX)));
            self.ticks += 1;
        }
        // Its parent would print these lines for the operator.
        for line in report["said"].as_array().into_iter().flatten() {
            self.push(line.as_str().unwrap_or_default().to_owned());
        }
    }
}

/// Reads lines until the other end closes.
fn read_lines(
    from: impl Read + Send + 'static,
    log: Arc<Mutex<NodeOutput>>,
    take: impl Fn(&mut NodeOutput, String) + Send + 'static,
) -> io::Result<JoinHandle<()>> {
    let lines = BufReader::new(from).lines();
    let work = move || {
        for line in lines.map_while(Result::ok) {
            take(
                &mut log.lock().unwrap_or_else(PoisonError::into_inner),
                line,
            );
        }
    };
    thread::Builder::new().name("listen".to_owned()).spawn(work)
}

/// Resources of a process at one moment.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Vitals {
    /// Memory in use, bytes (resident set).
    pub memory_bytes: u64,
    /// Threads.
    pub threads: u32,
    /// Open files and sockets.
    pub handles: u32,
    /// Processor time since its start, milliseconds, over all threads.
    pub cpu_ms: u64,
}

impl Vitals {
    /// Of process `pid`; `None` if it has ended.
    pub fn read(pid: u32) -> Option<Self> {
        let status = fs::read_to_string(format!("/proc/{pid}/status")).ok()?;
        let field = |name: &str| {
            let line = status.lines().find_map(|line| line.strip_prefix(name))?;
            line.split_whitespace().next()?.parse::<u64>().ok()
        };
        let handles = fs::read_dir(format!("/proc/{pid}/fd")).ok()?.count();
        let stat = fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
        // The name, in brackets, may contain any character; user and system time are the 12th and 13th after it.
        let mut after_name = stat.rsplit_once(") ")?.1.split(' ').skip(11);
        let mut clock_ticks = || after_name.next()?.parse::<u64>().ok();
        // Linux counts in hundredths of a second on every architecture.
        let cpu_ms = (clock_ticks()? + clock_ticks()?) * 10;
        Some(Self {
            memory_bytes: field("VmRSS:")? * 1024,
            threads: u32::try_from(field("Threads:")?).ok()?,
            handles: u32::try_from(handles).ok()?,
            cpu_ms,
        })
    }
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
    fn a_node_is_read_and_ends_when_closed() {
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
    fn all_output_is_read_once_a_node_has_ended() {
        let mut node = shell("seq 150 >&2");
        assert!(node.wait(PATIENCE).unwrap().unwrap().success());
        assert!(node.output().ends_with("149\n150\n"), "{}", node.output());
    }

    #[test]
    fn a_killed_node_leaves_nothing_behind() {
        let node = shell("read x");
        let pid = node.pid();
        node.kill().unwrap();
        assert_eq!(Vitals::read(pid), None);
    }

    #[test]
    fn a_handle_more_and_a_thread_more_are_counted() {
        let pid = std::process::id();
        let before = Vitals::read(pid).unwrap();
        assert!(before.memory_bytes > 100_000);
        let files: Vec<fs::File> = (0..50)
            .map(|_| fs::File::open("/proc/self/status").unwrap())
            .collect();
        let (end, wait) = std::sync::mpsc::channel::<()>();
        let thread = std::thread::spawn(move || wait.recv().is_err());
        let with = Vitals::read(pid).unwrap();
        drop((files, end));
        thread.join().unwrap();
        // Other tests of this process start and end.
        assert!(with.handles >= before.handles + 30, "{before:?} {with:?}");
        assert!(with.threads >= 2);
        assert_eq!(Vitals::read(u32::MAX), None);
    }
}
