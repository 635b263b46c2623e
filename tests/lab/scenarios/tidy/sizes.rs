//! How long files are, how many lie in a folder, and that each says what it is. Functions are held to 80 lines by clippy.

use farfield_lab::reading::RustFile;
use farfield_lab::reading::figures::{MAX_FILE_LINES, MAX_FILES_OF_FOLDER, full_folders};

use super::{check, workspace};

fn faults(of: impl Fn(&RustFile) -> Option<String>) -> Vec<String> {
    let files = workspace().files.iter();
    let faults: Vec<String> = files
        .filter_map(|file| Some(format!("{}: {}", file.path, of(file)?)))
        .collect();
    assert!(workspace().files.len() > 500, "the code was read");
    faults
}

#[test]
fn no_file_is_longer_than_one_subject() {
    check(&faults(|file| {
        let lines = file.source().count();
        (lines > MAX_FILE_LINES).then(|| format!("{lines} lines, at most {MAX_FILE_LINES}"))
    }));
}

#[test]
fn no_folder_has_more_files_than_can_be_kept_in_mind() {
    let fault = |(folder, files): (String, usize)| {
        format!("{folder}: {files} Rust files, at most {MAX_FILES_OF_FOLDER}")
    };
    let full = full_folders(workspace());
    check(&full.into_iter().map(fault).collect::<Vec<_>>());
}

#[test]
fn every_file_says_at_its_head_what_it_is() {
    check(&faults(|file| {
        let mut lines = file.text.lines();
        let first = lines.find(|line| !line.trim().is_empty() && !line.starts_with("#!["));
        let is_head = first.is_some_and(|line| line.starts_with("//! ") && line.len() > 12);
        (!is_head).then(|| "does not start with a `//!` sentence".to_owned())
    }));
}

#[test]
fn every_file_is_part_of_a_crate() {
    let packages = || workspace().packages.iter();
    let is_target = |path: &str| {
        let mut targets = packages().flat_map(|package| &package.targets);
        targets.any(|target| {
            target
                .src_path
                .replace('\\', "/")
                .ends_with(&format!("/{path}"))
        }) || packages().any(|package| {
            let folder = package.manifest_path.replace('\\', "/");
            path == "build.rs"
                || folder
                    .replace("Cargo.toml", "build.rs")
                    .ends_with(&format!("/{path}"))
        })
    };
    check(&faults(|file| {
        let (folder, name) = file.path.rsplit_once('/')?;
        let (parent, module) = match name {
            "mod.rs" => folder.rsplit_once('/')?,
            _ => (folder, name.strip_suffix(".rs")?),
        };
        let declares = |line: &str| {
            line.ends_with(&format!("mod {module};")) || line.contains(&format!("{name}\"]"))
        };
        let is_above = |other: &&RustFile| {
            let of_parent = other.path.strip_prefix(parent);
            other.path.strip_suffix(".rs") == Some(parent)
                || of_parent.is_some_and(|rest| rest.starts_with('/') && !rest[1..].contains('/'))
        };
        let mut above = workspace().files.iter().filter(is_above);
        let is_declared = above.any(|other| other.text.lines().any(|line| declares(line.trim())));
        (!is_declared && !is_target(&file.path)).then(|| "no `mod` brings it in".to_owned())
    }));
}
