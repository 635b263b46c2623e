//! Requests of a Lab Streaming Layer inlet, of any content: see `lsl_requests` in
//! `tests/lab/src/hostile_input/`.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| farfield_fuzz::run("lsl_requests", bytes));
