//! Lines that nodes write on standard error: which of them the run prints, and when.
//!
//! The run prints the lines of its nodes under their names. Lines from before the run begins are printed when it
//! begins, or at its end if it never does. The error with which a node ends is not printed when it arrives: it is the
//! reason of that end, which the run compares with those of the other nodes.
use std::collections::BTreeMap;
use std::time::Duration;

use tokio::time::Instant;

/// Prefix of an error line.
const ERROR: &str = "error: ";
/// Prefix of a warning about files; the run has read these files and printed the warning itself.
const WARNING: &str = "doubtful: ";
/// A node that has printed its final error ends within this time, also on a busy machine.
const ENDS_WITHIN: Duration = Duration::from_secs(2);
/// Limit for the lines of an error.
const MOST_LINES: usize = 200;
/// Limit for lines that wait for the beginning of a run.
const MOST_EARLY: usize = 200;
/// Time after which a repeated line of a node is printed again.
const AGAIN: Duration = Duration::from_secs(10);

/// How much the nodes print.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum LineDetail {
    /// Messages for the operator.
    Notices,
    /// A log, which is printed at once.
    Log,
}

impl LineDetail {
    /// [`Self::Log`] if `RUST_LOG` is set, as the nodes do.
    pub(super) fn from_environment() -> Self {
        match std::env::var_os("RUST_LOG") {
            Some(_) => Self::Log,
            None => Self::Notices,
        }
    }
}

/// The possible final error of a node, with the lines that follow it.
#[derive(Debug)]
pub(super) struct FinalError {
    detail: LineDetail,
    lines: Vec<String>,
    since: Option<Instant>,
    /// The last error after which the node kept running.
    survived: Vec<String>,
}

impl FinalError {
    pub(super) fn new(detail: LineDetail) -> Self {
        Self {
            detail,
            lines: Vec::new(),
            since: None,
            survived: Vec::new(),
        }
    }

    /// Takes a line that came at `now`. Returns the line if it is to be printed at once.
    pub(super) fn take(&mut self, line: String, now: Instant) -> Option<String> {
        if self.since.is_none() && !line.starts_with(ERROR) {
            return Some(line);
        }
        self.since.get_or_insert(now);
        let logged = (self.detail == LineDetail::Log).then(|| line.clone());
        if self.lines.len() < MOST_LINES {
            self.lines.push(line);
        }
        logged
    }

    /// When the stored error is no longer the final one, if the node still runs.
    pub(super) fn expires_at(&self) -> Option<Instant> {
        self.since.map(|since| since + ENDS_WITHIN)
    }

    /// The node has survived the error. Returns the lines that are still to be printed.
    pub(super) fn expire(&mut self) -> Vec<String> {
        self.since = None;
        self.survived = std::mem::take(&mut self.lines);
        match self.detail {
            LineDetail::Notices => self.survived.clone(),
            LineDetail::Log => Vec::new(),
        }
    }

    /// The node has ended. Returns its final error and the last error that it survived, for a node that takes long to
    /// end.
    pub(super) fn at_exit(self) -> [Vec<String>; 2] {
        [self.lines, self.survived]
    }
}

/// Filters the lines of all nodes.
#[derive(Debug)]
pub(super) struct NodeLines {
    detail: LineDetail,
    has_begun: bool,
    /// Lines from before the beginning, with their nodes.
    early: Vec<(String, String)>,
    /// The last line printed of every node, and when.
    last: BTreeMap<String, (String, Instant)>,
}

impl NodeLines {
    pub(super) fn new(detail: LineDetail) -> Self {
        Self {
            detail,
            has_begun: false,
            early: Vec::new(),
            last: BTreeMap::new(),
        }
    }

