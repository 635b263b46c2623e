//! Reads the project's own files for `lab figures` and the tidy scenario.
//!
//! Rust is read by line in the format of rustfmt: a `#[cfg(test)]` module ends at the next `}` of its own indentation, and the
//! file of a `#[cfg(test)] mod x;` is a test with everything below it.

pub mod figures;
mod test_code;

use std::collections::BTreeMap;
use std::path::Path;
use std::process::Command;

use serde::Deserialize;
use walkdir::WalkDir;

use self::test_code::{test_lines, test_modules};

/// Folders of other people's code, or outside version control.
const SKIPPED: [&str; 7] = [
    ".git",
    "target",
    "vendor",
    "farfield-out",
    "corpus",
    "artifacts",
    "node_modules",
];
/// Folders of targets for developers only.
const TEST_FOLDERS: [&str; 4] = ["tests", "scenarios", "benches", "fuzz_targets"];
/// The source of a package in a folder named `tests`.
const SOURCE_UNDER_TESTS: &str = "tests/lab/src/";
/// The manifest of a package that is not a member of the workspace.
const OUTSIDE: &str = "fuzz/Cargo.toml";

/// Why the code cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum ReadError {
    /// `cargo metadata` failed.
    #[error("cargo metadata for {manifest}: {what}")]
    Manifest {
        /// Path of the manifest.
        manifest: String,
        /// Output of cargo, or the fault in it.
        what: String,
    },
    /// A file or folder that cannot be read.
    #[error("{path}: {source}")]
    File {
        /// Path of the file.
        path: String,
        /// The cause.
        source: std::io::Error,
    },
}

/// All text files and packages of a checkout.
pub struct Workspace {
    /// The members, and the fuzz targets.
    pub packages: Vec<Package>,
    /// Every text file, by its path from the root, with `/` on all systems.
    pub texts: BTreeMap<String, String>,
    /// The Rust files among them.
    pub files: Vec<RustFile>,
}

/// A Rust file.
pub struct RustFile {
    /// Path from the root.
    pub path: String,
    /// Its content.
    pub text: String,
    /// By line: whether it is test code.
    is_test: Vec<bool>,
}

impl Workspace {
    /// Reads the checkout at `root`.
    ///
    /// # Errors
    /// [`ReadError`], if something cannot be read.
    pub fn read(root: &Path) -> Result<Self, ReadError> {
        let texts = texts(root)?;
        let rust = || texts.iter().filter(|(path, _)| is_rust(path));
        let modules: Vec<String> = rust()
            .flat_map(|(path, text)| test_modules(path, text))
            .collect();
        let files = rust().map(|(path, text)| RustFile::new(path, text, &modules));
        let mut members = packages(&root.join("Cargo.toml"))?;
        members.extend(packages(&root.join(OUTSIDE))?);
        Ok(Self {
            packages: members,
            files: files.collect(),
            texts,
        })
    }
}

impl RustFile {
    fn new(path: &str, text: &str, test_modules: &[String]) -> Self {
        let is_of = |module: &String| {
            let rest = path.strip_prefix(module.as_str());
            rest.is_some_and(|rest| rest == ".rs" || rest.starts_with('/'))
        };
        let folders = path.strip_prefix(SOURCE_UNDER_TESTS).unwrap_or(path);
        let is_in_folder = folders.split('/').any(|it| TEST_FOLDERS.contains(&it));
        let is_by_name = path.ends_with("_tests.rs");
        let is_test = if is_in_folder || is_by_name || test_modules.iter().any(is_of) {
            vec![true; text.lines().count()]
        } else {
            test_lines(text)
        };
        Self {
            path: path.to_owned(),
            text: text.to_owned(),
            is_test,
        }
    }

    /// The lines that are not test code, each with its number from 1.
    pub fn source(&self) -> impl Iterator<Item = (usize, &str)> {
        self.lines(false)
    }

    /// The lines of test code, each with its number from 1.
    pub fn tests(&self) -> impl Iterator<Item = (usize, &str)> {
        self.lines(true)
    }

    fn lines(&self, of_tests: bool) -> impl Iterator<Item = (usize, &str)> {
        let lines = self.text.lines().zip(&self.is_test).enumerate();
        lines
            .filter(move |(_, (_, is_test))| **is_test == of_tests)
            .map(|(index, (line, _))| (index + 1, line))
    }
}

fn texts(root: &Path) -> Result<BTreeMap<String, String>, ReadError> {
    let is_ours = |name: &std::ffi::OsStr| !SKIPPED.iter().any(|it| name == *it);
    let walk = WalkDir::new(root).into_iter();
    let mut texts = BTreeMap::new();
    for entry in walk.filter_entry(|entry| is_ours(entry.file_name())) {
        let entry = entry.map_err(|error| ReadError::File {
            path: root.display().to_string(),
            source: error.into(),
        })?;
        if !entry.file_type().is_file() {
            continue;
        }
        // Files that are not UTF-8 are not text.
        if let Ok(text) = std::fs::read_to_string(entry.path()) {
            let path = entry.path().strip_prefix(root).unwrap_or(entry.path());
            texts.insert(path.to_string_lossy().replace('\\', "/"), text);
        }
    }
    Ok(texts)
}

/// Whether this is the path of a Rust file.
pub fn is_rust(path: &str) -> bool {
    Path::new(path).extension().is_some_and(|it| it == "rs")
}

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
