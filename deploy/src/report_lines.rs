//! Reports of `farfield check`, `farfield doctor` and `farfield init`: groups of lines with verdict and remedy, as text
//! or JSON.

use std::fmt::Write as _;
use std::process::ExitCode;

use farfield_proto::finding::{Advice, Severity};
use serde::Serialize;

use crate::output;

/// Result of a check.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Verdict {
    /// Valid or healthy.
    Ok,
    /// A run may succeed.
    Warning,
    /// No run can succeed.
    Failed,
}

impl From<Severity> for Verdict {
    fn from(severity: Severity) -> Self {
        match severity {
            Severity::Note => Self::Ok,
            Severity::Doubtful => Self::Warning,
            Severity::Wrong => Self::Failed,
        }
    }
}

/// One result.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub(crate) struct ReportLine {
    #[serde(skip)]
    pub(crate) group: &'static str,
    pub(crate) verdict: Verdict,
    /// What was found, and what was expected.
    pub(crate) text: String,
    /// The command or the field that fixes it; empty if nothing needs a fix.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub(crate) remedy: String,
}

/// All results, in order.
#[derive(Debug, Default)]
pub(crate) struct ReportLines {
    lines: Vec<ReportLine>,
}

#[derive(Serialize)]
struct Document<'a> {
    verdict: Verdict,
    failed: usize,
    warnings: usize,
    groups: Vec<Group<'a>>,
}

#[derive(Serialize)]
struct Group<'a> {
    group: &'a str,
    lines: Vec<&'a ReportLine>,
}

impl ReportLines {
    /// Adds a line that is OK.
    pub(crate) fn ok(&mut self, group: &'static str, text: impl Into<String>) {
        self.push(group, Verdict::Ok, text, "");
    }

    /// Adds a warning.
    pub(crate) fn warn(
        &mut self,
        group: &'static str,
        text: impl Into<String>,
        remedy: impl Into<String>,
    ) {
        self.push(group, Verdict::Warning, text, remedy);
    }

    /// Adds a failure.
    pub(crate) fn fail(
        &mut self,
        group: &'static str,
        text: impl Into<String>,
        remedy: impl Into<String>,
    ) {
        self.push(group, Verdict::Failed, text, remedy);
    }

    /// Adds advice on an input.
    pub(crate) fn advise(&mut self, group: &'static str, advice: Advice) {
        self.push(group, advice.severity.into(), advice.problem, advice.remedy);
    }

    /// Adds one line.
    pub(crate) fn push(
        &mut self,
        group: &'static str,
        verdict: Verdict,
        text: impl Into<String>,
        remedy: impl Into<String>,
    ) {
        self.lines.push(ReportLine {
            group,
            verdict,
            text: text.into(),
            remedy: remedy.into(),
        });
    }

    /// Appends the lines of another report.
    pub(crate) fn append(&mut self, later: Self) {
        self.lines.extend(later.lines);
    }

    /// The lines so far, in order.
    #[cfg(test)]
    pub(crate) fn lines(&self) -> &[ReportLine] {
        &self.lines
    }

    /// Number of lines with this verdict.
    pub(crate) fn count(&self, verdict: Verdict) -> usize {
        self.lines.iter().filter(|it| it.verdict == verdict).count()
    }

    /// The worst verdict; [`Verdict::Ok`] without lines.
    pub(crate) fn verdict(&self) -> Verdict {
        let worst = self.lines.iter().map(|it| it.verdict).max();
        worst.unwrap_or(Verdict::Ok)
    }

