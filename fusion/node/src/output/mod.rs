//! The output of a run: its folder, pose files, summary and progress reports.

pub(super) mod claim;
pub(super) mod disk_watch;
pub(super) mod export_thread;
pub(super) mod exporter;
pub(super) mod made_folders;
mod pose_queue;
pub(super) mod progress;
pub(super) mod summary;
pub(super) mod summary_file;
pub(super) mod tally;
