//! Packets: size and kind, 32 bits each, little endian, then the content.

use thiserror::Error;

/// Length of a packet's header, bytes.
const HEAD: usize = 8;
/// Maximum size of a client's packet, bytes; commands have tens, settings some thousands.
const MAX_PACKET: usize = 64 * 1024;

/// Kind of a packet.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PacketKind {
    /// Text: an error.
    Error = 0,
    /// Text: a command or its answer.
    Command = 1,
    /// Text: parameters.
    Xml = 2,
    /// Components of a frame.
    Data = 3,
    /// There is no frame.
    NoMoreData = 4,
    /// One byte: an event.
    Event = 6,
}

/// A packet of a client.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Packet {
    /// Number of its kind on the wire.
    pub kind: u32,
    /// The content after the header.
    pub payload: Vec<u8>,
}

/// A client announced a packet that is longer than any command.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[error("found a packet of {found} bytes, expected 8 to {MAX_PACKET}")]
pub struct TooLong {
    /// The announced size.
    pub found: u32,
}

/// Buffers a client's bytes until they form whole packets. Holds at most one packet and the bytes
/// read beyond it.
#[derive(Debug, Default)]
pub struct Incoming {
    bytes: Vec<u8>,
}

impl Incoming {
    /// Adds received bytes.
    pub fn push(&mut self, bytes: &[u8]) {
        self.bytes.extend_from_slice(bytes);
    }

    /// The next whole packet; `None` if incomplete.
    ///
    /// # Errors
    /// An invalid size; the following bytes cannot be interpreted.
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

/// A packet of this kind.
pub(crate) fn packet(kind: PacketKind, payload: &[u8]) -> Vec<u8> {
    let size = u32::try_from(HEAD + payload.len()).unwrap_or(u32::MAX);
    let mut bytes = Vec::with_capacity(HEAD + payload.len());
    bytes.extend_from_slice(&size.to_le_bytes());
    bytes.extend_from_slice(&(kind as u32).to_le_bytes());
    bytes.extend_from_slice(payload);
    bytes
}

/// A packet with zero-terminated text.
pub(crate) fn text(kind: PacketKind, text: &str) -> Vec<u8> {
    let mut payload = text.as_bytes().to_vec();
    payload.push(0);
    packet(kind, &payload)
}

/// The text of a packet: up to the first zero, as lossy UTF-8.
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
        fn packets_round_trip_in_arbitrary_pieces(
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
    fn packets_of_invalid_size_are_refused_before_reading() {
        for size in [0u32, 7, 65_537, u32::MAX] {
            let mut incoming = Incoming::default();
            incoming.push(&size.to_le_bytes());
            incoming.push(&1u32.to_le_bytes());
            assert_eq!(incoming.take(), Err(TooLong { found: size }));
        }
    }
}
