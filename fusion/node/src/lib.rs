//! The async shell of fusion: it owns Zenoh, time, threads and files, and runs the core in lock-step or live.
//!
//! Order: load (opens only the files of the venue), build (opens all that can fail), run, drain.

mod config;
mod handout;
mod listeners;
mod live;
mod lock_step;
mod output;
mod recorder_node;
mod recording;
mod replay;
mod run;
mod session;
mod status;
mod subjects;
mod venue_checks;
mod worker;

pub use self::config::{FusionArgs, check_calibration, check_names, load_card};
pub use self::listeners::{
    Listeners, NoListeners, OpenListeners, Opening, ReplayedRecording, RunAtItsStart,
};
pub use self::output::claim::{FolderClaim, check_folder, is_written_to, was_killed};
pub use self::output::exporter::layout as pose_layout;
pub use self::output::progress::{Body, LinkProgress, Progress, Report};
pub use self::recorder_node::{RecordArgs, main as record};
pub use self::recording::{
    OWN_RECORDING, RecordingOnDemand, RecordingsOnDemand, check_place, is_for_many, without_end,
};
pub use self::replay::{
    RecordedRun, ReplayArgs, main as replay, of_values, open_recording, recorded_venue, with_values,
};
pub use self::run::{main, main_with};
pub use self::session::wiretap::{CopiedMessage, CopiedStep, Wiretap};
pub use self::subjects::{KnownSubjects, load_subjects};
pub use self::venue_checks::{
    check_detector, check_given_keypoints, check_given_ticks, check_live_or_recorded,
    check_viewpoints,
};
