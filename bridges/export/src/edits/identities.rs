//! What all edits come to: who of the poses is whom, and what they are called.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;

use super::change::{Change, RefusedEdit};
use super::roll::{PersonRoll, Roll, common, ticks_in_words};

/// Who of the poses is whom. Without edits everybody is who they are.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Identities {
    /// Per id of the poses that an edit has to do with: from which tick on it is whom (`None`: left out), ascending; the first is
    /// from the beginning.
    pieces: BTreeMap<u32, Vec<(i64, Option<u32>)>>,
    /// Ids that splits have made.
    made: BTreeSet<u32>,
    names: BTreeMap<u32, String>,
    /// Whose name nobody has given: the body told it.
    guessed: BTreeSet<u32>,
    /// Whose name somebody has taken away: that of a body is not wanted.
    nameless: BTreeSet<u32>,
}

/// The tick before all others.
const BEGINNING: i64 = i64::MIN;

impl Identities {
    /// Applies the changes that are `in_force`, with their numbers, in order; see [`EditList::identities`](super::EditList::identities).
    /// `ever_made`: all new ids of splits, of those that were undone too.
    pub(super) fn of(
        in_force: &[(usize, &Change)],
        ever_made: &BTreeSet<u32>,
        roll: Option<&Roll>,
    ) -> Result<Self, RefusedEdit> {
        let mut identities = Self::default();
        for &(number, change) in in_force {
            let refused = |problem| RefusedEdit { number, problem };
            if let Some(roll) = roll {
                identities.check(change, roll, ever_made).map_err(refused)?;
            }
            identities.apply(change).map_err(refused)?;
        }
        Ok(identities)
    }

    /// Whom the pose of `id` at `tick` shows; `None`: nobody who is to be seen.
    pub fn person_at(&self, tick: i64, id: u32) -> Option<u32> {
        let Some(pieces) = self.pieces.get(&id) else {
            return Some(id);
        };
        let after = pieces.partition_point(|(from, _)| *from <= tick);
        let piece = after.checked_sub(1).and_then(|i| pieces.get(i));
        piece.map_or(Some(id), |(_, person)| *person)
    }

    /// The names, by person.
    pub fn names(&self) -> &BTreeMap<u32, String> {
        &self.names
    }

    /// The name that somebody has given to a person: none that the body told.
    pub fn given_name(&self, person: u32) -> Option<&str> {
        let name = self.names.get(&person).map(String::as_str);
        name.filter(|_| !self.guessed.contains(&person))
    }

    /// Whether somebody has taken the name of a person away, and given none since.
    pub fn is_nameless_by_hand(&self, person: u32) -> bool {
        self.nameless.contains(&person)
    }

    /// Notes that names which bodies told were taken back, of those who have none.
    pub(super) fn take_back(&mut self, guessed: impl Iterator<Item = u32>) {
        for person in guessed {
            if !self.names.contains_key(&person) && self.is_there(person) {
                self.nameless.insert(person);
            }
        }
    }

    /// Whether a split has made this id: the poses must not have it then.
    pub fn has_made(&self, id: u32) -> bool {
        self.made.contains(&id)
    }

    /// What those of the poses are called who are one person throughout, by the ids of the poses: for who shows them as they are.
    pub fn names_of_poses(&self, ids: impl IntoIterator<Item = u32>) -> BTreeMap<u32, String> {
        let name = |id: u32| Some((id, self.names.get(&self.whole(id)?)?.clone()));
        ids.into_iter().filter_map(name).collect()
    }

    /// All ids of the poses that edits have to do with.
    pub fn edited_ids(&self) -> impl Iterator<Item = u32> {
        let named = self.names.keys().filter(|id| !self.made.contains(id));
        let all: BTreeSet<u32> = self.pieces.keys().chain(named).copied().collect();
        all.into_iter()
    }

    /// Who `id` of the poses is, where that is one person all the time.
    pub fn whole(&self, id: u32) -> Option<u32> {
        match self.pieces.get(&id).map(Vec::as_slice) {
            None => Some(id),
            Some([(_, person)]) => *person,
            Some(_) => None,
        }
    }

