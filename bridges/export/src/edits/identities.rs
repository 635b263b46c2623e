//! The combined effect of all edits: which person each pose belongs to, and the names of people.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;

use super::change::{Change, RefusedEdit};

/// Maps ids of poses to people. Without edits every id is a person.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Identities {
    /// By id, for ids that edits affect: the person from a tick on (`None` if dropped), ascending;
    /// the first entry applies from the beginning.
    pieces: BTreeMap<u32, Vec<(i64, Option<u32>)>>,
    /// Ids created by splits.
    made: BTreeSet<u32>,
    names: BTreeMap<u32, String>,
    /// People whose name comes from body recognition, not from a user.
    guessed: BTreeSet<u32>,
    /// People whose name a user removed, so that recognised names are not used.
    nameless: BTreeSet<u32>,
}

/// The tick before all others.
const BEGINNING: i64 = i64::MIN;

impl Identities {
    /// Applies the changes that are `in_force`, with their numbers, in order; see
    /// [`EditList::identities`](super::EditList::identities). `ever_made` are all new ids of
    /// splits, including undone ones.
    pub(super) fn from_changes(
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

    /// The person of the pose of `id` at `tick`; `None` if dropped.
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

    /// The name that a user gave to a person; not one from body recognition.
    pub fn given_name(&self, person: u32) -> Option<&str> {
        let name = self.names.get(&person).map(String::as_str);
        name.filter(|_| !self.guessed.contains(&person))
    }

    /// Whether a user removed the name of a person and gave none since.
    pub fn is_nameless_by_hand(&self, person: u32) -> bool {
        self.nameless.contains(&person)
    }

    /// Records that recognised names were undone, for people without a name.
    pub(super) fn take_back(&mut self, guessed: impl Iterator<Item = u32>) {
        for person in guessed {
            if !self.names.contains_key(&person) && self.is_there(person) {
                self.nameless.insert(person);
            }
        }
    }

    /// Whether a split created this id; then the poses must not contain it.
    pub fn has_made(&self, id: u32) -> bool {
        self.made.contains(&id)
    }

    /// Names by ids of poses, for ids that are one person throughout; for callers that show
    /// unedited poses.
    pub fn names_of_poses(&self, ids: impl IntoIterator<Item = u32>) -> BTreeMap<u32, String> {
        let name = |id: u32| Some((id, self.names.get(&self.whole(id)?)?.clone()));
        ids.into_iter().filter_map(name).collect()
    }

    /// All ids of poses that edits affect.
    pub fn edited_ids(&self) -> impl Iterator<Item = u32> {
        let named = self.names.keys().filter(|id| !self.made.contains(id));
        let all: BTreeSet<u32> = self.pieces.keys().chain(named).copied().collect();
        all.into_iter()
    }

    /// The person of `id`, if it is one person throughout.
    pub fn whole(&self, id: u32) -> Option<u32> {
        match self.pieces.get(&id).map(Vec::as_slice) {
            None => Some(id),
            Some([(_, person)]) => *person,
            Some(_) => None,
        }
    }

    /// Splits the `ticks` of `id` by person, in order.
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

    /// The stretches of ticks of each edited person of `roll`, ascending; ticks with two poses
    /// occur twice.
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

    /// The table of all edited people of `roll`.
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

    /// Whether poses can belong to `person`, so that an edit may use it. Ids that are not in any
    /// edit may exist.
    pub fn is_there(&self, person: u32) -> bool {
        let contains_person = |pieces: &Vec<(i64, Option<u32>)>| {
            pieces.iter().any(|(_, owner)| *owner == Some(person))
        };
        let is_untouched = !self.pieces.contains_key(&person) && !self.made.contains(&person);
        is_untouched || self.pieces.values().any(contains_person)
    }

    fn apply(&mut self, change: &Change) -> Result<(), String> {
        let need = |person: u32| {
            if self.is_there(person) {
                return Ok(());
            }
            Err(format!(
                "found person {person}, which was merged or left out"
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

    /// Merges names: the name of `into` is kept unless only the other one exists or is of a better
    /// kind. Names by users are better than recognised names.
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

    /// Replaces the owner of every piece of `person` by the result of `by` for its first tick.
    fn replace(&mut self, person: u32, by: impl Fn(i64) -> Option<u32>) {
        self.touch(person);
        for pieces in self.pieces.values_mut() {
            for (from, owner) in pieces.iter_mut() {
                if *owner == Some(person) {
                    *owner = by(*from);
                }
            }
            pieces.dedup_by_key(|(_, owner)| *owner);
        }
    }

    /// Starts a new piece of `person` at `tick`.
    fn cut(&mut self, person: u32, tick: i64) {
        self.touch(person);
        for pieces in self.pieces.values_mut() {
            let after = pieces.partition_point(|(from, _)| *from < tick);
            let begins = pieces.get(after).is_some_and(|(from, _)| *from == tick);
            let before = after.checked_sub(1).and_then(|i| pieces.get(i).copied());
            if let Some((_, Some(owner))) = before
                && owner == person
                && !begins
            {
                pieces.insert(after, (tick, Some(person)));
            }
        }
    }

    /// Creates the initial piece of `person`, if it is an id of the poses.
    fn touch(&mut self, person: u32) {
        if !self.made.contains(&person) {
            let whole = || vec![(BEGINNING, Some(person))];
            self.pieces.entry(person).or_insert_with(whole);
        }
    }

    /// Checks a change against the people that exist.
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
                // The page may name people that these poses lack, which does no harm.
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
                        describe_ticks(&both)
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
                    return Err(format!("found {new} as the new id, which is in use"));
                }
            }
            Change::Undo { .. } => {}
        }
        Ok(())
    }
}

/// Maximum number of stretches per person; further gaps are ignored.
const MOST_STRETCHES: usize = 100_000;

/// Presence by ids of the poses.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Roll {
    /// Stretches of ticks with poses, by person, ascending and disjoint.
    stretches: BTreeMap<u32, Vec<Range<i64>>>,
}

