//! `--overlay` of a replay: the skeletons of single ticks over the pictures, where these are still there.

use std::cell::RefCell;
use std::collections::BTreeSet;
use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};

use anyhow::Context as _;
use farfield_export::run::PoseLine;
use farfield_export::run::line::for_each_line;
use farfield_node::process::{NodeError, say};
use farfield_proto::tick::Tick;
use farfield_proto::toml_file::FileError;
use farfield_proto::venue::Venue;
use farfield_sim::simulated::VenueSources;

use crate::exchange::place::POSES;
use crate::overlay::{TickList, background, draw_poses, overlay, overlay_ticks, with_people};

/// A recording that is solved again.
pub(super) struct Solved {
    /// Of which venue the results are.
    pub(super) venue: Venue,
    /// Where they are.
    pub(super) out: PathBuf,
    /// The first and the last tick.
    pub(super) ticks: [Tick; 2],
}

/// Draws what it came to.
///
/// # Errors
/// [`NodeError::Refused`] for ticks that are none of the replay's, [`NodeError::Failed`] when a picture cannot be written.
pub(super) fn draw(asked: Option<TickList>, solved: &Solved) -> Result<(), NodeError> {
    let Solved { venue, out, ticks } = solved;
    let poses = out.join(POSES);
    let span = span(&poses).map_err(NodeError::Failed)?;
    let Some(with_poses) = span else {
        say(format_args!(
            "`--overlay`: nobody was found, so there is nobody to draw"
        ));
        return Ok(());
    };
    let [first, last] = if asked.is_some() { *ticks } else { with_poses };
    let ticks = overlay_ticks(asked, &(first..last + 1)).map_err(NodeError::Refused)?;
    let sources = VenueSources::default();
    let gone = RefCell::new(BTreeSet::new());
    draw_poses((venue, &ticks, &poses), out, |camera, tick, persons| {
        Ok(
            overlay(&sources, venue, camera, tick, persons).unwrap_or_else(|_| {
                gone.borrow_mut().insert(camera.model.name().to_owned());
                with_people(background(None, &camera.model), &camera.model, persons)
            }),
        )
    })
    .map_err(NodeError::Failed)?;
    let gone: Vec<String> = gone.into_inner().into_iter().collect();
    if !gone.is_empty() {
        say(format_args!(
            "the recordings of {} are not where the venue file says: drawn without pictures (`--venue VENUE.toml` says where they are)",
            gone.join(", ")
        ));
    }
    Ok(())
}

/// The first and the last tick of the poses of a file; `None` without any.
fn span(poses: &Path) -> anyhow::Result<Option<[Tick; 2]>> {
    let reading = || format!("reading {}", poses.display());
    let file = File::open(poses).with_context(reading)?;
    let mut span: Option<[Tick; 2]> = None;
    for_each_line(BufReader::new(file), poses, |text, number| {
        let tick = Tick(PoseLine::parse(text, poses, number)?.tick);
        let [first, last] = span.unwrap_or([tick; 2]);
        span = Some([first.min(tick), last.max(tick)]);
        Ok::<_, FileError>(())
    })?;
    Ok(span)
}
