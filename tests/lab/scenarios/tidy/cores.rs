//! The cores are pure: values in, values out. They give the same bits on any machine: fusion calls no function of the C
//! library, which chooses implementations by the processor.

use super::{check, root, workspace};

const CORES: [&str; 5] = [
    "proto/src/",
    "calibration/src/",
    "edge/src/",
    "fusion/src/",
    "bridges/export/src/",
];
/// Shells in the folders of the cores. Everything else uses no file, socket, clock or runtime.
const SHELLS: [&str; 5] = [
    "edge/src/node",
    "edge/src/source",
    "edge/src/network",
    "edge/src/detector",
    "edge/src/main.rs",
];
/// Core files that write files, under a temporary name until they are finished.
const WRITERS: [&str; 4] = [
    "bridges/export/src/files.rs",
    "fusion/src/export/part_file.rs",
    "fusion/src/export/unfinished.rs",
    "fusion/src/export/whole.rs",
];

/// Names that a core must not use.
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

/// The first forbidden name in a line of code.
fn reaches_outside(line: &str) -> Option<&'static str> {
    let code = line.split("//").next().unwrap_or_default();
    OUTSIDE_WORLD.into_iter().find(|name| {
        let before = code.split(name).next().unwrap_or_default();
        code.contains(name) && !before.ends_with(|c: char| c.is_alphanumeric() || c == '_')
    })
}

#[test]
fn the_cores_use_no_file_socket_clock_or_runtime() {
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
fn forbidden_names_are_found_in_code_only() {
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
fn every_listed_shell_exists() {
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

/// Code that needs the same bits: maps, poses, calibrations, exports.
const SAME: [&str; 4] = [
    "proto/src/",
    "calibration/src/",
    "fusion/src/",
    "bridges/export/src/",
];
/// Functions of `f64` and `f32` that the C library computes. Square roots are exact on every processor.
const OF_THE_C_LIBRARY: [&str; 25] = [
    "sin", "cos", "tan", "sin_cos", "asin", "acos", "atan", "atan2", "sinh", "cosh", "tanh",
    "asinh", "acosh", "atanh", "exp", "exp2", "exp_m1", "ln", "ln_1p", "log", "log2", "log10",
    "powf", "hypot", "cbrt",
];

/// The first such function in a line, called as a method or named by the path of its type.
fn called(line: &str) -> Option<&'static str> {
    let code = line.split("//").next().unwrap_or_default();
    OF_THE_C_LIBRARY.into_iter().find(|name| {
        let forms = ["f64::", "f32::", "."].map(|before| format!("{before}{name}("));
        let by_name = ["f64::", "f32::"].map(|before| format!("{before}{name})"));
        forms
            .iter()
            .chain(&by_name)
            .any(|form| code.contains(form.as_str()))
    })
}

#[test]
fn fusion_calls_no_function_of_the_c_library() {
    let mut faults = Vec::new();
    let files = workspace().files.iter();
    let mut read = 0;
    for file in files.filter(|file| SAME.iter().any(|folder| file.path.starts_with(folder))) {
        read += 1;
        for (number, line) in file.source() {
            faults.extend(called(line).map(|name| {
                format!(
                    "{}:{number}: {name} of the C library, not of libm",
                    file.path
                )
            }));
        }
    }
    assert!(read > 100, "proto and fusion were read");
    check(&faults);
}

#[test]
fn a_call_differs_from_a_name() {
    for line in [
        "let a = b.sin();",
        "x.map(f64::exp)",
        "(a / b).ln().powi(2)",
    ] {
        assert!(called(line).is_some(), "{line}");
    }
    for line in [
        "libm::sin(a)",
        "// a.sin()",
        "log.push(a)",
        "rotation.angle()",
        "exp(1)",
    ] {
        assert!(called(line).is_none(), "{line}");
    }
}
