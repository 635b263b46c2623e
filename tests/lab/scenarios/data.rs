//! Recordings that some scenarios need and the project does not contain.

use std::fs;
use std::io::{Write as _, stdout};
use std::path::{Path, PathBuf};

use farfield_edge::network::{BackendChoice, InferenceBackend};

/// A path in the folder of recordings: `$FARFIELD_DATA`, else `../shared` next to the checkout.
///
/// Prints on stdout that `scenario` is skipped if `needed` is missing.
pub(crate) fn recording(scenario: &str, needed: &str) -> Option<PathBuf> {
    let root = std::env::var_os("FARFIELD_DATA")
        .map_or_else(|| checkout().join("../shared"), PathBuf::from);
    let path = root.join(needed);
    if path.exists() {
        return Some(path);
    }
    print_skipped(&format!(
        "{scenario}: {} is not there (set FARFIELD_DATA to the folder that holds it)",
        path.display()
    ));
    None
}

/// Whether ONNX Runtime is installed. If not, prints on stdout that `scenario` is skipped, because `ort-tract` takes twenty
/// times as long.
pub(crate) fn onnx_runtime(scenario: &str) -> bool {
    let is_installed =
        InferenceBackend::start(BackendChoice::Best).is_ok_and(|backend| !backend.is_tract());
    if !is_installed {
        print_skipped(&format!(
            "{scenario}: no ONNX Runtime library (pip install onnxruntime), and ort-tract is too slow for it"
        ));
    }
    is_installed
}

/// The cases of `scenario` to run: the first `usual`, or all if `$FARFIELD_EVERY_CASE` is 1 (`.ci/measure cases` sets it).
pub(crate) fn cases<T, const N: usize>(
    scenario: &str,
    all: [T; N],
    usual: usize,
) -> impl Iterator<Item = T> {
    let is_every = std::env::var("FARFIELD_EVERY_CASE").is_ok_and(|value| value == "1");
    let tried = if is_every { N } else { usual };
    if tried < N {
        print_skipped(&format!(
            "{scenario}: {} of {N} cases (FARFIELD_EVERY_CASE=1 tries all)",
            N - tried
        ));
    }
    all.into_iter().take(tried)
}

pub(crate) fn checkout() -> &'static Path {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."))
}

/// A folder with a copy of the sample, `examples/walk`, to spoil or to run commands in.
pub(crate) struct SampleFolder {
    dir: tempfile::TempDir,
}

impl SampleFolder {
    pub(crate) fn new() -> Self {
        let dir = tempfile::tempdir().unwrap();
        for entry in fs::read_dir(checkout().join("examples/walk")).unwrap() {
            let path = entry.unwrap().path();
            fs::copy(&path, dir.path().join(path.file_name().unwrap())).unwrap();
        }
        Self { dir }
    }

    pub(crate) fn folder(&self) -> &Path {
        self.dir.path()
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }

    pub(crate) fn replace(&self, file: &str, from: &str, to: &str) {
        let text = fs::read_to_string(self.path(file)).unwrap();
        assert!(text.contains(from), "{file} has no {from:?}");
        fs::write(self.path(file), text.replacen(from, to, 1)).unwrap();
    }
}

/// Writes to stdout directly: output of macros is hidden for tests that pass.
pub(crate) fn print_skipped(what: &str) {
    stdout()
        .write_all(format!("SKIPPED {what}\n").as_bytes())
        .unwrap();
}
