//! Replays: names and edits of the recording move to the folder of the new run, and `--overlay` draws the results.
//!
//! If ids mean the same people, edits are copied before the first tick. Otherwise those that can be matched by the
//! positions of people are added after the last tick.

use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

use anyhow::{Context as _, anyhow};
use farfield_export::EditsFile;
use farfield_export::edits::carried::Place;
use farfield_export::edits::{Carried, Counterparts, EditList};
use farfield_export::run::PoseLine;
use farfield_export::run::line::for_each_line;
use farfield_fusion::body::skeleton::Joint;
use farfield_fusion::export::unfinished::write_whole;
use farfield_fusion_node::{OpenListeners, Opening, ReplayedRecording, RunAtItsStart};
use farfield_node::process::{NodeError, say};
use farfield_proto::tick::Tick;
use farfield_proto::toml_file::FileError;
use farfield_proto::transport::Identity;
use farfield_proto::venue::Venue;
use farfield_sim::simulated::VenueSources;
use nalgebra::Vector3;

use super::ListenerArgs;
use super::page::PAGE;
use super::page_access::check_own_machine;
use crate::exchange::people::now;
use crate::exchange::place::POSES;
use crate::exchange::recorded::RecordedRun;
use crate::overlay::{TickList, background, draw_poses, overlay, overlay_ticks, with_people};

/// Ids and positions per tick.
type Bodies = BTreeMap<i64, Vec<Place>>;

/// The target of edits that are transferred after the last tick.
type Later = Arc<OnceLock<PathBuf>>;

/// Outputs of a replay; they copy the edits of the recording first.
pub(super) struct ReplayListeners {
    pub(super) listeners: ListenerArgs,
    pub(super) later: Later,
    /// The replay, once it has begun.
    pub(super) begun: Arc<OnceLock<Solved>>,
    /// The ticks to draw at the end, if listed.
    pub(super) drawn: Option<TickList>,
}

impl OpenListeners for ReplayListeners {
    fn check(&self, _identity: Option<&Identity>) -> Result<(), NodeError> {
        // A replay has no keys.
        match self.listeners.page.flatten() {
            Some(address) => {
                check_own_machine(PAGE, address, "a replay").map_err(NodeError::Refused)
            }
            None => Ok(()),
        }
    }

