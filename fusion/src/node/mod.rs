//! The async shell of fusion: it owns Zenoh, time, threads and files, and runs the core, in
//! lock-step or live.
//!
//! Load (nothing opened) -> build (everything that can fail is opened) -> run -> drain.

mod config;
mod doorman;
mod given;
mod handout;
mod inbox;
mod link;
mod live;
mod lockstep;
mod output;
mod progress;
mod record;
mod recorder;
mod recording;
mod replay;
mod roll_call;
mod run;
mod start;
mod summary;
mod tally;
mod tap;
mod worker;

pub use farfield_node::log::start_log;
pub use farfield_node::process::{
    EXIT_INTERRUPTED, EXIT_REFUSED, Ending, NodeError, exit_code, say,
};

pub use self::config::{FusionArgs, check_names, load_card};
pub use self::given::{check_given_keypoints, check_given_ticks};
pub use self::output::{Claim, check_folder};
pub use self::progress::{Body, LinkProgress, Progress, Report};
pub use self::record::{RecordArgs, main as record};
pub use self::recording::check_place;
pub use self::replay::{ReplayArgs, main as replay};
pub use self::run::main;
pub use self::tap::{Decided, Tap, TapMessage};
