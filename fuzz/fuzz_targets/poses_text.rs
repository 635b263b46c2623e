//! Files of poses or truth of any content: read or refused, never a panic.
#![no_main]

use std::hint::black_box;
use std::path::Path;

use farfield_score::lines::{Recording, Role};
use farfield_score::points::PointSet;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let path = Path::new("poses.jsonl");
    for points in [PointSet::Joints, PointSet::Shelf14] {
        for role in [Role::Poses, Role::Truth] {
            black_box(Recording::read(bytes, path, role, points, None).is_ok());
        }
    }
});
