//! Things that are linked, however indirectly, as groups.

/// Groups of things by their index.
#[derive(Debug, Clone, Default)]
pub(super) struct Groups {
    /// Per thing, another of its group that comes before it, or itself.
    before: Vec<usize>,
    numbers: Vec<Option<usize>>,
}

impl Groups {
    /// `n` things, each alone.
    pub(super) fn reset(&mut self, n: usize) {
        self.before.clear();
        self.before.extend(0..n);
    }

    /// Makes the groups of two things one.
    pub(super) fn link(&mut self, a: usize, b: usize) {
        let (a, b) = (self.first_of(a), self.first_of(b));
        self.before[a.max(b)] = a.min(b);
    }

    /// Numbers the groups in the order of their first things, of the things that are `kept`; returns how many there
    /// are.
    pub(super) fn number(&mut self, kept: impl Fn(usize) -> bool) -> usize {
        let mut n = 0;
        self.numbers.clear();
        self.numbers.resize(self.before.len(), None);
        for thing in (0..self.before.len()).filter(|thing| kept(*thing)) {
            let first = self.first_of(thing);
            let number = *self.numbers[first].get_or_insert_with(|| {
                n += 1;
                n - 1
            });
            self.numbers[thing] = Some(number);
        }
        // The first of a group may be none that is kept.
        for thing in (0..self.before.len()).filter(|thing| !kept(*thing)) {
            self.numbers[thing] = None;
        }
        n
    }

    /// Per thing, its group; `None` where it was not kept.
    pub(super) fn numbers(&self) -> &[Option<usize>] {
        &self.numbers
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
    fn what_is_linked_through_others_is_one_group_and_what_is_not_kept_has_none() {
        let mut groups = Groups::default();
        groups.reset(7);
        for [a, b] in [[5, 6], [0, 4], [4, 2], [6, 5]] {
            groups.link(a, b);
        }
        assert_eq!(groups.number(|thing| thing != 0 && thing != 3), 3);
        let expected = [None, Some(0), Some(1), None, Some(1), Some(2), Some(2)];
        assert_eq!(groups.numbers(), expected);
        groups.reset(2);
        assert_eq!(groups.number(|_| true), 2);
        assert_eq!(groups.numbers(), [Some(0), Some(1)]);
    }
}