    /// Takes a line of `node` that came at `now`. Returns the line to print now, if any.
    pub(super) fn take(&mut self, node: &str, line: String, now: Instant) -> Option<String> {
        if self.detail == LineDetail::Log {
            return Some(named(node, &line));
        }
        let is_skipped = line.trim().is_empty() || line.starts_with(WARNING);
        if is_skipped || self.is_repeated(node, &line, now) {
            return None;
        }
        self.last.insert(node.to_owned(), (line.clone(), now));
        if self.has_begun {
            return Some(named(node, &line));
        }
        if self.early.len() < MOST_EARLY {
            self.early.push((node.to_owned(), line));
        }
        None
    }

    /// The run begins, or never will. Returns the earlier lines that are to be printed.
    pub(super) fn begin(&mut self) -> Vec<String> {
        self.has_begun = true;
        let early = std::mem::take(&mut self.early);
        let lines = early.iter().map(|(node, line)| named(node, line));
        lines.collect()
    }

    /// Lines of `node` that are not printed yet, since the run has not begun.
    pub(super) fn early_lines(&self, node: &str) -> Vec<String> {
        let own = self.early.iter().filter(|(name, _)| name == node);
        own.map(|(_, line)| line.clone()).collect()
    }

    /// Whether `line` is a repetition: it was the last line printed of `node`, or, before the run begins, another node
    /// has
    /// written it since: all nodes read the same files then. Later lines belong to one node, such as free space on its
    /// disk.
    fn is_repeated(&self, node: &str, line: &str, now: Instant) -> bool {
        let last = self.last.get(node);
        if last.is_some_and(|(last, at)| last == line && now.duration_since(*at) < AGAIN) {
            return true;
        }
        let mut since = self.early.iter().rev().take_while(|(name, _)| name != node);
        since.any(|(_, it)| it == line)
    }
}

