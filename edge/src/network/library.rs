//! Search for ONNX Runtime libraries.

use std::collections::BTreeSet;
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// The variable with the library's path; it has priority.
pub(super) const VARIABLE: &str = "ORT_DYLIB_PATH";

/// The searched places, read from the process once.
#[derive(Debug, Clone, Default)]
pub(super) struct Places {
    /// `$ORT_DYLIB_PATH`, if set and not empty.
    pub(super) variable: Option<PathBuf>,
    /// Folder of the running binary.
    pub(super) binary_folder: Option<PathBuf>,
    /// The system's library folders.
    pub(super) system: Vec<PathBuf>,
    /// The user's home, for Python packages.
    pub(super) home: Option<PathBuf>,
}

impl Places {
    /// The places of this process.
    pub(super) fn of_process() -> Self {
        let set = |name: &str| std::env::var_os(name).filter(|value: &OsString| !value.is_empty());
        let mut system: Vec<PathBuf> = set("LD_LIBRARY_PATH")
            .iter()
            .flat_map(|paths| std::env::split_paths(paths).collect::<Vec<_>>())
            .collect();
        let triplet = format!("{}-linux-gnu", std::env::consts::ARCH);
        for root in ["/usr/local/lib", "/usr/lib", "/lib"] {
            system.push(Path::new(root).join(&triplet));
            system.push(root.into());
        }
        system.push("/usr/lib64".into());
        system.push("/opt/onnxruntime/lib".into());
        let exe = std::env::current_exe().ok();
        Self {
            variable: set(VARIABLE).map(PathBuf::from),
            binary_folder: exe.and_then(|exe| exe.parent().map(Path::to_path_buf)),
            system,
            home: set("HOME").map(PathBuf::from),
        }
    }

    /// Libraries in the folder of the binary and in the system's folders, in that order.
    pub(super) fn installed(&self) -> Vec<PathBuf> {
        self.binary_folder
            .iter()
            .chain(&self.system)
            .flat_map(|folder| libraries(folder))
            .collect()
    }

    /// Libraries in installed `onnxruntime` Python packages: first of the `python3` on the path,
    /// then of the user's and the system's other Pythons.
    pub(super) fn of_python_packages(&self) -> Vec<PathBuf> {
        let mut packages: Vec<PathBuf> = package_of_python3().into_iter().collect();
        let mut roots: Vec<PathBuf> = Vec::new();
        if let Some(home) = &self.home {
            roots.push(home.join(".local/lib"));
            let versions = home.join(".pyenv/versions");
            roots.extend(
                sorted_entries(&versions)
                    .into_iter()
                    .map(|name| versions.join(name).join("lib")),
            );
        }
        roots.extend(["/usr/local/lib", "/usr/lib"].map(PathBuf::from));
        for root in roots {
            for name in sorted_entries(&root)
                .iter()
                .filter(|name| name.starts_with("python3"))
            {
                let python = root.join(name);
                packages.extend(
                    ["site-packages", "dist-packages"].map(|p| python.join(p).join("onnxruntime")),
                );
            }
        }
        let mut seen = BTreeSet::new();
        let libraries = packages
            .iter()
            .flat_map(|package| libraries(&package.join("capi")));
        libraries
            .filter(|library| seen.insert(library.clone()))
            .collect()
    }
}

/// Asks `python3` for the path of `onnxruntime`, without importing it.
fn package_of_python3() -> Option<PathBuf> {
    const ASK: &str = "import importlib.util as u; s = u.find_spec('onnxruntime'); \
                       print(s.submodule_search_locations[0] if s else '')";
    let mut python = Command::new("python3");
    let answer = python
        .args(["-c", ASK])
        .stdin(Stdio::null())
        .stderr(Stdio::null())
        .output()
        .ok()?;
    let line = String::from_utf8(answer.stdout).ok()?;
    (answer.status.success() && !line.trim().is_empty()).then(|| PathBuf::from(line.trim()))
}

