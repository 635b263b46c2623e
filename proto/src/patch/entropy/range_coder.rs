//! An adaptive binary range coder: bits to bytes at nearly their information.
//!
//! Range coding after Martin 1979, with the carry handling of LZMA. Both directions implement [`BitCoder`], so that one
//! walk over the maps serves both and they cannot fall out of step.

use std::hint::select_unpredictable;

/// The least probability of either bit, of 65,536: an unexpected bit costs at most 10 bits, an expected one at least
/// 0.0014 bits.
const LEAST: u32 = 64;
/// Below this range a byte is shifted out.
const BYTE_DUE: u32 = 1 << 24;
/// Bytes that a decoder reads past the end of a whole stream: it is four ahead, and the encoder
/// ends with one.
const READ_AHEAD: usize = 3;

/// Fraction bits of [`Rate::share`]: with these, products with 16 bits are the quotients, exactly.
const SHARE_BITS: u32 = 23;

/// How fast is learnt after some bits.
#[derive(Debug, Clone, Copy)]
struct Rate {
    /// 1/(n + 2), rounded up, for n bits seen.
    share: u32,
    /// How many are then seen.
    next: u8,
}

/// By how many bits were seen; for every `u8`, so that no index needs a check.
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

/// How probable a `false` is, learnt from the bits so far: fast at first, then slower.
#[derive(Debug, Clone, Copy)]
pub(in crate::patch) struct Probability {
    /// Probability of `false`, of 65,536.
    of_false: u16,
    /// Bits seen, up to [`Self::MEMORY`].
    seen: u8,
}

impl Probability {
    /// Over how many bits is averaged in the end.
    const MEMORY: u8 = 60;
    /// As how many seen bits a prior counts.
    const BEFOREHAND: u8 = 10;

    /// Nothing known.
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

    /// Known beforehand as if from some bits already.
    pub(in crate::patch) const fn known(of_false: u16) -> Self {
        Self {
            of_false,
            seen: Self::BEFOREHAND,
        }
    }

    /// Moves towards what was seen by 1/2, 1/3, 1/4 and so on of the way there; `of_false` is 0 after a `true`, and has
    /// all bits after a `false`.
    ///
    /// No branch depends on the bit: of a `false`, the way is the complement of the negative one less one.
    #[inline]
    fn learn(&mut self, of_false: u32) {
        let Rate { share, next } = RATES[usize::from(self.seen)];
        let own = u32::from(self.of_false);
        let end = LEAST + (of_false & (u32::from(u16::MAX) + 2 - 2 * LEAST));
        let way = own.wrapping_sub(end) ^ of_false;
        let part = ((u64::from(way) * u64::from(share)) >> SHARE_BITS) as u32;
        // Between its two ends at all times, so nothing here leaves 16 bits.
        let learnt = own.wrapping_add(of_false).wrapping_sub(part ^ of_false);
        (self.of_false, self.seen) = (learnt as u16, next);
    }

    /// The part of `range` that stands for `false`: above 0 and below `range`.
    fn share_of(self, range: u32) -> u32 {
        (range >> 16) * u32::from(self.of_false)
    }
}

/// One direction of the coder.
pub(in crate::patch) trait BitCoder {
    /// Whether the bits are known and written; else they are read.
    const WRITES: bool;

    /// Writes `bit` and returns it, or reads a bit and returns that.
    fn code(&mut self, bit: bool, probability: &mut Probability) -> bool;

    /// As [`Self::code`] of a bit that is as good as random.
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
    /// The last byte that a carry can still change, once there is one.
    held: Option<u8>,
    /// Bytes of 255 after it, through which a carry would run.
    pending: usize,
    bytes: Vec<u8>,
}

impl BitWriter {
    /// Writes to the end of `bytes`.
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

    /// The bytes, complete: the shortest number inside the last range ends them.
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

/// Bytes to bits; past their end it reads zeros, and says so afterwards.
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

    /// Bytes that no bit needed.
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
        // Chosen, not branched to: the bits are what cannot be foreseen.
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
        fn bits_come_back(bits in prop::collection::vec(any::<bool>(), 0..2000), contexts in 1usize..9) {
            check(&bits, contexts);
        }

        #[test]
        fn rare_bits_come_back(ones in prop::collection::vec(0usize..60_000, 0..12)) {
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