    fn open(self: Box<Self>, run: RunAtItsStart<'_>) -> Opening<'_> {
        Box::pin(async move {
            if let Some(replayed) = run.replays {
                let [first, last] = replayed.ticks;
                if let Some(list) = self.drawn {
                    overlay_ticks(Some(list), &(first..last + 1)).map_err(NodeError::Refused)?;
                }
                self.begun.get_or_init(|| Solved {
                    venue: run.venue.clone(),
                    out: run.out.to_owned(),
                    ticks: replayed.ticks,
                });
                if !take_over(&replayed, run.out).map_err(NodeError::Refused)? {
                    self.later.get_or_init(|| run.out.to_owned());
                }
            }
            Box::new(self.listeners).open(run).await
        })
    }
}

/// Copies the edits of a recording to the run in `out` if the ids are the same. Returns whether nothing is left to do.
///
/// # Errors
/// Invalid edits, or a file that cannot be written.
fn take_over(replayed: &ReplayedRecording<'_>, out: &Path) -> anyhow::Result<bool> {
    let from = EditsFile::of_recording(replayed.file);
    let list = from.read()?;
    list.identities(None)
        .map_err(|fault| fault.in_file(from.path()))?;
    if list.is_empty() {
        return Ok(true);
    }
    if !replayed.keeps_ids || RecordedRun::open(replayed.file)?.session() != replayed.session {
        return Ok(false);
    }
    let to = EditsFile::of_run(out);
    let lines = list.all().map(|(number, edit)| (number, edit.line()));
    // Undo edits refer to line numbers, so all lines keep theirs.
    let mut text = String::new();
    let mut next = 1;
    for (number, line) in lines {
        while next < number {
            text.push('\n');
            next += 1;
        }
        text.push_str(&line);
        next += 1;
    }
    let writing = || format!("writing {}", to.path().display());
    write_whole(to.path(), text.as_bytes()).with_context(writing)?;
    Ok(true)
}

/// Adds the edits of the recording `file` to the run in `out` as far as their people are found, and prints the others.
///
/// # Errors
/// A file cannot be read or written.
pub(super) fn carry(file: &Path, out: &Path) -> anyhow::Result<()> {
    let from = EditsFile::of_recording(file);
    let list: EditList = from.read()?;
    let identities = list.identities(None);
    let identities = identities.map_err(|fault| fault.in_file(from.path()))?;
    let before = recorded(file)?;
    let mut counterparts = Counterparts::default();
    for (tick, after) in solved(&out.join(POSES))? {
        let before = before.get(&tick).map_or(&[][..], Vec::as_slice);
        counterparts.add(tick, before, &after, &identities);
    }
    let Carried { changes, left } = counterparts.carried(&identities);
    let to = EditsFile::of_run(out);
    if !changes.is_empty() {
        let n = changes.len();
        to.add_all(&now(), None, |_| Ok(changes))?;
        say(format_args!(
            "{}: {n} edits of the recording, matched by positions",
            to.path().display(),
        ));
    }
    for left in left {
        say(format_args!("not transferred: {left}"));
    }
    Ok(())
}

/// Ids and positions in the poses of a recording.
fn recorded(file: &Path) -> anyhow::Result<Bodies> {
    let mut bodies = Bodies::new();
    RecordedRun::open(file)?.poses(&mut |poses| {
        let place = |pose: &farfield_proto::message::PersonPose| {
            let pelvis = pose.joints_m.get(Joint::Pelvis.index())?;
            Some((pose.person.0, Vector3::from(pelvis.map(f64::from))))
        };
        let places = poses.persons.iter().filter_map(place);
        bodies.entry(poses.tick.0).or_default().extend(places);
    })?;
    Ok(bodies)
}

/// Ids and positions in the poses of a run.
fn solved(poses: &Path) -> anyhow::Result<Bodies> {
    let reading = || anyhow!("reading {}", poses.display());
    let file = File::open(poses).with_context(reading)?;
    let mut bodies = Bodies::new();
    for_each_line(BufReader::new(file), poses, |text, number| {
        let line = PoseLine::parse(text, poses, number)?;
        let place = (line.person, line.joints_m[Joint::Pelvis.index()]);
        bodies.entry(line.tick).or_default().push(place);
        Ok::<_, FileError>(())
    })?;
    Ok(bodies)
}

/// A recording that is computed again.
pub(super) struct Solved {
    /// The venue of the results.
    pub(super) venue: Venue,
    /// The results folder.
    pub(super) out: PathBuf,
    /// The first and the last tick.
    pub(super) ticks: [Tick; 2],
}

/// Draws the results.
///
/// # Errors
/// [`NodeError::Refused`] for ticks outside the replay, [`NodeError::Failed`] when an image cannot be written.
pub(super) fn draw(requested: Option<TickList>, solved: &Solved) -> Result<(), NodeError> {
    let Solved { venue, out, ticks } = solved;
    let poses = out.join(POSES);
    let span = span(&poses).map_err(NodeError::Failed)?;
    let Some(with_poses) = span else {
        say(format_args!(
            "`--overlay`: no person was detected, so there is nothing to draw"
        ));
        return Ok(());
    };
    let [first, last] = if requested.is_some() {
        *ticks
    } else {
        with_poses
    };
    let ticks = overlay_ticks(requested, &(first..last + 1)).map_err(NodeError::Refused)?;
    let sources = VenueSources::default();
    let missing = RefCell::new(BTreeSet::new());
    draw_poses((venue, &ticks, &poses), out, |camera, tick, persons| {
        Ok(
            overlay(&sources, venue, camera, tick, persons).unwrap_or_else(|_| {
                missing.borrow_mut().insert(camera.model.name().to_owned());
                with_people(background(None, &camera.model), &camera.model, persons)
            }),
        )
    })
    .map_err(NodeError::Failed)?;
    let missing: Vec<String> = missing.into_inner().into_iter().collect();
    if !missing.is_empty() {
        say(format_args!(
            "the recordings of {} are not at the paths of the venue file: drawn without images (set other paths with `--venue VENUE.toml`)",
            missing.join(", ")
        ));
    }
    Ok(())
}

/// The first and the last tick of the poses in a file; `None` without poses.
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
