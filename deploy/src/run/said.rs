//! What nodes say on their standard error: what of it whoever runs them is told, and when.
//!
//! A node that was started by hand says to its terminal what an operator must know. Here the run says it in its place, under
//! the node's name, from its beginning on; what came before is told when it begins, or at its end where it never does. The
//! error with which a node ends is not told as it comes: it is the reason of that end, and who runs the nodes weighs it
//! against the others'.

use std::collections::BTreeMap;
use std::time::Duration;

use tokio::time::Instant;

/// How a node begins to say why it ends, and what else has failed.
const ERROR: &str = "error: ";
/// How a doubt begins about files that the run has read, too, and was in doubt about before any node.
const DOUBTFUL: &str = "doubtful: ";
/// A node that has said why it ends is gone within this time, also on a machine that has much to do.
const ENDS_WITHIN: Duration = Duration::from_secs(2);
/// Lines of an error that are kept.
const MOST_LINES: usize = 200;
/// Lines that wait for the beginning of a run.
const MOST_EARLY: usize = 200;
/// After this time a node that says the same again is told again.
const AGAIN: Duration = Duration::from_secs(10);

/// How much nodes are asked to say.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum SaidDetail {
    /// What an operator must know.
    Notices,
    /// A log of what happens: all of it is told at once.
    Log,
}

impl SaidDetail {
    /// As `RUST_LOG` is set or not, which nodes heed.
    pub(super) fn of_environment() -> Self {
        match std::env::var_os("RUST_LOG") {
            Some(_) => Self::Log,
            None => Self::Notices,
        }
    }
}

/// What a node may have said last: an error, and what came right after it.
#[derive(Debug)]
pub(super) struct LastWords {
    detail: SaidDetail,
    lines: Vec<String>,
    since: Option<Instant>,
    /// The last error after which it lived on.
    outlived: Vec<String>,
}

impl LastWords {
    /// Of a node that has said nothing yet.
    pub(super) fn new(detail: SaidDetail) -> Self {
        Self {
            detail,
            lines: Vec::new(),
            since: None,
            outlived: Vec::new(),
        }
    }

    /// Takes a line that came at `now`; gives it back where it is not kept, or there is to be a log.
    pub(super) fn take(&mut self, line: String, now: Instant) -> Option<String> {
        if self.since.is_none() && !line.starts_with(ERROR) {
            return Some(line);
        }
        self.since.get_or_insert(now);
        let logged = (self.detail == SaidDetail::Log).then(|| line.clone());
        if self.lines.len() < MOST_LINES {
            self.lines.push(line);
        }
        logged
    }

    /// When those that are kept are no last words, if the node lives on until then.
    pub(super) fn outlived_at(&self) -> Option<Instant> {
        self.since.map(|since| since + ENDS_WITHIN)
    }

    /// The node has lived on: what is still to be told of what was kept.
    pub(super) fn outlived(&mut self) -> Vec<String> {
        self.since = None;
        self.outlived = std::mem::take(&mut self.lines);
        match self.detail {
            SaidDetail::Notices => self.outlived.clone(),
            SaidDetail::Log => Vec::new(),
        }
    }

    /// The node has ended: its last words, and the last error after which it had lived on, as one that takes long to end.
    pub(super) fn at_its_end(self) -> [Vec<String>; 2] {
        [self.lines, self.outlived]
    }
}

/// The lines of all nodes, as they come.
#[derive(Debug)]
pub(super) struct SaidLines {
    detail: SaidDetail,
    has_begun: bool,
    /// Those before the beginning, with who said them.
    early: Vec<(String, String)>,
    /// What was told last of every node, and when.
    last: BTreeMap<String, (String, Instant)>,
}

impl SaidLines {
    /// Of a run that is still to begin.
    pub(super) fn new(detail: SaidDetail) -> Self {
        Self {
            detail,
            has_begun: false,
            early: Vec::new(),
            last: BTreeMap::new(),
        }
    }

