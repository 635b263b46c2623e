//! Recovery of people after losses by the scene: whether they keep their id, and how soon their skeleton fits again.

use std::fmt;

use farfield_proto::tick::Tick;
use farfield_score::lines::PoseLines;
use farfield_score::{errors_over_time, matches_at};
use serde::Serialize;

use crate::conditions::Cuts;
use farfield_sim::scene::Scene;

/// Largest error of a skeleton that fits, metres.
pub const FITS_M: f64 = 0.05;
/// Duration of a loss from which a person may get a new id, seconds: only the body is left to recognise it by.
pub const LONG_S: f64 = 1.2;
/// Time that a skeleton must fit to count as recovered, seconds.
const STAYS_S: f64 = 0.5;

/// One person's loss and recovery.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Recovery {
    /// Number of the person.
    pub actor: u32,
    /// Start and end of the loss, seconds.
    pub lost_s: [f64; 2],
    /// Whether the first pose afterwards has the id of the last one before.
    pub same_id: bool,
    /// Whether it has the former id of another person.
    pub others_id: bool,
    /// Ticks without a pose within 0.5 m during the loss.
    pub gaps: u64,
    /// Largest error during the loss, millimetres, over ticks with a pose within 0.5 m.
    pub worst_mm: Option<f64>,
    /// Time from the end of the loss until the error is below 50 mm for half a second (or to the end of the scene), seconds;
    /// `None`: never.
    pub seconds: Option<f64>,
}

impl Recovery {
    /// The recoveries of `poses` in `scene` with its `truth`: one for each loss, and one per person for each cut of all links,
    /// that begins and ends within the scene's ticks.
    pub fn all(
        scene: &Scene,
        cuts: Option<Cuts>,
        poses: &PoseLines,
        truth: &PoseLines,
    ) -> Vec<Self> {
        let errors = errors_over_time(poses, truth);
        let lost = scene.lost().iter();
        let mut lost: Vec<(usize, [f64; 2])> = lost
            .map(|lost| (lost.person, [lost.from_s, lost.until_s]))
            .collect();
        for [from, until] in cuts.iter().flat_map(|cuts| cuts.within(&scene.ticks())) {
            let at_s = [scene.time_s(from), scene.time_s(until)];
            lost.extend((0..scene.people().len()).map(|person| (person, at_s)));
        }
        let end_s = scene.seconds();
        lost.retain(|(_, [_, until_s])| *until_s < end_s);
        lost.into_iter()
            .filter_map(|(person, lost_s)| {
                let actor = scene.people()[person].number;
                let track = ErrorTrack {
                    actor,
                    rate_hz: scene.rate_hz(),
                    errors: errors.get(&actor)?,
                };
                Some(track.recovery(lost_s, poses, truth))
            })
            .collect()
    }

    /// Whether the id is kept, or after [`LONG_S`] is new rather than another person's.
    pub fn is_fair(&self) -> bool {
        let [from_s, until_s] = self.lost_s;
        self.same_id || until_s - from_s >= LONG_S && !self.others_id
    }
}

/// One actor's error at every tick of the truth.
struct ErrorTrack<'a> {
    actor: u32,
    rate_hz: f64,
    errors: &'a [(Tick, Option<f64>)],
}

impl ErrorTrack<'_> {
    fn recovery(&self, lost_s: [f64; 2], poses: &PoseLines, truth: &PoseLines) -> Recovery {
        let [from, until] = lost_s.map(|s| Tick((s * self.rate_hz).ceil() as i64));
        let during = || {
            self.errors
                .iter()
                .filter(|(tick, _)| (from..until).contains(tick))
        };
        let id_at = |(tick, error): &(Tick, Option<f64>)| {
            error.and_then(|_| matches_at(*tick, poses, truth).get(&self.actor).copied())
        };
        let before = self.errors.iter().rev().filter(|(tick, _)| *tick < from);
        let after = || self.errors.iter().filter(|(tick, _)| *tick >= until);
        let ids = [before.clone().find_map(id_at), after().find_map(id_at)];
        let before_all = before
            .clone()
            .next()
            .map(|(tick, _)| matches_at(*tick, poses, truth));
        let others_id = before_all
            .into_iter()
            .flatten()
            .any(|(other, id)| other != self.actor && ids[1] == Some(id));
        let stays = (STAYS_S * self.rate_hz).ceil().max(1.0) as usize;
        let fits = |(_, error): &(Tick, Option<f64>)| error.is_some_and(|e| e < FITS_M);
        let afterwards: Vec<_> = after().collect();
        let first = (0..afterwards.len()).find(|&i| {
            let end = afterwards.len().min(i + stays);
            afterwards[i..end].iter().all(|error| fits(error))
        });
        Recovery {
            actor: self.actor,
            lost_s,
            same_id: ids[0].is_some() && ids[0] == ids[1],
            others_id,
            gaps: during().filter(|(_, error)| error.is_none()).count() as u64,
            worst_mm: during()
                .filter_map(|(_, error)| error.map(|m| 1000.0 * m))
                .max_by(f64::total_cmp),
            seconds: first.map(|i| (afterwards[i].0 - until) as f64 / self.rate_hz),
        }
    }
}

