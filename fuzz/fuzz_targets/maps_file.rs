//! Files of maps made beforehand: read or refused. The checksum is made to fit, or nothing behind it
//! would ever be reached.
#![no_main]

use std::sync::{Arc, LazyLock};

use farfield_proto::camera::CameraModel;
use farfield_sim::embedded;
use farfield_sim::maps_file::MapsFile;
use libfuzzer_sys::fuzz_target;

const MAGIC: &[u8] = b"FARFIELD-MAPS\0\x01";

static CAMERA: LazyLock<Arc<CameraModel>> = LazyLock::new(|| {
    let scene = embedded::scene("court").expect("an embedded scene can be read");
    Arc::new(scene.cameras()[0].clone())
});

fuzz_target!(|rest: &[u8]| {
    let mut bytes = [MAGIC, rest].concat();
    let checksum = blake3::hash(&bytes);
    bytes.extend_from_slice(checksum.as_bytes());
    let Ok(file) = MapsFile::parse(bytes) else {
        return;
    };
    for tick in 0..u64::from(file.header().ticks).min(4) {
        if let Ok(Some(seen)) = file.observation(tick, &CAMERA) {
            let seen: &dyn farfield_edge::source::MapPainter = &seen;
            assert!(seen.persons().iter().all(|person| person.len() == 17));
        }
    }
});
