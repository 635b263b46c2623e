//! The files of poses that a run leaves in its folder, written as the ticks come.
//!
//! `poses.jsonl`, and per person `poses_<person>.trc` and `angles_<person>.mot`. They get their names
//! in [`PoseFiles::finish`], also after a run that was cut short or whose disk took no more: what was written
//! so far is whole.

use std::collections::{BTreeMap, VecDeque};
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use farfield_proto::id::PersonId;
use farfield_proto::message::{PersonPose, PoseSet};
use farfield_proto::tick::Tick;

use super::full_disk::FullDisk;
use super::line::PoseLine;
use super::mot::{self, MotRows};
use super::run_clock::{RunClock, RunEnd};
use super::unfinished::{Unfinished, sync_folder_of};
use super::whole::{Kind, Whole, make_whole};
use super::{Layout, trc};
use crate::body::stature::stature_m;

/// Why a file could not be written.
#[derive(Debug, thiserror::Error)]
pub enum WriteError {
    /// The system refused.
    #[error("writing {}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// Ticks came out of order.
    #[error("tick {tick} came after tick {last}")]
    OutOfOrder {
        /// The tick that came.
        tick: Tick,
        /// The last one written.
        last: Tick,
    },
}

/// When a person was there, and how tall.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Presence {
    /// Who.
    pub person: PersonId,
    /// First tick with a pose.
    pub first_tick: Tick,
    /// Last tick with a pose.
    pub last_tick: Tick,
    /// Ticks with a pose.
    pub ticks: u64,
    /// From the soles to the top of the head, by the link lengths of the last pose, metres: without shoes and hair.
    pub stature_m: Option<f64>,
}

/// What a run's files have come to.
#[derive(Debug, Default)]
pub struct Written {
    /// Who was there, by id, also at ticks that could not be written.
    pub people: Vec<Presence>,
    /// Ticks whose poses are not in `poses.jsonl`, or not all; the files of persons may lack a few more.
    pub unwritten_ticks: u64,
    /// Why not, or why a file has not got its name.
    pub failure: Option<WriteError>,
}

/// The growing files of one run.
#[derive(Debug)]
pub struct PoseFiles {
    folder: PathBuf,
    layout: Layout,
    clock: RunClock,
    disk: Arc<dyn FullDisk>,
    lines: Unfinished,
    persons: BTreeMap<PersonId, PersonFiles>,
    last: Option<Tick>,
    /// The first thing that went wrong; nothing is written after it.
    failure: Option<WriteError>,
    /// Per tick with lines that the system may not have yet: where they end.
    unsettled: VecDeque<u64>,
    /// Ticks since the failure.
    refused_ticks: u64,
}

#[derive(Debug)]
struct PersonFiles {
    trc: Unfinished,
    trc_rows: u64,
    /// Room for it is kept at the beginning of the file, and of [`Self::mot_head`] in the other.
    trc_head: String,
    mot: Unfinished,
    mot_head: String,
    mot_rows: MotRows,
    n_mot_rows: u64,
    presence: Presence,
}

impl PersonFiles {
    fn add_row(&mut self, row: &str) -> Result<(), WriteError> {
        append(&mut self.trc, row)?;
        self.trc_rows += 1;
        Ok(())
    }

    fn both(&mut self) -> [&mut Unfinished; 2] {
        [&mut self.trc, &mut self.mot]
    }
}

impl PoseFiles {
    /// Starts `poses.jsonl` in `folder`, which must exist. `rate_hz` must be above 0; `disk` says what is
    /// done when there is no room. Time counts from the first tick that is written, also one without anybody.
    ///
    /// # Errors
    /// [`WriteError::Io`] when the file cannot be made.
    pub fn create(
        folder: impl Into<PathBuf>,
        layout: Layout,
        rate_hz: f64,
        end: RunEnd,
        disk: Arc<dyn FullDisk>,
    ) -> Result<Self, WriteError> {
        let folder = folder.into();
        let lines = create(folder.join("poses.jsonl"), &disk)?;
        Ok(Self {
            folder,
            layout,
            clock: RunClock::new(rate_hz, end),
            disk,
            lines,
            persons: BTreeMap::new(),
            last: None,
            failure: None,
            unsettled: VecDeque::new(),
            refused_ticks: 0,
        })
    }

    /// The first tick of the run, where something has been written.
    pub fn first(&self) -> Option<Tick> {
        self.clock.first
    }

    /// Lets time count from `first`, the first tick of the run; for files whose own first tick is a later one.
    #[must_use]
    pub fn counting_from(mut self, first: Option<Tick>) -> Self {
        self.clock.first = first;
        self
    }

