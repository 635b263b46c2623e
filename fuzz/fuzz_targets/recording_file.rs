//! Recordings of any content: read through, to their end or to where they are broken, never a panic.
#![no_main]

use std::io::Cursor;

use farfield_fusion::recording::reader::Recording;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let Ok(mut recording) = Recording::open(Cursor::new(bytes)) else {
        return;
    };
    for part in recording.sessions().to_vec() {
        let [first, last] = part.ticks;
        for tick in [first, last] {
            let sets = recording.sets(part.session, tick);
            let poses = recording.poses(part.session, tick);
            assert!(sets.is_ok() && poses.is_ok(), "what was found is found again");
        }
    }
});
