//! Words of the private dialect become fewer, and nothing is left undone.

use farfield_lab::reading::figures::dialect;

use super::{check, workspace};

/// Words of the dialect in the tree. A change that removes some lowers it.
const MOST: usize = 55;
/// By how much the count may be below it before it is lowered.
const SLACK: usize = 20;

#[test]
fn the_dialect_does_not_grow() {
    let words = dialect(workspace());
    assert!(
        words <= MOST,
        "{words} words of the dialect, at most {MOST}: write in plain English (CONTRIBUTING.md)"
    );
    assert!(
        words + SLACK > MOST,
        "{words} words of the dialect: lower MOST"
    );
}

#[test]
fn nothing_is_left_undone() {
    // Put together here, so that this file does not contain them.
    let marks = [
        concat!("TO", "DO"),
        concat!("FIX", "ME"),
        concat!("todo", "!("),
        concat!("unimplemented", "!("),
        concat!("#[", "ignore"),
    ];
    let mut faults = Vec::new();
    for file in &workspace().files {
        for (index, line) in file.text.lines().enumerate() {
            let found = marks.iter().filter(|mark| line.contains(*mark));
            faults.extend(found.map(|mark| format!("{}:{}: {mark}", file.path, index + 1)));
        }
    }
    check(&faults);
}