    /// Writes the persons of one tick, by id. Ticks must rise. After a failure nothing is written any more:
    /// ticks are counted.
    ///
    /// # Errors
    /// [`WriteError::OutOfOrder`], or [`WriteError::Io`] when the disk does not take it.
    pub fn write(&mut self, poses: &PoseSet) -> Result<(), &WriteError> {
        if self.failure.is_none()
            && let Err(error) = self.write_tick(poses)
        {
            self.failure = Some(error);
        }
        let handed_over = self.lines.handed_over();
        while self
            .unsettled
            .front()
            .is_some_and(|&end| end <= handed_over)
        {
            self.unsettled.pop_front();
        }
        let has_lines = !poses.persons.is_empty();
        match &self.failure {
            None => {
                self.unsettled
                    .extend(has_lines.then_some(self.lines.taken()));
                Ok(())
            }
            Some(failure) => {
                self.refused_ticks += u64::from(has_lines);
                Err(failure)
            }
        }
    }

    fn write_tick(&mut self, poses: &PoseSet) -> Result<(), WriteError> {
        if let Some(last) = self.last.filter(|&last| poses.tick <= last) {
            return Err(WriteError::OutOfOrder {
                tick: poses.tick,
                last,
            });
        }
        self.last = Some(poses.tick);
        self.clock.first.get_or_insert(poses.tick);
        let mut sorted: Vec<&PersonPose> = poses.persons.iter().collect();
        sorted.sort_by_key(|pose| pose.person);
        for pose in sorted {
            let line = PoseLine {
                tick: poses.tick,
                pose,
                layout: &self.layout,
            };
            line.write_to(&mut self.lines)
                .map_err(|e| io_error(self.lines.path(), e))?;
            self.write_person(poses.tick, pose)?;
        }
        for files in self.persons.values_mut() {
            if files.presence.last_tick != poses.tick {
                each(files.both(), Unfinished::rest)?;
            }
        }
        Ok(())
    }

    fn write_person(&mut self, tick: Tick, pose: &PersonPose) -> Result<(), WriteError> {
        let person = pose.person;
        if !self.persons.contains_key(&person) {
            let files = self.begin_person(person, tick)?;
            self.persons.insert(person, files);
        }
        let Some(files) = self.persons.get_mut(&person) else {
            return Ok(());
        };
        let clock = self.clock;
        for gap in clock
            .blank(files.presence.last_tick.0 + 1..tick.0)
            .map(Tick)
        {
            files.add_row(&trc::row(&self.layout, gap, clock.seconds(gap), None))?;
        }
        let seconds = clock.seconds(tick);
        files.add_row(&trc::row(&self.layout, tick, seconds, Some(pose)))?;
        if mot::has_row(pose) {
            let row = files.mot_rows.row(&self.layout, seconds, pose);
            append(&mut files.mot, &row)?;
            files.n_mot_rows += 1;
        }
        let presence = &mut files.presence;
        presence.last_tick = tick;
        presence.ticks += 1;
        // The last lengths are the best: they are measured anew as a person is seen for longer.
        presence.stature_m = stature_m(&pose.joints_m);
        Ok(())
    }

    fn begin_person(&self, person: PersonId, tick: Tick) -> Result<PersonFiles, WriteError> {
        let name = format!("poses_{person}.trc");
        // The rows before come with the first pose.
        let absence = self.clock.first_at(tick).0..tick.0;
        let first_row = Tick(self.clock.blank(absence).start);
        let rate_hz = self.clock.rate_hz;
        let original = trc::OriginalTicks {
            rate_hz,
            first: first_row,
        };
        let mut files = PersonFiles {
            trc: create(self.folder.join(&name), &self.disk)?,
            trc_rows: 0,
            trc_head: trc::header(&self.layout, &name, rate_hz, original),
            mot: create(self.folder.join(format!("angles_{person}.mot")), &self.disk)?,
            mot_head: mot::header(&self.layout),
            mot_rows: MotRows::default(),
            n_mot_rows: 0,
            presence: Presence {
                person,
                first_tick: tick,
                last_tick: first_row + -1,
                ticks: 0,
                stature_m: None,
            },
        };
        append(&mut files.trc, &files.trc_head)?;
        append(&mut files.mot, &files.mot_head)?;
        Ok(files)
    }

    /// Waits until the disk has `poses.jsonl` as it is so far.
    ///
    /// # Errors
    /// [`WriteError::Io`]; nothing is written any more then.
    pub fn sync_lines(&mut self) -> Result<(), &WriteError> {
        self.sync_with(|files| each([&mut files.lines], Unfinished::sync))
    }

