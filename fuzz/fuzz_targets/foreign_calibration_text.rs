//! Calibrations of other programs, of any content: see `foreign_calibration_text` in
//! `tests/lab/src/hostile_input/`.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| farfield_fuzz::run("foreign_calibration_text", bytes));