/// A line with the name of its node; some nodes add their name themselves.
fn named(node: &str, line: &str) -> String {
    let rest = line.strip_prefix(node);
    if rest.is_some_and(|rest| rest.starts_with(": ")) {
        line.to_owned()
    } else {
        format!("{node}: {line}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Everything printed of these lines, which come at once.
    fn printed(lines: &mut NodeLines, input: &[(&str, &str)]) -> Vec<String> {
        let now = Instant::now();
        let taken = input
            .iter()
            .filter_map(|(node, line)| lines.take(node, (*line).to_owned(), now));
        taken.collect()
    }

    fn begun() -> NodeLines {
        let mut lines = NodeLines::new(LineDetail::Notices);
        assert!(lines.begin().is_empty());
        lines
    }

    #[test]
    fn lines_of_a_running_node_are_printed_once_with_its_name() {
        let input = [
            ("fusion", "edits.jsonl:1: `edit`: found \"rename\""),
            ("fusion", "fusion: turned away 3 times in all"),
            ("ne", "camera `ne-1`: no route to host"),
            ("ne", "ne: refused by fusion: its clock is off"),
            ("ne", ""),
        ];
        assert_eq!(
            printed(&mut begun(), &input),
            [
                "fusion: edits.jsonl:1: `edit`: found \"rename\"",
                "fusion: turned away 3 times in all",
                "ne: camera `ne-1`: no route to host",
                "ne: refused by fusion: its clock is off",
            ]
        );
    }

    #[test]
    fn early_lines_are_printed_when_the_run_begins_without_warnings() {
        let mut lines = NodeLines::new(LineDetail::Notices);
        let input = [
            ("fusion", "doubtful: calibration.toml: camera `a` is high"),
            ("ne", "camera `ne-1`: there is no /dev/video0"),
        ];
        assert!(printed(&mut lines, &input).is_empty());
        assert_eq!(
            lines.begin(),
            ["ne: camera `ne-1`: there is no /dev/video0"]
        );
        assert!(lines.early_lines("ne").is_empty(), "it was printed");
    }

    #[test]
    fn early_lines_of_a_node_that_never_begins_are_not_lost() {
        let mut lines = NodeLines::new(LineDetail::Notices);
        let input = [("ne", "no pictures are sent"), ("sw", "nor here")];
        printed(&mut lines, &input);
        assert_eq!(lines.early_lines("ne"), ["no pictures are sent"]);
        assert_eq!(lines.begin(), ["ne: no pictures are sent", "sw: nor here"]);
    }

    #[test]
    fn an_early_line_of_all_nodes_is_printed_once() {
        let mut lines = NodeLines::new(LineDetail::Notices);
        let key = "certs/authority.key: the key of the venue's authority lies there";
        let [full, room] = ["there is no room", "there is room again"];
        printed(&mut lines, &[("fusion", key), ("ne", key), ("sw", key)]);
        printed(&mut lines, &[("ne", full), ("sw", full), ("sw", room)]);
        printed(&mut lines, &[("sw", full)]);
        assert_eq!(
            lines.begin(),
            [
                format!("fusion: {key}"),
                format!("ne: {full}"),
                format!("sw: {room}"),
                format!("sw: {full}"),
            ]
        );
    }

    #[test]
    fn a_repeated_line_is_printed_again_after_a_while() {
        let (mut lines, start) = (begun(), Instant::now());
        let mut is_printed = |after_s: u64| {
            let now = start + Duration::from_secs(after_s);
            let left = "viewpoint ne has left".to_owned();
            lines.take("fusion", left, now).is_some()
        };
        assert!(is_printed(20));
        assert!(!is_printed(21));
        assert!(is_printed(31), "it has left once more");
    }

    /// Symptom: a full disk was not reported if the node had reported free space shortly before, or while the disk of
    /// another
    /// node was full. The last line printed was then false.
    #[test]
    fn the_last_line_printed_of_a_node_is_its_last_line() {
        let [full, room] = ["sets are not kept for now", "sets are kept again"];
        let input = [
            ("ne", full),
            ("ne", room),
            ("ne", full),
            ("ne", full),
            ("sw", full),
            ("ne", room),
            ("sw", room),
        ];
        assert_eq!(
            printed(&mut begun(), &input),
            [
                format!("ne: {full}"),
                format!("ne: {room}"),
                format!("ne: {full}"),
                format!("sw: {full}"),
                format!("ne: {room}"),
                format!("sw: {room}"),
            ]
        );
    }

    #[test]
    fn a_log_is_printed_in_full_and_at_once() {
        let mut lines = NodeLines::new(LineDetail::Log);
        let input = [("ne", "DEBUG started"), ("ne", "DEBUG started")];
        assert_eq!(printed(&mut lines, &input).len(), 2);
        let mut error = FinalError::new(LineDetail::Log);
        let now = Instant::now();
        let line = error.take("error: the disk is gone".to_owned(), now);
        assert_eq!(line.unwrap(), "error: the disk is gone");
        let [last, survived] = error.at_exit();
        assert_eq!(last, ["error: the disk is gone"]);
        assert!(survived.is_empty());
    }

    #[test]
    fn an_error_is_stored_until_its_node_ends_or_survives_it() {
        let now = Instant::now();
        let mut stored = FinalError::new(LineDetail::Notices);
        let mut take = |line: &str| stored.take(line.to_owned(), now);
        assert_eq!(take("the disk is full").unwrap(), "the disk is full");
        assert_eq!(take("error: no more poses are written"), None);
        assert_eq!(take("  no space left"), None, "a line of the error");
        assert_eq!(stored.expires_at(), Some(now + ENDS_WITHIN));
        let error = ["error: no more poses are written", "  no space left"];
        assert_eq!(stored.expire(), error);
        assert_eq!(stored.expires_at(), None);
        assert!(
            stored.take("all is well".to_owned(), now).is_some(),
            "the error is over"
        );
        stored.take(error[0].to_owned(), now);
        let [last, survived] = stored.at_exit();
        assert_eq!(last, [error[0]]);
        assert_eq!(survived, error, "of a node that takes long to end");
    }
}
