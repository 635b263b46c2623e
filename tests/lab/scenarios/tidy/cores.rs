//! The cores compute: values in, values out.

use super::{check, root, workspace};

/// The cores.
const CORES: [&str; 5] = [
    "proto/src/",
    "calibration/src/",
    "edge/src/",
    "fusion/src/",
    "export/src/",
];
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
/// The core files that write files: they give them their names when they are whole.
const WRITERS: [&str; 4] = [
    "export/src/files.rs",
    "fusion/src/export/part_file.rs",
    "fusion/src/export/unfinished.rs",
    "fusion/src/export/whole.rs",
];

/// What no path in a core begins with.
const FORBIDDEN_ROOTS: [&[&str]; 5] = [
    &["std", "fs"],
    &["std", "net"],
    &["std", "process"],
    &["tokio"],
    &["zenoh"],
];
/// What no path in a core has in it.
const FORBIDDEN_PARTS: [&[&str]; 2] = [&["SystemTime"], &["Instant", "now"]];

/// What of the outside world a path names.
fn forbidden(path: &[String]) -> Option<String> {
    let begins =
        |root: &&[&str]| path.len() >= root.len() && path.iter().zip(*root).all(|(a, b)| a == b);
    let has = |part: &&[&str]| path.windows(part.len()).any(|it| it.iter().eq(part.iter()));
    let root = FORBIDDEN_ROOTS.iter().copied().find(|it| begins(it));
    let found = root.or_else(|| FORBIDDEN_PARTS.iter().copied().find(|it| has(it)));
    found.map(|names| names.join("::"))
}

#[test]
fn the_cores_know_no_file_no_socket_no_clock_and_no_runtime() {
    let is_shell =
        |path: &str| WRITERS.contains(&path) || SHELLS.iter().any(|shell| path.starts_with(shell));
    let mut faults = Vec::new();
    let mut seen = 0;
    for crate_ in &workspace().crates {
        for module in crate_.modules.values().filter(|module| !module.test) {
            let file = &module.file;
            if !CORES.iter().any(|core| file.starts_with(core)) || is_shell(file) {
                continue;
            }
            seen += 1;
            let imports = module.code.imports.iter().map(|it| (&it.path, it.line));
            let mentions = module.code.mentions.iter().map(|it| (&it.path, it.line));
            for (path, line) in imports.chain(mentions) {
                if let Some(what) = forbidden(path) {
                    faults.push(format!("{file}:{line}: {what} in the core"));
                }
            }
        }
    }
    assert!(seen > 100, "the cores were read");
    check(&faults);
}

#[test]
fn what_reaches_outside_is_told_from_what_does_not() {
    let split = |path: &str| -> Vec<String> { path.split("::").map(str::to_owned).collect() };
    for path in [
        "std::fs",
        "std::fs::File::open",
        "tokio",
        "Instant::now",
        "std::time::SystemTime",
    ] {
        assert!(forbidden(&split(path)).is_some(), "{path}");
    }
    for path in [
        "std::fmt",
        "std::time::Instant",
        "crate::fs::read",
        "tokio_like::x",
    ] {
        assert!(forbidden(&split(path)).is_none(), "{path}");
    }
}

#[test]
fn no_shell_on_the_list_is_gone() {
    let gone = |path: &&str| {
        let path = root().join(path);
        !path.exists() && !path.with_extension("rs").exists()
    };
    let listed = SHELLS.iter().chain(&WRITERS).copied().filter(gone);
    check(
        &listed
            .map(|path| format!("{path} is not there"))
            .collect::<Vec<_>>(),
    );
}
