//! Folders that a node creates for its output, and removes if they stay empty.

use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use anyhow::Context as _;

/// Folders created by this process, each inside the one before. Dropping it removes the empty ones.
#[derive(Debug, Default)]
pub(crate) struct MadeFolders(Vec<PathBuf>);

impl MadeFolders {
    /// Creates `folder` and its missing parents; an empty path is the current folder.
    ///
    /// # Errors
    /// Names the folder that cannot be created; those created before are removed.
    pub(crate) fn with_parents(folder: &Path) -> anyhow::Result<Self> {
        let is_missing = |it: &&Path| !it.as_os_str().is_empty() && !it.exists();
        let missing: Vec<&Path> = folder.ancestors().take_while(is_missing).collect();
        let mut made = Self::default();
        for folder in missing.into_iter().rev() {
            made.make(folder)?;
        }
        Ok(made)
    }

    /// Creates `folder`; returns whether it did not exist.
    ///
    /// # Errors
    /// Names the folder that cannot be created.
    pub(crate) fn make(&mut self, folder: &Path) -> anyhow::Result<bool> {
        let mut made = fs::create_dir(folder);
        if made
            .as_ref()
            .is_err_and(|it| it.kind() == ErrorKind::NotFound)
            && let Some(parent) = folder.parent()
        {
            // Another run, which had created the parent, has removed it again.
            let mut above = Self::with_parents(parent)?;
            self.0.append(&mut above.0);
            made = fs::create_dir(folder);
        }
        match made {
            Ok(()) => {
                self.0.push(folder.to_owned());
                Ok(true)
            }
            Err(error) if error.kind() == ErrorKind::AlreadyExists => Ok(false),
            Err(error) if error.kind() == ErrorKind::NotADirectory => {
                let is_file = |it: &&Path| it.is_file();
                let file = folder.ancestors().find(is_file).unwrap_or(folder);
                Err(error).with_context(|| {
                    format!(
                        "making folder {}: {} is a file: rename it, or use another folder with `--out`",
                        folder.display(),
                        file.display()
                    )
                })
            }
            Err(error) => Err(error).with_context(|| format!("making folder {}", folder.display())),
        }
    }

    /// Keeps the folders, empty or not.
    pub(crate) fn keep(mut self) {
        self.0.clear();
    }
}

impl Drop for MadeFolders {
    fn drop(&mut self) {
        for folder in self.0.iter().rev() {
            // Removing a folder that is not empty fails, as intended.
            drop(fs::remove_dir(folder));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn created_folders_are_removed_if_empty_and_existing_ones_stay() {
        let dir = tempfile::tempdir().unwrap();
        let at = |name: &str| dir.path().join(name);
        fs::create_dir(at("there")).unwrap();
        let mut made = MadeFolders::with_parents(&at("there/new/deeper")).unwrap();
        assert!(made.make(&at("there/new/deeper/deepest")).unwrap());
        assert!(!made.make(&at("there")).unwrap());
        drop(made);
        assert!(at("there").is_dir() && !at("there/new").exists());
        let made = MadeFolders::with_parents(&at("a/b")).unwrap();
        fs::write(at("a/file"), "").unwrap();
        drop(made);
        assert!(at("a/file").is_file() && !at("a/b").exists());
        MadeFolders::with_parents(&at("kept/b")).unwrap().keep();
        assert!(at("kept/b").is_dir());
    }

    #[test]
    fn a_file_in_place_of_a_folder_is_named() {
        let dir = tempfile::tempdir().unwrap();
        let file = dir.path().join("results");
        fs::write(&file, "").unwrap();
        let refused = MadeFolders::with_parents(&file.join("run-1")).unwrap_err();
        let is_file = format!("{} is a file", file.display());
        assert!(refused.to_string().contains(&is_file), "{refused}");
    }

    #[test]
    fn a_failure_removes_the_folders_created_before() {
        let dir = tempfile::tempdir().unwrap();
        let long = dir.path().join("new").join("x".repeat(300));
        let refused = MadeFolders::with_parents(&long).unwrap_err();
        assert!(refused.to_string().contains("new"), "{refused}");
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 0);
    }
}
