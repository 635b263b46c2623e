//! What a run leaves behind and tells meanwhile: the folder, the files of poses, the summary, the progress.

pub(super) mod claim;
pub(super) mod exporter;
pub(super) mod progress;
pub(super) mod summary;
pub(super) mod tally;
