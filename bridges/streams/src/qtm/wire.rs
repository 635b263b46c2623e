//! Packets: a head of size and kind, 32 bits each, little endian, and what is in them.

use thiserror::Error;

/// Length of a packet's head, bytes.
const HEAD: usize = 8;
/// Most bytes of a packet that a client may send: commands have tens, settings some thousands.
const MAX_PACKET: usize = 64 * 1024;

/// What a packet is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PacketKind {
    /// Text: what was wrong.
    Error = 0,
    /// Text: a command, or the answer to one.
    Command = 1,
    /// Text: parameters.
    Xml = 2,
    /// Components of a frame.
    Data = 3,
    /// There is no frame.
    NoMoreData = 4,
    /// One byte: something happened.
    Event = 6,
}

/// A packet of a client.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Packet {
    /// Number of its kind, as sent.
    pub kind: u32,
    /// What follows the head.
    pub payload: Vec<u8>,
}

/// A client announced a packet that no command is as long as.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[error("found a packet of {found} bytes, expected 8 to {MAX_PACKET}")]
pub struct TooLong {
    /// The size in its head.
    pub found: u32,
}

/// Bytes of a client, until they are whole packets. Holds at most one packet and what was read beyond it.
#[derive(Debug, Default)]
pub struct Incoming {
    bytes: Vec<u8>,
}

impl Incoming {
    /// Takes bytes as they come.
    pub fn push(&mut self, bytes: &[u8]) {
        self.bytes.extend_from_slice(bytes);
    }

    /// The next whole packet; `None` until there is one.
    ///
    /// # Errors
    /// A size that no packet has: nothing that follows can be understood.
    pub fn take(&mut self) -> Result<Option<Packet>, TooLong> {
        let word = |at: usize| {
            let four = self.bytes.get(at..at + 4)?;
            Some(u32::from_le_bytes(four.try_into().ok()?))
        };
        let (Some(size), Some(kind)) = (word(0), word(4)) else {
            return Ok(None);
        };
        let n = size as usize;
        if !(HEAD..=MAX_PACKET).contains(&n) {
            return Err(TooLong { found: size });
        }
        let Some(payload) = self.bytes.get(HEAD..n) else {
            return Ok(None);
        };
        let payload = payload.to_vec();
        self.bytes.drain(..n);
        Ok(Some(Packet { kind, payload }))
    }
}

/// A packet of that kind.
pub(crate) fn packet(kind: PacketKind, payload: &[u8]) -> Vec<u8> {
    let size = u32::try_from(HEAD + payload.len()).unwrap_or(u32::MAX);
    let mut bytes = Vec::with_capacity(HEAD + payload.len());
    bytes.extend_from_slice(&size.to_le_bytes());
    bytes.extend_from_slice(&(kind as u32).to_le_bytes());
    bytes.extend_from_slice(payload);
    bytes
}

/// A packet of text, which ends with a zero.
pub(crate) fn text(kind: PacketKind, text: &str) -> Vec<u8> {
    let mut payload = text.as_bytes().to_vec();
    payload.push(0);
    packet(kind, &payload)
}

/// The text of a packet: up to the first zero, as UTF-8 where it is that.
pub(crate) fn text_of(payload: &[u8]) -> String {
    let end = payload
        .iter()
        .position(|byte| *byte == 0)
        .unwrap_or(payload.len());
    String::from_utf8_lossy(payload.get(..end).unwrap_or_default()).into_owned()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn packets_come_out_as_they_went_in_however_they_are_cut(
            texts in prop::collection::vec("[a-zA-Z0-9: ]{0,40}", 0..6), cut in 1usize..9,
        ) {
            let sent: Vec<u8> = texts.iter().flat_map(|t| text(PacketKind::Command, t)).collect();
            let (mut incoming, mut got) = (Incoming::default(), Vec::new());
            for piece in sent.chunks(cut) {
                incoming.push(piece);
                while let Some(packet) = incoming.take().unwrap() {
                    prop_assert_eq!(packet.kind, PacketKind::Command as u32);
                    got.push(text_of(&packet.payload));
                }
            }
            prop_assert_eq!(got, texts);
        }

        #[test]
        fn no_bytes_panic(bytes in prop::collection::vec(any::<u8>(), 0..64)) {
            let mut incoming = Incoming::default();
            incoming.push(&bytes);
            while let Ok(Some(packet)) = incoming.take() {
                text_of(&packet.payload);
            }
        }
    }

    #[test]
    fn a_packet_of_impossible_size_is_refused_before_it_is_read() {
        for size in [0u32, 7, 65_537, u32::MAX] {
            let mut incoming = Incoming::default();
            incoming.push(&size.to_le_bytes());
            incoming.push(&1u32.to_le_bytes());
            assert_eq!(incoming.take(), Err(TooLong { found: size }));
        }
    }
}
