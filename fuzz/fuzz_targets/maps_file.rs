//! Files of precomputed maps: see `maps_file` in `tests/lab/src/hostile_input/`.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| farfield_fuzz::run("maps_file", bytes));
