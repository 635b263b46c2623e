//! All files, crates and arrows of a workspace.

use std::collections::BTreeMap;
use std::path::Path;

use walkdir::WalkDir;

use super::ReadError;
use super::manifest::{self, Package};
use super::modules::arrows::{self, Arrow};
use super::modules::tree::{Crate, Files, Role, plain};
use super::syntax::code_file::CodeFile;

/// Folders that are not ours to judge, or not under version control.
const SKIPPED: [&str; 7] = [
    ".git",
    "target",
    // Other people's code, kept as they wrote it.
    "vendor",
    "farfield-out",
    // What fuzzers work on.
    "corpus",
    "artifacts",
    "node_modules",
];

/// A workspace as it was read.
pub struct Workspace {
    /// Its packages, and those that lie in it without being members.
    pub packages: Vec<Package>,
    /// Every file that is text, by path from the root; those of Rust too.
    pub texts: BTreeMap<String, String>,
    /// Every file of Rust.
    pub files: Files,
    /// The crates that the packages build.
    pub crates: Vec<Crate>,
    /// Who knows whom.
    pub arrows: Vec<Arrow>,
    /// For each file that some crate has in it: the package's name, and what the file is there for.
    pub roles: BTreeMap<String, (String, Role)>,
}

impl Workspace {
    /// Reads the workspace at `root`; `outside` are manifests of packages that are no members of it, from
    /// the root. What those build counts as tests.
    ///
    /// # Errors
    /// [`ReadError`], where something cannot be read.
    pub fn read(root: &Path, outside: &[&str]) -> Result<Self, ReadError> {
        let root = root.canonicalize().map_err(|source| ReadError::File {
            path: root.display().to_string(),
            source,
        })?;
        let texts = texts(&root)?;
        let mut files = Files::new();
        for (path, text) in texts.iter().filter(|(path, _)| is_rust(path)) {
            files.insert(path.clone(), CodeFile::parse(path, text.clone())?);
        }
        let members = manifest::packages(&root.join("Cargo.toml"))?;
        let mut crates = grow(&root, &members, None, &files)?;
        let mut packages = members;
        for outsider in outside {
            let found = manifest::packages(&root.join(outsider))?;
            crates.extend(grow(&root, &found, Some(Role::Test), &files)?);
            packages.extend(found);
        }
        Ok(Self {
            arrows: arrows::arrows(&crates),
            roles: roles(&crates),
            packages,
            texts,
            files,
            crates,
        })
    }

    /// The files that are there for `role`, of one package or of all.
    pub fn files_of<'a>(
        &'a self,
        package: Option<&'a str>,
        role: Role,
    ) -> impl Iterator<Item = &'a CodeFile> {
        let wanted = move |(owner, own): &(String, Role)| {
            *own == role && package.is_none_or(|package| package == owner)
        };
        let roles = self.roles.iter().filter(move |(_, it)| wanted(it));
        roles.filter_map(|(path, _)| self.files.get(path))
    }

    /// The files of Rust that no crate has in it.
    pub fn orphans(&self) -> impl Iterator<Item = &str> {
        let paths = self.files.keys().map(String::as_str);
        paths.filter(|path| !self.roles.contains_key(*path))
    }
}

/// The crates of `packages`, all of `role` when there is one.
fn grow(
    root: &Path,
    packages: &[Package],
    role: Option<Role>,
    files: &Files,
) -> Result<Vec<Crate>, ReadError> {
    let mut crates = Vec::new();
    for package in packages {
        for target in &package.targets {
            let path = plain(Path::new(&target.src_path));
            let Some(path) = path.strip_prefix(&format!("{}/", plain(root))) else {
                continue;
            };
            let is = |kind: &str| target.kind.iter().any(|it| it == kind);
            let own = match () {
                () if is("test") => Role::Test,
                () if is("example") || is("bench") => Role::Example,
                () => Role::Source,
            };
            let role = role.unwrap_or(own);
            crates.push(Crate::grow(
                &package.name,
                &target.name,
                is("lib"),
                role,
                path,
                files,
            )?);
        }
    }
    Ok(crates)
}

/// What each file is there for. A file that two crates share is what weighs most: source, then test.
fn roles(crates: &[Crate]) -> BTreeMap<String, (String, Role)> {
    let mut roles: BTreeMap<String, (String, Role)> = BTreeMap::new();
    for crate_ in crates {
        for module in crate_.modules.values() {
            // A module inside a file does not make the file a test; one that is the file does.
            if !module.code.inside.is_empty() {
                continue;
            }
            let role = if module.test { Role::Test } else { crate_.role };
            let entry = roles.entry(module.file.clone());
            let known = entry.or_insert_with(|| (crate_.package.clone(), role));
            if role < known.1 {
                *known = (crate_.package.clone(), role);
            }
        }
    }
    roles
}

/// All files below `root` that are text.
fn texts(root: &Path) -> Result<BTreeMap<String, String>, ReadError> {
    let skipped = |name: &std::ffi::OsStr| SKIPPED.iter().any(|it| name == *it);
    let walk = WalkDir::new(root).into_iter();
    let mut texts = BTreeMap::new();
    for entry in walk.filter_entry(|entry| !skipped(entry.file_name())) {
        let entry = entry.map_err(|error| ReadError::File {
            path: root.display().to_string(),
            source: error.into(),
        })?;
        if !entry.file_type().is_file() {
            continue;
        }
        if let Ok(text) = std::fs::read_to_string(entry.path()) {
            let path = entry.path().strip_prefix(root).unwrap_or(entry.path());
            texts.insert(plain(path), text);
        }
    }
    Ok(texts)
}

/// Whether a path is that of a Rust file.
pub fn is_rust(path: &str) -> bool {
    Path::new(path).extension().is_some_and(|it| it == "rs")
}
