//! An adaptive binary range coder, close to the entropy of the bits.
//!
//! Range coding after Martin 1979, with the carry handling of LZMA. Both directions implement
//! [`BitCoder`], so one traversal of the maps serves both, and they cannot diverge.

use std::hint::select_unpredictable;

/// The smallest probability of either bit, of 65,536: an unexpected bit costs at most 10 bits, an
/// expected one at least 0.0014 bits.
const LEAST: u32 = 64;
/// Below this range a byte is shifted out.
const BYTE_DUE: u32 = 1 << 24;
/// Bytes that a decoder reads past the end of a whole stream: it is four ahead, and the encoder
/// ends with one.
const READ_AHEAD: usize = 3;

/// Fraction bits of [`Rate::share`]: with these, products with 16 bits equal the exact quotients.
const SHARE_BITS: u32 = 23;

/// The learning rate after some bits.
#[derive(Debug, Clone, Copy)]
struct Rate {
    /// 1/(n + 2), rounded up, for n bits seen.
    share: u32,
    /// The number of bits seen next.
    next: u8,
}

/// By the number of bits seen; for every `u8`, so that no index needs a check.
const RATES: [Rate; 256] = {
    let mut rates = [Rate { share: 0, next: 0 }; 256];
    let mut n = 0;
    while n < rates.len() {
        let most = Probability::MEMORY as usize;
        rates[n] = Rate {
            share: (1u32 << SHARE_BITS).div_ceil(n as u32 + 2),
            next: if n < most { n as u8 + 1 } else { most as u8 },
        };
        n += 1;
    }
    rates
};

/// The adaptive probability of `false`: it changes fast at first, then slower.
#[derive(Debug, Clone, Copy)]
pub(in crate::patch) struct Probability {
    /// Probability of `false`, of 65,536.
    of_false: u16,
    /// Bits seen, up to [`Self::MEMORY`].
    seen: u8,
}

impl Probability {
    /// Length of the final average, bits.
    const MEMORY: u8 = 60;
    /// Number of bits that a prior counts as.
    const BEFOREHAND: u8 = 10;

    /// Without knowledge.
    pub(in crate::patch) const fn even() -> Self {
        Self {
            of_false: 1 << 15,
            seen: 0,
        }
    }

    /// The probability of `false`, of 65,536.
    pub(in crate::patch) fn of_false(self) -> u16 {
        self.of_false
    }

    /// With a prior that counts as some bits.
    pub(in crate::patch) const fn known(of_false: u16) -> Self {
        Self {
            of_false,
            seen: Self::BEFOREHAND,
        }
    }

    /// Moves towards the seen bit by 1/2, 1/3, 1/4 and so on of the difference; `of_false` is 0
    /// after a `true`, and has all bits set after a `false`.
    ///
    /// There is no branch on the bit: for a `false`, the difference is the complement of the
    /// negative one minus one.
    #[inline]
    fn learn(&mut self, of_false: u32) {
        let Rate { share, next } = RATES[usize::from(self.seen)];
        let own = u32::from(self.of_false);
        let end = LEAST + (of_false & (u32::from(u16::MAX) + 2 - 2 * LEAST));
        let way = own.wrapping_sub(end) ^ of_false;
        let part = ((u64::from(way) * u64::from(share)) >> SHARE_BITS) as u32;
        // Always between its two ends, so nothing here exceeds 16 bits.
        let learnt = own.wrapping_add(of_false).wrapping_sub(part ^ of_false);
        (self.of_false, self.seen) = (learnt as u16, next);
    }

    /// The part of `range` for `false`: above 0 and below `range`.
    fn share_of(self, range: u32) -> u32 {
        (range >> 16) * u32::from(self.of_false)
    }
}

/// One direction of the coder.
pub(in crate::patch) trait BitCoder {
    /// Whether the bits are known and written; otherwise they are read.
    const WRITES: bool;

    /// Writes `bit` and returns it, or reads a bit and returns that.
    fn code(&mut self, bit: bool, probability: &mut Probability) -> bool;

    /// As [`Self::code`] for a bit that is practically random.
    #[inline]
    fn even(&mut self, bit: bool) -> bool {
        self.code(bit, &mut Probability::even())
    }
}

/// Bits to bytes.
#[derive(Debug, Clone)]
pub(in crate::patch) struct BitWriter {
    /// Start of the current range; bit 32 is a carry.
    low: u64,
    range: u32,
    /// The last byte that a carry can still change, if any.
    held: Option<u8>,
    /// Number of 255 bytes after it, through which a carry would propagate.
    pending: usize,
    bytes: Vec<u8>,
}

impl BitWriter {
    /// Appends to `bytes`.
    pub(in crate::patch) fn new(bytes: Vec<u8>) -> Self {
        Self {
            low: 0,
            range: u32::MAX,
            held: None,
            pending: 0,
            bytes,
        }
    }

