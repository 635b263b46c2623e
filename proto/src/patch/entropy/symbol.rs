//! Integers as bits with contexts (Exp-Golomb form, bit by bit), for modes and corrections.

use super::range_coder::{BitCoder, Probability};

/// Contexts of one [`number`]: zero, sign, length, second bit.
pub(in crate::patch) const NUMBER: usize = 2 + 2 * MOST_BITS;
/// Largest number of bits of a magnitude after the first.
const MOST_BITS: usize = 9;

/// Codes an integer that is usually near 0, at most 1,023 either way; a read value is within that
/// range.
pub(in crate::patch) fn number<C: BitCoder>(
    coder: &mut C,
    contexts: &mut [Probability],
    value: i32,
) -> i32 {
    let (head, rest) = contexts.split_at_mut(2);
    if !coder.code(value != 0, &mut head[0]) {
        return 0;
    }
    let negative = coder.code(value < 0, &mut head[1]);
    let (length, second) = rest.split_at_mut(MOST_BITS);
    let whole = value.unsigned_abs();
    let bits = whole.max(1).ilog2() as usize;
    let mut n = 0;
    while n < MOST_BITS && coder.code(n < bits, &mut length[n]) {
        n += 1;
    }
    let mut coded = 1;
    for i in (0..n).rev() {
        let bit = whole >> i & 1 == 1;
        // Bits below the second are practically random.
        let bit = if i + 1 == n {
            coder.code(bit, &mut second[i])
        } else {
            coder.even(bit)
        };
        coded = coded << 1 | i32::from(bit);
    }
    if negative { -coded } else { coded }
}

/// Codes the lowest `bits` of a number, all practically random.
pub(in crate::patch) fn plain<C: BitCoder>(coder: &mut C, bits: u32, value: u32) -> u32 {
    (0..bits).rev().fold(0, |coded, i| {
        coded << 1 | u32::from(coder.even(value >> i & 1 == 1))
    })
}

/// Codes a number below `contexts.len() + 1`, a power of two, bit by bit from the highest, each in
/// the context of the bits above it.
pub(in crate::patch) fn tree<C: BitCoder>(
    coder: &mut C,
    contexts: &mut [Probability],
    value: usize,
) -> usize {
    let leaves = contexts.len() + 1;
    let mut node = 1;
    while node < leaves {
        // The path of the value: its leading bits, as many as were coded.
        let next = (leaves | value) >> (leaves.ilog2() - node.ilog2() - 1);
        node = node << 1 | usize::from(coder.code(next & 1 == 1, &mut contexts[node - 1]));
    }
    node - leaves
}

/// Codes a count, at most the number of contexts.
pub(in crate::patch) fn count<C: BitCoder>(
    coder: &mut C,
    contexts: &mut [Probability],
    value: usize,
) -> usize {
    let more = |(i, context): (usize, &mut Probability)| coder.code(i < value, context);
    contexts
        .iter_mut()
        .enumerate()
        .map(more)
        .take_while(|&more| more)
        .count()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::range_coder::{BitReader, BitWriter};
    use super::*;

    /// Checks that everything `code` codes is read back, and that the contexts of both sides stay
    /// equal.
    fn check<T: Copy + PartialEq + std::fmt::Debug + Default>(
        values: &[T],
        n_contexts: usize,
        code: impl Fn(&mut dyn AnyCoder, &mut [Probability], T) -> T,
    ) {
        let mut contexts = vec![Probability::even(); n_contexts];
        let mut writer = BitWriter::new(Vec::new());
        for &value in values {
            assert_eq!(code(&mut writer, &mut contexts, value), value);
        }
        let bytes = writer.finish();
        let mut contexts = vec![Probability::even(); n_contexts];
        let mut reader = BitReader::new(&bytes);
        for &value in values {
            assert_eq!(code(&mut reader, &mut contexts, T::default()), value);
        }
    }

    /// A coder of either direction.
    trait AnyCoder {
        fn any_number(&mut self, contexts: &mut [Probability], value: i32) -> i32;
        fn any_tree(&mut self, contexts: &mut [Probability], value: usize) -> usize;
        fn any_count(&mut self, contexts: &mut [Probability], value: usize) -> usize;
    }

    impl<C: BitCoder> AnyCoder for C {
        fn any_number(&mut self, contexts: &mut [Probability], value: i32) -> i32 {
            number(self, contexts, value)
        }
        fn any_tree(&mut self, contexts: &mut [Probability], value: usize) -> usize {
            tree(self, contexts, value)
        }
        fn any_count(&mut self, contexts: &mut [Probability], value: usize) -> usize {
            count(self, contexts, value)
        }
    }

    proptest! {
        #[test]
        fn numbers_are_read_back(values in prop::collection::vec(-1023i32..=1023, 0..60)) {
            check(&values, NUMBER, |coder, contexts, value| coder.any_number(contexts, value));
        }

        #[test]
        fn leaves_are_read_back(values in prop::collection::vec(0usize..16, 0..60)) {
            check(&values, 15, |coder, contexts, value| coder.any_tree(contexts, value));
        }

        #[test]
        fn counts_are_read_back(values in prop::collection::vec(0usize..=4, 0..60)) {
            check(&values, 4, |coder, contexts, value| coder.any_count(contexts, value));
        }
    }
}
