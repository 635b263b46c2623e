//! Groups of witnesses that grow from the pairs that agree.

use std::collections::{BTreeMap, BTreeSet};

use farfield_proto::id::ViewpointIndex;

use super::agreement::{Agreements, Gates};
use crate::sightings::rays::SightedBody;

/// Share of the members that may disagree with a new one: one bad sighting in a group must not
/// exclude the good ones.
const MAX_DISAGREEING: f64 = 0.34;

/// Members from which a group is not grown again from other pairs of its own. Nearly all of these
/// pairs lead to it, and they are as many as its viewpoints squared.
const LARGE: usize = 6;

/// The different groups that grow from pairs of `free` witnesses (indices into `witnesses`) that
/// agree, members ascending.
pub(super) fn grown_groups(
    witnesses: &[SightedBody],
    free: &[usize],
    gates: &Gates,
) -> BTreeSet<Vec<usize>> {
    let mut growth = Growth::new(Agreements::among(witnesses, free, gates), gates);
    let mut groups: BTreeSet<Vec<usize>> = BTreeSet::new();
    // Per witness, the numbers of the large groups that contain it.
    let mut large_of: BTreeMap<usize, BTreeSet<usize>> = BTreeMap::new();
    let mut n_large = 0;
    for (a, b) in growth.agreements.pairs() {
        let is_inside = (large_of.get(&a).zip(large_of.get(&b)))
            .is_some_and(|(of_a, of_b)| !of_a.is_disjoint(of_b));
        if is_inside {
            continue;
        }
        let group = growth.grow(a, b);
        if group.len() >= LARGE && !groups.contains(&group) {
            for &member in &group {
                large_of.entry(member).or_default().insert(n_large);
            }
            n_large += 1;
        }
        groups.insert(group);
    }
    let witness = |place: usize| growth.agreements.witness(place);
    let groups = groups.into_iter();
    groups
        .map(|group| group.into_iter().map(witness).collect())
        .collect()
}

/// The votes of a group's members on a witness.
#[derive(Debug, Clone, Copy, Default)]
struct MemberVotes {
    agreeing: u32,
    disagreeing: u32,
    /// Each agreement counts up to 1, by its distance.
    sum: f64,
}

impl MemberVotes {
    fn agree(&mut self, distance_m: f64, gates: &Gates) {
        self.agreeing += 1;
        self.sum += 1.0 - 0.5 * distance_m / gates.ray_distance_m;
    }

    /// How well the witness fits the members; `None` if none agrees or too many disagree.
    fn fit(&self) -> Option<f64> {
        let compared = f64::from(self.agreeing + self.disagreeing);
        let few_disagree = f64::from(self.disagreeing) <= MAX_DISAGREEING * compared;
        (self.agreeing > 0 && few_disagree).then_some(self.sum)
    }
}

/// A growing group, by places among the agreements.
struct Growth<'a> {
    agreements: Agreements<'a>,
    gates: &'a Gates,
    members: Vec<usize>,
    viewpoints: BTreeSet<ViewpointIndex>,
    /// Places that agree with a member, of viewpoints without a member.
    candidates: Vec<usize>,
    /// Per place, the votes of the members.
    votes: Vec<MemberVotes>,
    /// Per place, whether it is or was a candidate: a place of a member's viewpoint does not come
    /// back.
    is_known: Vec<bool>,
    /// Per place, the last member to join that agrees with it.
    agreed_last: Vec<usize>,
}

impl<'a> Growth<'a> {
    fn new(agreements: Agreements<'a>, gates: &'a Gates) -> Self {
        let n = agreements.len();
        Self {
            agreements,
            gates,
            members: Vec::new(),
            viewpoints: BTreeSet::new(),
            candidates: Vec::new(),
            votes: vec![MemberVotes::default(); n],
            is_known: vec![false; n],
            agreed_last: vec![usize::MAX; n],
        }
    }

    /// Grows the pair (`a`, `b`) by the witness of another viewpoint that its members agree with
    /// best, until there is none. Members ascending.
    fn grow(&mut self, a: usize, b: usize) -> Vec<usize> {
        self.clear();
        self.join(a);
        self.join(b);
        while let Some(best) = self.best() {
            self.join(best);
        }
        let mut members = self.members.clone();
        members.sort_unstable();
        members
    }

    fn clear(&mut self) {
        // Every known place agrees with a member.
        for member in self.members.drain(..) {
            for &(place, _) in self.agreements.with(member) {
                self.is_known[place] = false;
                self.agreed_last[place] = usize::MAX;
            }
        }
        self.viewpoints.clear();
        self.candidates.clear();
    }

    /// The candidate that fits the members best; of equal ones the first.
    fn best(&self) -> Option<usize> {
        let fits = self
            .candidates
            .iter()
            .filter_map(|&c| Some((c, self.votes[c].fit()?)));
        let best = fits.max_by(|x, y| x.1.total_cmp(&y.1).then(y.0.cmp(&x.0)));
        best.map(|(place, _)| place)
    }

    /// Adds `new` to the group, and its votes on all places that agree with a member.
    fn join(&mut self, new: usize) {
        let viewpoint = self.agreements.viewpoint(new);
        self.viewpoints.insert(viewpoint);
        let agreements = &self.agreements;
        self.candidates
            .retain(|&c| agreements.viewpoint(c) != viewpoint);
        let n_old = self.candidates.len();
        for i in 0..self.agreements.with(new).len() {
            let (place, distance_m) = self.agreements.with(new)[i];
            self.agreed_last[place] = new;
            if !self.is_known[place] {
                self.is_known[place] = true;
                if self.viewpoints.contains(&self.agreements.viewpoint(place)) {
                    continue;
                }
                self.candidates.push(place);
                self.votes[place] = self.votes_before(place);
            }
            self.votes[place].agree(distance_m, self.gates);
        }
        let comparable = self.agreements.comparable(new);
        for &c in &self.candidates[..n_old] {
            let disagrees = self.agreed_last[c] != new && comparable[c];
            self.votes[c].disagreeing += u32::from(disagrees);
        }
        self.members.push(new);
    }

    /// The votes of the members on `place`, with which none of them agrees.
    fn votes_before(&mut self, place: usize) -> MemberVotes {
        let mut votes = MemberVotes::default();
        for &member in &self.members {
            votes.disagreeing += u32::from(self.agreements.comparable(member)[place]);
        }
        votes
    }
}
