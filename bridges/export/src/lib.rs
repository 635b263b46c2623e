//! Writes the poses of a run in the formats of other programs.
//!
//! [`export`](export()) is the entry point: a run folder in, files out, completely or not at all.
//!
//! | module | content |
//! | --- | --- |
//! | [`run`] | reads a run folder, line by line |
//! | [`edits`] | names and edits of its people: an undoable list |
//! | [`skeleton`] | the export skeleton of all animated formats |
//! | [`axes`] | units and axes of programs |
//! | [`timeline`] | resampling; gaps kept or filled |
//! | [`formats`] | one writer per format |
//!
//! Equal runs and options give equal bytes.

pub mod axes;
pub mod edits;
mod edits_file;
mod error;
mod export;
mod files;
pub mod formats;
mod options;
mod person_names;
mod profile;
pub mod run;
pub mod skeleton;
mod subject;
mod target_names;
pub mod timeline;
mod together;

pub use edits_file::EditsFile;
pub use error::{ExportError, OptionField};
pub use export::{Progress, Written, export, profile_of};
pub use options::{Existing, ExportRequest, Format, Lengths, Options};
pub use profile::SubjectProfile;
pub use subject::Subject;

#[cfg(test)]
mod export_tests;
#[cfg(test)]
pub(crate) mod fixture;
