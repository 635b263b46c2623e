//! No code that is switched off, and nothing that somebody meant to do later.

use super::{check, workspace};

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
    for (path, file) in &workspace().files {
        for (number, line) in file.text.lines().enumerate() {
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
