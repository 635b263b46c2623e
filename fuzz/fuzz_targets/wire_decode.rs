//! Messages of strangers: the first byte chooses the kind, the rest is the message.
#![no_main]

use farfield_proto::message::{BoxSet, PatchSet, PoseSet, SightingSet, Status};
use farfield_proto::wire::{Message, decode, encode};
use libfuzzer_sys::fuzz_target;

fn check<M: Message>(bytes: &[u8]) {
    if let Ok(message) = decode::<M>(bytes) {
        assert!(decode::<M>(&encode(&message)).is_ok());
    }
}

fuzz_target!(|bytes: &[u8]| {
    let Some((kind, bytes)) = bytes.split_first() else { return };
    match kind % 5 {
        0 => check::<PatchSet>(bytes),
        1 => check::<BoxSet>(bytes),
        2 => check::<SightingSet>(bytes),
        3 => check::<PoseSet>(bytes),
        _ => check::<Status>(bytes),
    }
});
