//! Patches of strangers: decoding ends, and what was decoded is encoded again, without loss and at every compression level.
#![no_main]

use farfield_proto::patch::{Decoder, EncodedMaps, Encoder, Maps, CompressionLevel};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|input: (u16, u16, u8, &[u8])| {
    let (width, height, keypoints, bytes) = input;
    let encoded = EncodedMaps { width, height, keypoints, bytes: bytes.to_vec() };
    let mut maps = Maps::default();
    if Decoder::new().decode(&encoded, &mut maps).is_ok() {
        let mut twice = Maps::default();
        let mut encoder = Encoder::new();
        let again = encoder.encode_above(&maps, 0);
        Decoder::new().decode(&again, &mut twice).expect("an encoder's own bytes can be decoded");
        assert_eq!(maps, twice);
        for level in CompressionLevel::all() {
            let again = encoder.encode(&maps, level);
            Decoder::new().decode(&again, &mut twice).expect("an encoder's own bytes can be decoded");
        }
    }
});
