//! An adaptive binary range coder: bits to bytes at nearly their information.
//!
//! Martin 1979's range coding with the carry handling of LZMA. Both directions stand behind
//! [`BitCoder`], so that one walk over the maps serves both and they cannot fall out of step.

/// The least probability of either bit, of 65,536: what a surprise may cost (10 bits) against what
/// an expected bit must (0.0014 bits).
const LEAST: u16 = 64;
/// Below this range a byte is shifted out.
const BYTE_DUE: u32 = 1 << 24;
/// Bytes that a decoder reads past the end of a whole stream: it is four ahead, and the encoder
/// ends with one.
const READ_AHEAD: usize = 3;

/// How probable a `false` is, learnt from the bits so far: fast at first, then slower.
#[derive(Debug, Clone, Copy)]
pub(super) struct Probability {
    /// Probability of `false`, of 65,536.
    of_false: u16,
    /// Bits seen, up to [`Self::MEMORY`].
    seen: u16,
}

impl Probability {
    /// Over how many bits is averaged in the end.
    const MEMORY: u16 = 60;

    /// Nothing known.
    pub(super) const fn even() -> Self {
        Self {
            of_false: 1 << 15,
            seen: 0,
        }
    }

    fn learn(&mut self, bit: bool) {
        let target = if bit {
            i32::from(LEAST)
        } else {
            65_536 - i32::from(LEAST)
        };
        let share = (target - i32::from(self.of_false)) / i32::from(self.seen + 2);
        // Between the two targets, so within 16 bits.
        self.of_false = (i32::from(self.of_false) + share) as u16;
        self.seen = (self.seen + 1).min(Self::MEMORY);
    }

    /// The part of `range` that stands for `false`: above 0 and below `range`.
    fn share_of(self, range: u32) -> u32 {
        (range >> 16) * u32::from(self.of_false)
    }
}

/// One direction of the coder.
pub(super) trait BitCoder {
    /// Whether the bits are known and written; else they are read.
    const WRITES: bool;

    /// Writes `bit` and returns it, or reads a bit and returns that.
    fn code(&mut self, bit: bool, probability: &mut Probability) -> bool;
}

/// Bits to bytes.
#[derive(Debug, Clone)]
pub(super) struct Writer {
    /// Start of the current range; bit 32 is a carry.
    low: u64,
    range: u32,
    /// The last byte that a carry can still change, once there is one.
    held: Option<u8>,
    /// Bytes of 255 after it, through which a carry would run.
    pending: usize,
    bytes: Vec<u8>,
}

impl Writer {
    /// Writes to the end of `bytes`.
    pub(super) fn new(bytes: Vec<u8>) -> Self {
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
    pub(super) fn finish(mut self) -> Vec<u8> {
        let step = u64::from(BYTE_DUE);
        self.low = self.low.div_ceil(step) * step;
        self.shift();
        self.shift();
        self.bytes
    }
}

impl BitCoder for Writer {
    const WRITES: bool = true;

    fn code(&mut self, bit: bool, probability: &mut Probability) -> bool {
        let share = probability.share_of(self.range);
        if bit {
            self.low += u64::from(share);
            self.range -= share;
        } else {
            self.range = share;
        }
        probability.learn(bit);
        while self.range < BYTE_DUE {
            self.range <<= 8;
            self.shift();
        }
        bit
    }
}

/// Bytes to bits; past their end it reads zeros, and says so afterwards.
#[derive(Debug, Clone)]
pub(super) struct Reader<'a> {
    bytes: &'a [u8],
    read: usize,
    code: u32,
    range: u32,
}

impl<'a> Reader<'a> {
    pub(super) fn new(bytes: &'a [u8]) -> Self {
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
        self.read = self.read.saturating_add(1);
        self.code = (self.code << 8) | u32::from(byte);
    }

    /// Whether more was read than a whole stream has.
    pub(super) fn is_past_end(&self) -> bool {
        self.read > self.bytes.len() + READ_AHEAD
    }

    /// Bytes that no bit needed.
    pub(super) fn left(&self) -> usize {
        (self.bytes.len() + READ_AHEAD).saturating_sub(self.read)
    }
}

impl BitCoder for Reader<'_> {
    const WRITES: bool = false;

    fn code(&mut self, _bit: bool, probability: &mut Probability) -> bool {
        let share = probability.share_of(self.range);
        let bit = self.code >= share;
        if bit {
            self.code -= share;
            self.range -= share;
        } else {
            self.range = share;
        }
        probability.learn(bit);
        while self.range < BYTE_DUE {
            self.range <<= 8;
            self.pull();
        }
        bit
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn written(bits: &[bool], contexts: usize) -> Vec<u8> {
        let mut probabilities = vec![Probability::even(); contexts];
        let mut writer = Writer::new(Vec::new());
        for (i, &bit) in bits.iter().enumerate() {
            writer.code(bit, &mut probabilities[i % contexts]);
        }
        writer.finish()
    }

    fn check(bits: &[bool], contexts: usize) {
        let bytes = written(bits, contexts);
        let mut probabilities = vec![Probability::even(); contexts];
        let mut reader = Reader::new(&bytes);
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
    fn an_expected_bit_costs_next_to_nothing() {
        assert!(written(&vec![false; 50_000], 1).len() < 40);
    }
}
