//! Reads a run folder: `poses.jsonl` line by line, and the part of `summary.json` that an export
//! needs.
//!
//! Memory holds at most one line and the data per person: the file is read once for the survey, and
//! once per person and format.

use std::path::Path;

use farfield_proto::toml_file::FileError;
use serde::Deserialize;

pub mod line;
pub mod sample;
pub mod survey;

pub use line::PoseLine;
pub use sample::Sample;
pub use survey::{PeopleTable, PersonSurvey, Survey, TableRow};

/// Valid rates of a venue, Hz.
const RATES_HZ: std::ops::RangeInclusive<f64> = 0.01..=100_000.0;

/// The clock of a run.
#[derive(Debug, Clone, PartialEq, Deserialize)]
pub struct RunFacts {
    /// Name of the venue.
    pub venue: String,
    /// Ticks per second.
    pub rate_hz: f64,
    /// The ticks of the run.
    pub ticks: RunTicks,
}

/// First tick of a run and the one after its last.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
pub struct RunTicks {
    /// First tick: time 0 of all files.
    pub first: i64,
    /// The tick after the last.
    pub end: i64,
}

impl RunFacts {
    /// Parses the summary `text`, the content of `path`. Other fields are ignored, since newer runs
    /// write more.
    ///
    /// # Errors
    /// What was found and what was expected.
    pub fn parse(text: &str, path: &Path) -> Result<Self, FileError> {
        let facts: Self =
            serde_json::from_str(text).map_err(|e| FileError::new(path, e.to_string()))?;
        if !RATES_HZ.contains(&facts.rate_hz) {
            let problem = format!(
                "found {}, expected a number from 0.01 to 100000",
                facts.rate_hz
            );
            return Err(FileError::new(path, problem).at_field("rate_hz"));
        }
        let RunTicks { first, end } = facts.ticks;
        // An hour at a million ticks per second, and far from the limits of i64.
        if end < first || first.unsigned_abs().max(end.unsigned_abs()) > 1 << 42 {
            let problem = format!("found {first} to {end}, expected an end after the first");
            return Err(FileError::new(path, problem).at_field("ticks"));
        }
        Ok(facts)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_clock_is_parsed_and_checked() {
        let text = |rate: &str| {
            format!(
                r#"{{"venue":"hall","rate_hz":{rate},"ticks":{{"first":3,"end":9,"done":6}},"links":{{}}}}"#
            )
        };
        let read = |rate: &str| RunFacts::parse(&text(rate), Path::new("summary.json"));
        assert_eq!(read("60.0").unwrap().ticks, RunTicks { first: 3, end: 9 });
        let refused = read("0").unwrap_err().to_string();
        assert_eq!(
            refused,
            "summary.json: `rate_hz`: found 0, expected a number from 0.01 to 100000"
        );
    }
}
