//! What a listener heard of a venue's poses, scored against a truth that repeats.
//!
//! People who walk there and back have the same places again after a period, so their truth is read once, and a venue may
//! run for as long as it likes, and through several lives of fusion: ticks go on.

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

/// Ticks that are kept, the newest: 200 s at 60 Hz.
const MAX_TICKS: usize = 12_000;

/// How far a pose may be from a person to be its own, metres.
const ITS_OWN_M: f64 = 0.5;

/// The people of one tick.
type People = BTreeMap<u32, ScoredBody>;

/// Who is where, again and again.
#[derive(Debug)]
pub struct RepeatingTruth(Vec<People>);

impl RepeatingTruth {
    /// Reads a truth whose ticks begin with 0 and lack none.
    ///
    /// # Errors
    /// The file cannot be read, or lacks a tick.
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

    /// How many people there are at the first tick.
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

/// The poses that a listener hears.
#[derive(Debug, Clone, Default)]
pub struct PoseLog(Arc<Mutex<BTreeMap<Tick, People>>>);

impl PoseLog {
    /// From now on, for as long as `watch` listens.
    ///
    /// # Errors
    /// What Zenoh says.
    pub fn listen(watch: &VenueWatch) -> anyhow::Result<Self> {
        let log = Self::default();
        let own = log.clone();
        watch.hear_poses(move |set| own.add(&set))?;
        Ok(log)
    }

    /// What was heard of `ticks`, against who was there; a tick of which nothing was heard is a gap of everybody.
    pub fn score(&self, truth: &RepeatingTruth, ticks: &Range<Tick>, rate_hz: f64) -> Scores {
        let heard = self
            .lock()
            .range(ticks.clone())
            .map(|(tick, people)| (*tick, people.clone()))
            .collect();
        let poses = PoseLines::from_people(PointSet::Joints, heard);
        score(
            &poses,
            &truth.over(ticks),
            TruthExtent::Whole,
            Some(rate_hz),
        )
    }

    /// Which person of the truth has which id at `tick`: that of the nearest body, if one is near.
    pub fn who_is_who(&self, truth: &RepeatingTruth, tick: Tick) -> BTreeMap<u32, u32> {
        let heard = self.lock().get(&tick).cloned().unwrap_or_default();
        let nearest = |(person, body): (&u32, &ScoredBody)| {
            let off_m = |other: &ScoredBody| mean_distance_m(body, other);
            let near = heard.iter().filter_map(|(id, it)| Some((off_m(it)?, *id)));
            let (off_m, id) = near.min_by(|a, b| a.0.total_cmp(&b.0))?;
            (off_m < ITS_OWN_M).then_some((*person, id))
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
        // A panic elsewhere leaves whole ticks behind.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// How far the points are apart that both have, metres.
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

    /// Somebody all of whose joints are at `x_m`.
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
    fn a_truth_repeats_and_a_tick_of_which_nothing_was_heard_is_a_gap() {
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
        assert_eq!(log.who_is_who(&truth(), Tick(13)), [(2, 7)].into());
    }

    #[test]
    fn ids_that_are_exchanged_are_switches() {
        let scores = scored(|tick| if tick < 105 { [7, 8] } else { [8, 7] });
        assert_eq!(scores.identity.switches, 2);
    }
}
