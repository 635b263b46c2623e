//! `farfield calibrate all`: computes a calibration from recordings of boards and of a ball. Each stage writes its
//! files, so an interrupted command continues after the last finished stage.

use std::collections::BTreeMap;
use std::path::PathBuf;

use anyhow::Context as _;
use clap::Args;
use farfield_node::process::{NodeError, say};

use super::Judged;
use super::ball::{BallScan, lines, scan_all, with_lenses};
use super::board::{BoardStage, BoardsArgs};
use super::lenses::{Lens, lens_of};
use super::points::{SolveArgs, solve};
use super::recorded::OwnVenue;
use super::results::OutputArgs;
use crate::init::recordings::Recording;

/// Arguments of `farfield calibrate all`.
#[derive(Debug, Args)]
pub(super) struct AllArgs {
    #[command(flatten)]
    scan: BallScan,
    #[command(flatten)]
    boards: BoardsArgs,
    #[command(flatten)]
    solve: SolveArgs,
    /// Folder for NAME.txt: positions of the ball, by camera.
    ///
    /// Each is written after the scan of its camera. An existing one of the same recording, lens and options is reused:
    /// after an interruption only missing ones are scanned.
    #[arg(
        long,
        value_name = "DIR",
        default_value = "seen",
        hide_short_help = true
    )]
    seen: PathBuf,
    #[command(flatten)]
    pub(super) output: OutputArgs,
}

/// Measures the lenses on boards, scans the recordings, solves the cameras, writes calibration and sheet.
///
/// # Errors
/// [`NodeError::Refused`] where the input does not determine a calibration, [`NodeError::Failed`] for errors of the
/// disk.
pub(super) fn from_recordings(args: &AllArgs) -> Result<Judged, NodeError> {
    args.output.refuse_existing()?;
    let recordings = args.scan.recordings().map_err(NodeError::Refused)?;
    let names: Vec<String> = recordings.iter().map(|it| it.name.clone()).collect();
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let mut lenses = args.solve.cameras.lenses().map_err(NodeError::Refused)?;
    // Known errors are reported before scans of minutes, whatever lens a board will give.
    let any = |name: &str| Ok(lenses.get(name).cloned().unwrap_or_else(Lens::placeholder));
    let request = args.solve.request(&names, any);
    request.map_err(NodeError::Refused)?;
    let without: Vec<&str> = names
        .iter()
        .copied()
        .filter(|name| !lenses.contains_key(*name))
        .collect();
    let boards = args.boards.stage(&without, args.output.replace)?;
    check_recordings(&recordings, &lenses, &boards).map_err(NodeError::Refused)?;
    lenses.extend(boards.lenses()?);

    let request = args
        .solve
        .request(&names, |name| lens_of(&lenses, name).cloned());
    let request = request.map_err(NodeError::Refused)?;
    let cameras = with_lenses(recordings, &lenses).map_err(NodeError::Refused)?;
    let seen = scan_all(&args.scan, &cameras, &args.seen, args.output.replace)?;
    say(format_args!("{}", lines(&seen).trim_end()));
    let seen = seen.into_iter().filter(|it| it.sightings > 0);
    let files = seen.map(|it| (it.camera, it.file)).collect();
    solve(request, &files, &args.output)
}

/// Refuses recordings that cannot be scanned, and those whose size differs from that of their lens, before minutes of
/// work on boards.
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
            let found = frames(recording, &Lens::with_size(*size_px));
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

/// Number of frames that can be scanned through `lens`.
fn frames(recording: &Recording, lens: &Lens) -> anyhow::Result<u64> {
    OwnVenue::new(recording, lens)?.frames()
}
