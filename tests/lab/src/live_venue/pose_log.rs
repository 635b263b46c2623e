//! A log of a venue's poses, scored against a truth that repeats.
//!
//! People who walk back and forth repeat their positions after a period. So their truth is read once, and a venue may run for
//! any time and over restarts of fusion, since ticks continue.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufReader;
use std::ops::Range;
use std::path::Path;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use anyhow::{Context as _, ensure};
use farfield_fusion::body::skeleton::Joint;
use farfield_proto::message::{PersonPose, PoseSet};
use farfield_proto::tick::Tick;
use farfield_score::lines::{LinesRole, PoseLines, TruthExtent};
use farfield_score::points::{PointSet, ScoredBody};
use farfield_score::{Scores, score};
use nalgebra::Vector3;

use super::VenueWatch;

/// Number of newest ticks that are kept: 200 s at 60 Hz.
const MAX_TICKS: usize = 12_000;

/// Largest distance of a pose from its person, metres.
const MAX_DISTANCE_M: f64 = 0.5;

/// The people of one tick.
type People = BTreeMap<u32, ScoredBody>;

/// The truth of one period.
#[derive(Debug)]
pub struct RepeatingTruth(Vec<People>);

impl RepeatingTruth {
    /// Reads a truth whose ticks begin with 0 and have no gap.
    ///
    /// # Errors
    /// The file cannot be read, or a tick is missing.
    pub fn read(path: &Path) -> anyhow::Result<Self> {
        let file = File::open(path).with_context(|| format!("opening {}", path.display()))?;
        let reader = BufReader::new(file);
        let lines = PoseLines::read(reader, path, LinesRole::Truth, PointSet::Joints, None)?;
        let ticks: Vec<Tick> = lines.ticks().collect();
        let is_whole = ticks.iter().zip(0..).all(|(tick, i)| tick.0 == i);
        ensure!(
            is_whole && !ticks.is_empty(),
            "{}: ticks are missing",
            path.display()
        );
        let people = ticks.iter().filter_map(|tick| lines.people_at(*tick));
        Ok(Self(people.cloned().collect()))
    }

    /// Number of people at the first tick.
    pub fn people(&self) -> usize {
        self.0.first().map_or(0, BTreeMap::len)
    }

    fn at(&self, tick: Tick) -> &People {
        let period = i64::try_from(self.0.len()).unwrap_or(i64::MAX);
        &self.0[usize::try_from(tick.0.rem_euclid(period)).unwrap_or(0)]
    }

    fn over(&self, ticks: &Range<Tick>) -> PoseLines {
        let people =
            (ticks.start.0..ticks.end.0).map(|tick| (Tick(tick), self.at(Tick(tick)).clone()));
        PoseLines::from_people(PointSet::Joints, people.collect())
    }
}

/// The poses that an observer has received.
#[derive(Debug, Clone, Default)]
pub struct PoseLog(Arc<Mutex<BTreeMap<Tick, People>>>);

impl PoseLog {
    /// Starts a log that lives as long as `watch`.
    ///
    /// # Errors
    /// Zenoh fails.
    pub fn subscribe(watch: &VenueWatch) -> anyhow::Result<Self> {
        let log = Self::default();
        let own = log.clone();
        watch.subscribe_poses(move |set| own.add(&set))?;
        Ok(log)
    }

    /// Scores the received poses of `ticks`; a tick that was not received is a gap of all people.
    pub fn score(&self, truth: &RepeatingTruth, ticks: &Range<Tick>, rate_hz: f64) -> Scores {
        let received = self
            .lock()
            .range(ticks.clone())
            .map(|(tick, people)| (*tick, people.clone()))
            .collect();
        let poses = PoseLines::from_people(PointSet::Joints, received);
        score(
            &poses,
            &truth.over(ticks),
            TruthExtent::Whole,
            Some(rate_hz),
        )
    }

