//! Requests of a Foxglove client, of any content: see `foxglove_request_text` in
//! `tests/lab/src/hostile_input/`.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| farfield_fuzz::run("foxglove_request_text", bytes));
