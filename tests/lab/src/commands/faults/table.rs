//! The effects of faults with their limits.

use std::fmt;

/// Factor on the limits with `--quick`, since machines that check every change are loaded.
const QUICK_FACTOR: f64 = 3.0;

/// One value; less is better.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Measure {
    /// What was measured, with its unit.
    pub(super) what: &'static str,
    pub(super) value: f64,
    /// Upper limit; `None`: the value is only reported.
    pub(super) limit: Option<f64>,
}

impl Measure {
    pub(super) fn limited(what: &'static str, value: f64, limit: f64) -> Self {
        let limit = Some(limit);
        Self { what, value, limit }
    }

    pub(super) fn reported(what: &'static str, value: f64) -> Self {
        let limit = None;
        Self { what, value, limit }
    }

    /// Whether the value is within `factor` times its limit; NaN is not.
    fn is_within(&self, factor: f64) -> bool {
        self.limit.is_none_or(|limit| self.value <= factor * limit)
    }
}

/// Result of a fault's run.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum FaultOutcome {
    Measured(Vec<Measure>),
    /// This machine lacks something that the fault needs.
    Unavailable(String),
    /// The run failed.
    Failed(String),
}

/// The effect of one fault.
#[derive(Debug, Clone)]
pub(super) struct FaultRow {
    pub(super) fault: &'static str,
    pub(super) outcome: FaultOutcome,
}

/// The table of all faults.
#[derive(Debug)]
pub(super) struct FaultTable {
    /// Accepted factor on the limits.
    factor: f64,
    pub(super) rows: Vec<FaultRow>,
}

impl FaultTable {
    pub(super) fn new(is_quick: bool) -> Self {
        Self {
            factor: if is_quick { QUICK_FACTOR } else { 1.0 },
            rows: Vec::new(),
        }
    }

    /// The runs that failed.
    pub(super) fn failed(&self) -> Vec<String> {
        let failed = self.rows.iter().filter_map(|row| match &row.outcome {
            FaultOutcome::Failed(why) => Some(format!("{}: {why}", row.fault)),
            FaultOutcome::Measured(_) | FaultOutcome::Unavailable(_) => None,
        });
        failed.collect()
    }

    /// The runs that failed, and the values beyond their limits.
    pub(super) fn broken(&self) -> Vec<String> {
        let mut broken = self.failed();
        for row in &self.rows {
            let FaultOutcome::Measured(measures) = &row.outcome else {
                continue;
            };
            let beyond = measures.iter().filter(|it| !it.is_within(self.factor));
            broken.extend(beyond.map(|it| {
                let bound = self.factor * it.limit.unwrap_or_default();
                format!(
                    "{}: {}: {:.1}, at most {bound:.1}",
                    row.fault, it.what, it.value
                )
            }));
        }
        broken
    }
}

const HEAD: &str =
    "fault          measured                                                value    limit";

impl fmt::Display for FaultTable {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{HEAD}")?;
        self.rows.iter().try_for_each(|row| writeln!(f, "{row}"))
    }
}

impl fmt::Display for FaultRow {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let fault = self.fault;
        let measures = match &self.outcome {
            FaultOutcome::Measured(measures) => measures,
            FaultOutcome::Unavailable(why) => {
                return write!(f, "{fault:14} not available here: {why}");
            }
            FaultOutcome::Failed(why) => return write!(f, "{fault:14} FAILED: {why}"),
        };
        for (i, it) in measures.iter().enumerate() {
            let (name, end) = if i == 0 { (fault, "") } else { ("", "\n") };
            write!(f, "{end}{name:14} {:50} {:>10.2}", it.what, it.value)?;
            if let Some(limit) = it.limit {
                let verdict = if it.is_within(1.0) {
                    "inside"
                } else {
                    "OUTSIDE"
                };
                write!(f, " {limit:>8.2}  {verdict}")?;
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn broken(is_quick: bool, outcome: FaultOutcome) -> usize {
        let mut table = FaultTable::new(is_quick);
        table.rows.push(FaultRow {
            fault: "loss",
            outcome,
        });
        table.broken().len()
    }

    #[test]
    fn quick_runs_allow_three_times_a_limit_but_not_of_zero() {
        let distance =
            |mm| FaultOutcome::Measured(vec![Measure::limited("mean distance, mm", mm, 25.0)]);
        assert_eq!(
            [broken(false, distance(26.0)), broken(true, distance(26.0))],
            [1, 0]
        );
        assert_eq!(broken(true, distance(76.0)), 1);
        let switches = FaultOutcome::Measured(vec![Measure::limited("id switches", 1.0, 0.0)]);
        assert_eq!(broken(true, switches), 1);
    }

    #[test]
    fn nan_and_failed_runs_are_broken() {
        let nothing =
            FaultOutcome::Measured(vec![Measure::limited("mean distance, mm", f64::NAN, 25.0)]);
        assert_eq!(broken(true, nothing), 1);
        assert_eq!(broken(true, FaultOutcome::Failed("no pose".to_owned())), 1);
        assert_eq!(
            broken(true, FaultOutcome::Unavailable("no root".to_owned())),
            0
        );
        assert_eq!(
            broken(
                true,
                FaultOutcome::Measured(vec![Measure::reported("s", 9.0)])
            ),
            0
        );
    }
}
