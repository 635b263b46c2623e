//! A run folder as it is read: `poses.jsonl` line by line, and what of `summary.json` an export needs.
//!
//! Nothing here holds more than one line and what is kept per person: the file is read once to survey it, and once
//! more per person and format.

pub mod line;
pub mod sample;
pub mod summary;
pub mod survey;
pub mod table;

pub use line::PoseLine;
pub use sample::Sample;
pub use summary::RunFacts;
pub use survey::{PersonSurvey, Survey};
pub use table::{PeopleTable, TableRow};
