//! Transfers edits to poses that were solved again with other ids, by comparing positions.
//!
//! The matches of an edited person with the new ids are counted tick by tick. Two poses match if
//! each is the other's nearest, within a distance. Only unambiguous matches are transferred.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::Vector3;

use super::change::Change;
use super::identities::Identities;

/// Maximum distance of matching pelvises, metres: half a step.
const NEAR_M: f64 = 0.3;
/// Minimum share of the matched ticks of a new id that must belong to one person.
const CLEAR_SHARE: f64 = 0.9;
/// Minimum share of all ticks of a new id that must have a match.
const MET_SHARE: f64 = 0.5;

/// A body at a tick: its id, and the pelvis in the world, metres.
pub type Place = (u32, Vector3<f64>);

/// Counts of matches between the old and the new poses.
#[derive(Debug, Clone, Default)]
pub struct Counterparts {
    /// By new id: number of ticks per old person; `None` for dropped people.
    met: BTreeMap<u32, BTreeMap<Option<u32>, u64>>,
    /// By new id: number of its ticks.
    ticks: BTreeMap<u32, u64>,
    /// Pairs of new ids that occur at the same tick.
    at_once: BTreeSet<(u32, u32)>,
    /// By old person: its ids in the old poses.
    ids: BTreeMap<u32, BTreeSet<u32>>,
}

/// The transferred edits.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Carried {
    /// In the order in which they are applied.
    pub changes: Vec<Change>,
    /// Edits that were not transferred, with the reason: lines for operators.
    pub left: Vec<String>,
}

impl Counterparts {
    /// Adds a tick with the bodies `before`, edited by `identities`, and the bodies `after`, with
    /// their ids.
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

    /// The edits for the new poses. Recognised names are omitted, since they are recognised again;
    /// names that a user removed are transferred.
    pub fn carried(&self, identities: &Identities) -> Carried {
        let mut carried = Carried::default();
        let mut matches = BTreeMap::<Option<u32>, Vec<u32>>::new();
        for (id, met) in &self.met {
            let all: u64 = met.values().sum();
            let Some((person, most)) = met.iter().max_by_key(|(_, n)| **n) else {
                continue;
            };
            let is_met = all as f64 >= MET_SHARE * self.ticks[id] as f64;
            if is_met && *most as f64 >= CLEAR_SHARE * all as f64 {
                matches.entry(*person).or_default().push(*id);
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
            let ids = matches.get(&Some(*person)).map_or(&[][..], Vec::as_slice);
            self.carry(*person, ids, identities, &mut carried);
        }
        let left_out = matches.get(&None).into_iter().flatten();
        carried
            .changes
            .extend(left_out.map(|person| Change::Drop { person: *person }));
        carried
    }

    /// Transfers merges and the name of one person to its new `ids`.
    fn carry(&self, person: u32, ids: &[u32], identities: &Identities, carried: &mut Carried) {
        let is_nameless = identities.is_nameless_by_hand(person);
        let name = identities.given_name(person).or(is_nameless.then_some(""));
        let Some((first, others)) = ids.split_first() else {
            let person = description(person, identities);
            carried.left.push(format!("{person}: no clear match"));
            return;
        };
        for other in others {
            let pair = (*first.min(other), *first.max(other));
            if self.at_once.contains(&pair) {
                let person = description(person, identities);
                let line = format!("{person}: found persons {first} and {other} at one tick");
                carried.left.push(line);
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
            Some(person) => format!("{} at {ticks} ticks", description(*person, identities)),
            None => format!("people who were left out at {ticks} ticks"),
        };
        let parts: Vec<String> = met.iter().map(part).collect();
        let all = self.ticks[&id];
        format!(
            "person {id}, present at {all} ticks, is {}",
            parts.join(", ")
        )
    }
}

/// The nearest of `others` to `at_m`, within the maximum distance.
fn nearest(at_m: Vector3<f64>, others: &[Place]) -> Option<Place> {
    let apart = |place: &Place| (place.1 - at_m).norm();
    let nearest = others.iter().min_by(|a, b| apart(a).total_cmp(&apart(b)))?;
    (apart(nearest) <= NEAR_M).then_some(*nearest)
}

/// Whether edits named the person, removed its name, merged or split it, or dropped it.
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

fn description(person: u32, identities: &Identities) -> String {
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

    /// A hundred ticks with ids at positions along the hall.
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
    fn names_go_to_the_person_at_the_same_position() {
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
    fn a_match_with_two_people_is_reported_and_not_named() {
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
        let is_reported = |name| found.left.iter().any(|it| it.starts_with(name));
        assert!(is_reported("Anna") && is_reported("Bo"), "{found:?}");
    }

    #[test]
    fn merges_and_drops_are_transferred() {
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
        // If both have the same new id, nothing needs to be merged.
        let found = carried(edits, before, |_| vec![(1, 0.0)]);
        assert_eq!(found.changes, [name(1, "Anna")]);
    }

    /// Regression: a name that a user had rejected was recognised again for the new id.
    #[test]
    fn removed_names_are_transferred() {
        let guess = || Change::Guess {
            person: 3,
            name: "Anna".to_owned(),
        };
        let (before, after) = (|_| vec![(3, 0.0)], |_| vec![(1, 0.0)]);
        for taken_back in [name(3, ""), Change::Undo { number: 1 }] {
            let found = carried([guess(), taken_back.clone()], before, after);
            assert_eq!(found.changes, [name(1, "")], "{taken_back:?}");
            let elsewhere = carried([guess(), taken_back], before, |_| vec![(1, 3.0)]);
            let expected = ["person 3 of the recording: no clear match"];
            assert_eq!(elsewhere.left, expected);
        }
        // A later name wins.
        let found = carried([guess(), name(3, ""), name(3, "Bo")], before, after);
        assert_eq!(found.changes, [name(1, "Bo")]);
        // A removed name is merged too.
        let merged = [guess(), name(3, ""), Change::Merge { person: 3, into: 4 }];
        let found = carried(merged, before, after);
        assert_eq!(found.changes, [name(1, "")]);
    }

    #[test]
    fn recognised_names_and_unmatched_people_are_not_transferred() {
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
            ["Anna (person 3 of the recording): no clear match"]
        );
    }
}
