//! The cores compute: values in, values out.

use super::{check, root, workspace};

/// The cores.
const CORES: [&str; 5] = [
    "proto/src/",
    "calibration/src/",
    "edge/src/",
    "fusion/src/",
    "bridges/export/src/",
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
    "bridges/export/src/files.rs",
    "fusion/src/export/part_file.rs",
    "fusion/src/export/unfinished.rs",
    "fusion/src/export/whole.rs",
];

/// What no line of a core names.
const OUTSIDE_WORLD: [&str; 8] = [
    // A group may hide one of the next three.
    "use std::{",
    "std::fs",
    "std::net",
    "std::process",
    "tokio::",
    "zenoh::",
    "SystemTime",
    "Instant::now",
];

/// What of the outside world a line of code names.
fn reaches_outside(line: &str) -> Option<&'static str> {
    let code = line.split("//").next().unwrap_or_default();
    OUTSIDE_WORLD.into_iter().find(|name| {
        let before = code.split(name).next().unwrap_or_default();
        code.contains(name) && !before.ends_with(|c: char| c.is_alphanumeric() || c == '_')
    })
}

#[test]
fn the_cores_know_no_file_no_socket_no_clock_and_no_runtime() {
    let is_shell =
        |path: &str| WRITERS.contains(&path) || SHELLS.iter().any(|shell| path.starts_with(shell));
    let is_core = |path: &str| CORES.iter().any(|core| path.starts_with(core)) && !is_shell(path);
    let mut faults = Vec::new();
    let mut read = 0;
    for file in workspace().files.iter().filter(|file| is_core(&file.path)) {
        read += 1;
        for (number, line) in file.source() {
            let found = reaches_outside(line);
            faults.extend(found.map(|what| format!("{}:{number}: {what} in the core", file.path)));
        }
    }
    assert!(read > 100, "the cores were read");
    check(&faults);
}

#[test]
fn names_of_the_outside_world_are_found_where_they_are_code() {
    for line in [
        "use std::fs;",
        "use std::{fmt, fs};",
        "let now = Instant::now();",
        "    tokio::spawn(f);",
    ] {
        assert!(reaches_outside(line).is_some(), "{line}");
    }
    for line in [
        "use crate::other_std::fs;",
        "// not std::fs",
        "use std::time::Instant;",
    ] {
        assert!(reaches_outside(line).is_none(), "{line}");
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
