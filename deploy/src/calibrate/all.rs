//! `farfield calibrate all`: from recordings of boards and of a ball to a calibration in one go. Each stage leaves its files; whoever is
//! interrupted goes on where they end.

use std::collections::BTreeMap;
use std::path::PathBuf;

use anyhow::Context as _;
use clap::Args;
use farfield_node::process::{NodeError, say};

use super::Judged;
use super::ball::{BallLook, lines, look_at_all, with_lenses};
use super::board::{BoardStage, BoardsArgs};
use super::handed_over::FoundArgs;
use super::lenses::{Lens, lens_of};
use super::points::{AskedArgs, solve};
use super::recorded::OwnVenue;
use crate::init::recordings::Recording;

/// What `farfield calibrate all` is told.
#[derive(Debug, Args)]
pub(super) struct AllArgs {
    #[command(flatten)]
    look: BallLook,
    #[command(flatten)]
    boards: BoardsArgs,
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

/// Finds the lenses on boards, looks through the recordings, finds the cameras, writes calibration and sheet.
///
/// # Errors
/// [`NodeError::Refused`] where the input cannot carry a calibration, [`NodeError::Failed`] where the disk is in the way.
pub(super) fn from_recordings(args: &AllArgs) -> Result<Judged, NodeError> {
    args.found.refuse_existing()?;
    let recordings = args.look.recordings().map_err(NodeError::Refused)?;
    let names: Vec<String> = recordings.iter().map(|it| it.name.clone()).collect();
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let mut lenses = args.asked.cameras.lenses().map_err(NodeError::Refused)?;
    // All that is known to be wrong is told before looks of minutes, whatever lens a board will tell.
    let any = |name: &str| Ok(lenses.get(name).cloned().unwrap_or_else(Lens::of_nobody));
    let asked = args.asked.request(&names, any);
    asked.map_err(NodeError::Refused)?;
    let without: Vec<&str> = names
        .iter()
        .copied()
        .filter(|name| !lenses.contains_key(*name))
        .collect();
    let boards = args.boards.stage(&without, args.found.replace)?;
    check_recordings(&recordings, &lenses, &boards).map_err(NodeError::Refused)?;
    lenses.extend(boards.lenses()?);

    let request = args
        .asked
        .request(&names, |name| lens_of(&lenses, name).cloned());
    let request = request.map_err(NodeError::Refused)?;
    let cameras = with_lenses(recordings, &lenses).map_err(NodeError::Refused)?;
    let seen = look_at_all(&args.look, &cameras, &args.seen, args.found.replace)?;
    say(format_args!("{}", lines(&seen).trim_end()));
    let seen = seen.into_iter().filter(|it| it.sightings > 0);
    let files = seen.map(|it| (it.camera, it.file)).collect();
    solve(request, &files, &args.found)
}

/// Refuses recordings that cannot be looked through, and those that are not as large as what the lens is of: before minutes of
/// boards.
fn check_recordings(
    recordings: &[Recording],
    lenses: &BTreeMap<String, Lens>,
    boards: &BoardStage<'_>,
) -> anyhow::Result<()> {
    let filmed = boards.first_sizes()?;
    for recording in recordings {
        let name = recording.name.as_str();
        if let Some((first, size_px)) = filmed.get(name) {
            let [width, height] = size_px;
            let found = frames(recording, &Lens::of_size(*size_px));
            found.with_context(|| {
                format!(
                    "camera `{name}`, of which {} is {width}x{height}",
                    first.display()
                )
            })?;
        } else {
            frames(recording, lens_of(lenses, name)?)?;
        }
    }
    Ok(())
}

/// How many frames can be looked at through `lens`.
fn frames(recording: &Recording, lens: &Lens) -> anyhow::Result<u64> {
    OwnVenue::new(recording, lens)?.frames()
}
