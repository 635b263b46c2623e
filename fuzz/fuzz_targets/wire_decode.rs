//! Untrusted messages: see `wire_decode` in `tests/lab/src/hostile_input/`.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| farfield_fuzz::run("wire_decode", bytes));
