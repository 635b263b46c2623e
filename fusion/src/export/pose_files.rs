//! The files of poses that a run leaves in its folder, written as the ticks come.
//!
//! `poses.jsonl`, and per person `poses_<person>.trc` and `angles_<person>.mot`. They get their names
//! in [`PoseFiles::finish`], also after a run that was cut short: what was finished so far is whole.

use std::collections::BTreeMap;
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};

use farfield_proto::id::PersonId;
use farfield_proto::message::{PersonPose, PoseSet};
use farfield_proto::tick::Tick;

use super::line::PoseLine;
use super::unfinished::Unfinished;
use super::{Layout, mot, trc};

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

/// When a person was there.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Presence {
    /// Who.
    pub person: PersonId,
    /// First tick with a pose.
    pub first_tick: Tick,
    /// Last tick with a pose.
    pub last_tick: Tick,
    /// Ticks with a pose.
    pub ticks: u64,
}

/// The growing files of one run.
#[derive(Debug)]
pub struct PoseFiles {
    folder: PathBuf,
    layout: Layout,
    rate_hz: f64,
    lines: Unfinished,
    persons: BTreeMap<PersonId, PersonFiles>,
    last: Option<Tick>,
}

#[derive(Debug)]
struct PersonFiles {
    trc: Unfinished,
    mot: Unfinished,
    presence: Presence,
}

impl PoseFiles {
    /// Starts `poses.jsonl` in `folder`, which must exist. `rate_hz` must be above 0.
    ///
    /// # Errors
    /// [`WriteError::Io`] when the file cannot be made.
    pub fn create(
        folder: impl Into<PathBuf>,
        layout: Layout,
        rate_hz: f64,
    ) -> Result<Self, WriteError> {
        let folder = folder.into();
        let lines = create(folder.join("poses.jsonl"))?;
        Ok(Self {
            folder,
            layout,
            rate_hz,
            lines,
            persons: BTreeMap::new(),
            last: None,
        })
    }

    /// Writes the persons of one tick, by id. Ticks must rise.
    ///
    /// # Errors
    /// [`WriteError::OutOfOrder`], or [`WriteError::Io`] when the disk does not take it.
    pub fn write(&mut self, poses: &PoseSet) -> Result<(), WriteError> {
        if let Some(last) = self.last.filter(|&last| poses.tick <= last) {
            return Err(WriteError::OutOfOrder {
                tick: poses.tick,
                last,
            });
        }
        self.last = Some(poses.tick);
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
        for files in self
            .persons
            .values_mut()
            .filter(|f| f.presence.last_tick != poses.tick)
        {
            for file in [&mut files.trc, &mut files.mot] {
                file.rest()
                    .map_err(|source| io_error(file.path(), source))?;
            }
        }
        Ok(())
    }

    fn write_person(&mut self, tick: Tick, pose: &PersonPose) -> Result<(), WriteError> {
        let person = pose.person;
        let files = match self.persons.entry(person) {
            std::collections::btree_map::Entry::Occupied(entry) => entry.into_mut(),
            std::collections::btree_map::Entry::Vacant(entry) => entry.insert(PersonFiles {
                trc: create(self.folder.join(format!("poses_{person}.trc")))?,
                mot: create(self.folder.join(format!("angles_{person}.mot")))?,
                presence: Presence {
                    person,
                    first_tick: tick,
                    last_tick: tick + -1,
                    ticks: 0,
                },
            }),
        };
        let presence = &mut files.presence;
        let seconds = |tick: Tick| (tick - presence.first_tick) as f64 / self.rate_hz;
        for gap in (presence.last_tick.0 + 1..tick.0).map(Tick) {
            append(
                &mut files.trc,
                &trc::row(&self.layout, gap, seconds(gap), None),
            )?;
        }
        append(
            &mut files.trc,
            &trc::row(&self.layout, tick, seconds(tick), Some(pose)),
        )?;
        append(&mut files.mot, &mot::row(&self.layout, seconds(tick), pose))?;
        presence.last_tick = tick;
        presence.ticks += 1;
        Ok(())
    }

    /// Gives all files their names, and says who was there, by id.
    ///
    /// # Errors
    /// [`WriteError::Io`]; files that already have their names keep them.
    pub fn finish(self) -> Result<Vec<Presence>, WriteError> {
        let Self {
            layout,
            rate_hz,
            lines,
            persons,
            ..
        } = self;
        let path = lines.path().to_owned();
        lines.finish().map_err(|source| io_error(&path, source))?;
        let mut presences = Vec::with_capacity(persons.len());
        for (person, files) in persons {
            let PersonFiles { trc, mot, presence } = files;
            let n_rows = (presence.last_tick - presence.first_tick + 1).unsigned_abs();
            let name = format!("poses_{person}.trc");
            let heads = [
                trc::header(&layout, &name, rate_hz, presence.first_tick, n_rows),
                mot::header(&layout, presence.ticks),
            ];
            for (file, head) in [trc, mot].into_iter().zip(heads) {
                let path = file.path().to_owned();
                file.finish_with_head(&head)
                    .map_err(|source| io_error(&path, source))?;
            }
            presences.push(presence);
        }
        Ok(presences)
    }
}

