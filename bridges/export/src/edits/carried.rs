//! Edits of poses that were solved again under other ids: who is whom is told by who is where when.
//!
//! What an edited person of the poses before comes to among those after is counted tick by tick: of two sets of poses those belong
//! together that are nearest to each other, and near. Only who clearly is one person is carried.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::Vector3;

use super::change::Change;
use super::identities::Identities;

/// Poses whose pelvises are farther apart than this are of two people, metres: half a step.
const NEAR_M: f64 = 0.3;
/// Least share of the ticks of an id, of those at which somebody was before, that are one person's for the two to be the same.
const CLEAR_SHARE: f64 = 0.9;
/// Least share of all ticks of an id at which somebody was before.
const MET_SHARE: f64 = 0.5;

/// A body at a tick: who it is, and where the pelvis is, world, metres.
pub type Place = (u32, Vector3<f64>);

/// Who is where when, before and after.
#[derive(Debug, Clone, Default)]
pub struct Counterparts {
    /// By id after: at how many ticks it is whom of before; `None`: somebody who is left out.
    met: BTreeMap<u32, BTreeMap<Option<u32>, u64>>,
    /// By id after: its ticks.
    ticks: BTreeMap<u32, u64>,
    /// Pairs of ids that are there at one tick after.
    at_once: BTreeSet<(u32, u32)>,
    /// By person before: the ids that it has in the poses.
    ids: BTreeMap<u32, BTreeSet<u32>>,
}

/// What of the edits is carried.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Carried {
    /// In the order in which they are made.
    pub changes: Vec<Change>,
    /// What is not carried, and why: lines for operators.
    pub left: Vec<String>,
}

impl Counterparts {
    /// Takes a tick: the bodies `before`, which are whom the edits (`identities`) say, and those `after`, by their ids.
    pub fn add(&mut self, tick: i64, before: &[Place], after: &[Place], identities: &Identities) {
        for (id, _) in before {
            if let Some(person) = identities.person_at(tick, *id) {
                self.ids.entry(person).or_default().insert(*id);
            }
        }
        for (index, (id, at_m)) in after.iter().enumerate() {
            *self.ticks.entry(*id).or_insert(0) += 1;
            let others = after.iter().skip(index + 1);
            self.at_once
                .extend(others.map(|(other, _)| (*id.min(other), *id.max(other))));
            let Some((nearest, there_m)) = nearest(*at_m, before) else {
                continue;
            };
            let is_mutual = self::nearest(there_m, after).is_some_and(|(back, _)| back == *id);
            if is_mutual {
                let person = identities.person_at(tick, nearest);
                *self.met.entry(*id).or_default().entry(person).or_insert(0) += 1;
            }
        }
    }

    /// The edits that `identities` come to, for the poses after. Names that bodies told are left out: they are told anew; that somebody
    /// has taken one away is carried.
    pub fn carried(&self, identities: &Identities) -> Carried {
        let mut carried = Carried::default();
        let mut whose = BTreeMap::<Option<u32>, Vec<u32>>::new();
        for (id, met) in &self.met {
            let all: u64 = met.values().sum();
            let Some((person, most)) = met.iter().max_by_key(|(_, n)| **n) else {
                continue;
            };
            let is_met = all as f64 >= MET_SHARE * self.ticks[id] as f64;
            if is_met && *most as f64 >= CLEAR_SHARE * all as f64 {
                whose.entry(*person).or_default().push(*id);
            } else if met
                .keys()
                .any(|person| is_edited(identities, &self.ids, *person))
            {
                carried.left.push(self.mixed(*id, met, identities));
            }
        }
        let edited = self
            .ids
            .keys()
            .filter(|it| is_edited(identities, &self.ids, Some(**it)));
        for person in edited {
            let ids = whose.get(&Some(*person)).map_or(&[][..], Vec::as_slice);
            self.carry(*person, ids, identities, &mut carried);
        }
        let left_out = whose.get(&None).into_iter().flatten();
        carried
            .changes
            .extend(left_out.map(|person| Change::Drop { person: *person }));
        carried
    }

