//! Sizes of files and folders, and module heads. Clippy limits functions to 80 lines.

use std::collections::BTreeSet;
use std::path::Path;

use farfield_lab::reading::RustFile;
use farfield_lab::reading::figures::{MAX_FILE_LINES, MAX_FILES_OF_FOLDER, full_folders};

use super::{check, root, workspace};

fn faults(fault: impl Fn(&RustFile) -> Option<String>) -> Vec<String> {
    let files = workspace().files.iter();
    let faults: Vec<String> = files
        .filter_map(|file| Some(format!("{}: {}", file.path, fault(file)?)))
        .collect();
    assert!(workspace().files.len() > 500, "the code was read");
    faults
}

#[test]
fn no_file_is_too_long() {
    check(&faults(|file| {
        let lines = file.source().count();
        (lines > MAX_FILE_LINES).then(|| format!("{lines} lines, at most {MAX_FILE_LINES}"))
    }));
}

#[test]
fn no_folder_has_too_many_files() {
    let fault = |(folder, files): (String, usize)| {
        format!("{folder}: {files} Rust files, at most {MAX_FILES_OF_FOLDER}")
    };
    let full = full_folders(workspace());
    check(&full.into_iter().map(fault).collect::<Vec<_>>());
}

#[test]
fn every_file_has_a_module_head() {
    check(&faults(|file| {
        let mut lines = file.text.lines();
        let first = lines.find(|line| !line.trim().is_empty() && !line.starts_with("#!["));
        let is_head = first.is_some_and(|line| line.starts_with("//! ") && line.len() > 12);
        (!is_head).then(|| "does not start with a `//!` sentence".to_owned())
    }));
}

#[test]
fn every_file_is_part_of_a_crate() {
    let root = root().canonicalize().unwrap();
    let packages = workspace().packages.iter();
    let targets = packages.flat_map(|package| &package.targets);
    let targets: BTreeSet<String> = targets
        .filter_map(|target| Path::new(&target.src_path).strip_prefix(&root).ok())
        .map(|path| path.to_string_lossy().replace('\\', "/"))
        .collect();
    assert!(targets.len() > 20, "the targets were read");
    check(&faults(|file| {
        let is_declared = is_declared(&file.path, &targets);
        let is_target = targets.contains(&file.path) || file.path.ends_with("build.rs");
        (!is_declared && !is_target).then(|| "no `mod` declares it".to_owned())
    }));
}

/// Whether a parent declares the file as a module: the module of its folder, a crate root in its folder, or a file of its
/// folder by a `#[path]`.
fn is_declared(path: &str, targets: &BTreeSet<String>) -> bool {
    let Some((folder, name)) = path.rsplit_once('/') else {
        return false;
    };
    let (parent, module) = match name.strip_suffix(".rs") {
        Some("mod") | None => folder.rsplit_once('/').unwrap_or(("", folder)),
        Some(stem) => (folder, stem),
    };
    let in_folder = |folder: &str, other: &str| {
        let rest = other
            .strip_prefix(folder)
            .and_then(|it| it.strip_prefix('/'));
        rest.is_some_and(|rest| !rest.contains('/'))
    };
    let declares = |file: &RustFile| {
        let is_parent = file.path.strip_suffix(".rs") == Some(parent)
            || file.path.strip_suffix("/mod.rs") == Some(parent)
            || targets.contains(&file.path) && in_folder(parent, &file.path);
        let by_name = format!("mod {module};");
        let by_path = format!("#[path = \"{name}\"]");
        file.text.lines().map(str::trim).any(|line| {
            is_parent && (line == by_name || line.ends_with(&format!(" {by_name}")))
                || line == by_path && in_folder(folder, &file.path)
        })
    };
    workspace().files.iter().any(declares)
}

#[test]
fn an_orphan_is_found_although_a_sibling_declares_its_name() {
    let targets = BTreeSet::from(["proto/src/lib.rs".to_owned()]);
    assert!(is_declared("proto/src/wire.rs", &targets));
    assert!(is_declared("proto/src/patch/mod.rs", &targets));
    assert!(!is_declared("proto/src/tests.rs", &targets));
}
