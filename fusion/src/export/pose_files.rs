//! The pose files in the folder of a run, written tick by tick.
//!
//! `poses.jsonl`, and per person `poses_<person>.trc` and `angles_<person>.mot`. They get their
//! names in [`PoseFiles::finish`], also after an interrupted run or on a full disk: what was
//! written so far is then complete.

use std::collections::{BTreeMap, VecDeque};
use std::path::PathBuf;
use std::sync::Arc;

use farfield_proto::id::PersonId;
use farfield_proto::message::{PersonPose, PoseSet};
use farfield_proto::tick::Tick;

use super::disk_policy::DiskPolicy;
use super::line::PoseLine;
use super::mot::{self, MotRows};
use super::part_file::{Ended, PartFile, io_error};
use super::refusal::{Refusal, WriteError};
use super::run_clock::{RunClock, RunEnd};
use super::unfinished::sync_folder_of;
use super::whole::Kind;
use super::{Layout, trc};
use crate::body::stature::stature_m;

/// When a person was present, and its stature.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Presence {
    /// The person.
    pub person: PersonId,
    /// First tick with a pose.
    pub first_tick: Tick,
    /// Last tick with a pose.
    pub last_tick: Tick,
    /// Ticks with a pose.
    pub ticks: u64,
    /// Body height from the link lengths of the last pose, metres, without shoes and hair.
    pub stature_m: Option<f64>,
}

/// The result of a run's files.
#[derive(Debug, Default)]
pub struct Written {
    /// People who were present, by id, also at ticks that could not be written.
    pub people: Vec<Presence>,
    /// Ticks whose poses are missing in `poses.jsonl`, or incomplete; the files of persons may lack
    /// a few more.
    pub unwritten_ticks: u64,
    /// Why, or why a file did not get its name.
    pub failure: Option<WriteError>,
    /// The files that the system refused while they were written.
    pub refusals: Vec<Refusal>,
}

/// The growing files of one run.
#[derive(Debug)]
pub struct PoseFiles {
    folder: PathBuf,
    layout: Layout,
    clock: RunClock,
    disk: Arc<dyn DiskPolicy>,
    lines: PartFile,
    persons: BTreeMap<PersonId, PersonFiles>,
    last: Option<Tick>,
    /// The final error; nothing is written after it.
    failure: Option<WriteError>,
    /// Per tick whose lines the system may not have yet: where they end.
    unsettled: VecDeque<u64>,
    /// Ticks since the failure.
    refused_ticks: u64,
}

#[derive(Debug)]
struct PersonFiles {
    trc: PartFile,
    mot: PartFile,
    mot_rows: MotRows,
    presence: Presence,
}

impl PersonFiles {
    fn both(&mut self) -> [&mut PartFile; 2] {
        [&mut self.trc, &mut self.mot]
    }
}

impl PoseFiles {
    /// Starts `poses.jsonl` in `folder`, which must exist. `rate_hz` must be above 0; `disk`
    /// handles disk errors. Time counts from the first written tick, also one without people.
    ///
    /// # Errors
    /// [`WriteError::Io`] if the file cannot be created.
    pub fn create(
        folder: impl Into<PathBuf>,
        layout: Layout,
        rate_hz: f64,
        end: RunEnd,
        disk: Arc<dyn DiskPolicy>,
    ) -> Result<Self, WriteError> {
        let folder = folder.into();
        let lines = PartFile::create(
            folder.join("poses.jsonl"),
            Kind::Lines,
            String::new(),
            &disk,
        )?;
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

    /// The first tick of the run, if something was written.
    pub fn first(&self) -> Option<Tick> {
        self.clock.first
    }

    /// Counts time from `first`, the first tick of the run, for files that begin later.
    #[must_use]
    pub fn counting_from(mut self, first: Option<Tick>) -> Self {
        self.clock.first = first;
        self
    }

    /// Writes the persons of one tick, by id. Ticks must rise. After a failure nothing more is
    /// written: ticks are counted.
    ///
    /// # Errors
    /// [`WriteError::OutOfOrder`], or [`WriteError::Io`] for a disk error.
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
            let mut row = Vec::new();
            line.write_to(&mut row)
                .map_err(|error| io_error(self.lines.path(), error))?;
            self.lines.add_row(&row)?;
            self.write_person(poses.tick, pose)?;
        }
        for files in self.persons.values_mut() {
            if files.presence.last_tick != poses.tick {
                each(files.both(), PartFile::rest)?;
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
            let row = trc::row(&self.layout, gap, clock.seconds(gap), None);
            files.trc.add_row(row.as_bytes())?;
        }
        let seconds = clock.seconds(tick);
        let row = trc::row(&self.layout, tick, seconds, Some(pose));
        files.trc.add_row(row.as_bytes())?;
        if mot::has_row(pose) {
            let row = files.mot_rows.row(&self.layout, seconds, pose);
            files.mot.add_row(row.as_bytes())?;
        }
        let presence = &mut files.presence;
        presence.last_tick = tick;
        presence.ticks += 1;
        // The last lengths are the best: they are remeasured as a person is seen for longer.
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
        let head = trc::header(&self.layout, &name, rate_hz, original);
        let trc = PartFile::create(self.folder.join(&name), Kind::Trc, head, &self.disk)?;
        let path = self.folder.join(format!("angles_{person}.mot"));
        let mot = PartFile::create(path, Kind::Mot, mot::header(&self.layout), &self.disk)?;
        Ok(PersonFiles {
            trc,
            mot,
            mot_rows: MotRows::default(),
            presence: Presence {
                person,
                first_tick: tick,
                last_tick: first_row + -1,
                ticks: 0,
                stature_m: None,
            },
        })
    }