    /// Waits until the disk has the files of persons as they are so far. Those who are not there at present
    /// keep no handle.
    ///
    /// # Errors
    /// [`WriteError::Io`]; nothing is written any more then.
    pub fn sync_persons(&mut self) -> Result<(), &WriteError> {
        self.sync_with(|files| {
            let last = files.last;
            for person in files.persons.values_mut() {
                let is_there = Some(person.presence.last_tick) == last;
                each(person.both(), Unfinished::sync)?;
                if !is_there {
                    each(person.both(), Unfinished::rest)?;
                }
            }
            // The names of files that were begun since.
            sync_folder_of(files.lines.path()).map_err(|e| io_error(&files.folder, e))
        })
    }

    fn sync_with(
        &mut self,
        sync: impl FnOnce(&mut Self) -> Result<(), WriteError>,
    ) -> Result<(), &WriteError> {
        if self.failure.is_none() {
            self.failure = sync(self).err();
        }
        match &self.failure {
            Some(failure) => Err(failure),
            None => Ok(()),
        }
    }

    /// Gives all files their names. Where not everything could be written, they are cut after their last
    /// whole line.
    pub fn finish(mut self) -> Written {
        let is_synced = self.sync_lines().is_ok() && self.sync_persons().is_ok();
        let people = self.persons.values().map(|files| files.presence).collect();
        let folder = self.lines.path().to_owned();
        let (unwritten_ticks, failure) = if is_synced {
            (0, self.name_all())
        } else {
            let failure = self.failure.take();
            (self.cut_all(), failure)
        };
        let synced = sync_folder_of(&folder).map_err(|e| io_error(&folder, e));
        Written {
            people,
            unwritten_ticks,
            failure: failure.or(synced.err()),
        }
    }

    /// All of it is on the disk. One file that gets no name keeps no other from it.
    fn name_all(self) -> Option<WriteError> {
        let mut failure = None;
        let mut note = |done: Result<(), WriteError>| {
            failure = failure.take().or(done.err());
        };
        note(name(self.lines, None));
        for mut files in self.persons.into_values() {
            let until = self.last.filter(|_| self.clock.end == RunEnd::Known);
            let left = files.presence.last_tick;
            let absence = left.0 + 1..until.unwrap_or(left).0 + 1;
            let is_filled = self.clock.blank(absence).map(Tick).try_for_each(|gap| {
                let seconds = self.clock.seconds(gap);
                files.add_row(&trc::row(&self.layout, gap, seconds, None))
            });
            let n_mot_rows = files.n_mot_rows;
            note(match is_filled {
                Ok(()) => name(files.trc, trc::with_rows(&files.trc_head, files.trc_rows)),
                // All poses are in it.
                Err(_) => cut(files.trc, Kind::Trc).map(drop),
            });
            note(name(files.mot, mot::with_rows(&files.mot_head, n_mot_rows)));
        }
        failure
    }

    /// Keeps what the system has taken; returns how many ticks are not in it.
    fn cut_all(self) -> u64 {
        for files in self.persons.into_values() {
            // The failure is known already; what stays has a name that says what it is.
            drop((cut(files.trc, Kind::Trc), cut(files.mot, Kind::Mot)));
        }
        let lines = cut(self.lines, Kind::Lines).ok().flatten();
        let bytes = lines.map_or(0, |whole| whole.bytes);
        let torn = self.unsettled.iter().filter(|&&end| end > bytes).count();
        self.refused_ticks + torn as u64
    }
}

/// Cuts a file after its last whole line, and gives it its name.
fn cut(mut file: Unfinished, kind: Kind) -> Result<Option<Whole>, WriteError> {
    // There may be a little room by now.
    drop(file.rest());
    let path = file.leave();
    make_whole(&path, kind).map_err(|e| io_error(&path, e))
}

/// Gives a file its name, and before that its head, where it has one.
fn name(mut file: Unfinished, head: Option<String>) -> Result<(), WriteError> {
    let head = head.map_or(Ok(()), |head| file.overwrite_head(head.as_bytes()));
    head.and_then(|()| file.give_name())
        .map_err(|e| io_error(file.path(), e))
}

fn each<const N: usize>(
    files: [&mut Unfinished; N],
    mut work: impl FnMut(&mut Unfinished) -> io::Result<()>,
) -> Result<(), WriteError> {
    files
        .into_iter()
        .try_for_each(|file| work(file).map_err(|e| io_error(file.path(), e)))
}

fn io_error(path: &Path, source: io::Error) -> WriteError {
    WriteError::Io {
        path: path.to_owned(),
        source,
    }
}

fn create(path: PathBuf, disk: &Arc<dyn FullDisk>) -> Result<Unfinished, WriteError> {
    let made = Unfinished::create_on(&path, Arc::clone(disk));
    made.map_err(|source| WriteError::Io { path, source })
}

fn append(file: &mut Unfinished, text: &str) -> Result<(), WriteError> {
    file.write_all(text.as_bytes())
        .map_err(|source| io_error(file.path(), source))
}

#[cfg(test)]
#[path = "pose_files_tests.rs"]
mod tests;
