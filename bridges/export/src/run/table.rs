//! Everybody of a run in a table: who, from when to when, how surely known.

use std::collections::BTreeMap;
use std::io::BufRead;
use std::path::Path;

use farfield_proto::message::{PersonPose, PoseSet};
use farfield_proto::toml_file::FileError;
use serde::Deserialize;

use super::line::for_each_line;
use super::survey::{MOST_PEOPLE, unsorted};
use crate::edits::{Identities, PersonRoll, Roll};

/// Who is there when, and how surely.
#[derive(Debug, Clone, Default)]
pub struct PeopleTable {
    /// Who is there when, by the ids of the poses.
    pub roll: Roll,
    /// By the persons that edits make: sum and number of what ticks say.
    sigmas: BTreeMap<u32, (f64, u64)>,
}

/// One person.
#[derive(Debug, Clone, PartialEq)]
pub struct TableRow {
    /// Who, as edits make it.
    pub person: u32,
    /// When.
    pub roll: PersonRoll,
    /// One standard deviation of a joint per axis, the mean over joints and ticks, metres; `None` where it is not known.
    pub sigma_m: Option<f64>,
}

/// What of a line is looked at.
#[derive(Deserialize)]
struct Line {
    tick: i64,
    person: u32,
    #[serde(default)]
    sigma_m: BTreeMap<String, f64>,
}

impl PeopleTable {
    /// The table of the lines of `file` (called `path`), with `identities`.
    ///
    /// # Errors
    /// The first line that is wrong.
    pub fn of_lines(
        file: impl BufRead,
        path: &Path,
        identities: &Identities,
    ) -> Result<Self, FileError> {
        let mut table = Self::default();
        let mut last = None;
        for_each_line(file, path, |text, number| {
            let line: Line = serde_json::from_str(text)
                .map_err(|e| FileError::new(path, e.to_string()).at_line(number))?;
            let place = (line.tick, line.person);
            if let Some(before) = last.replace(place).filter(|before| *before >= place) {
                return Err(unsorted(before, place, path).at_line(number));
            }
            let sigma_m = mean(line.sigma_m.values().copied());
            table.add(line.tick, line.person, sigma_m, identities);
            if table.roll.n_ids() > MOST_PEOPLE {
                let problem =
                    format!("found more than {MOST_PEOPLE} people, expected those of a field");
                return Err(FileError::new(path, problem).at_line(number));
            }
            Ok::<_, FileError>(())
        })?;
        Ok(table)
    }

    /// Adds the poses of a tick, which must be later than those before.
    pub fn add_poses(&mut self, poses: &PoseSet, identities: &Identities) {
        for pose in &poses.persons {
            let PersonPose { sigma_m, .. } = pose;
            let sigma_m = mean(sigma_m.iter().map(|sigma| f64::from(*sigma)));
            self.add(poses.tick.0, pose.person.0, sigma_m, identities);
        }
    }

    fn add(&mut self, tick: i64, id: u32, sigma_m: Option<f64>, identities: &Identities) {
        self.roll.add(tick, id);
        if let (Some(person), Some(sigma_m)) = (identities.person_at(tick, id), sigma_m) {
            let (sum, n) = self.sigmas.entry(person).or_default();
            (*sum, *n) = (*sum + sigma_m, *n + 1);
        }
    }

    /// The rows, by person.
    pub fn rows(&self, identities: &Identities) -> Vec<TableRow> {
        let rows = identities.people(&self.roll).into_iter();
        let row = |(person, roll)| {
            let sigma = self.sigmas.get(&person);
            let sigma_m = sigma.map(|(sum, n)| sum / *n as f64);
            TableRow {
                person,
                roll,
                sigma_m,
            }
        };
        rows.map(row).collect()
    }
}

fn mean(numbers: impl Iterator<Item = f64>) -> Option<f64> {
    let known = numbers.filter(|number| number.is_finite());
    let (sum, n) = known.fold((0.0, 0_u32), |(sum, n), number| (sum + number, n + 1));
    (n > 0).then(|| sum / f64::from(n))
}
