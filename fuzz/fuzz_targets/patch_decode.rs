//! Untrusted patches: see `patch_decode` in `tests/lab/src/hostile_input/`.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| farfield_fuzz::run("patch_decode", bytes));
