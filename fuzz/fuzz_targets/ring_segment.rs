//! Segments of an edge's ring of any content: see `ring_segment` in `tests/lab/src/hostile_input/`.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| farfield_fuzz::run("ring_segment", bytes));
