//! What is written down is true of the tree.

use farfield_lab::reading::workspace::is_rust;

use super::{check, root, workspace};

/// `ARCHITECTURE.md` is read in one sitting.
const MAX_ARCHITECTURE_LINES: usize = 220;

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
fn the_architecture_can_be_read_in_one_sitting_and_names_what_exists() {
    let text = &workspace().texts["ARCHITECTURE.md"];
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
