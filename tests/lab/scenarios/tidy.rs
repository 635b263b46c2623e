//! The house rules that no compiler checks: sizes, heads, the purity of the cores, and that what is
//! written down exists.

use std::fs;
use std::path::{Path, PathBuf};

/// A file that is longer has a second subject in it.
const MAX_LINES: usize = 500;
/// `ARCHITECTURE.md` is read in one sitting.
const MAX_ARCHITECTURE_LINES: usize = 220;

/// The cores: values in, values out.
const CORES: [&str; 3] = ["proto/src", "edge/src", "fusion/src"];
/// What in their folders is shell. Everything else knows no file, socket, clock or runtime.
const SHELLS: [&str; 7] = [
    "edge/src/node",
    "edge/src/source",
    "edge/src/network",
    "edge/src/detector",
    "edge/src/main.rs",
    "fusion/src/node",
    "fusion/src/main.rs",
];
/// The one core file that writes files: it gives them their names when they are whole.
const WRITER: &str = "fusion/src/export/unfinished.rs";
const FORBIDDEN_IN_CORES: [&str; 7] = [
    "std::fs",
    "std::net",
    "std::process",
    "SystemTime",
    "Instant::now",
    "tokio::",
    "zenoh::",
];

/// Folders that are not ours to judge, or not under version control.
const SKIPPED: [&str; 7] = [
    ".git",
    "target",
    // Other people's code, kept as they wrote it.
    "vendor",
    "farfield-out",
    "corpus",
    "artifacts",
    "node_modules",
];

fn root() -> PathBuf {
    let manifest = Path::new(env!("CARGO_MANIFEST_DIR"));
    manifest
        .ancestors()
        .nth(2)
        .expect("the package lies two folders below the workspace")
        .to_owned()
}

/// All files of the workspace with their text, by path relative to its root. Files that are not text
/// are left out.
fn files() -> Vec<(String, String)> {
    fn visit(folder: &Path, root: &Path, found: &mut Vec<(String, String)>) {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            let name = path.file_name().unwrap().to_string_lossy();
            if SKIPPED.contains(&name.as_ref()) {
                continue;
            }
            if path.is_dir() {
                visit(&path, root, found);
            } else if let Ok(text) = fs::read_to_string(&path) {
                let relative = path
                    .strip_prefix(root)
                    .unwrap()
                    .to_string_lossy()
                    .into_owned();
                found.push((relative, text));
            }
        }
    }
    let root = root();
    let mut found = Vec::new();
    visit(&root, &root, &mut found);
    found.sort();
    found
}

fn rust_files() -> Vec<(String, String)> {
    files()
        .into_iter()
        .filter(|(path, _)| is_rust(path))
        .collect()
}

/// The text before the file's tests.
fn without_tests(text: &str) -> &str {
    text.find("#[cfg(test)]\nmod tests")
        .map_or(text, |at| &text[..at])
}

/// The code of a line, without a comment behind it.
fn code(line: &str) -> &str {
    line.split("//").next().unwrap_or_default()
}

fn is_shell(path: &str) -> bool {
    SHELLS.iter().any(|shell| path.starts_with(shell))
}

fn check(faults: &[String]) {
    assert!(faults.is_empty(), "\n{}", faults.join("\n"));
}

fn is_rust(path: &str) -> bool {
    Path::new(path)
        .extension()
        .is_some_and(|extension| extension == "rs")
}

#[test]
fn no_file_is_longer_than_one_subject() {
    let long = |(path, text): (String, String)| {
        let lines = without_tests(&text).lines().count();
        (lines > MAX_LINES).then(|| format!("{path}: {lines} lines, at most {MAX_LINES}"))
    };
    check(
        &rust_files()
            .into_iter()
            .filter_map(long)
            .collect::<Vec<_>>(),
    );
}

#[test]
fn every_file_says_at_its_head_what_it_is() {
    let headless = |(path, text): (String, String)| {
        let first = text
            .lines()
            .find(|line| !line.trim().is_empty() && !line.starts_with("#!["));
        let head = first.is_some_and(|line| line.starts_with("//! ") && line.len() > 12);
        (!head).then(|| format!("{path}: does not start with a `//!` sentence"))
    };
    check(
        &rust_files()
            .into_iter()
            .filter_map(headless)
            .collect::<Vec<_>>(),
    );
}