    fn groups(&self) -> Vec<Group<'_>> {
        let mut groups: Vec<Group<'_>> = Vec::new();
        for line in &self.lines {
            match groups.iter_mut().find(|it| it.group == line.group) {
                Some(group) => group.lines.push(line),
                None => groups.push(Group {
                    group: line.group,
                    lines: vec![line],
                }),
            }
        }
        groups
    }

    /// Text for people: the groups, each line with its remedy below it, and a summary line.
    pub(crate) fn to_text(&self) -> String {
        let mut text = String::new();
        for group in self.groups() {
            // Writing to a string does not fail.
            writeln!(text, "{}", group.group).ok();
            for line in group.lines {
                let word = match line.verdict {
                    Verdict::Ok => "OK",
                    Verdict::Warning => "warning",
                    Verdict::Failed => "failed",
                };
                writeln!(
                    text,
                    "  {word:<8} {}",
                    line.text.replace('\n', "\n           ")
                )
                .ok();
                if !line.remedy.is_empty() {
                    writeln!(text, "           -> {}", line.remedy).ok();
                }
            }
        }
        text + &self.closing() + "\n"
    }

    /// The summary line.
    fn closing(&self) -> String {
        let plural = |count: usize| if count == 1 { "" } else { "s" };
        let (failed, warnings) = (self.count(Verdict::Failed), self.count(Verdict::Warning));
        match (failed, warnings) {
            (0, 0) => "everything is OK".to_owned(),
            (0, _) => format!("nothing failed, {warnings} warning{}", plural(warnings)),
            (_, 0) => format!("{failed} failed"),
            (_, _) => format!("{failed} failed, {warnings} warning{}", plural(warnings)),
        }
    }

    /// JSON for programs: `{verdict, failed, warnings, groups: [{group, lines: [{verdict, text, remedy}]}]}`.
    pub(crate) fn to_json(&self) -> anyhow::Result<String> {
        let document = Document {
            verdict: self.verdict(),
            failed: self.count(Verdict::Failed),
            warnings: self.count(Verdict::Warning),
            groups: self.groups(),
        };
        Ok(serde_json::to_string_pretty(&document)? + "\n")
    }

    /// Prints the lines. The exit code is 1 if anything failed.
    ///
    /// # Errors
    /// When standard output cannot be written.
    pub(crate) fn print(&self, form: ReportForm) -> anyhow::Result<ExitCode> {
        output::print(&match form {
            ReportForm::Text => self.to_text(),
            ReportForm::Json => self.to_json()?,
        })?;
        Ok(match self.verdict() {
            Verdict::Failed => ExitCode::FAILURE,
            Verdict::Ok | Verdict::Warning => ExitCode::SUCCESS,
        })
    }
}

/// Output format of a report.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum ReportForm {
    /// For people.
    Text,
    /// For programs.
    Json,
}

impl ReportForm {
    /// From the flag `--json`.
    pub(crate) fn from_flag(json: bool) -> Self {
        if json { Self::Json } else { Self::Text }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn report() -> ReportLines {
        let mut report = ReportLines::default();
        report.ok("disk", "12 GB are free");
        report.fail("ports", "7447 is taken", "stop it");
        report.warn("disk", "it is slow", "");
        report
    }

    #[test]
    fn text_has_groups_remedies_and_a_summary() {
        assert_eq!(
            report().to_text(),
            "disk\n  OK       12 GB are free\n  warning  it is slow\nports\n  failed   7447 is taken\n           -> stop it\n1 failed, 1 warning\n"
        );
        assert_eq!(ReportLines::default().to_text(), "everything is OK\n");
    }

    #[test]
    fn appended_lines_come_last() {
        let mut all = report();
        let mut later = ReportLines::default();
        later.ok("nodes", "none runs");
        all.append(later);
        let groups = all.lines().iter().map(|line| line.group);
        assert_eq!(
            groups.collect::<Vec<_>>(),
            ["disk", "ports", "disk", "nodes"]
        );
    }

    #[test]
    fn json_has_the_same_lines() {
        let json: serde_json::Value = serde_json::from_str(&report().to_json().unwrap()).unwrap();
        assert_eq!(json["verdict"], "failed");
        assert_eq!(
            (json["failed"].as_u64(), json["warnings"].as_u64()),
            (Some(1), Some(1))
        );
        assert_eq!(json["groups"][1]["lines"][0]["remedy"], "stop it");
        assert_eq!(json["groups"][0]["lines"][0]["verdict"], "ok");
    }
}
