//! First pass over `poses.jsonl`: presence and limb lengths of people, and the table of all people.

use farfield_proto::message::{PersonPose, PoseSet};
use serde::Deserialize;
use std::collections::BTreeMap;
use std::io::BufRead;
use std::ops::Range;
use std::path::Path;

use farfield_fusion::body::skeleton::{Joint, N_JOINTS, sites_of};
use farfield_proto::keypoints::KeypointSet;
use farfield_proto::toml_file::FileError;
use nalgebra::Vector3;

use super::line::{PoseLine, for_each_line};
use crate::edits::{Identities, PersonRoll, Roll};
use crate::skeleton::{Offsets, links_of};

/// Width of a histogram bin for lengths, metres.
const BIN_M: f64 = 1e-4;
/// Resolution of positions in `poses.jsonl`, metres.
const GRAIN_M: f64 = 1e-5;
/// Maximum number of people in a run; limits the memory per person.
const MOST_PEOPLE: usize = 10_000;
/// Maximum number of keypoint names.
const MOST_KEYPOINTS: usize = 512;
/// Longer lengths are clamped to this, metres.
const LONGEST_M: f64 = 3.0;

/// The people in a file of poses.
#[derive(Debug, Clone, Default)]
pub struct Survey {
    /// All people after edits, by edited id.
    pub people: BTreeMap<u32, PersonSurvey>,
    /// Names of the keypoints, in order of first occurrence.
    pub keypoints: Vec<String>,
    /// Presence by the ids of the file.
    pub roll: Roll,
}

/// One person of a file.
#[derive(Debug, Clone)]
pub struct PersonSurvey {
    /// First and last tick with an exported pose; `None` if there is none.
    pub present: Option<(i64, i64)>,
    /// Offsets of the body: the median over all ticks of the file, by component. While a run still
    /// learns a body, this is the final value.
    pub offsets: Offsets,
    /// Spread of the offsets of single ticks: one standard deviation per axis, metres, by
    /// [`Joint::index`].
    pub sigma_m: [f64; N_JOINTS],
    /// Joint of each keypoint, and the keypoint's offset from it in the frame of the link that
    /// holds the joint (x forward, y left, z up in the neutral pose), metres: the mean over all
    /// ticks. Keypoints without a joint are omitted.
    pub sites_m: BTreeMap<String, (Joint, Vector3<f64>)>,
}

#[derive(Default)]
struct Counting {
    last: Option<i64>,
    present: Option<(i64, i64)>,
    n_ticks: u64,
    bins: Vec<[BTreeMap<i32, Bin>; 3]>,
    sites: BTreeMap<String, (Joint, Vector3<f64>, u64)>,
}

#[derive(Default)]
struct Bin {
    count: u64,
    sum_m: f64,
}

impl Survey {
    /// Reads all lines of `file` (at `path`), edited by `identities`. Lengths and names are those
    /// of the whole file; `ticks` only affect presence.
    ///
    /// # Errors
    /// The first line that is invalid, out of order, a second pose of a person at a tick, or of an
    /// id that a split created.
    pub fn from_lines(
        file: impl BufRead,
        path: &Path,
        ticks: &Range<i64>,
        identities: &Identities,
    ) -> Result<Self, FileError> {
        let mut survey = Self::default();
        let mut people = BTreeMap::<u32, Counting>::new();
        let mut sites = BTreeMap::<String, Joint>::new();
        let mut last = None;
        for_each_line(file, path, |text, number| {
            let line = PoseLine::parse(text, path, number)?;
            let place = (line.tick, line.person);
            let at = |problem: String| Err(FileError::new(path, problem).at_line(number));
            if let Some(before) = last.replace(place).filter(|before| *before >= place) {
                return Err(unsorted(before, place, path).at_line(number));
            }
            for (name, _) in &line.keypoints_m {
                if !survey.keypoints.contains(name) {
                    survey.keypoints.push(name.clone());
                    let set = KeypointSet::new(vec![name.clone()]);
                    sites.extend(
                        sites_of(&set, &BTreeMap::new())
                            .into_iter()
                            .flatten()
                            .map(|site| (name.clone(), site.joint)),
                    );
                }
            }
            survey.roll.add(line.tick, line.person);
            if identities.has_made(line.person) {
                return at(format!(
                    "found person {}, an id that a split created, expected no poses of it",
                    line.person
                ));
            }
            let Some(person) = identities.person_at(line.tick, line.person) else {
                return Ok(());
            };
            let counting = people.entry(person).or_default();
            if counting.last == Some(line.tick) {
                return at(format!(
                    "found person {} twice at tick {} after the edits, expected one pose of a person",
                    person, line.tick
                ));
            }
            counting.last = Some(line.tick);
            counting.add(&line, &sites);
            if ticks.contains(&line.tick) {
                let first = counting.present.map_or(line.tick, |(first, _)| first);
                counting.present = Some((first, line.tick));
            }
            if people.len() > MOST_PEOPLE || survey.keypoints.len() > MOST_KEYPOINTS {
                return at(format!(
                    "found more than {MOST_PEOPLE} people or {MOST_KEYPOINTS} keypoints, expected fewer"
                ));
            }
            Ok(())
        })?;
        survey.people = people
            .into_iter()
            .map(|(id, counting)| (id, counting.finish()))
            .collect();
        Ok(survey)
    }
}