    /// Carries merge and name of one person to the `ids` that it has after.
    fn carry(&self, person: u32, ids: &[u32], identities: &Identities, carried: &mut Carried) {
        let is_nameless = identities.is_nameless_by_hand(person);
        let name = identities.given_name(person).or(is_nameless.then_some(""));
        let Some((first, others)) = ids.split_first() else {
            let called = called(person, identities);
            carried.left.push(format!("{called}: nobody clearly is"));
            return;
        };
        for other in others {
            let pair = (*first.min(other), *first.max(other));
            if self.at_once.contains(&pair) {
                let called = called(person, identities);
                let told = format!("{called}: found persons {first} and {other} at one tick");
                carried.left.push(told);
                return;
            }
        }
        let merges = others.iter().map(|other| Change::Merge {
            person: *other,
            into: *first,
        });
        carried.changes.extend(merges);
        if let Some(name) = name {
            let name = name.to_owned();
            carried.changes.push(Change::Name {
                person: *first,
                name,
            });
        }
    }

    fn mixed(&self, id: u32, met: &BTreeMap<Option<u32>, u64>, identities: &Identities) -> String {
        let part = |(person, ticks): (&Option<u32>, &u64)| match person {
            Some(person) => format!("{} at {ticks} ticks", called(*person, identities)),
            None => format!("somebody who is left out at {ticks} ticks"),
        };
        let parts: Vec<String> = met.iter().map(part).collect();
        let all = self.ticks[&id];
        format!(
            "person {id}, who is there at {all} ticks, is {}",
            parts.join(", ")
        )
    }
}

/// Who of `others` is nearest to `at_m`, and near.
fn nearest(at_m: Vector3<f64>, others: &[Place]) -> Option<Place> {
    let apart = |place: &Place| (place.1 - at_m).norm();
    let nearest = others.iter().min_by(|a, b| apart(a).total_cmp(&apart(b)))?;
    (apart(nearest) <= NEAR_M).then_some(*nearest)
}

/// Whether edits have given the person a name or taken it away, made it of several, or left it out.
fn is_edited(
    identities: &Identities,
    ids: &BTreeMap<u32, BTreeSet<u32>>,
    person: Option<u32>,
) -> bool {
    let Some(person) = person else { return true };
    let is_whole = ids
        .get(&person)
        .is_none_or(|ids| ids.len() == 1 && ids.contains(&person));
    identities.given_name(person).is_some() || identities.is_nameless_by_hand(person) || !is_whole
}