fn io_error(path: &Path, source: io::Error) -> WriteError {
    WriteError::Io {
        path: path.to_owned(),
        source,
    }
}

fn create(path: PathBuf) -> Result<Unfinished, WriteError> {
    Unfinished::create(&path).map_err(|source| WriteError::Io { path, source })
}

fn append(file: &mut Unfinished, text: &str) -> Result<(), WriteError> {
    file.write_all(text.as_bytes())
        .map_err(|source| io_error(file.path(), source))
}

#[cfg(test)]
mod tests {
    use std::fs;

    use farfield_proto::message::PersonState::Tracked;

    use super::super::fixture;
    use super::*;

    fn written(ticks: &[(i64, &[u32])]) -> (tempfile::TempDir, Vec<Presence>) {
        let folder = tempfile::tempdir().unwrap();
        let mut files = PoseFiles::create(folder.path(), fixture::layout(), 50.0).unwrap();
        for &(tick, ids) in ticks {
            let persons: Vec<_> = ids.iter().map(|&id| (id, Tracked)).collect();
            files.write(&fixture::poses(tick, &persons)).unwrap();
        }
        let presences = files.finish().unwrap();
        (folder, presences)
    }

    #[test]
    fn a_run_leaves_lines_by_tick_and_person_and_two_files_per_person() {
        let (folder, presences) = written(&[(10, &[2, 1]), (11, &[2])]);
        let mut names: Vec<String> = fs::read_dir(folder.path())
            .unwrap()
            .map(|e| e.unwrap().file_name().into_string().unwrap())
            .collect();
        names.sort();
        assert_eq!(
            names,
            [
                "angles_1.mot",
                "angles_2.mot",
                "poses.jsonl",
                "poses_1.trc",
                "poses_2.trc"
            ]
        );
        let lines = fs::read_to_string(folder.path().join("poses.jsonl")).unwrap();
        let heads: Vec<&str> = lines.lines().map(|line| &line[..22]).collect();
        let head = |tick: i64, person: u32| format!("{{\"tick\":{tick},\"person\":{person},");
        assert_eq!(heads, [head(10, 1), head(10, 2), head(11, 2)]);
        assert_eq!(
            (
                presences[1].first_tick,
                presences[1].last_tick,
                presences[1].ticks
            ),
            (Tick(10), Tick(11), 2)
        );
    }

    #[test]
    fn a_tick_without_the_person_is_a_row_of_nan_in_trc_and_no_row_in_mot() {
        let (folder, _) = written(&[(10, &[1]), (11, &[]), (12, &[1])]);
        let trc = fs::read_to_string(folder.path().join("poses_1.trc")).unwrap();
        let rows: Vec<&str> = trc.lines().skip(5).collect();
        assert_eq!(rows.len(), 3);
        assert!(rows[1].starts_with("11\t0.020000\tNaN\t"));
        assert!(rows[2].starts_with("12\t0.040000\t2.00000\t"));
        let mot = fs::read_to_string(folder.path().join("angles_1.mot")).unwrap();
        assert!(mot.contains("nRows=2\n"));
        let times: Vec<&str> = mot
            .lines()
            .skip(11)
            .map(|row| row.split('\t').next().unwrap())
            .collect();
        assert_eq!(times, ["0.000000", "0.040000"]);
    }

    #[test]
    fn nobody_leaves_an_empty_file_of_lines() {
        let (folder, presences) = written(&[(0, &[])]);
        assert!(presences.is_empty());
        assert_eq!(
            fs::read_to_string(folder.path().join("poses.jsonl")).unwrap(),
            ""
        );
    }

    #[test]
    fn a_run_that_is_given_up_leaves_nothing_half_written() {
        let folder = tempfile::tempdir().unwrap();
        let mut files = PoseFiles::create(folder.path(), fixture::layout(), 50.0).unwrap();
        files.write(&fixture::poses(0, &[(1, Tracked)])).unwrap();
        drop(files);
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
    }

    #[test]
    fn ticks_out_of_order_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let mut files = PoseFiles::create(folder.path(), fixture::layout(), 50.0).unwrap();
        files.write(&fixture::poses(5, &[])).unwrap();
        let error = files.write(&fixture::poses(5, &[])).unwrap_err();
        assert_eq!(error.to_string(), "tick 5 came after tick 5");
    }
}