    /// Waits until `poses.jsonl` as it is so far is on the disk.
    ///
    /// # Errors
    /// [`WriteError::Io`]; nothing more is written then.
    pub fn sync_lines(&mut self) -> Result<(), &WriteError> {
        self.sync_with(|files| files.lines.sync())
    }

    /// Waits until the files of persons as they are so far are on the disk. Files of absent people
    /// are closed.
    ///
    /// # Errors
    /// [`WriteError::Io`]; nothing more is written then.
    pub fn sync_persons(&mut self) -> Result<(), &WriteError> {
        self.sync_with(|files| {
            let last = files.last;
            for person in files.persons.values_mut() {
                let is_there = Some(person.presence.last_tick) == last;
                each(person.both(), PartFile::sync)?;
                if !is_there {
                    each(person.both(), PartFile::rest)?;
                }
            }
            // The names of files created since. If the disk refuses, the next call syncs them.
            drop(sync_folder_of(files.lines.path()));
            Ok(())
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

    /// Gives all files their names. If not everything could be written, they are cut after their
    /// last whole line.
    pub fn finish(mut self) -> Written {
        let is_synced = self.sync_lines().is_ok() && self.sync_persons().is_ok();
        let people = self.persons.values().map(|files| files.presence).collect();
        let path = self.lines.path().to_owned();
        let mut written = Written {
            people,
            failure: self.failure.take(),
            ..Written::default()
        };
        if is_synced {
            self.name_all(&mut written);
        } else {
            self.cut_all(&mut written);
        }
        let synced = sync_folder_of(&path).map_err(|e| io_error(&path, e));
        written.failure = written.failure.or(synced.err());
        written
    }

    /// After a successful sync: a file that gets no name does not affect the others.
    fn name_all(self, written: &mut Written) {
        let lines = self.lines.finish();
        written.unwritten_ticks = lines.n_lost;
        written.add(lines);
        for mut files in self.persons.into_values() {
            let until = self.last.filter(|_| self.clock.end == RunEnd::Known);
            let left = files.presence.last_tick;
            let absence = left.0 + 1..until.unwrap_or(left).0 + 1;
            let is_filled = self.clock.blank(absence).map(Tick).try_for_each(|gap| {
                let seconds = self.clock.seconds(gap);
                let row = trc::row(&self.layout, gap, seconds, None);
                files.trc.add_row(row.as_bytes())
            });
            written.add(match is_filled {
                Ok(()) => files.trc.finish(),
                // All poses are in it.
                Err(_) => files.trc.cut(),
            });
            written.add(files.mot.finish());
        }
    }

    /// Keeps what the system has, and counts the missing ticks.
    fn cut_all(self, written: &mut Written) {
        for files in self.persons.into_values() {
            written.add(files.trc.cut());
            written.add(files.mot.cut());
        }
        let lines = self.lines.cut();
        let torn = self.unsettled.iter().filter(|&&end| end > lines.bytes);
        written.unwritten_ticks = self.refused_ticks + torn.count() as u64 + lines.n_lost;
        written.add(lines);
    }
}

impl Written {
    fn add(&mut self, ended: Ended) {
        self.refusals.extend(ended.refusals);
        self.failure = self.failure.take().or(ended.failure);
    }
}

fn each<const N: usize>(
    files: [&mut PartFile; N],
    work: impl FnMut(&mut PartFile) -> Result<(), WriteError>,
) -> Result<(), WriteError> {
    files.into_iter().try_for_each(work)
}

#[cfg(test)]
#[path = "pose_files_tests.rs"]
mod tests;
