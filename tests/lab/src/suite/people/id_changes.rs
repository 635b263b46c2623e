//! Changes of a person's id, and the former owner of the new id. An id of another person is the worst case for users of ids; a
//! new one costs least.

use std::collections::BTreeMap;
use std::fmt;

use farfield_proto::tick::Tick;
use farfield_score::lines::PoseLines;
use farfield_score::matches_at;
use serde::Serialize;

/// Time that an id must stay with a person to be its own, seconds.
const STAYS_S: f64 = 0.1;

/// A pose of a person with another id than its last one.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct IdChange {
    /// The first tick with the new id.
    pub tick: i64,
    /// Number of the person.
    pub actor: u32,
    /// The id before, and the new one.
    pub ids: [u32; 2],
    /// The last other owner of the new id; `None` if it is new or was its own.
    pub of: Option<u32>,
}

impl IdChange {
    /// The changes in `poses`, in order. Only an id that stays for a while counts: while a person is out of sight, a pose that is
    /// extrapolated may pass another person.
    pub fn all(poses: &PoseLines, truth: &PoseLines, rate_hz: f64) -> Vec<Self> {
        let stays = (STAYS_S * rate_hz).ceil().max(1.0) as u32;
        let mut changes = Vec::new();
        // Per actor its id; per actor a candidate, since when and for how many ticks; per id its last actor.
        let mut id_of: BTreeMap<u32, u32> = BTreeMap::new();
        let mut next: BTreeMap<u32, (u32, Tick, u32)> = BTreeMap::new();
        let mut actor_of: BTreeMap<u32, u32> = BTreeMap::new();
        for tick in truth.ticks() {
            for (actor, id) in matches_at(tick, poses, truth) {
                let candidate = next.entry(actor).or_insert((id, tick, 0));
                if candidate.0 != id {
                    *candidate = (id, tick, 0);
                }
                candidate.2 += 1;
                let (_, since, ticks) = *candidate;
                if ticks < stays {
                    continue;
                }
                let of = actor_of.insert(id, actor).filter(|&other| other != actor);
                if let Some(before) = id_of.insert(actor, id).filter(|&before| before != id) {
                    changes.push(Self {
                        tick: since.0,
                        actor,
                        ids: [before, id],
                        of,
                    });
                }
            }
        }
        changes
    }
}

impl fmt::Display for IdChange {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            tick,
            actor,
            ids: [before, now],
            of,
        } = self;
        write!(
            f,
            "{actor} is id {now} in the place of id {before} from tick {tick} on"
        )?;
        match of {
            Some(other) => write!(f, ", WHICH WAS {other}"),
            None => write!(f, ", which is new or its own"),
        }
    }
}

#[cfg(test)]
mod tests {
    use farfield_score::points::{PointSet, ScoredBody};
    use nalgebra::Vector3;

    use super::*;

    /// Two people 5 m apart, with these ids at each tick.
    fn recording(ids: impl Fn(i64) -> [u32; 2]) -> PoseLines {
        let people = (0..60).map(|tick| {
            let bodies = ids(tick).into_iter().zip([0.0, 5.0]).map(|(id, x_m)| {
                let mut body = ScoredBody::default();
                body.points_m[0] = Some(Vector3::new(x_m, 0.0, 1.0));
                (id, body)
            });
            (Tick(tick), bodies.collect())
        });
        PoseLines::from_people(PointSet::Joints, people.collect())
    }

    fn changes(ids: impl Fn(i64) -> [u32; 2]) -> Vec<IdChange> {
        IdChange::all(&recording(ids), &recording(|_| [1, 2]), 60.0)
    }

    #[test]
    fn swapped_ids_have_a_former_owner_and_new_ids_have_none() {
        let swapped = changes(|tick| if tick < 30 { [7, 8] } else { [8, 7] });
        let of: Vec<_> = swapped.iter().map(|c| (c.actor, c.of)).collect();
        assert_eq!(of, [(1, Some(2)), (2, Some(1))]);
        assert!(swapped[0].to_string().contains("WHICH WAS 2"));
        let new = changes(|tick| if tick < 30 { [7, 8] } else { [7, 9] });
        assert_eq!(new.len(), 1);
        assert_eq!((new[0].tick, new[0].ids, new[0].of), (30, [8, 9], None));
    }

    #[test]
    fn a_passing_id_is_no_change() {
        let passed = changes(|tick| {
            if (30..33).contains(&tick) {
                [8, 7]
            } else {
                [7, 8]
            }
        });
        assert!(passed.is_empty());
        assert!(changes(|_| [7, 8]).is_empty());
    }
}
