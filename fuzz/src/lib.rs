//! The bodies of the fuzz targets, which the project's own tests replay the corpus through. `cargo fuzz`
//! works on a folder: `lab fuzz-corpus unpack` writes it, and `lab fuzz-corpus pack` takes it back.

#[path = "../../tests/lab/src/hostile_input/mod.rs"]
pub mod hostile_input;

/// Takes `bytes` through the target of this name.
///
/// # Panics
/// When there is none, or when it broke a promise.
pub fn run(target: &str, bytes: &[u8]) {
    let target = hostile_input::target(target).expect("each fuzz target has a body");
    std::hint::black_box(target(bytes));
}
