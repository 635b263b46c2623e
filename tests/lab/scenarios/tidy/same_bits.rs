//! What fusion computes has the same bits on any machine: no function of the C library, which picks another one
//! by the processor.

use super::{check, workspace};

/// What must: maps decoded and solved, cameras calibrated, poses exported.
const SAME: [&str; 4] = [
    "proto/src/",
    "calibration/src/",
    "fusion/src/",
    "bridges/export/src/",
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
