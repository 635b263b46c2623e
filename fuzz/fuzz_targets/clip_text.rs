//! Motion clips (BVH) of any content: see `clip_text` in `tests/lab/src/hostile_input/`.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| farfield_fuzz::run("clip_text", bytes));