/// The error of a pose (tick, person) that is out of order.
fn unsorted(before: (i64, u32), place: (i64, u32), path: &Path) -> FileError {
    let problem = format!(
        "found tick {} of person {} after tick {} of person {}, expected them sorted",
        place.0, place.1, before.0, before.1
    );
    FileError::new(path, problem)
}

impl Counting {
    fn add(&mut self, line: &PoseLine, sites: &BTreeMap<String, Joint>) {
        if self.n_ticks == 0 {
            self.bins.resize_with(N_JOINTS, Default::default);
        }
        self.n_ticks += 1;
        let body = links_of(&line.angles);
        let offsets = Offsets::measured(&line.joints_m, &body);
        for (bins, offset_m) in self.bins.iter_mut().zip(&offsets.0) {
            for (bins, &v) in bins.iter_mut().zip(offset_m) {
                let v = v.clamp(-LONGEST_M, LONGEST_M);
                let bin = bins.entry((v / BIN_M).round() as i32).or_default();
                bin.count += 1;
                bin.sum_m += v;
            }
        }
        for (name, at_m) in &line.keypoints_m {
            let Some(&joint) = sites.get(name) else {
                continue;
            };
            let apart_m = at_m - line.joints_m[joint.index()];
            let site = self.sites.entry(name.clone());
            let (_, sum, count) = site.or_insert((joint, Vector3::zeros(), 0));
            *sum += body.rotation(joint.link()).tr_mul(&apart_m);
            *count += 1;
        }
    }

    fn finish(self) -> PersonSurvey {
        let mut offsets = Offsets([Vector3::zeros(); N_JOINTS]);
        let mut sigma_m = [0.0; N_JOINTS];
        for ((offset_m, sigma_m), bins) in offsets.0.iter_mut().zip(&mut sigma_m).zip(&self.bins) {
            let mut sum_m2 = 0.0;
            for (v, bins) in offset_m.iter_mut().zip(bins) {
                *v = median_m(bins, self.n_ticks);
                sum_m2 += squares_m2(bins, *v);
            }
            *sigma_m = (sum_m2 / (3 * self.n_ticks.max(1)) as f64).sqrt();
        }
        let sites_m = self
            .sites
            .into_iter()
            .map(|(name, (joint, sum, count))| (name, (joint, sum / count as f64)));
        PersonSurvey {
            present: self.present,
            offsets,
            sigma_m,
            sites_m: sites_m.collect(),
        }
    }
}

/// Mean of the bin with the median, rounded like `poses.jsonl`, so that level lengths stay level.
fn median_m(bins: &BTreeMap<i32, Bin>, n: u64) -> f64 {
    let mut below = 0;
    for bin in bins.values() {
        below += bin.count;
        if 2 * below >= n {
            let mean_m = bin.sum_m / bin.count as f64;
            return (mean_m / GRAIN_M).round() * GRAIN_M;
        }
    }
    0.0
}

/// Sum of squared distances from `median_m`, with the resolution of the bins.
fn squares_m2(bins: &BTreeMap<i32, Bin>, median_m: f64) -> f64 {
    let square = |bin: &Bin| {
        let apart_m = bin.sum_m / bin.count as f64 - median_m;
        bin.count as f64 * apart_m * apart_m
    };
    bins.values().map(square).sum()
}

/// Presence and accuracy of people.
#[derive(Debug, Clone, Default)]
pub struct PeopleTable {
    /// Presence by ids of the poses.
    pub roll: Roll,
    /// By edited person: sum and number of standard deviations.
    sigmas: BTreeMap<u32, (f64, u64)>,
}

/// One person.
#[derive(Debug, Clone, PartialEq)]
pub struct TableRow {
    /// The edited id.
    pub person: u32,
    /// Its presence.
    pub roll: PersonRoll,
    /// One standard deviation of a joint per axis, mean over joints and ticks, metres; `None` if
    /// unknown.
    pub sigma_m: Option<f64>,
}

/// The fields of a line that are used.
#[derive(Deserialize)]
struct Line {
    tick: i64,
    person: u32,
    #[serde(default)]
    sigma_m: BTreeMap<String, f64>,
}

impl PeopleTable {
    /// Reads the lines of `file` (at `path`), edited by `identities`.
    ///
    /// # Errors
    /// The first invalid line.
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
                let problem = format!("found more than {MOST_PEOPLE} people, expected fewer");
                return Err(FileError::new(path, problem).at_line(number));
            }
            Ok::<_, FileError>(())
        })?;
        Ok(table)
    }

    /// Adds the poses of a tick, which must be later than the previous ones.
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
