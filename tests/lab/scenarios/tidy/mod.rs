//! House rules that no compiler checks: sizes, module heads, dependencies, pure cores, plain English, and paths in
//! documents.

mod arrows;
mod cores;
mod documents;
mod plain_english;
mod sizes;

use std::path::PathBuf;
use std::sync::LazyLock;

use farfield_lab::reading::Workspace;

fn root() -> PathBuf {
    // The package lies two folders below the root.
    PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."))
}

/// The workspace, read once for all tests.
fn workspace() -> &'static Workspace {
    static WORKSPACE: LazyLock<Workspace> =
        LazyLock::new(|| Workspace::read(&root()).unwrap_or_else(|error| panic!("{error}")));
    &WORKSPACE
}

fn check(faults: &[String]) {
    assert!(faults.is_empty(), "\n{}", faults.join("\n"));
}
