//! Ticks whose poses are not final yet, because a tentative person may still be confirmed.
//!
//! In lock-step a confirmed person's tentative ticks are written too. So a tick leaves the journal
//! only when all people who were tentative in it are decided. One flat body that stands still,
//! undecided for `births.still_s`, delays the ticks of all people for as long.

use std::collections::VecDeque;

use farfield_proto::message::{PersonPose, PersonState, PoseSet};
use farfield_proto::tick::Tick;

/// Ticks in order, held until they are final.
#[derive(Debug, Clone, Default)]
pub struct Journal {
    pending: VecDeque<PoseSet>,
}

impl Journal {
    /// Adds the newest tick with its confirmed persons.
    pub fn push(&mut self, set: PoseSet) {
        debug_assert!(
            self.pending.back().is_none_or(|last| last.tick < set.tick),
            "ticks come in order"
        );
        self.pending.push_back(set);
    }

    /// Adds poses of a person who was tentative at those ticks and is confirmed now. Poses of ticks
    /// that have already left are dropped.
    pub fn insert(&mut self, poses: impl IntoIterator<Item = (Tick, PersonPose)>) {
        for (tick, pose) in poses {
            let Ok(at) = self.pending.binary_search_by_key(&tick, |set| set.tick) else {
                continue;
            };
            let persons = &mut self.pending[at].persons;
            match persons.binary_search_by_key(&pose.person, |p| p.person) {
                Err(place) => persons.insert(place, pose),
                // A measured pose replaces a predicted one.
                Ok(place) if persons[place].state == PersonState::Coasting => {
                    persons[place] = pose;
                }
                Ok(_) => {}
            }
        }
    }

    /// Returns, in order, the ticks before `undecided`: the first tick of the oldest person who is
    /// still tentative (`None`: all are decided).
    pub fn release(&mut self, undecided: Option<Tick>) -> Vec<PoseSet> {
        let n_final = self
            .pending
            .iter()
            .take_while(|set| undecided.is_none_or(|first| set.tick < first))
            .count();
        self.pending.drain(..n_final).collect()
    }
}

#[cfg(test)]
mod tests {
    use farfield_proto::id::{PersonId, SessionId};

    use super::*;

    fn pose(person: u32) -> PersonPose {
        PersonPose {
            person: PersonId(person),
            state: PersonState::Tentative,
            joints_m: Vec::new(),
            keypoints_m: Vec::new(),
            sigma_m: Vec::new(),
            angles: Vec::new(),
            unobserved: 0,
            views: 2,
        }
    }

    fn set(tick: i64, persons: &[u32]) -> PoseSet {
        PoseSet {
            session: SessionId(1),
            tick: Tick(tick),
            persons: persons.iter().copied().map(pose).collect(),
        }
    }

    #[test]
    fn a_measured_pose_replaces_a_predicted_one() {
        let with_state = |state, views| PersonPose {
            state,
            views,
            ..pose(1)
        };
        let mut journal = Journal::default();
        for (tick, state) in [(0, PersonState::Tracked), (1, PersonState::Coasting)] {
            let mut set = set(tick, &[]);
            set.persons.push(with_state(state, 0));
            journal.push(set);
        }
        let seen = with_state(PersonState::Tentative, 3);
        journal.insert([(Tick(0), seen.clone()), (Tick(1), seen)]);
        let views: Vec<u16> = journal
            .release(None)
            .iter()
            .map(|set| set.persons[0].views)
            .collect();
        assert_eq!(views, [0, 3]);
    }

    #[test]
    fn a_tick_waits_for_its_tentative_people() {
        let mut journal = Journal::default();
        for tick in 0..4 {
            journal.push(set(tick, &[2]));
        }
        let ready = journal.release(Some(Tick(2)));
        assert_eq!(ready.iter().map(|s| s.tick.0).collect::<Vec<_>>(), [0, 1]);
        journal.insert([(Tick(1), pose(1)), (Tick(2), pose(1)), (Tick(3), pose(1))]);
        let rest = journal.release(None);
        let persons = |s: &PoseSet| s.persons.iter().map(|p| p.person.0).collect::<Vec<_>>();
        assert_eq!(
            rest.iter().map(persons).collect::<Vec<_>>(),
            [[1, 2], [1, 2]],
            "sorted by person"
        );
        assert!(journal.release(None).is_empty());
    }
}
