//! Messages that nodes write on standard error: which of them the run prints, and when.
//!
//! The run prints the messages of its nodes under their names. Those from before the run begins are printed when it
//! begins, or at its end if it never does. The error with which a node ends is not printed when it arrives: it is the
//! reason of that end, which the run compares with those of the other nodes.
use std::collections::BTreeMap;
use std::time::Duration;

use farfield_node::process::{LineKind, NodeLine};
use tokio::time::Instant;

/// Limit for messages that wait for the beginning of a run.
const MOST_EARLY: usize = 200;
/// Time after which a repeated message of a node is printed again.
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

/// The message in a line of a node's standard error. What is not written as JSON, such as a log or a panic, is a notice.
pub(super) fn read(line: String) -> NodeLine {
    serde_json::from_str(&line).unwrap_or(NodeLine {
        kind: LineKind::Notice,
        text: line,
    })
}

/// A message with the name of its node.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Named {
    node: String,
    line: NodeLine,
}

/// Filters the messages of all nodes.
#[derive(Debug)]
pub(super) struct NodeLines {
    detail: LineDetail,
    has_begun: bool,
    /// Messages from before the beginning.
    early: Vec<Named>,
    /// The last message printed of every node, and when.
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

    /// Takes a message of `node` that came at `now`. Returns its kind and the text to print now, if any.
    pub(super) fn take(
        &mut self,
        node: &str,
        line: NodeLine,
        now: Instant,
    ) -> Option<(LineKind, String)> {
        let node = node.to_owned();
        if self.detail == LineDetail::Log {
            return Some(Named { node, line }.shown());
        }
        // The run has read the same files and has printed these findings itself.
        let is_skipped = line.text.trim().is_empty() || line.kind == LineKind::FileFinding;
        if is_skipped || self.is_repeated(&node, &line.text, now) {
            return None;
        }
        self.last.insert(node.clone(), (line.text.clone(), now));
        let named = Named { node, line };
        if self.has_begun {
            return Some(named.shown());
        }
        if self.early.len() < MOST_EARLY {
            self.early.push(named);
        }
        None
    }

    /// The run begins, or never will. Returns the earlier messages that are to be printed.
    pub(super) fn begin(&mut self) -> Vec<(LineKind, String)> {
        self.has_begun = true;
        let early = std::mem::take(&mut self.early);
        early.iter().map(Named::shown).collect()
    }

    /// Messages of `node` that are not printed yet, since the run has not begun.
    pub(super) fn early_lines(&self, node: &str) -> Vec<String> {
        let own = self.early.iter().filter(|early| early.node == node);
        own.map(|early| early.line.to_string()).collect()
    }

    /// Whether `text` is a repetition: it was the last message printed of `node`, or, before the run begins, another
    /// node has written it since: all nodes read the same files then. Later messages belong to one node, such as free
    /// space on its disk.
    fn is_repeated(&self, node: &str, text: &str, now: Instant) -> bool {
        let last = self.last.get(node);
        if last.is_some_and(|(last, at)| last == text && now.duration_since(*at) < AGAIN) {
            return true;
        }
        let mut since = (self.early.iter().rev()).take_while(|early| early.node != node);
        since.any(|early| early.line.text == text)
    }
}

impl Named {
    /// Its kind, and its text with the name of its node, which some nodes add themselves.
    fn shown(&self) -> (LineKind, String) {
        let Self { node, line } = self;
        let rest = line.text.strip_prefix(node.as_str());
        let shown = if rest.is_some_and(|rest| rest.starts_with(": ")) {
            line.to_string()
        } else {
            format!("{node}: {line}")
        };
        (line.kind, shown)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn notice(text: &str) -> NodeLine {
        read(text.to_owned())
    }

    fn texts(lines: Vec<(LineKind, String)>) -> Vec<String> {
        lines.into_iter().map(|(_, text)| text).collect()
    }

    /// Everything printed of these lines, which come at once.
    fn printed(lines: &mut NodeLines, input: &[(&str, &str)]) -> Vec<String> {
        let now = Instant::now();
        let taken = input
            .iter()
            .filter_map(|(node, line)| lines.take(node, notice(line), now));
        texts(taken.collect())
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
    fn early_lines_are_printed_when_the_run_begins_without_findings_on_files() {
        let mut lines = NodeLines::new(LineDetail::Notices);
        let input = [
            (
                "fusion",
                r#"{"kind":"file_finding","text":"calibration.toml: camera `a` is high"}"#,
            ),
            ("ne", "camera `ne-1`: there is no /dev/video0"),
        ];
        assert!(printed(&mut lines, &input).is_empty());
        assert_eq!(
            texts(lines.begin()),
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
        assert_eq!(
            texts(lines.begin()),
            ["ne: no pictures are sent", "sw: nor here"]
        );
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
            texts(lines.begin()),
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
            let left = notice("viewpoint ne has left");
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
    }

    #[test]
    fn the_kind_of_a_message_is_printed_with_it() {
        let line = NodeLine {
            kind: LineKind::Error,
            text: "no room".to_owned(),
        };
        let json = serde_json::to_string(&line).unwrap();
        assert_eq!(read(json.clone()), line);
        assert_eq!(
            printed(&mut begun(), &[("ne", &json)]),
            ["ne: error: no room"]
        );
    }
}
