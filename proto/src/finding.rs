//! Problems of an input: their severity, what was found, and the remedy.

use std::fmt;

/// How serious a finding is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Severity {
    /// For information only.
    Note,
    /// Suspect, but correct in some venues.
    Doubtful,
    /// No run can be correct with it.
    Wrong,
}

/// A problem of an input that its owner may not know, and the remedy.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Advice {
    /// Its severity.
    pub severity: Severity,
    /// The problem.
    pub problem: String,
    /// The remedy, or where it is not sufficient.
    pub remedy: String,
}

impl Advice {
    /// A suspect input.
    pub fn doubtful(problem: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self {
            severity: Severity::Doubtful,
            problem: problem.into(),
            remedy: remedy.into(),
        }
    }

    /// Prefixes the problem with `named`.
    #[must_use]
    pub fn of(self, named: &str) -> Self {
        Self {
            problem: format!("{named} {}", self.problem),
            ..self
        }
    }
}

/// Format: `doubtful: camera `ne` is interlaced; to use every field: ...`.
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

/// One reason against a calibration. Each module with such checks lists its `Cause`s.
///
/// Format: ``camera `ne`: it stands 1.2 m under the floor, expected above it; ...``.
#[derive(Debug, Clone, PartialEq)]
pub struct Finding<Cause> {
    /// The affected camera; `None` for all cameras.
    pub camera: Option<String>,
    /// The kind of mistake.
    pub cause: Cause,
    /// Its severity.
    pub severity: Severity,
    /// What was found.
    pub found: String,
    /// What was expected.
    pub expected: String,
    /// The remedy.
    pub remedy: String,
}

impl<Cause> Finding<Cause> {
    /// Whether no run can be correct with it.
    pub fn is_wrong(&self) -> bool {
        self.severity == Severity::Wrong
    }

    /// Found and expected values, without the remedy.
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
