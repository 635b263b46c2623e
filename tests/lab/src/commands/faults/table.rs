//! What faults did to a venue, beside the bars.

use std::fmt;

/// With `--quick`, bounds are so many times the bars: machines that check every change do other things, too.
const QUICK_FACTOR: f64 = 3.0;

/// One figure; less is better.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Measure {
    /// What was measured, with its unit.
    pub(super) what: &'static str,
    pub(super) value: f64,
    /// What it may be at most; `None`: it is only told.
    pub(super) bar: Option<f64>,
}

impl Measure {
    pub(super) fn barred(what: &'static str, value: f64, bar: f64) -> Self {
        let bar = Some(bar);
        Self { what, value, bar }
    }

    pub(super) fn told(what: &'static str, value: f64) -> Self {
        let bar = None;
        Self { what, value, bar }
    }

    /// Whether it is no more than `factor` times its bar; what is no number is more than any.
    fn is_within(&self, factor: f64) -> bool {
        self.bar.is_none_or(|bar| self.value <= factor * bar)
    }
}

/// How a drive ended.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Driven {
    Measured(Vec<Measure>),
    /// What it takes cannot be had on this machine.
    NotHad(String),
    /// What should have come did not.
    Failed(String),
}

/// What a fault did.
#[derive(Debug, Clone)]
pub(super) struct FaultRow {
    pub(super) fault: &'static str,
    pub(super) driven: Driven,
}

/// The table of all.
#[derive(Debug)]
pub(super) struct FaultTable {
    /// How many times its bar a figure may be.
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

    /// The drives that did not come to their end.
    pub(super) fn failed(&self) -> Vec<String> {
        let failed = self.rows.iter().filter_map(|row| match &row.driven {
            Driven::Failed(why) => Some(format!("{}: {why}", row.fault)),
            Driven::Measured(_) | Driven::NotHad(_) => None,
        });
        failed.collect()
    }

    /// These, and the figures that are beyond their bounds.
    pub(super) fn broken(&self) -> Vec<String> {
        let mut broken = self.failed();
        for row in &self.rows {
            let Driven::Measured(measures) = &row.driven else {
                continue;
            };
            let beyond = measures.iter().filter(|it| !it.is_within(self.factor));
            broken.extend(beyond.map(|it| {
                let bound = self.factor * it.bar.unwrap_or_default();
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
    "fault          measured                                                value      bar";

impl fmt::Display for FaultTable {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{HEAD}")?;
        self.rows.iter().try_for_each(|row| writeln!(f, "{row}"))
    }
}

impl fmt::Display for FaultRow {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let fault = self.fault;
        let measures = match &self.driven {
            Driven::Measured(measures) => measures,
            Driven::NotHad(why) => return write!(f, "{fault:14} not to be had here: {why}"),
            Driven::Failed(why) => return write!(f, "{fault:14} FAILED: {why}"),
        };
        for (i, it) in measures.iter().enumerate() {
            let (name, end) = if i == 0 { (fault, "") } else { ("", "\n") };
            write!(f, "{end}{name:14} {:50} {:>10.2}", it.what, it.value)?;
            if let Some(bar) = it.bar {
                let verdict = if it.is_within(1.0) {
                    "inside"
                } else {
                    "OUTSIDE"
                };
                write!(f, " {bar:>8.2}  {verdict}")?;
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn broken(is_quick: bool, driven: Driven) -> usize {
        let mut table = FaultTable::new(is_quick);
        table.rows.push(FaultRow {
            fault: "loss",
            driven,
        });
        table.broken().len()
    }

    #[test]
    fn quickly_three_times_the_bar_is_let_pass_and_never_what_must_not_be_at_all() {
        let distance = |mm| Driven::Measured(vec![Measure::barred("mean distance, mm", mm, 25.0)]);
        assert_eq!(
            [broken(false, distance(26.0)), broken(true, distance(26.0))],
            [1, 0]
        );
        assert_eq!(broken(true, distance(76.0)), 1);
        let switches = Driven::Measured(vec![Measure::barred("id switches", 1.0, 0.0)]);
        assert_eq!(broken(true, switches), 1);
    }

    #[test]
    fn what_is_no_number_or_did_not_come_to_its_end_is_broken() {
        let nothing = Driven::Measured(vec![Measure::barred("mean distance, mm", f64::NAN, 25.0)]);
        assert_eq!(broken(true, nothing), 1);
        assert_eq!(broken(true, Driven::Failed("no pose".to_owned())), 1);
        assert_eq!(broken(true, Driven::NotHad("no root".to_owned())), 0);
        assert_eq!(
            broken(true, Driven::Measured(vec![Measure::told("s", 9.0)])),
            0
        );
    }
}
