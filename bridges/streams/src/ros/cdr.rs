//! CDR, the encoding of ROS 2 messages: little endian, every number at a multiple of its own size.
//!
//! Source: OMG, *Common Object Request Broker Architecture*, part 2, 9.3 (CDR transfer syntax), with the encapsulation of
//! *The Real-time Publish-Subscribe Protocol* (DDSI-RTPS), 10.5: `CDR_LE`.

/// Length of the head that says how the rest is encoded; places count from behind it.
const HEAD: usize = 4;

/// A message as it grows.
#[derive(Debug)]
pub(super) struct Cdr(Vec<u8>);

impl Cdr {
    pub(super) fn new() -> Self {
        Self(vec![0, 1, 0, 0])
    }

    pub(super) fn finish(self) -> Vec<u8> {
        self.0
    }

    fn align(&mut self, to: usize) {
        while !(self.0.len() - HEAD).is_multiple_of(to) {
            self.0.push(0);
        }
    }

    pub(super) fn byte(&mut self, value: u8) {
        self.0.push(value);
    }

    pub(super) fn i32(&mut self, value: i32) {
        self.align(4);
        self.0.extend_from_slice(&value.to_le_bytes());
    }

    pub(super) fn u32(&mut self, value: u32) {
        self.align(4);
        self.0.extend_from_slice(&value.to_le_bytes());
    }

    pub(super) fn f32s(&mut self, values: &[f32]) {
        self.align(4);
        for value in values {
            self.0.extend_from_slice(&value.to_le_bytes());
        }
    }

    pub(super) fn f64s(&mut self, values: &[f64]) {
        self.align(8);
        for value in values {
            self.0.extend_from_slice(&value.to_le_bytes());
        }
    }

    /// How many elements follow.
    pub(super) fn count(&mut self, n: usize) {
        self.u32(u32::try_from(n).unwrap_or(u32::MAX));
    }

    /// Its length with the zero at its end, its bytes, the zero.
    pub(super) fn text(&mut self, text: &str) {
        self.count(text.len() + 1);
        self.0.extend_from_slice(text.as_bytes());
        self.0.push(0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_lie_at_multiples_of_their_size_counted_from_behind_the_head() {
        let mut cdr = Cdr::new();
        cdr.text("ab");
        cdr.f64s(&[1.0]);
        cdr.byte(7);
        cdr.u32(5);
        let mut expected = vec![0, 1, 0, 0, 3, 0, 0, 0, b'a', b'b', 0, 0];
        // "ab" ends at 7 behind the head: the double is at 8.
        expected.extend_from_slice(&1.0f64.to_le_bytes());
        expected.extend_from_slice(&[7, 0, 0, 0, 5, 0, 0, 0]);
        assert_eq!(cdr.finish(), expected);
    }
}
