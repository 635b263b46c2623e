//! Command line of `farfield run`.

use std::ops::Range;
use std::path::PathBuf;

use clap::Args;
use farfield_proto::tick::{Tick, parse_range};

use crate::listeners::ListenerArgs;
use crate::overlay::TickList;

/// Arguments of `farfield run`.
#[derive(Debug, Args)]
pub(crate) struct RunArgs {
    /// The venue file.
    pub(crate) venue: PathBuf,
    /// Run live, by the clock; the default is lock-step.
    ///
    /// Cameras send images as they capture them; recordings play at their own rate. In lock-step every node waits for
    /// the others, and two runs give the same poses.
    #[arg(long)]
    pub(crate) live: bool,
    /// Process only these ticks; B is excluded.
    ///
    /// Every recording must contain them.
    #[arg(long, value_name = "A..B", value_parser = parse_range, allow_hyphen_values = true)]
    pub(crate) ticks: Option<Range<Tick>>,
    /// Folder for the results.
    ///
    /// It must be empty or not exist. Default: `farfield-out/VENUE-N`.
    #[arg(long, value_name = "DIR")]
    pub(crate) out: Option<PathBuf>,
    /// Draw skeletons over the images of these ticks.
    ///
    /// Numbers separated by commas; without a value, the middle tick. One image per camera. Joints that no image
    /// determined are grey.
    #[arg(long, value_name = "TICKS", num_args = 0..=1, require_equals = true)]
    #[expect(
        clippy::option_option,
        reason = "absent, without and with ticks: clap's form"
    )]
    pub(crate) overlay: Option<Option<TickList>>,
    /// Record the run for `farfield replay`.
    ///
    /// An MCAP file with everything that fusion receives and sends, and what it used for each tick. A path that ends
    /// with a slash is a folder: it is created if needed and gets a new file. Default: `recording.mcap` in the results
    /// folder.
    #[arg(long, value_name = "FILE", num_args = 0..=1, require_equals = true)]
    #[expect(
        clippy::option_option,
        reason = "absent, without and with a file: clap's form"
    )]
    pub(crate) record: Option<Option<PathBuf>>,
    #[command(flatten)]
    pub(crate) listeners: ListenerArgs,
    /// Exit with code 1 if the cameras disagree
    #[arg(long, hide_short_help = true)]
    pub(crate) strict: bool,
    /// Set a parameter to another value.
    ///
    /// For example `smoothing.cutoff_hz=3`; `farfield parameters` lists them. The changed venue file is saved with the
    /// results.
    #[arg(long, value_name = "TABLE.FIELD=VALUE", hide_short_help = true)]
    pub(crate) set: Vec<String>,
    /// Print the summary or the error as JSON.
    #[arg(long, hide_short_help = true)]
    pub(crate) json: bool,
}

#[cfg(test)]
mod tests {
    use clap::Parser as _;

    use super::*;

    #[derive(Debug, clap::Parser)]
    struct RunLine {
        #[command(flatten)]
        args: RunArgs,
    }

    fn parsed(args: &[&str]) -> Result<RunArgs, clap::Error> {
        RunLine::try_parse_from([&["run", "venue.toml"], args].concat()).map(|line| line.args)
    }

    fn run_args(args: &[&str]) -> RunArgs {
        parsed(args).unwrap()
    }

    #[test]
    fn overlay_takes_an_optional_list_of_ticks() {
        let ticks = |ticks: &[i64]| Some(Some(TickList(ticks.iter().copied().map(Tick).collect())));
        assert_eq!(run_args(&[]).overlay, None);
        assert_eq!(run_args(&["--overlay"]).overlay, Some(None));
        assert_eq!(run_args(&["--overlay", "--json"]).overlay, Some(None));
        assert_eq!(run_args(&["--overlay=42", "--json"]).overlay, ticks(&[42]));
        assert_eq!(run_args(&["--overlay=-3"]).overlay, ticks(&[-3]));
        assert_eq!(
            run_args(&["--overlay=-3,42, 50"]).overlay,
            ticks(&[-3, 42, 50])
        );
    }

    #[test]
    fn an_invalid_overlay_tick_is_named_in_the_error() {
        let error = parsed(&["--overlay=3,x"]).unwrap_err();
        assert_eq!(error.exit_code(), 2);
        assert!(error.to_string().contains("`x`"), "{error}");
    }

    #[test]
    fn ticks_are_a_half_open_range() {
        assert_eq!(
            run_args(&["--ticks", "300..900"]).ticks,
            Some(Tick(300)..Tick(900))
        );
        let error = parsed(&["--ticks", "9..3"]).unwrap_err();
        assert_eq!(error.exit_code(), 2);
        assert!(error.to_string().contains("9..3"), "{error}");
    }
}
