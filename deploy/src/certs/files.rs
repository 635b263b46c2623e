//! A folder of keys: keys are for their owner alone, and nothing is written over.

use std::fs::{self, OpenOptions};
use std::io::Write as _;
use std::os::unix::fs::OpenOptionsExt as _;
use std::path::{Path, PathBuf};

use anyhow::Context as _;

use super::authority::Pair;

/// The authority's certificate.
pub(super) const AUTHORITY: &str = "ca.pem";
/// The authority's key.
pub(super) const AUTHORITY_KEY: &str = "ca.key";
/// Readable by all, writable by the owner.
const PUBLIC: u32 = 0o644;
/// For the owner alone.
const SECRET: u32 = 0o600;

/// A folder of keys.
pub(super) struct Folder {
    path: PathBuf,
}

impl Folder {
    pub(super) fn new(path: &Path) -> Self {
        Self {
            path: path.to_owned(),
        }
    }

    /// Refuses the first of `names` that is there already.
    pub(super) fn check_free(&self, names: &[String]) -> anyhow::Result<()> {
        let taken = names.iter().map(|name| self.path.join(name));
        let taken = taken
            .into_iter()
            .find(|path| path.symlink_metadata().is_ok());
        taken.map_or(Ok(()), |path| {
            Err(anyhow::anyhow!(
                "{} is there already, and keys are not written over: choose another folder, or issue a node's key again with --renew NODE",
                path.display()
            ))
        })
    }

    pub(super) fn make(&self) -> anyhow::Result<()> {
        fs::create_dir_all(&self.path)
            .with_context(|| format!("making the folder {}", self.path.display()))
    }

    pub(super) fn read(&self, name: &str) -> anyhow::Result<String> {
        let path = self.path.join(name);
        fs::read_to_string(&path).with_context(|| format!("reading {}", path.display()))
    }

    pub(super) fn write(&self, name: &str, text: &str) -> anyhow::Result<()> {
        self.create(name, text, PUBLIC)
    }

    pub(super) fn write_secret(&self, name: &str, text: &str) -> anyhow::Result<()> {
        self.create(name, text, SECRET)
    }

    /// Puts a new pair in the place of a node's old one; a node that reads meanwhile finds whole files.
    pub(super) fn replace(&self, node: &str, pair: &Pair) -> anyhow::Result<()> {
        let files = [
            (format!("{node}.key"), &pair.key, SECRET),
            (format!("{node}.pem"), &pair.certificate, PUBLIC),
        ];
        for (name, text, mode) in &files {
            let new = self.path.join(format!("{name}.new"));
            // What an earlier, interrupted renewal has left.
            drop(fs::remove_file(&new));
            self.create(&format!("{name}.new"), text, *mode)?;
        }
        for (name, _, _) in &files {
            let (from, to) = (self.path.join(format!("{name}.new")), self.path.join(name));
            fs::rename(&from, &to).with_context(|| format!("replacing {}", to.display()))?;
        }
        Ok(())
    }

    fn create(&self, name: &str, text: &str, mode: u32) -> anyhow::Result<()> {
        let path = self.path.join(name);
        let open = OpenOptions::new()
            .write(true)
            .create_new(true)
            .mode(mode)
            .open(&path);
        open.and_then(|mut file| file.write_all(text.as_bytes()))
            .with_context(|| format!("writing {}", path.display()))
    }
}