    /// Takes a line of `node` that came at `now`; what is to be told of it now.
    pub(super) fn take(&mut self, node: &str, line: String, now: Instant) -> Option<String> {
        if self.detail == SaidDetail::Log {
            return Some(named(node, &line));
        }
        let is_nothing = line.trim().is_empty() || line.starts_with(DOUBTFUL);
        if is_nothing || self.is_told(node, &line, now) {
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

    /// The run begins, or never will: what is to be told of what was said before.
    pub(super) fn begin(&mut self) -> Vec<String> {
        self.has_begun = true;
        let early = std::mem::take(&mut self.early);
        let told = early.iter().map(|(node, line)| named(node, line));
        told.collect()
    }

    /// What `node` has said that is still to be told, since the run has not begun.
    pub(super) fn early_of(&self, node: &str) -> Vec<String> {
        let own = self.early.iter().filter(|(of, _)| of == node);
        own.map(|(_, line)| line.clone()).collect()
    }

    /// Whether telling `line` of `node` says nothing new: it is the last that was told of it, or another has said it since, of
    /// the files that all read before the run begins. Later on lines are of what a node alone finds: there is room again on
    /// its disk, not on all.
    fn is_told(&self, node: &str, line: &str, now: Instant) -> bool {
        let last = self.last.get(node);
        if last.is_some_and(|(last, at)| last == line && now.duration_since(*at) < AGAIN) {
            return true;
        }
        let mut since = self.early.iter().rev().take_while(|(of, _)| of != node);
        since.any(|(_, it)| it == line)
    }
}

/// A line under the name of its node, which some say themselves.
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

    /// Everything that is told of these lines, which come at once.
    fn told(lines: &mut SaidLines, said: &[(&str, &str)]) -> Vec<String> {
        let now = Instant::now();
        let taken = said
            .iter()
            .filter_map(|(node, line)| lines.take(node, (*line).to_owned(), now));
        taken.collect()
    }

    fn begun() -> SaidLines {
        let mut lines = SaidLines::new(SaidDetail::Notices);
        assert!(lines.begin().is_empty());
        lines
    }

    #[test]
    fn while_a_run_goes_on_what_its_nodes_say_is_told_with_their_name_once() {
        let said = [
            ("fusion", "edits.jsonl:1: `edit`: found \"rename\""),
            ("fusion", "fusion: turned away 3 times in all"),
            ("ne", "camera `ne-1`: no route to host"),
            ("ne", "ne: refused by fusion: its clock is off"),
            ("ne", ""),
        ];
        assert_eq!(
            told(&mut begun(), &said),
            [
                "fusion: edits.jsonl:1: `edit`: found \"rename\"",
                "fusion: turned away 3 times in all",
                "ne: camera `ne-1`: no route to host",
                "ne: refused by fusion: its clock is off",
            ]
        );
    }

    #[test]
    fn what_comes_before_the_run_is_told_when_it_begins_but_for_doubts_that_the_run_has_told() {
        let mut lines = SaidLines::new(SaidDetail::Notices);
        let said = [
            ("fusion", "doubtful: calibration.toml: camera `a` is high"),
            ("ne", "camera `ne-1`: there is no /dev/video0"),
        ];
        assert!(told(&mut lines, &said).is_empty());
        assert_eq!(
            lines.begin(),
            ["ne: camera `ne-1`: there is no /dev/video0"]
        );
        assert!(lines.early_of("ne").is_empty(), "it was told");
    }

    #[test]
    fn what_a_node_says_that_cannot_begin_is_why_and_lost_to_nobody() {
        let mut lines = SaidLines::new(SaidDetail::Notices);
        let said = [("ne", "no pictures are sent"), ("sw", "nor here")];
        told(&mut lines, &said);
        assert_eq!(lines.early_of("ne"), ["no pictures are sent"]);
        assert_eq!(lines.begin(), ["ne: no pictures are sent", "sw: nor here"]);
    }

    #[test]
    fn what_all_nodes_say_before_the_run_is_told_of_the_first() {
        let mut lines = SaidLines::new(SaidDetail::Notices);
        let key = "certs/authority.key: the key of the venue's authority lies there";
        let [full, room] = ["there is no room", "there is room again"];
        told(&mut lines, &[("fusion", key), ("ne", key), ("sw", key)]);
        told(&mut lines, &[("ne", full), ("sw", full), ("sw", room)]);
        told(&mut lines, &[("sw", full)]);
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
    fn what_a_node_says_again_is_told_again_after_a_while() {
        let (mut lines, start) = (begun(), Instant::now());
        let mut is_told = |after_s: u64| {
            let now = start + Duration::from_secs(after_s);
            let left = "viewpoint ne has left".to_owned();
            lines.take("fusion", left, now).is_some()
        };
        assert!(is_told(20));
        assert!(!is_told(21));
        assert!(is_told(31), "it has left once more");
    }

    /// Symptom: a full disk was not told of whose node had said shortly before that there is room again, or while another's
    /// was full, so that what was told last was false.
    #[test]
    fn what_is_told_last_of_a_node_is_what_it_has_said_last() {
        let [full, room] = ["sets are not kept for now", "sets are kept again"];
        let said = [
            ("ne", full),
            ("ne", room),
            ("ne", full),
            ("ne", full),
            ("sw", full),
            ("ne", room),
            ("sw", room),
        ];
        assert_eq!(
            told(&mut begun(), &said),
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
    fn of_a_log_everything_is_told_at_once() {
        let mut lines = SaidLines::new(SaidDetail::Log);
        let said = [("ne", "DEBUG started"), ("ne", "DEBUG started")];
        assert_eq!(told(&mut lines, &said).len(), 2);
        let mut words = LastWords::new(SaidDetail::Log);
        let now = Instant::now();
        let line = words.take("error: the disk is gone".to_owned(), now);
        assert_eq!(line.unwrap(), "error: the disk is gone");
        let [last, outlived] = words.at_its_end();
        assert_eq!(last, ["error: the disk is gone"]);
        assert!(outlived.is_empty());
    }

    #[test]
    fn an_error_is_kept_for_the_end_of_its_node_and_told_where_it_lives_on() {
        let now = Instant::now();
        let mut words = LastWords::new(SaidDetail::Notices);
        let mut take = |line: &str| words.take(line.to_owned(), now);
        assert_eq!(take("the disk is full").unwrap(), "the disk is full");
        assert_eq!(take("error: no more poses are written"), None);
        assert_eq!(take("  no space left"), None, "a line of the error");
        assert_eq!(words.outlived_at(), Some(now + ENDS_WITHIN));
        let error = ["error: no more poses are written", "  no space left"];
        assert_eq!(words.outlived(), error);
        assert_eq!(words.outlived_at(), None);
        assert!(
            words.take("all is well".to_owned(), now).is_some(),
            "the error is over"
        );
        words.take(error[0].to_owned(), now);
        let [last, outlived] = words.at_its_end();
        assert_eq!(last, [error[0]]);
        assert_eq!(outlived, error, "what a node says that takes long to end");
    }
}
