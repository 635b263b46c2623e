//! The packages of a workspace from cargo: their targets and dependencies.

use std::path::Path;
use std::process::Command;

use serde::Deserialize;

use super::ReadError;

/// A package.
#[derive(Clone, Debug, Deserialize)]
pub struct Package {
    /// Its name, as in `Cargo.toml`.
    pub name: String,
    /// Path of its `Cargo.toml`.
    pub manifest_path: String,
    /// Libraries, binaries, tests, benches, examples.
    pub targets: Vec<CargoTarget>,
    /// The tables of dependencies, all in one.
    pub dependencies: Vec<Dependency>,
}

/// A target of a package.
#[derive(Clone, Debug, Deserialize)]
pub struct CargoTarget {
    /// Path of its first file.
    pub src_path: String,
}

/// A line of a table of dependencies.
#[derive(Clone, Debug, Deserialize)]
pub struct Dependency {
    /// Name of the other package.
    pub name: String,
    /// `dev` or `build`; `None` for the plain table.
    pub kind: Option<String>,
}

/// The packages of the workspace of `manifest`, without building or fetching.
///
/// # Errors
/// [`ReadError::Manifest`] if cargo is missing or refuses the manifest.
pub fn packages(manifest: &Path) -> Result<Vec<Package>, ReadError> {
    #[derive(Deserialize)]
    struct Metadata {
        packages: Vec<Package>,
    }
    let fault = |what: String| ReadError::Manifest {
        manifest: manifest.display().to_string(),
        what,
    };
    // Cargo passes its own path to the programs that it runs.
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let answer = Command::new(cargo)
        .args(["metadata", "--no-deps", "--offline", "--format-version=1"])
        .arg("--manifest-path")
        .arg(manifest)
        .output()
        .map_err(|error| fault(error.to_string()))?;
    if !answer.status.success() {
        return Err(fault(String::from_utf8_lossy(&answer.stderr).into_owned()));
    }
    let metadata: Metadata =
        serde_json::from_slice(&answer.stdout).map_err(|error| fault(error.to_string()))?;
    Ok(metadata.packages)
}