/// Presence of one person after edits.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct PersonRoll {
    /// First and last tick with a pose.
    pub span: [i64; 2],
    /// Ticks with a pose.
    pub ticks: u64,
    /// Stretches of ticks without a pose between the first and the last.
    pub gaps: usize,
}

impl Roll {
    /// Adds a pose of `id` at `tick`. Ticks of a person must increase.
    pub fn add(&mut self, tick: i64, id: u32) {
        let stretches = self.stretches.entry(id).or_default();
        let is_full = stretches.len() >= MOST_STRETCHES;
        match stretches.last_mut() {
            Some(last) if is_full || last.end >= tick => last.end = tick.saturating_add(1),
            _ => stretches.push(tick..tick.saturating_add(1)),
        }
    }

    /// All ids of the poses.
    pub fn ids(&self) -> impl DoubleEndedIterator<Item = u32> {
        self.stretches.keys().copied()
    }

    /// Number of ids.
    pub fn n_ids(&self) -> usize {
        self.stretches.len()
    }

    /// Whether the poses have that id.
    pub fn has(&self, id: u32) -> bool {
        self.stretches.contains_key(&id)
    }
}

/// The intersections of two lists of stretches.
fn common(a: &[Range<i64>], b: &[Range<i64>]) -> Vec<Range<i64>> {
    let (mut i, mut j) = (0, 0);
    let mut common = Vec::new();
    while let (Some(x), Some(y)) = (a.get(i), b.get(j)) {
        let both = x.start.max(y.start)..x.end.min(y.end);
        if !both.is_empty() {
            common.push(both);
        }
        if x.end <= y.end {
            i += 1;
        } else {
            j += 1;
        }
    }
    common
}

/// Describes ticks: the first few stretches, and the total number.
fn describe_ticks(stretches: &[Range<i64>]) -> String {
    const MAX_SHOWN: usize = 3;
    let stretch = |ticks: &Range<i64>| match ticks.end.abs_diff(ticks.start) {
        1 => ticks.start.to_string(),
        _ => format!("{} to {}", ticks.start, ticks.end - 1),
    };
    let shown: Vec<String> = stretches.iter().take(MAX_SHOWN).map(stretch).collect();
    let more = if stretches.len() > MAX_SHOWN {
        ", ..."
    } else {
        ""
    };
    let n: u64 = stretches
        .iter()
        .map(|ticks| ticks.end.abs_diff(ticks.start))
        .sum();
    let plural = if n == 1 { "tick" } else { "ticks" };
    format!("{plural} {}{more} ({n} in all)", shown.join(", "))
}
