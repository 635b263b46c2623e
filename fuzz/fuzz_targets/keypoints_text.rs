//! Files of 2D keypoints of any content: see `keypoints_text` in `tests/lab/src/hostile_input/`.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| farfield_fuzz::run("keypoints_text", bytes));