    fn shift(&mut self) {
        const CARRY: u64 = 1 << 32;
        if self.low < 0xff00_0000 || self.low >= CARRY {
            let carry = u8::from(self.low >= CARRY);
            if let Some(held) = self.held {
                self.bytes.push(held.wrapping_add(carry));
            }
            let run = std::mem::take(&mut self.pending);
            self.bytes
                .resize(self.bytes.len() + run, 0xff_u8.wrapping_add(carry));
            self.held = Some((self.low >> 24) as u8);
        } else {
            self.pending += 1;
        }
        self.low = (self.low & 0x00ff_ffff) << 8;
    }

    /// The complete bytes; the shortest number inside the last range ends them.
    pub(in crate::patch) fn finish(mut self) -> Vec<u8> {
        let step = u64::from(BYTE_DUE);
        self.low = self.low.div_ceil(step) * step;
        self.shift();
        self.shift();
        self.bytes
    }
}

impl BitCoder for BitWriter {
    const WRITES: bool = true;

    fn code(&mut self, bit: bool, probability: &mut Probability) -> bool {
        let share = probability.share_of(self.range);
        if bit {
            self.low += u64::from(share);
            self.range -= share;
        } else {
            self.range = share;
        }
        probability.learn(if bit { 0 } else { u32::MAX });
        while self.range < BYTE_DUE {
            self.range <<= 8;
            self.shift();
        }
        bit
    }
}

/// Reads bits from bytes; past the end it reads zeros and remembers it.
#[derive(Debug, Clone)]
pub(in crate::patch) struct BitReader<'a> {
    bytes: &'a [u8],
    read: usize,
    code: u32,
    range: u32,
}

impl<'a> BitReader<'a> {
    pub(in crate::patch) fn new(bytes: &'a [u8]) -> Self {
        let mut reader = Self {
            bytes,
            read: 0,
            code: 0,
            range: u32::MAX,
        };
        (0..4).for_each(|_| reader.pull());
        reader
    }

    fn pull(&mut self) {
        let byte = self.bytes.get(self.read).copied().unwrap_or(0);
        self.read += 1;
        self.code = (self.code << 8) | u32::from(byte);
    }

    /// Whether more was read than a whole stream has.
    pub(in crate::patch) fn is_past_end(&self) -> bool {
        self.read > self.bytes.len() + READ_AHEAD
    }

    /// Number of unread bytes.
    pub(in crate::patch) fn left(&self) -> usize {
        (self.bytes.len() + READ_AHEAD).saturating_sub(self.read)
    }
}

impl BitCoder for BitReader<'_> {
    const WRITES: bool = false;

    #[inline]
    fn code(&mut self, _bit: bool, probability: &mut Probability) -> bool {
        let share = probability.share_of(self.range);
        let (above, is_below) = self.code.overflowing_sub(share);
        // A select instead of a branch, because the bits are unpredictable.
        self.code = select_unpredictable(is_below, self.code, above);
        self.range = select_unpredictable(is_below, share, self.range - share);
        probability.learn(select_unpredictable(is_below, u32::MAX, 0));
        while self.range < BYTE_DUE {
            self.range <<= 8;
            self.pull();
        }
        !is_below
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn written(bits: &[bool], contexts: usize) -> Vec<u8> {
        let mut probabilities = vec![Probability::even(); contexts];
        let mut writer = BitWriter::new(Vec::new());
        for (i, &bit) in bits.iter().enumerate() {
            writer.code(bit, &mut probabilities[i % contexts]);
        }
        writer.finish()
    }

    fn check(bits: &[bool], contexts: usize) {
        let bytes = written(bits, contexts);
        let mut probabilities = vec![Probability::even(); contexts];
        let mut reader = BitReader::new(&bytes);
        for (i, &bit) in bits.iter().enumerate() {
            assert_eq!(
                reader.code(false, &mut probabilities[i % contexts]),
                bit,
                "bit {i}"
            );
            assert!(!reader.is_past_end(), "bit {i}");
        }
        assert_eq!(reader.left(), 0);
    }

    proptest! {
        #[test]
        fn written_bits_are_read_back(bits in prop::collection::vec(any::<bool>(), 0..2000), contexts in 1usize..9) {
            check(&bits, contexts);
        }

        #[test]
        fn rare_bits_are_read_back(ones in prop::collection::vec(0usize..60_000, 0..12)) {
            let mut bits = vec![false; 60_000];
            for i in ones {
                bits[i] = true;
            }
            check(&bits, 1);
            let inverse: Vec<bool> = bits.iter().map(|b| !b).collect();
            check(&inverse, 1);
        }
    }

    #[test]
    fn a_bit_moves_its_probability_by_the_stated_share_of_the_way() {
        let ends = [65_536 - LEAST.cast_signed(), LEAST.cast_signed()];
        for seen in 0..=Probability::MEMORY {
            for of_false in LEAST as u16..=(65_536 - LEAST) as u16 {
                for bit in [false, true] {
                    let mut learnt = Probability { of_false, seen };
                    learnt.learn(if bit { 0 } else { u32::MAX });
                    let way = ends[usize::from(bit)] - i32::from(of_false);
                    let expected = i32::from(of_false) + way / i32::from(seen + 2);
                    assert_eq!(i32::from(learnt.of_false), expected);
                }
            }
        }
    }

    #[test]
    fn an_expected_bit_costs_next_to_nothing() {
        assert!(written(&vec![false; 50_000], 1).len() < 40);
    }
}