    /// The `ticks` of `id` by who it is at them, in order.
    pub(super) fn pieces(&self, id: u32, ticks: &Range<i64>) -> Vec<(Range<i64>, Option<u32>)> {
        let Some(pieces) = self.pieces.get(&id) else {
            return vec![(ticks.clone(), Some(id))];
        };
        let ends = pieces.iter().skip(1).map(|(from, _)| *from);
        let ends = ends.chain([i64::MAX]);
        let clipped = pieces.iter().zip(ends).map(|((from, person), end)| {
            let both = ticks.start.max(*from)..ticks.end.min(end);
            (both, *person)
        });
        clipped.filter(|(ticks, _)| !ticks.is_empty()).collect()
    }

    /// When each person is there of `roll` by these identities, stretches ascending; of a tick that two poses have, twice.
    pub fn edited(&self, roll: &Roll) -> BTreeMap<u32, Vec<Range<i64>>> {
        let mut people = BTreeMap::<u32, Vec<Range<i64>>>::new();
        for (&id, stretches) in &roll.stretches {
            for stretch in stretches {
                for (ticks, person) in self.pieces(id, stretch) {
                    if let Some(person) = person {
                        people.entry(person).or_default().push(ticks);
                    }
                }
            }
        }
        for stretches in people.values_mut() {
            stretches.sort_by_key(|ticks| (ticks.start, ticks.end));
        }
        people
    }

    /// The table: everybody of `roll` by these identities.
    pub fn people(&self, roll: &Roll) -> BTreeMap<u32, PersonRoll> {
        let edited = self.edited(roll).into_iter();
        let rows = edited.filter_map(|(person, stretches)| {
            let (first, last) = (
                stretches.first()?.start,
                stretches.last()?.end.saturating_sub(1),
            );
            let ends = stretches.iter().map(|ticks| ticks.end);
            let starts = stretches.iter().skip(1).map(|ticks| ticks.start);
            let row = PersonRoll {
                span: [first, last],
                ticks: stretches
                    .iter()
                    .map(|ticks| ticks.end.abs_diff(ticks.start))
                    .sum(),
                gaps: ends.zip(starts).filter(|(end, start)| start > end).count(),
            };
            Some((person, row))
        });
        rows.collect()
    }

    /// Whether poses can be of `person`, and an edit can name it: an id that nothing is known of may be there.
    pub fn is_there(&self, person: u32) -> bool {
        let is_somebody = |pieces: &Vec<(i64, Option<u32>)>| {
            pieces.iter().any(|(_, somebody)| *somebody == Some(person))
        };
        let is_untouched = !self.pieces.contains_key(&person) && !self.made.contains(&person);
        is_untouched || self.pieces.values().any(is_somebody)
    }

    fn apply(&mut self, change: &Change) -> Result<(), String> {
        let need = |person: u32| {
            if self.is_there(person) {
                return Ok(());
            }
            Err(format!(
                "found person {person}, who is not there any more: merged, or left out"
            ))
        };
        match *change {
            Change::Name { person, ref name } => {
                need(person)?;
                self.guessed.remove(&person);
                if name.is_empty() {
                    self.names.remove(&person);
                    self.nameless.insert(person);
                } else {
                    self.names.insert(person, name.clone());
                    self.nameless.remove(&person);
                }
            }
            Change::Guess { person, ref name } => {
                need(person)?;
                if !self.names.contains_key(&person) || self.guessed.contains(&person) {
                    self.names.insert(person, name.clone());
                    self.guessed.insert(person);
                    self.nameless.remove(&person);
                }
            }
            Change::Merge { person, into } => {
                need(person)?;
                need(into)?;
                self.replace(person, |_| Some(into));
                self.join_names(person, into);
            }
            Change::Split { person, tick, new } => {
                need(person)?;
                if self.made.contains(&new) || self.pieces.contains_key(&new) {
                    return Err(format!("found {new} as the new id, which is taken"));
                }
                self.cut(person, tick);
                self.replace(person, |from| Some(if from >= tick { new } else { person }));
                self.made.insert(new);
            }
            Change::Drop { person } => {
                need(person)?;
                self.replace(person, |_| None);
                self.names.remove(&person);
                self.guessed.remove(&person);
                self.nameless.remove(&person);
            }
            Change::Undo { .. } => {}
        }
        Ok(())
    }

