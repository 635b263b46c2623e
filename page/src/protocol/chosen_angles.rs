//! Kind 3: the selected angles of the selected people at a tick.

use farfield_proto::id::PersonId;
use farfield_proto::tick::Tick;

use super::{PROTOCOL, ReadError, Reader};

/// The kind of this message.
pub const KIND: u8 = 3;
const HEAD_BYTES: usize = 24;

/// Selected angles of selected people.
#[derive(Debug, Clone, PartialEq)]
pub struct ChosenAngles {
    /// The lower half of fusion's session.
    pub session: u32,
    /// The tick.
    pub tick: Tick,
    /// Number of angles per person, at most 255.
    pub angles: u8,
    /// The people that are present, with angles in the order of the request, each in its unit; 0
    /// for missing ones.
    pub persons: Vec<(PersonId, Vec<f32>)>,
}

impl ChosenAngles {
    /// Encodes the message.
    pub fn encode(&self) -> Vec<u8> {
        let n = self.persons.len().min(usize::from(u16::MAX));
        let mut bytes = Vec::with_capacity(HEAD_BYTES + n * (4 + 4 * usize::from(self.angles)));
        bytes.extend([PROTOCOL, KIND]);
        bytes.extend((n as u16).to_le_bytes());
        bytes.extend(self.session.to_le_bytes());
        bytes.extend(self.tick.0.to_le_bytes());
        bytes.extend([self.angles, 0, 0, 0, 0, 0, 0, 0]);
        for (id, values) in self.persons.iter().take(n) {
            bytes.extend(id.0.to_le_bytes());
            for i in 0..usize::from(self.angles) {
                bytes.extend(values.get(i).copied().unwrap_or_default().to_le_bytes());
            }
        }
        bytes
    }

    /// Decodes a message.
    ///
    /// # Errors
    /// [`ReadError`] if the bytes are not such a message.
    pub fn decode(bytes: &[u8]) -> Result<Self, ReadError> {
        let reader = Reader::with_kind(bytes, KIND)?;
        let (n, angles) = (usize::from(reader.u16(2)?), reader.u8(16)?);
        let stride = 4 + 4 * usize::from(angles);
        reader.holds(HEAD_BYTES + n * stride)?;
        let person = |i: usize| -> Result<(PersonId, Vec<f32>), ReadError> {
            let at = HEAD_BYTES + i * stride;
            let values = (0..usize::from(angles)).map(|a| reader.f32(at + 4 + 4 * a));
            Ok((PersonId(reader.u32(at)?), values.collect::<Result<_, _>>()?))
        };
        Ok(Self {
            session: reader.u32(4)?,
            tick: Tick(reader.i64(8)?),
            angles,
            persons: (0..n).map(person).collect::<Result<_, _>>()?,
        })
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn chosen_angles_round_trip(
            session: u32,
            tick: i64,
            values in prop::collection::vec((any::<u32>(), prop::collection::vec(-3.0f32..3.0, 4)), 0..9),
        ) {
            let chosen = ChosenAngles {
                session,
                tick: Tick(tick),
                angles: 4,
                persons: values.into_iter().map(|(id, values)| (PersonId(id), values)).collect(),
            };
            prop_assert_eq!(ChosenAngles::decode(&chosen.encode()).unwrap(), chosen);
        }

        #[test]
        fn arbitrary_bytes_are_angles_or_an_error(bytes in prop::collection::vec(any::<u8>(), 0..100)) {
            let mut begun = vec![PROTOCOL, KIND];
            begun.extend(bytes);
            let _read = ChosenAngles::decode(&begun);
        }
    }
}