    /// Ids by person of the truth at `tick`: that of the nearest body within the limit.
    pub fn ids_by_person(&self, truth: &RepeatingTruth, tick: Tick) -> BTreeMap<u32, u32> {
        let received = self.lock().get(&tick).cloned().unwrap_or_default();
        let nearest = |(person, body): (&u32, &ScoredBody)| {
            let off_m = |other: &ScoredBody| mean_distance_m(body, other);
            let near = received
                .iter()
                .filter_map(|(id, it)| Some((off_m(it)?, *id)));
            let (off_m, id) = near.min_by(|a, b| a.0.total_cmp(&b.0))?;
            (off_m < MAX_DISTANCE_M).then_some((*person, id))
        };
        truth.at(tick).iter().filter_map(nearest).collect()
    }

    fn add(&self, set: &PoseSet) {
        let mut ticks = self.lock();
        let people = set.persons.iter().map(|pose| (pose.person.0, body(pose)));
        ticks.insert(set.tick, people.collect());
        if ticks.len() > MAX_TICKS {
            ticks.pop_first();
        }
    }

    fn lock(&self) -> MutexGuard<'_, BTreeMap<Tick, People>> {
        // A panic elsewhere leaves complete ticks.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Mean distance of the points that both have, metres.
fn mean_distance_m(a: &ScoredBody, b: &ScoredBody) -> Option<f64> {
    let pairs = a.points_m.iter().zip(&b.points_m);
    let off_m = pairs.filter_map(|(a, b)| Some(((*a)? - (*b)?).norm()));
    let off_m: Vec<f64> = off_m.collect();
    let n = off_m.len();
    (n > 0).then(|| off_m.into_iter().sum::<f64>() / n as f64)
}

fn body(pose: &PersonPose) -> ScoredBody {
    let joint = |name: &str| {
        let at = pose.joints_m.get(Joint::from_name(name)?.index())?;
        Some(Vector3::from(at.map(f64::from)))
    };
    ScoredBody::gather(PointSet::Joints, joint, joint)
}

#[cfg(test)]
mod tests {
    use farfield_fusion::body::skeleton::N_JOINTS;
    use farfield_proto::id::{PersonId, SessionId};
    use farfield_proto::message::PersonState;

    use super::*;

    /// A person with all joints at `x_m`.
    fn pose(person: u32, x_m: f32) -> PersonPose {
        PersonPose {
            person: PersonId(person),
            state: PersonState::Tracked,
            joints_m: vec![[x_m, 0.0, 1.0]; N_JOINTS],
            keypoints_m: Vec::new(),
            sigma_m: Vec::new(),
            angles: Vec::new(),
            unobserved: 0,
            views: 4,
        }
    }

    /// Two people who stand 3 m apart for 10 ticks.
    fn truth() -> RepeatingTruth {
        let at_tick = || [(1, body(&pose(1, 0.0))), (2, body(&pose(2, 3.0)))].into();
        RepeatingTruth((0..10).map(|_| at_tick()).collect())
    }

    fn scored(ids: impl Fn(i64) -> [u32; 2]) -> Scores {
        let log = PoseLog::default();
        for tick in (90..120).filter(|tick| *tick != 100) {
            let [left, right] = ids(tick);
            log.add(&PoseSet {
                session: SessionId(1),
                tick: Tick(tick),
                persons: vec![pose(left, 0.01), pose(right, 3.01)],
            });
        }
        log.score(&truth(), &(Tick(90)..Tick(120)), 60.0)
    }

    #[test]
    fn a_truth_repeats_and_a_missing_tick_is_a_gap() {
        let scores = scored(|_| [7, 8]);
        assert!((scores.mean.mpjpe_mm.unwrap() - 10.0).abs() < 0.01);
        let gaps: u64 = scores.actors.values().map(|actor| actor.gaps).sum();
        assert_eq!(
            (gaps, scores.identity.switches, scores.identity.false_births),
            (2, 0, 0)
        );
    }

    #[test]
    fn a_person_has_the_id_of_the_body_in_its_place() {
        let log = PoseLog::default();
        log.add(&PoseSet {
            session: SessionId(1),
            tick: Tick(13),
            persons: vec![pose(7, 3.1), pose(8, 1.0)],
        });
        assert_eq!(log.ids_by_person(&truth(), Tick(13)), [(2, 7)].into());
    }

    #[test]
    fn swapped_ids_are_switches() {
        let scores = scored(|tick| if tick < 105 { [7, 8] } else { [8, 7] });
        assert_eq!(scores.identity.switches, 2);
    }
}