fn called(person: u32, identities: &Identities) -> String {
    match identities.given_name(person) {
        Some(name) => format!("{name} (person {person} of the recording)"),
        None => format!("person {person} of the recording"),
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::edits::{Edit, EditList};

    fn list(changes: impl IntoIterator<Item = Change>) -> EditList {
        let lines = changes.into_iter().map(|change| {
            Edit {
                at: "now".to_owned(),
                change,
            }
            .line()
        });
        EditList::parse(&lines.collect::<String>(), Path::new("edits.jsonl")).unwrap()
    }

    fn name(person: u32, name: &str) -> Change {
        Change::Name {
            person,
            name: name.to_owned(),
        }
    }

    /// A hundred ticks at which ids stand at places along the hall.
    fn carried(
        changes: impl IntoIterator<Item = Change>,
        before: impl Fn(i64) -> Vec<(u32, f64)>,
        after: impl Fn(i64) -> Vec<(u32, f64)>,
    ) -> Carried {
        let identities = list(changes).identities(None).unwrap();
        let at = |places: Vec<(u32, f64)>| -> Vec<Place> {
            let place = |(id, x): (u32, f64)| (id, Vector3::new(x, 0.0, 0.9));
            places.into_iter().map(place).collect()
        };
        let mut counterparts = Counterparts::default();
        for tick in 0..100 {
            counterparts.add(tick, &at(before(tick)), &at(after(tick)), &identities);
        }
        counterparts.carried(&identities)
    }

    #[test]
    fn a_name_goes_to_who_stands_there() {
        let edits = [name(3, "Anna"), name(4, "Bo")];
        let found = carried(
            edits,
            |_| vec![(3, 0.0), (4, 2.0), (5, 4.0)],
            |_| vec![(1, 2.05), (2, 0.1), (7, 4.0)],
        );
        assert_eq!(found.changes, [name(2, "Anna"), name(1, "Bo")]);
        assert!(found.left.is_empty(), "{found:?}");
    }

    #[test]
    fn who_is_two_of_before_has_no_name_and_that_is_said() {
        let edits = [name(3, "Anna"), name(4, "Bo")];
        let found = carried(
            edits,
            |tick| {
                if tick < 50 {
                    vec![(3, 0.0)]
                } else {
                    vec![(4, 0.0)]
                }
            },
            |_| vec![(1, 0.0)],
        );
        assert!(found.changes.is_empty(), "{found:?}");
        assert!(
            found.left[0].contains("Anna (person 3 of the recording) at 50 ticks"),
            "{found:?}"
        );
        let nobody = |name| found.left.iter().any(|it| it.starts_with(name));
        assert!(nobody("Anna") && nobody("Bo"), "{found:?}");
    }

    #[test]
    fn who_was_merged_is_one_after_too_and_who_was_left_out_is_left_out() {
        let edits = [
            Change::Merge { person: 4, into: 3 },
            name(3, "Anna"),
            Change::Drop { person: 9 },
        ];
        let before = |tick| match tick {
            ..50 => vec![(3, 0.0), (9, 5.0)],
            _ => vec![(4, 0.0), (9, 5.0)],
        };
        let found = carried(edits.clone(), before, before);
        let expected = [
            Change::Merge { person: 4, into: 3 },
            name(3, "Anna"),
            Change::Drop { person: 9 },
        ];
        assert_eq!(found.changes, expected);
        // Where the two are one already there is nothing to merge.
        let found = carried(edits, before, |_| vec![(1, 0.0)]);
        assert_eq!(found.changes, [name(1, "Anna")]);
    }

    /// Once the body told the name again under the new id, and who had been told to be nobody of that name was.
    #[test]
    fn that_a_body_told_the_wrong_name_is_carried() {
        let guess = || Change::Guess {
            person: 3,
            name: "Anna".to_owned(),
        };
        let (before, after) = (|_| vec![(3, 0.0)], |_| vec![(1, 0.0)]);
        for taken_back in [name(3, ""), Change::Undo { number: 1 }] {
            let found = carried([guess(), taken_back.clone()], before, after);
            assert_eq!(found.changes, [name(1, "")], "{taken_back:?}");
            let elsewhere = carried([guess(), taken_back], before, |_| vec![(1, 3.0)]);
            let told = ["person 3 of the recording: nobody clearly is"];
            assert_eq!(elsewhere.left, told);
        }
        // Whoever has a name since has that.
        let found = carried([guess(), name(3, ""), name(3, "Bo")], before, after);
        assert_eq!(found.changes, [name(1, "Bo")]);
        // It goes with whom the person was merged with.
        let merged = [guess(), name(3, ""), Change::Merge { person: 3, into: 4 }];
        let found = carried(merged, before, after);
        assert_eq!(found.changes, [name(1, "")]);
    }

    #[test]
    fn what_a_body_told_is_not_carried_and_who_is_elsewhere_is_nobody() {
        let guess = Change::Guess {
            person: 3,
            name: "Anna".to_owned(),
        };
        let found = carried([guess], |_| vec![(3, 0.0)], |_| vec![(1, 0.0)]);
        assert_eq!(found, Carried::default());
        let found = carried([name(3, "Anna")], |_| vec![(3, 0.0)], |_| vec![(1, 3.0)]);
        assert!(found.changes.is_empty());
        assert_eq!(
            found.left,
            ["Anna (person 3 of the recording): nobody clearly is"]
        );
    }
}
