//! Messages of strangers.

use farfield_proto::message::decision::Decision;
use farfield_proto::message::fill::{FillRequest, Filled};
use farfield_proto::message::handout::{Chunk, FileList, HandoutRequest, SignedList};
use farfield_proto::message::identity_event::IdentityEventSet;
use farfield_proto::message::naming::NamingSet;
use farfield_proto::message::thumbnail::Thumbnail;
use farfield_proto::message::{BoxSet, PatchSet, PoseSet, SightingSet, Status};
use farfield_proto::patch::{CompressionLevel, Decoder, EncodedMaps, Encoder, Maps};
use farfield_proto::wire::{Message, decode, encode};

use super::{refused, size};

/// Patches: decoding ends, and decoded maps are encoded again, without loss and at every level. Width, height (two bytes each,
/// the low one first) and number of maps come before the bytes of the maps; missing bytes of these five are 0.
pub(super) fn patch_decode(bytes: &[u8]) -> String {
    let mut head = [0; 5];
    let (start, rest) = bytes.split_at(bytes.len().min(head.len()));
    head[..start.len()].copy_from_slice(start);
    let [w0, w1, h0, h1, keypoints] = head;
    let encoded = EncodedMaps {
        width: u16::from_le_bytes([w0, w1]),
        height: u16::from_le_bytes([h0, h1]),
        keypoints,
        bytes: rest.to_vec(),
    };
    let mut maps = Maps::default();
    if let Err(error) = Decoder::new().decode(&encoded, &mut maps) {
        return refused(&error);
    }
    let mut twice = Maps::default();
    let mut encoder = Encoder::new();
    let again = encoder.encode_above(&maps, 0);
    let decoded = Decoder::new().decode(&again, &mut twice);
    decoded.expect("an encoder's own bytes can be decoded");
    assert_eq!(maps, twice);
    let mut sizes = vec![size(again.bytes.len())];
    for level in CompressionLevel::all() {
        let again = encoder.encode(&maps, level);
        let decoded = Decoder::new().decode(&again, &mut twice);
        decoded.expect("an encoder's own bytes can be decoded");
        sizes.push(size(again.bytes.len()));
    }
    format!("read, {sizes:?}")
}

/// Number of message kinds in [`wire_decode`].
pub(crate) const KINDS: u8 = 15;

/// Messages of any kind: the first byte chooses the kind, the rest is the message. `lab fuzz-seeds` writes one of each, in
/// this order.
pub(super) fn wire_decode(bytes: &[u8]) -> String {
    let Some((kind, bytes)) = bytes.split_first() else {
        return "nothing".to_owned();
    };
    let kind = kind % KINDS;
    let behaviour = match kind {
        0 => decoded::<PatchSet>(bytes),
        1 => decoded::<BoxSet>(bytes),
        2 => decoded::<SightingSet>(bytes),
        3 => decoded::<PoseSet>(bytes),
        4 => decoded::<Status>(bytes),
        5 => decoded::<Decision>(bytes),
        6 => decoded::<FillRequest>(bytes),
        7 => decoded::<Filled>(bytes),
        8 => decoded::<HandoutRequest>(bytes),
        9 => decoded::<FileList>(bytes),
        10 => decoded::<SignedList>(bytes),
        11 => decoded::<Chunk>(bytes),
        12 => decoded::<IdentityEventSet>(bytes),
        13 => decoded::<Thumbnail>(bytes),
        _ => decoded::<NamingSet>(bytes),
    };
    format!("{kind}: {behaviour}")
}

fn decoded<M: Message>(bytes: &[u8]) -> String {
    match decode::<M>(bytes) {
        Err(error) => format!("{}, {}", refused(&error), size(bytes.len())),
        Ok(message) => {
            let again = encode(&message);
            assert!(
                decode::<M>(&again).is_ok(),
                "a decoded message can be encoded"
            );
            format!("read, {}", size(again.len()))
        }
    }
}
