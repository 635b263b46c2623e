//! A camera's sightings of a point, of any content: see `point_sightings_text` in
//! `tests/lab/src/hostile_input/`.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| farfield_fuzz::run("point_sightings_text", bytes));
