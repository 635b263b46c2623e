//! `farfield calibrate all`: from recordings of a ball to a calibration in one go. Each stage leaves its files; whoever is
//! interrupted goes on where they end.

use std::path::PathBuf;

use clap::Args;
use farfield_node::process::{NodeError, say};

use super::Judged;
use super::ball::{BallLook, LookingCamera, cameras, lines, look_at_all};
use super::handed_over::FoundArgs;
use super::points::{AskedArgs, solve};

/// What `farfield calibrate all` is told.
#[derive(Debug, Args)]
pub(super) struct AllArgs {
    #[command(flatten)]
    look: BallLook,
    #[command(flatten)]
    asked: AskedArgs,
    /// Folder for NAME.txt: where each camera saw it.
    ///
    /// Each is written when its camera is looked through. One that is there already, of the same recording, lens and options, is
    /// taken as it is: after an interruption only what is missing is looked for.
    #[arg(
        long,
        value_name = "DIR",
        default_value = "seen",
        hide_short_help = true
    )]
    seen: PathBuf,
    #[command(flatten)]
    pub(super) found: FoundArgs,
}

/// Looks through the recordings, finds the cameras, writes calibration and sheet.
///
/// # Errors
/// [`NodeError::Refused`] where the input cannot carry a calibration, [`NodeError::Failed`] where the disk is in the way.
pub(super) fn from_recordings(args: &AllArgs) -> Result<Judged, NodeError> {
    // Before a look of minutes.
    args.found.refuse_existing()?;
    let lenses = args.asked.cameras.needed_lenses();
    let lenses = lenses.map_err(NodeError::Refused)?;
    let cameras = cameras(&args.look, &lenses).map_err(NodeError::Refused)?;
    let names: Vec<&str> = cameras.iter().map(LookingCamera::name).collect();
    let request = args.asked.request(&names, &lenses);
    let request = request.map_err(NodeError::Refused)?;
    let seen = look_at_all(&args.look, &cameras, &args.seen, args.found.replace)?;
    say(format_args!("{}", lines(&seen).trim_end()));
    let seen = seen.into_iter().filter(|it| it.sightings > 0);
    let files = seen.map(|it| (it.camera, it.file)).collect();
    solve(request, &files, &args.found)
}
