//! Checks the paths of output files before any is created.

use std::path::{Path, PathBuf};

use anyhow::{bail, ensure};
use farfield_node::files::obstacle_of_folder;

/// Refuses a `folder`, given by `option`, if it or one of its parents is a file.
///
/// # Errors
/// Names the option and the file.
pub(crate) fn check_folder(option: &str, folder: &Path) -> anyhow::Result<()> {
    if let Some(file) = obstacle_of_folder(folder) {
        bail!(
            "{option} {}: {} is a file, expected a folder",
            folder.display(),
            file.display()
        );
    }
    Ok(())
}

/// Refuses a `file`, given by `option`, that is a folder, or whose folder is invalid.
///
/// # Errors
/// Names the option and the folder.
pub(crate) fn check_file(option: &str, file: &Path) -> anyhow::Result<()> {
    ensure!(
        !file.is_dir(),
        "{option} {}: found a folder, expected a file",
        file.display()
    );
    file.parent().map_or(Ok(()), |it| check_folder(option, it))
}

/// The file `word`; if that is a folder, the file `name` in it.
///
/// # Errors
/// A folder without that file.
pub(crate) fn file_in(word: &Path, name: &str) -> anyhow::Result<PathBuf> {
    if !word.is_dir() {
        return Ok(word.to_owned());
    }
    let file = word.join(name);
    ensure!(
        file.is_file(),
        "{}: found a folder without {name}, expected a file",
        word.display()
    );
    Ok(file)
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    #[test]
    fn a_trailing_slash_does_not_hide_a_file() {
        let dir = tempfile::tempdir().unwrap();
        let file = dir.path().join("file");
        fs::write(&file, "").unwrap();
        check_folder("--out", &file.join("")).unwrap_err();
        check_folder("--out", &dir.path().join("new/")).unwrap();
        check_folder("--out", Path::new(".")).unwrap();
    }

    #[test]
    fn files_and_folders_are_distinguished() {
        let dir = tempfile::tempdir().unwrap();
        let (folder, file) = (dir.path().join("run"), dir.path().join("poses.jsonl"));
        fs::create_dir(&folder).unwrap();
        fs::write(&file, "").unwrap();
        let new = folder.join("new");
        for (result, expected) in [
            (check_folder("--out", &folder), Ok(())),
            (check_folder("--out", &new.join("deeper")), Ok(())),
            (
                check_folder("--out", &file),
                Err("is a file, expected a folder"),
            ),
            (
                check_folder("--out", &file.join("in")),
                Err("poses.jsonl is a file"),
            ),
            (check_file("--to", &new), Ok(())),
            (check_file("--to", Path::new("anna.toml")), Ok(())),
            (
                check_file("--to", &folder),
                Err("found a folder, expected a file"),
            ),
            (check_file("--to", &new.join("anna.toml")), Ok(())),
            (
                check_file("--to", &file.join("anna.toml")),
                Err("poses.jsonl is a file"),
            ),
        ] {
            match (result, expected) {
                (Ok(()), Ok(())) => {}
                (Err(error), Err(expected)) => {
                    let error = error.to_string();
                    assert!(error.contains(expected), "{error}");
                }
                (result, expected) => panic!("{result:?}, expected {expected:?}"),
            }
        }
    }

    #[test]
    fn a_run_folder_is_replaced_by_its_poses() {
        let dir = tempfile::tempdir().unwrap();
        let file = dir.path().join("poses.jsonl");
        assert!(file_in(dir.path(), "poses.jsonl").is_err());
        fs::write(&file, "").unwrap();
        assert_eq!(file_in(dir.path(), "poses.jsonl").unwrap(), file);
        assert_eq!(file_in(&file, "truth.jsonl").unwrap(), file);
    }
}
