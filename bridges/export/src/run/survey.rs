//! What a first reading of `poses.jsonl` tells: who is there when, and how long everybody's limbs are.

use std::collections::BTreeMap;
use std::io::BufRead;
use std::ops::Range;
use std::path::Path;

use farfield_fusion::body::skeleton::{Joint, N_JOINTS, sites_of};
use farfield_proto::keypoints::KeypointSet;
use farfield_proto::toml_file::FileError;
use nalgebra::Vector3;

use super::line::{PoseLine, for_each_line};
use crate::edits::{Identities, Roll};
use crate::skeleton::{Offsets, links_of};

/// Width of a bin in which lengths are counted, metres.
const BIN_M: f64 = 1e-4;
/// What positions are rounded to in `poses.jsonl`, metres.
const GRAIN_M: f64 = 1e-5;
/// Most people of a run, far above any that a field holds: what is kept per person is bounded.
pub(crate) const MOST_PEOPLE: usize = 10_000;
/// Most names of keypoints.
const MOST_KEYPOINTS: usize = 512;
/// Lengths beyond this are counted as it, metres.
const LONGEST_M: f64 = 3.0;

/// Who is in a file of poses.
#[derive(Debug, Clone, Default)]
pub struct Survey {
    /// Everybody whom edits leave, by the id that they give.
    pub people: BTreeMap<u32, PersonSurvey>,
    /// Names of the keypoints, in the order in which they come first.
    pub keypoints: Vec<String>,
    /// Who of the file is there when, by its own ids.
    pub roll: Roll,
}

/// One person of a file.
#[derive(Debug, Clone)]
pub struct PersonSurvey {
    /// First and last tick with a pose among those that are exported; `None` where there is none.
    pub present: Option<(i64, i64)>,
    /// The body's offsets: the median over all ticks of the file, component by component. While a run still learns a body they are
    /// those it settles on.
    pub offsets: Offsets,
    /// How far the offsets of single ticks lie from them: one standard deviation per axis, metres, by [`Joint::index`].
    pub sigma_m: [f64; N_JOINTS],
    /// The joint that each keypoint sits on, and where it sits from it, in the frame of the link that holds the joint (x forward, y
    /// left, z up in the neutral pose), metres: the mean over all ticks. Keypoints that sit on none are left out.
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
    /// Reads all lines of `file` (called `path`). Lengths and names are those of the whole file, whatever `ticks`, which
    /// decide only who is present; `identities` say who is who.
    ///
    /// # Errors
    /// The first line that is wrong, out of order, of somebody who is there already at its tick, or of an id that a split has made.
    pub fn of(
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
                    "found person {}, an id that a split has made: expected nobody of it",
                    line.person
                ));
            }
            let Some(person) = identities.person_at(line.tick, line.person) else {
                return Ok(());
            };
            let counting = people.entry(person).or_default();
            if counting.last == Some(line.tick) {
                return at(format!(
                    "found person {} at tick {} a second time by the edits, expected one pose of a person",
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
                    "found more than {MOST_PEOPLE} people or {MOST_KEYPOINTS} keypoints, expected those of a field"
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

/// Of a pose (tick, person) that comes after the one before.
pub(super) fn unsorted(before: (i64, u32), place: (i64, u32), path: &Path) -> FileError {
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

/// The mean of the bin that holds the median, to the decimals of `poses.jsonl`: what is level stays level.
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

/// The sum of squared distances from `median_m`, as far as bins tell them apart.
fn squares_m2(bins: &BTreeMap<i32, Bin>, median_m: f64) -> f64 {
    let square = |bin: &Bin| {
        let apart_m = bin.sum_m / bin.count as f64 - median_m;
        bin.count as f64 * apart_m * apart_m
    };
    bins.values().map(square).sum()
}
