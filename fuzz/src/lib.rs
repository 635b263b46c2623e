//! The bodies of the fuzz targets; the project's own tests also replay the corpus with them.
//!
//! `cargo fuzz` works on a folder: `lab fuzz-corpus unpack` writes it, and `lab fuzz-corpus pack`
//! packs it again.

#[path = "../../tests/lab/src/hostile_input/mod.rs"]
pub mod hostile_input;

/// Runs the target of this name on `bytes`.
///
/// # Panics
/// For an unknown target, or when the target violates one of its guarantees.
pub fn run(target: &str, bytes: &[u8]) {
    let target = hostile_input::target(target).expect("each fuzz target has a body");
    std::hint::black_box(target(bytes));
}