impl fmt::Display for Recovery {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            actor,
            lost_s: [from_s, until_s],
            ..
        } = self;
        let id = match (self.same_id, self.others_id) {
            (true, _) => "id kept",
            (false, false) => "ID LOST",
            (false, true) => "ID OF ANOTHER",
        };
        let worst = self
            .worst_mm
            .map_or_else(|| "-".to_owned(), |mm| format!("{mm:.0} mm"));
        let back = match self.seconds {
            Some(seconds) => format!("below 50 mm after {seconds:.2} s"),
            None => "never below 50 mm again".to_owned(),
        };
        write!(
            f,
            "lost: {actor} from {from_s} to {until_s} s: {id}, {} gaps, error up to {worst}, {back}",
            self.gaps
        )
    }
}

/// Many recoveries in one line.
pub struct RecoverySummary<'a>(pub &'a [Recovery]);

impl fmt::Display for RecoverySummary<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let all = self.0.len();
        let count = |of: fn(&Recovery) -> bool| self.0.iter().filter(|r| of(r)).count();
        let mut seconds: Vec<f64> = self
            .0
            .iter()
            .map(|r| r.seconds.unwrap_or(f64::INFINITY))
            .collect();
        seconds.sort_by(f64::total_cmp);
        let after = |share: f64| seconds[((seconds.len() - 1) as f64 * share).round() as usize];
        write!(
            f,
            "lost {all} times: {} ids kept, {} new, {} of others; below 50 mm after {:.2} s (median), {:.2} s (95 %), {:.2} s (worst)",
            count(|r| r.same_id),
            count(|r| !r.same_id && !r.others_id),
            count(|r| r.others_id),
            after(0.5),
            after(0.95),
            after(1.0)
        )
    }
}

/// The slowest recovery, seconds; infinite if one never comes, `None` for an empty slice.
pub fn slowest_s(recoveries: &[Recovery]) -> Option<f64> {
    let each = recoveries
        .iter()
        .map(|r| r.seconds.unwrap_or(f64::INFINITY));
    each.max_by(f64::total_cmp)
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use farfield_score::points::{PointSet, ScoredBody};
    use nalgebra::Vector3;

    use super::*;

    /// A person whose points are all `off_m` from the truth, with an id, at each tick.
    fn recording(at: impl Fn(i64) -> Option<(u32, f64)>) -> PoseLines {
        let body = |off_m: f64| {
            let mut body = ScoredBody::default();
            body.points_m[0] = Some(Vector3::new(off_m, 0.0, 1.0));
            body
        };
        let people = (0..60).filter_map(|tick| {
            let (id, off_m) = at(tick)?;
            Some((Tick(tick), BTreeMap::from([(id, body(off_m))])))
        });
        PoseLines::from_people(PointSet::Joints, people.collect())
    }

    fn recovery(poses: &PoseLines) -> Recovery {
        recovery_at(10.0, poses)
    }

    /// The recovery of a person who is lost from 1 s to 2 s.
    fn recovery_at(rate_hz: f64, poses: &PoseLines) -> Recovery {
        let truth = recording(|_| Some((1, 0.0)));
        let errors = errors_over_time(poses, &truth);
        let track = ErrorTrack {
            actor: 1,
            rate_hz,
            errors: &errors[&1],
        };
        track.recovery([1.0, 2.0], poses, &truth)
    }

    #[test]
    fn a_skeleton_has_recovered_when_it_fits_and_stays() {
        // It drifts while lost, fits for a moment at 2.1 s, and for good from 2.3 s on.
        let off_m = |tick: i64| match tick {
            10..20 => 0.01 * (tick - 9) as f64,
            20 | 22 => 0.2,
            _ => 0.02,
        };
        let recovered = recovery(&recording(|tick| Some((7, off_m(tick)))));
        assert!(recovered.same_id && recovered.gaps == 0);
        assert!((recovered.worst_mm.unwrap() - 100.0).abs() < 1e-9);
        assert!((recovered.seconds.unwrap() - 0.3).abs() < 1e-9);
    }

    #[test]
    fn a_low_rate_needs_at_least_one_fitting_tick() {
        let off = recovery_at(
            1.0,
            &recording(|tick| Some((7, 0.1 * f64::from(tick >= 2)))),
        );
        assert_eq!(off.seconds, None);
    }

    #[test]
    fn another_id_afterwards_is_reported() {
        let poses = recording(|tick| match tick {
            0..12 => Some((7, 0.0)),
            25.. => Some((8, 0.0)),
            _ => None,
        });
        let lost = recovery(&poses);
        assert!(!lost.same_id && lost.gaps == 8);
        assert!((lost.seconds.unwrap() - 0.5).abs() < 1e-9);
        assert!(lost.to_string().contains("ID LOST"));
        let never = recovery(&recording(|tick| (tick < 12).then_some((7, 0.0))));
        assert_eq!(
            (never.seconds, slowest_s(std::slice::from_ref(&never))),
            (None, Some(f64::INFINITY))
        );
    }
}