/// The ONNX Runtime libraries in a folder, the highest version first; a file with several names
/// counts once.
fn libraries(folder: &Path) -> Vec<PathBuf> {
    let entries = sorted_entries(folder);
    let named = entries
        .iter()
        .filter_map(|name| Some((version(name)?, name)));
    let mut named: Vec<_> = named.collect();
    named.sort();
    let paths = named.iter().rev().map(|(_, name)| folder.join(name));
    let mut seen = BTreeSet::new();
    paths
        .filter(|path| seen.insert(path.canonicalize().unwrap_or_else(|_| path.clone())))
        .collect()
}

/// The version in the name of an ONNX Runtime library; empty if the name has none, `None` if it is
/// another file.
fn version(name: &str) -> Option<Vec<u32>> {
    let rest = match name {
        "onnxruntime.dll" | "libonnxruntime.dylib" => "",
        _ => name
            .strip_prefix("libonnxruntime.so")
            .or_else(|| name.strip_prefix("libonnxruntime.")?.strip_suffix("dylib"))?,
    };
    rest.split('.')
        .filter(|part| !part.is_empty())
        .map(|part| part.parse().ok())
        .collect()
}

/// The names in a folder, sorted; empty if the folder does not exist.
fn sorted_entries(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let mut names: Vec<String> = entries
        .filter_map(|entry| entry.file_name().into_string().ok())
        .collect();
    names.sort();
    names
}

#[cfg(test)]
mod tests {
    use super::*;

    fn touch(folder: &Path, name: &str) -> PathBuf {
        std::fs::create_dir_all(folder).unwrap();
        std::fs::write(folder.join(name), "").unwrap();
        folder.join(name)
    }

    #[test]
    fn only_the_runtime_itself_counts_as_its_library() {
        assert_eq!(version("libonnxruntime.so"), Some(vec![]));
        assert_eq!(version("libonnxruntime.so.1.31.1"), Some(vec![1, 31, 1]));
        assert_eq!(version("libonnxruntime.1.24.0.dylib"), Some(vec![1, 24, 0]));
        assert_eq!(version("libonnxruntime_providers_shared.so"), None);
        assert_eq!(version("libonnxruntime.so.debug"), None);
        assert_eq!(version("libzenoh.so"), None);
    }

    #[test]
    fn the_binary_folder_and_newer_versions_come_first() {
        let folder = tempfile::tempdir().unwrap();
        let (binary, system) = (folder.path().join("bin"), folder.path().join("lib"));
        let first = touch(&binary, "libonnxruntime.so");
        let third = touch(&system, "libonnxruntime.so.1.9.0");
        let second = touch(&system, "libonnxruntime.so.1.24.3");
        #[cfg(unix)]
        std::os::unix::fs::symlink(&second, system.join("libonnxruntime.so")).unwrap();
        let missing = folder.path().join("no");
        let places = Places {
            binary_folder: Some(binary),
            system: vec![missing, system],
            ..Places::default()
        };
        assert_eq!(places.installed(), [first, second, third]);
    }

    #[test]
    fn packages_of_the_users_pythons_are_found() {
        let home = tempfile::tempdir().unwrap();
        let capi = |python: &str| home.path().join(python).join("onnxruntime/capi");
        let user = touch(
            &capi(".local/lib/python3.11/site-packages"),
            "libonnxruntime.so.1.31.1",
        );
        let pyenv = touch(
            &capi(".pyenv/versions/3.12.1/lib/python3.12/site-packages"),
            "libonnxruntime.so.1.30.0",
        );
        let places = Places {
            home: Some(home.path().to_owned()),
            ..Places::default()
        };
        let found = places.of_python_packages();
        let ours: Vec<_> = found
            .iter()
            .filter(|path| path.starts_with(home.path()))
            .collect();
        assert_eq!(ours, [&user, &pyenv]);
    }
}
