//! Model cards of any content: see `model_card_text` in `tests/lab/src/hostile_input/`.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| farfield_fuzz::run("model_card_text", bytes));