#[test]
fn the_cores_know_no_file_no_socket_no_clock_and_no_runtime() {
    let mut faults = Vec::new();
    for (path, text) in rust_files() {
        let core = CORES.iter().any(|core| path.starts_with(core));
        if !core || is_shell(&path) || path == WRITER || path.ends_with("tests.rs") {
            continue;
        }
        for (number, line) in without_tests(&text).lines().enumerate() {
            for word in FORBIDDEN_IN_CORES
                .iter()
                .filter(|word| code(line).contains(*word))
            {
                faults.push(format!("{path}:{}: {word} in the core", number + 1));
            }
        }
    }
    check(&faults);
}

#[test]
fn no_shell_on_the_list_is_gone() {
    let gone = |path: &&str| {
        let path = root().join(path);
        !path.exists() && !path.with_extension("rs").exists()
    };
    let listed = SHELLS.iter().chain([&WRITER]).copied();
    check(
        &listed
            .filter(gone)
            .map(|path| format!("{path} is not there"))
            .collect::<Vec<_>>(),
    );
}

#[test]
fn nothing_is_commented_out_or_left_undone() {
    // Put together here, so that this file does not hold them.
    let marks = [
        concat!("TO", "DO"),
        concat!("FIX", "ME"),
        concat!("todo", "!("),
        concat!("unimplemented", "!("),
        concat!("#[", "ignore"),
    ];
    let mut faults = Vec::new();
    for (path, text) in rust_files() {
        for (number, line) in text.lines().enumerate() {
            let at = format!("{path}:{}", number + 1);
            for mark in marks.iter().filter(|mark| line.contains(*mark)) {
                faults.push(format!("{at}: {mark}"));
            }
            if line.trim_start().strip_prefix("// ").is_some_and(is_code) {
                faults.push(format!("{at}: commented-out code"));
            }
        }
    }
    check(&faults);
}

/// Whether a comment reads like Rust: it ends a statement or opens a block, and has a keyword, a call
/// or an assignment in it.
fn is_code(comment: &str) -> bool {
    let comment = comment.trim();
    let starts = [
        "let ", "pub ", "use ", "fn ", "if ", "for ", "return ", "#[",
    ];
    let keyword = starts.iter().any(|start| comment.starts_with(start));
    let calls = comment
        .find('(')
        .is_some_and(|at| comment[..at].ends_with(|c: char| c.is_alphanumeric() || c == '_'));
    let whole = comment.ends_with(';') || comment.ends_with('{');
    comment.starts_with("#[") || whole && (keyword || calls || comment.contains(" = "))
}

#[test]
fn what_is_code_is_told_from_prose() {
    for line in ["let x = 3;", "foo(bar);", "if x > 3 {", "#[test]", "x = y;"] {
        assert!(is_code(line), "{line}");
    }
    for line in [
        "Rows of a; columns of b",
        "the answer (see above);",
        "for all x: f(x) = 0",
    ] {
        assert!(!is_code(line), "{line}");
    }
}

#[test]
fn no_file_names_a_folder_of_one_machine() {
    let places = [
        concat!("/ho", "me/"),
        concat!("/ro", "ot/"),
        concat!("/Us", "ers/"),
        concat!("/wo", "rk/"),
        concat!(":\\Us", "ers"),
    ];
    let mut faults = Vec::new();
    for (path, text) in files() {
        for (number, line) in text.lines().enumerate() {
            for place in places.iter().filter(|place| line.contains(*place)) {
                faults.push(format!("{path}:{}: {place}", number + 1));
            }
        }
    }
    check(&faults);
}

#[test]
fn the_architecture_can_be_read_in_one_sitting_and_names_what_exists() {
    let text = fs::read_to_string(root().join("ARCHITECTURE.md")).unwrap();
    assert!(text.lines().count() < MAX_ARCHITECTURE_LINES);
    let mut faults = Vec::new();
    // In the code map, what stands in backticks and ends like a path is one.
    for name in text.split('`').skip(1).step_by(2) {
        let is_path = name.contains('/') && (name.ends_with('/') || is_rust(name));
        if is_path && !name.contains(['*', '{', ' ']) && !root().join(name).exists() {
            faults.push(format!("ARCHITECTURE.md: `{name}` is not there"));
        }
    }
    check(&faults);
}
