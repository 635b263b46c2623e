//! What is wrong or doubtful about an input: how severe it is, what was found, and the remedy.

use std::fmt;

/// How much a finding says.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Severity {
    /// Nothing is lost by it.
    Note,
    /// There are venues in which it is so.
    Doubtful,
    /// No run can be right with it.
    Wrong,
}

/// Something about an input that its owner may not know, and what to do.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Advice {
    /// How much it says.
    pub severity: Severity,
    /// What it is.
    pub problem: String,
    /// What to do about it, or where it is not enough.
    pub remedy: String,
}

impl Advice {
    /// Advice that something is doubtful.
    pub fn doubtful(problem: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self {
            severity: Severity::Doubtful,
            problem: problem.into(),
            remedy: remedy.into(),
        }
    }

    /// The same, of `named`: the problem begins with it.
    #[must_use]
    pub fn of(self, named: &str) -> Self {
        Self {
            problem: format!("{named} {}", self.problem),
            ..self
        }
    }
}

/// Reads as `doubtful: camera `ne` is interlaced; to use every field: ...`.
impl fmt::Display for Advice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let word = match self.severity {
            Severity::Note => "note",
            Severity::Doubtful => "doubtful",
            Severity::Wrong => "wrong",
        };
        write!(f, "{word}: {}; {}", self.problem, self.remedy)
    }
}

/// One thing that speaks against a calibration. Each module that looks for such things lists its `Cause`s.
///
/// Reads as ``camera `ne`: it stands 1.2 m under the floor, expected above it; ...``.
#[derive(Debug, Clone, PartialEq)]
pub struct Finding<Cause> {
    /// The camera that it is about; `None` when it is about all of them.
    pub camera: Option<String>,
    /// What kind of mistake it is.
    pub cause: Cause,
    /// How much it says.
    pub severity: Severity,
    /// What was found.
    pub found: String,
    /// What was expected.
    pub expected: String,
    /// What mends it.
    pub remedy: String,
}

impl<Cause> Finding<Cause> {
    /// Whether no run can be right with it.
    pub fn is_wrong(&self) -> bool {
        self.severity == Severity::Wrong
    }

    /// What was found and what was expected, without the remedy.
    pub fn problem(&self) -> String {
        let of = self
            .camera
            .as_ref()
            .map(|camera| format!("camera `{camera}`: "));
        format!(
            "{}{}, expected {}",
            of.unwrap_or_default(),
            self.found,
            self.expected
        )
    }
}

impl<Cause> fmt::Display for Finding<Cause> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}; {}", self.problem(), self.remedy)
    }
}
