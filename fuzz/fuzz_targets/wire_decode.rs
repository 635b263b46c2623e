//! Messages of strangers: the first byte chooses the kind, the rest is the message. The seeds are written by
//! `cargo run -p farfield-testbed --example write_fuzz_seeds -- fuzz/corpus`, in the order of the kinds here.
#![no_main]

use farfield_proto::decision::Decision;
use farfield_proto::fill::{FillRequest, Filled};
use farfield_proto::handout::{Chunk, FileList, HandoutRequest, SignedList};
use farfield_proto::message::identity_event::IdentityEventSet;
use farfield_proto::message::{BoxSet, PatchSet, PoseSet, SightingSet, Status};
use farfield_proto::wire::{Message, decode, encode};
use libfuzzer_sys::fuzz_target;

fn check<M: Message>(bytes: &[u8]) {
    if let Ok(message) = decode::<M>(bytes) {
        assert!(decode::<M>(&encode(&message)).is_ok());
    }
}

fuzz_target!(|bytes: &[u8]| {
    let Some((kind, bytes)) = bytes.split_first() else {
        return;
    };
    match kind % 13 {
        0 => check::<PatchSet>(bytes),
        1 => check::<BoxSet>(bytes),
        2 => check::<SightingSet>(bytes),
        3 => check::<PoseSet>(bytes),
        4 => check::<Status>(bytes),
        5 => check::<Decision>(bytes),
        6 => check::<FillRequest>(bytes),
        7 => check::<Filled>(bytes),
        8 => check::<HandoutRequest>(bytes),
        9 => check::<FileList>(bytes),
        10 => check::<SignedList>(bytes),
        11 => check::<Chunk>(bytes),
        _ => check::<IdentityEventSet>(bytes),
    }
});
