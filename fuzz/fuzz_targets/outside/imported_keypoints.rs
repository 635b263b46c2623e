//! Keypoints of other programs of any content: see `imported_keypoints` in
//! `tests/lab/src/hostile_input/`.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| farfield_fuzz::run("imported_keypoints", bytes));
