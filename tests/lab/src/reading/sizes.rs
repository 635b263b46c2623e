//! Lengths: their median, a high percentile, and the longest.

/// Lengths of many things of one kind.
#[derive(Clone, Debug, Default)]
pub struct Sizes {
    sorted: Vec<usize>,
}

impl Sizes {
    /// Of these lengths.
    pub fn of(lengths: impl IntoIterator<Item = usize>) -> Self {
        let mut sorted: Vec<usize> = lengths.into_iter().collect();
        sorted.sort_unstable();
        Self { sorted }
    }

    /// The length that `share` of 1 do not exceed; 0 when there are none. Nearest rank.
    pub fn at(&self, share: f64) -> usize {
        let rank = (share * self.sorted.len() as f64).ceil() as usize;
        self.sorted.get(rank.max(1) - 1).copied().unwrap_or(0)
    }

    /// The longest.
    pub fn max(&self) -> usize {
        self.at(1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::Sizes;

    #[test]
    fn percentiles_are_lengths_that_occur() {
        let sizes = Sizes::of([5, 1, 4, 2, 3, 6, 7, 8, 9, 10]);
        assert_eq!((sizes.at(0.5), sizes.at(0.9), sizes.max()), (5, 9, 10));
        assert_eq!(Sizes::of([7]).at(0.5), 7);
        assert_eq!(Sizes::of([]).max(), 0);
    }
}