    /// Who was two is called as `into`, where that has a name of the better kind, or of the same: given by hand, then guessed.
    fn join_names(&mut self, person: u32, into: u32) {
        let is_guess = self.guessed.remove(&person);
        let was_nameless = self.nameless.remove(&person);
        let Some(name) = self.names.remove(&person) else {
            if was_nameless && !self.names.contains_key(&into) {
                self.nameless.insert(into);
            }
            return;
        };
        let has_better =
            self.names.contains_key(&into) && (is_guess || !self.guessed.contains(&into));
        if !has_better {
            self.names.insert(into, name);
            self.nameless.remove(&into);
            self.guessed.remove(&into);
            if is_guess {
                self.guessed.insert(into);
            }
        }
    }

    /// Gives every piece that is `person` to whom `by` says, by its first tick.
    fn replace(&mut self, person: u32, by: impl Fn(i64) -> Option<u32>) {
        self.touch(person);
        for pieces in self.pieces.values_mut() {
            for (from, somebody) in pieces.iter_mut() {
                if *somebody == Some(person) {
                    *somebody = by(*from);
                }
            }
            pieces.dedup_by_key(|(_, somebody)| *somebody);
        }
    }

    /// Lets pieces of `person` begin at `tick`.
    fn cut(&mut self, person: u32, tick: i64) {
        self.touch(person);
        for pieces in self.pieces.values_mut() {
            let after = pieces.partition_point(|(from, _)| *from < tick);
            let begins = pieces.get(after).is_some_and(|(from, _)| *from == tick);
            let before = after.checked_sub(1).and_then(|i| pieces.get(i).copied());
            if let Some((_, Some(somebody))) = before
                && somebody == person
                && !begins
            {
                pieces.insert(after, (tick, Some(person)));
            }
        }
    }

    /// Keeps pieces of `person`, if that is one of the poses.
    fn touch(&mut self, person: u32) {
        if !self.made.contains(&person) {
            let whole = || vec![(BEGINNING, Some(person))];
            self.pieces.entry(person).or_insert_with(whole);
        }
    }

    /// Holds a change against who is there.
    fn check(&self, change: &Change, roll: &Roll, ever_made: &BTreeSet<u32>) -> Result<(), String> {
        let people = self.edited(roll);
        let stretches = |person: u32| {
            people.get(&person).map(Vec::as_slice).ok_or_else(|| {
                let known: Vec<&u32> = people.keys().collect();
                format!("found person {person}, expected one of {known:?}")
            })
        };
        match *change {
            Change::Name { person, .. }
            | Change::Guess { person, .. }
            | Change::Drop { person } => {
                // The page names whom it shows; these poses may lack somebody of them, and lose nothing by that.
                let is_elsewhere =
                    !roll.has(person) && !ever_made.contains(&person) && self.is_there(person);
                if !is_elsewhere {
                    stretches(person)?;
                }
            }
            Change::Merge { person, into } => {
                let both = common(stretches(person)?, stretches(into)?);
                if !both.is_empty() {
                    return Err(format!(
                        "found persons {person} and {into} both at {}, expected one of them at a time",
                        ticks_in_words(&both)
                    ));
                }
            }
            Change::Split { person, tick, new } => {
                let own = stretches(person)?;
                let span = own.first().zip(own.last());
                let is_inside =
                    span.is_some_and(|(a, b)| (a.start.saturating_add(1)..b.end).contains(&tick));
                if !is_inside {
                    let (first, last) = span.map_or((0, 0), |(a, b)| {
                        (a.start.saturating_add(1), b.end.saturating_sub(1))
                    });
                    return Err(format!(
                        "found tick {tick}, expected one from {first} to {last}: both must be there"
                    ));
                }
                if roll.has(new) || people.contains_key(&new) {
                    return Err(format!("found {new} as the new id, which somebody has"));
                }
            }
            Change::Undo { .. } => {}
        }
        Ok(())
    }
}
