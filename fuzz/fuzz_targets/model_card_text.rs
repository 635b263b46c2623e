//! Model cards of any content: read or refused, never a panic.
#![no_main]

use std::hint::black_box;
use std::path::Path;

use farfield_proto::model_card::ModelCard;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|text: &str| {
    black_box(ModelCard::parse(text, Path::new("card.toml")).is_ok());
});
