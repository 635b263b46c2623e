//! The async shell of fusion: it owns Zenoh, time, threads and files, and runs the core in lock-step.
//!
//! Load (nothing opened) -> build (everything that can fail is opened) -> run -> drain.

mod clock;
mod config;
mod given;
mod link;
mod lockstep;
mod output;
mod process;
mod progress;
mod recorder;
mod roll_call;
mod run;
mod start;
mod summary;
mod tally;
mod tap;
mod worker;

pub use self::config::{FusionArgs, check_names, load_card};
pub use self::given::{check_given_keypoints, check_given_ticks};
pub use self::output::{Claim, check_folder};
pub use self::process::{
    EXIT_INTERRUPTED, EXIT_REFUSED, Ending, NodeError, exit_code, say, start_log,
};
pub use self::progress::{Body, Progress, Report};
pub use self::run::main;
pub use self::tap::{Decided, Tap, TapMessage};
