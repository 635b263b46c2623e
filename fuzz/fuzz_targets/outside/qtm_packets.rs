//! Packets of a QTM client of any content: see `qtm_packets` in `tests/lab/src/hostile_input/`.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| farfield_fuzz::run("qtm_packets", bytes));
