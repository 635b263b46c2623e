//! Marks clicked in pictures of any content: see `clicked_marks_text` in
//! `tests/lab/src/hostile_input/`.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| farfield_fuzz::run("clicked_marks_text", bytes));
