//! Groups of things that are linked, directly or indirectly.

/// Groups of things by their index.
#[derive(Debug, Clone, Default)]
pub(super) struct Groups {
    /// Per thing, an earlier one of its group, or itself.
    before: Vec<usize>,
    /// Per first thing of a group, the group's number.
    numbers: Vec<Option<usize>>,
    /// Group number and index of the included things, by group.
    things: Vec<(usize, usize)>,
    /// Per group, the end of its things.
    ends: Vec<usize>,
}

impl Groups {
    /// `n` things, each alone.
    pub(super) fn reset(&mut self, n: usize) {
        self.before.clear();
        self.before.extend(0..n);
    }

    /// Merges the groups of two things.
    pub(super) fn link(&mut self, a: usize, b: usize) {
        let (a, b) = (self.first_of(a), self.first_of(b));
        self.before[a.max(b)] = a.min(b);
    }

    /// Whether two things are in one group.
    pub(super) fn are_linked(&mut self, a: usize, b: usize) -> bool {
        self.first_of(a) == self.first_of(b)
    }

    /// Numbers the groups of the `included` things in the order of their first ones; returns how
    /// many there are.
    pub(super) fn number(&mut self, included: impl Fn(usize) -> bool) -> usize {
        self.numbers.clear();
        self.numbers.resize(self.before.len(), None);
        self.things.clear();
        self.ends.clear();
        for thing in (0..self.before.len()).filter(|thing| included(*thing)) {
            let first = self.first_of(thing);
            let number = *self.numbers[first].get_or_insert_with(|| {
                self.ends.push(0);
                self.ends.len() - 1
            });
            self.ends[number] += 1;
            self.things.push((number, thing));
        }
        let mut end = 0;
        for own in &mut self.ends {
            end += *own;
            *own = end;
        }
        // By group; within one, in the original order.
        self.things.sort_unstable();
        self.ends.len()
    }

    /// The included things of a group, in order.
    pub(super) fn things(&self, group: usize) -> impl Iterator<Item = usize> {
        let first = group.checked_sub(1).map_or(0, |before| self.ends[before]);
        let own = self.things[first..self.ends[group]].iter();
        own.map(|&(_, thing)| thing)
    }

    fn first_of(&mut self, mut thing: usize) -> usize {
        while self.before[thing] != thing {
            self.before[thing] = self.before[self.before[thing]];
            thing = self.before[thing];
        }
        thing
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn indirect_links_make_one_group_and_excluded_things_none() {
        let mut groups = Groups::default();
        groups.reset(7);
        for [a, b] in [[5, 6], [0, 4], [4, 2], [6, 5]] {
            groups.link(a, b);
        }
        assert!(groups.are_linked(0, 2) && !groups.are_linked(0, 5));
        assert_eq!(groups.number(|thing| thing != 0 && thing != 3), 3);
        let things = |groups: &Groups, group| groups.things(group).collect::<Vec<_>>();
        let of_groups = [0, 1, 2].map(|group| things(&groups, group));
        assert_eq!(of_groups, [vec![1], vec![2, 4], vec![5, 6]]);
        groups.reset(2);
        assert_eq!(groups.number(|_| true), 2);
        assert_eq!([0, 1].map(|group| things(&groups, group)), [[0], [1]]);
    }
}
