//! Venue files of any content: see `venue_text` in `tests/lab/src/hostile_input/`.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| farfield_fuzz::run("venue_text", bytes));
