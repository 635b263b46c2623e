//! What a run leaves behind and tells meanwhile: the folder, the files of poses, the summary, the progress.

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
