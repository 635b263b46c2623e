//! Poses of a run in the formats of other programs.
//!
//! [`export`](export()) is the whole of it: a run folder in, files out, whole or not at all. What it is made of:
//!
//! | module | what |
//! | --- | --- |
//! | [`run`] | a run folder, read line by line |
//! | [`edits`] | names and edits of its people: an undoable list beside it |
//! | [`skeleton`] | the one export skeleton, which every animated format shares |
//! | [`axes`] | the units and axes that programs expect |
//! | [`timeline`] | other rates; gaps kept or filled |
//! | [`formats`] | a writer per format, of bytes |
//!
//! Equal runs and options give equal bytes.

pub mod axes;
mod called;
mod choice;
pub mod edits;
mod edits_file;
mod error;
mod export;
mod files;
pub mod formats;
mod options;
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
