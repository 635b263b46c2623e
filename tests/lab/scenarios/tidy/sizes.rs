//! How long things are, and how many lie together.

use farfield_lab::reading::figures::{
    MAX_FILE_LINES, MAX_FILES_OF_FOLDER, MAX_FUNCTION_LINES, full_folders,
};
use farfield_lab::reading::modules::tree::Role;
use farfield_lab::reading::syntax::code_file::CodeFile;

use super::{check, workspace};

#[test]
fn no_file_is_longer_than_one_subject() {
    let long = |file: &CodeFile| {
        let lines = file.lines();
        let path = &file.path;
        (lines > MAX_FILE_LINES).then(|| format!("{path}: {lines} lines, at most {MAX_FILE_LINES}"))
    };
    let files = workspace().files.values();
    check(&files.filter_map(long).collect::<Vec<_>>());
}

#[test]
fn no_function_is_longer_than_a_screen_or_two() {
    let mut faults = Vec::new();
    for file in workspace().files_of(None, Role::Source) {
        for it in file
            .functions
            .iter()
            .filter(|it| it.lines > MAX_FUNCTION_LINES)
        {
            let place = format!("{}:{}: {}", file.path, it.line, it.name);
            faults.push(format!(
                "{place}: {} lines, at most {MAX_FUNCTION_LINES}",
                it.lines
            ));
        }
    }
    check(&faults);
}

#[test]
fn no_folder_has_more_files_than_can_be_kept_in_mind() {
    let told = |(folder, files): (String, usize)| {
        format!("{folder}: {files} files of Rust, at most {MAX_FILES_OF_FOLDER}")
    };
    let full = full_folders(workspace());
    check(&full.into_iter().map(told).collect::<Vec<_>>());
}

#[test]
fn every_file_says_at_its_head_what_it_is() {
    let headless = |file: &CodeFile| {
        let mut lines = file.text.lines();
        let first = lines.find(|line| !line.trim().is_empty() && !line.starts_with("#!["));
        let head = first.is_some_and(|line| line.starts_with("//! ") && line.len() > 12);
        (!head).then(|| format!("{}: does not start with a `//!` sentence", file.path))
    };
    let files = workspace().files.values();
    check(&files.filter_map(headless).collect::<Vec<_>>());
}

#[test]
fn every_file_is_part_of_a_crate() {
    let told = |path: &str| format!("{path}: no `mod` brings it in");
    check(&workspace().orphans().map(told).collect::<Vec<_>>());
}
