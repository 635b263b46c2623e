//! Motion clips (BVH) of any content: read or refused, never a panic.
#![no_main]

use std::hint::black_box;
use std::path::Path;

use farfield_sim::motion::Clip;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|text: &str| {
    if let Ok(clip) = Clip::parse(text, Path::new("clip.bvh")) {
        black_box(clip);
    }
});
