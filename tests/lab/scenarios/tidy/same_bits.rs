//! What fusion computes has the same bits on any machine: no function of the C library, which picks another one
//! by the processor.

use std::collections::BTreeSet;

use super::{check, workspace};

/// What must: maps decoded and solved, cameras calibrated, poses exported.
const SAME: [&str; 4] = [
    "proto/src/",
    "calibration/src/",
    "fusion/src/",
    "export/src/",
];
/// The functions of `f64` and `f32` that the C library computes. (Square roots are the processor's, and exact.)
const OF_THE_C_LIBRARY: [&str; 25] = [
    "sin", "cos", "tan", "sin_cos", "asin", "acos", "atan", "atan2", "sinh", "cosh", "tanh",
    "asinh", "acosh", "atanh", "exp", "exp2", "exp_m1", "ln", "ln_1p", "log", "log2", "log10",
    "powf", "hypot", "cbrt",
];

/// The first such function that a line calls as a method, or by the path of its type.
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
fn fusion_computes_with_no_function_of_the_c_library() {
    let mut faults = Vec::new();
    let modules = workspace()
        .crates
        .iter()
        .flat_map(|crate_| crate_.modules.values());
    let is_same = |file: &&str| SAME.iter().any(|folder| file.starts_with(folder));
    let files: BTreeSet<&str> = modules
        .filter(|module| !module.test)
        .map(|module| module.file.as_str())
        .filter(is_same)
        .collect();
    assert!(files.len() > 100, "proto and fusion were read");
    for path in files {
        let file = &workspace().files[path];
        for (index, line) in file.text.lines().enumerate() {
            let found = called(line).filter(|_| !file.is_test_line(index + 1));
            faults.extend(found.map(|name| {
                format!(
                    "{}:{}: {name} of the C library, not of libm",
                    path,
                    index + 1
                )
            }));
        }
    }
    check(&faults);
}

#[test]
fn a_call_is_told_from_a_name() {
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
