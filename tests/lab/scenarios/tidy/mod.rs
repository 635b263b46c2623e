//! The house rules that no compiler checks: sizes, heads, who may know whom, the purity of the cores, and
//! that what is written down exists.
//!
//! Code is read as syntax ([`farfield_lab::reading`]), so that a `#[cfg(test)] mod tests;` near the head of a
//! file hides nothing of what follows.

mod arrows;
mod cores;
mod documents;
mod left_undone;
mod same_bits;
mod sizes;

use std::path::PathBuf;
use std::sync::LazyLock;

use farfield_lab::reading::{OUTSIDE, Workspace};

fn root() -> PathBuf {
    // The package lies two folders below the workspace.
    PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."))
}

/// The workspace, read once for all tests.
fn workspace() -> &'static Workspace {
    static WORKSPACE: LazyLock<Workspace> = LazyLock::new(|| {
        Workspace::read(&root(), &OUTSIDE).unwrap_or_else(|error| panic!("{error}"))
    });
    &WORKSPACE
}

fn check(faults: &[String]) {
    assert!(faults.is_empty(), "\n{}", faults.join("\n"));
}
