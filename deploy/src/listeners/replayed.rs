//! Names and edits of a recording that is solved again, in the folder of the new run.
//!
//! Where ids mean the same people they are there before the first tick; else those that still mean somebody are made when all is
//! solved, by who is where when.

use std::collections::BTreeMap;
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
use farfield_fusion::node::{OpenListeners, Opening, ReplayedRecording, RunAtItsStart};
use farfield_node::process::{NodeError, say};
use farfield_proto::toml_file::FileError;
use farfield_proto::transport::Identity;
use nalgebra::Vector3;

use super::ListenerArgs;
use super::address::check_own_machine;
use super::drawn::Solved;
use super::page::PAGE;
use crate::exchange::people::time_of_day::now;
use crate::exchange::place::POSES;
use crate::exchange::recorded::RecordedRun;
use crate::overlay::{TickList, overlay_ticks};

/// The bodies of each tick.
type Bodies = BTreeMap<i64, Vec<Place>>;

/// What is still to be carried when all is solved: where to.
type Later = Arc<OnceLock<PathBuf>>;

/// Listeners of a replay, who see to the edits of the recording first.
pub(super) struct ReplayListeners {
    pub(super) listeners: ListenerArgs,
    pub(super) later: Later,
    /// What is solved, once that has begun.
    pub(super) begun: Arc<OnceLock<Solved>>,
    /// The ticks that are to be drawn when all is solved, where they are named.
    pub(super) drawn: Option<TickList>,
}

impl OpenListeners for ReplayListeners {
    fn check(&self, _identity: Option<&Identity>) -> Result<(), NodeError> {
        // Keys are those of a run.
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

/// Copies the edits of a recording to the run in `out`, where its ids are the same; whether there is nothing left to do.
///
/// # Errors
/// What of the edits is wrong, or cannot be written.
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
    // Undos name edits by their lines.
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

/// Makes those edits of the recording `file` in the run of `out` that still mean somebody, and says which do not.
///
/// # Errors
/// What cannot be read or written.
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
            "{}: {n} edits of the recording, by who is where",
            to.path().display(),
        ));
    }
    for left in left {
        say(format_args!("not carried: {left}"));
    }
    Ok(())
}

/// Who is where in the poses of a recording.
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

/// Who is where in the poses of a run.
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
