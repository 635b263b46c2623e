//! Documents match the tree.

use std::path::Path;

use farfield_lab::reading::is_rust;

use super::{check, root, workspace};

/// `ARCHITECTURE.md` must be readable in one sitting.
const MAX_ARCHITECTURE_LINES: usize = 150;

#[test]
fn no_file_contains_a_path_of_one_machine() {
    let places = [
        concat!("/ho", "me/"),
        concat!("/ro", "ot/"),
        concat!("/Us", "ers/"),
        concat!("/wo", "rk/"),
        concat!(":\\Us", "ers"),
    ];
    let mut faults = Vec::new();
    for (path, text) in &workspace().texts {
        for (number, line) in text.lines().enumerate() {
            for place in places.iter().filter(|place| line.contains(*place)) {
                faults.push(format!("{path}:{}: {place}", number + 1));
            }
        }
    }
    check(&faults);
}

#[test]
fn the_architecture_is_short_and_its_paths_exist() {
    let text = &workspace().texts["ARCHITECTURE.md"];
    assert!(text.lines().count() < MAX_ARCHITECTURE_LINES);
    // In `ARCHITECTURE.md`, a folder of the root is a path as well.
    check(&missing_paths("ARCHITECTURE.md", text, |name| {
        name.contains('/')
    }));
}

#[test]
fn the_paths_in_documents_for_users_exist() {
    let is_document = |path: &str| {
        let is_markdown = Path::new(path).extension().is_some_and(|it| it == "md");
        (path.starts_with("docs/") && is_markdown)
            || ["README.md", "CONTRIBUTING.md"].contains(&path)
    };
    // `quic/` is an endpoint, and `venue/` a folder of results: a path has a slash inside.
    let is_deep = |name: &str| name.trim_end_matches('/').contains('/');
    let (mut faults, mut read) = (Vec::new(), 0);
    for (path, text) in &workspace().texts {
        if is_document(path) {
            read += 1;
            faults.extend(missing_paths(path, text, is_deep));
        }
    }
    assert!(read > 5, "the documents were read");
    check(&faults);
}

#[test]
fn code_blocks_in_documentation_are_not_rust() {
    // The manifests disable doctests, so a Rust example would not be tested.
    let others = ["text", "toml", "json"];
    let mut faults = Vec::new();
    for file in &workspace().files {
        let path = &file.path;
        let blocks = code_blocks(&file.text).filter(|(_, language)| !others.contains(language));
        faults.extend(blocks.map(|(line, _)| format!("{path}:{line}: an example that is not run")));
    }
    check(&faults);
}

/// Line and language of the blocks of code in the documentation of a Rust file.
fn code_blocks(text: &str) -> impl Iterator<Item = (usize, &str)> {
    let documentation = text.lines().enumerate().filter_map(|(number, line)| {
        let line = line.trim_start();
        let line = line.strip_prefix("///").or(line.strip_prefix("//!"))?;
        Some((number + 1, line.trim_start().strip_prefix("```")?.trim()))
    });
    documentation.step_by(2)
}

#[test]
fn code_blocks_are_found_with_their_language() {
    let text = "//! ```text\n//! a\n//! ```\nfn f() {}\n    /// ```\n    /// f();\n    /// ```\n";
    let found: Vec<_> = code_blocks(text).collect();
    assert_eq!(found, [(1, "text"), (5, "")]);
}

/// Paths in backticks that do not exist: of Rust files, or of folders with a slash at the end, if `is_path`.
fn missing_paths(document: &str, text: &str, is_path: impl Fn(&str) -> bool) -> Vec<String> {
    let mut faults = Vec::new();
    for name in text.split('`').skip(1).step_by(2) {
        let is_named = (name.ends_with('/') || is_rust(name)) && is_path(name);
        if is_named && !name.contains(['*', '{', ' ']) && !root().join(name).exists() {
            faults.push(format!("{document}: `{name}` is not there"));
        }
    }
    faults
}
