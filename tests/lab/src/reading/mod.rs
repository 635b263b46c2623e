//! Reads the project's own Rust code: its sizes, who knows whom, and what is named twice. The tidy test
//! holds the code to the rules with it, and `lab figures` prints what it finds.
//!
//! The code is read as syntax, not as text: comments and strings are no code, and whatever stands under
//! `#[cfg(test)]` is a test wherever it stands, the files that such a `mod` brings in too.
//!
//! What is not read: what macros turn into (the paths that are handed to a macro are), methods that are
//! called on values, and the features under which code is built: all of it counts.

pub mod figures;
pub mod manifest;
pub mod modules;
pub mod sizes;
pub mod syntax;
pub mod type_names;
pub mod workspace;

pub use workspace::Workspace;

/// Manifests of packages that lie in the workspace's folders without being members of it.
pub const OUTSIDE: [&str; 1] = ["fuzz/Cargo.toml"];

/// What keeps the code from being read.
#[derive(Debug, thiserror::Error)]
pub enum ReadError {
    /// `cargo metadata` did not answer.
    #[error("cargo metadata for {manifest}: {what}")]
    Manifest {
        /// The manifest that was asked about.
        manifest: String,
        /// What cargo said, or what its answer lacks.
        what: String,
    },
    /// A file or folder that cannot be read.
    #[error("{path}: {source}")]
    File {
        /// Path of the file.
        path: String,
        /// Why not.
        source: std::io::Error,
    },
    /// A file that is no Rust.
    #[error("{path}:{line}: {what}")]
    Syntax {
        /// Path of the file.
        path: String,
        /// Line, from 1.
        line: usize,
        /// What the parser expected.
        what: String,
    },
    /// A `mod x;` whose file is not there.
    #[error("{path}:{line}: the file of `mod {name};` is not there")]
    NoModule {
        /// Path of the file that declares it.
        path: String,
        /// Line, from 1.
        line: usize,
        /// Name of the module.
        name: String,
    },
}
