//! What `farfield run` is told.

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
    /// Run live: nobody waits; without it, in lock-step.
    ///
    /// Cameras give their pictures as they come, recordings as fast as they were made. In lock-step every node waits for
    /// the others, and two runs give the same poses.
    #[arg(long)]
    pub(crate) live: bool,
    /// Work on these ticks only, B not among them.
    ///
    /// All recordings must hold them.
    #[arg(long, value_name = "A..B", value_parser = parse_range, allow_hyphen_values = true)]
    pub(crate) ticks: Option<Range<Tick>>,
    /// Folder for the results.
    ///
    /// It must be empty or not there. Default: `farfield-out/VENUE-N`.
    #[arg(long, value_name = "DIR")]
    pub(crate) out: Option<PathBuf>,
    /// Draw skeletons over the pictures of these ticks.
    ///
    /// Numbers with commas between; without any, of the middle tick. One picture per camera. What nothing determined is
    /// grey.
    #[arg(long, value_name = "TICKS", num_args = 0..=1, require_equals = true)]
    #[expect(
        clippy::option_option,
        reason = "absent, without and with ticks: how clap says it"
    )]
    pub(crate) overlay: Option<Option<TickList>>,
    /// Record, for `farfield replay`.
    ///
    /// Everything that fusion hears and says, and what it used for each tick, as an MCAP file, or a new one in a folder, which is
    /// made where a slash ends its path. Default: `recording.mcap` in the folder of the results.
    #[arg(long, value_name = "FILE", num_args = 0..=1, require_equals = true)]
    #[expect(
        clippy::option_option,
        reason = "absent, without and with a file: how clap says it"
    )]
    pub(crate) record: Option<Option<PathBuf>>,
    #[command(flatten)]
    pub(crate) listeners: ListenerArgs,
    /// Exit code 1 when cameras disagree
    #[arg(long, hide_short_help = true)]
    pub(crate) strict: bool,
    /// Use another value of a parameter.
    ///
    /// See `farfield parameters`; for example `smoothing.cutoff_hz=3`. The venue file that comes of it lies among the
    /// results.
    #[arg(long, value_name = "TABLE.FIELD=VALUE", hide_short_help = true)]
    pub(crate) set: Vec<String>,
    /// Print the summary, or what went wrong, as JSON.
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
    fn an_overlay_may_name_its_ticks() {
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
    fn a_tick_that_is_no_number_is_refused_by_name() {
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
