//! Downloads packages with the package manager of the user, whose settings (proxy, mirror, certificates) apply.

use std::ffi::OsString;
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use farfield_proto::plain_text::one_line;

use crate::known::{Client, Package};

/// Most characters of a client's error message that are shown.
const MAX_MESSAGE: usize = 400;
/// Any wheel contains the network: the one for a usual machine is downloaded, whatever Python runs here.
const WHEEL: [&str; 5] = [
    "--implementation=cp",
    "--python-version=3.12",
    "--platform=manylinux_2_28_x86_64",
    "--platform=manylinux2014_x86_64",
    "--only-binary=:all:",
];

/// Why a package was not downloaded.
#[derive(Debug)]
pub(crate) enum FetchError {
    /// The client is not installed.
    NoClient,
    /// The client failed: its message.
    Failed(String),
}

impl Client {
    /// The name of its program.
    pub fn name(self) -> &'static str {
        match self {
            Self::Npm => "npm",
            Self::Pip => "pip",
        }
    }

    /// Programs that may be this client, with their first arguments.
    fn programs(self) -> &'static [&'static [&'static str]] {
        match self {
            Self::Npm => &[&["npm"]],
            Self::Pip => &[&["pip3"], &["pip"], &["python3", "-m", "pip"]],
        }
    }
}

impl Package {
    /// Name and version in the form of its client.
    fn request(&self) -> String {
        match self.client {
            Client::Npm => format!("{}@{}", self.name, self.version),
            Client::Pip => format!("{}=={}", self.name, self.version),
        }
    }

    /// The command with which a user downloads it.
    pub fn command(&self) -> String {
        let request = self.request();
        match self.client {
            Client::Npm => format!("npm pack {request}"),
            Client::Pip => {
                let wheel = WHEEL.join(" ");
                format!("pip download --no-deps {wheel} {request}")
            }
        }
    }

    /// Arguments of the client that downloads it into the current folder.
    fn args(&self) -> Vec<String> {
        let fixed: &[&str] = match self.client {
            Client::Npm => &["pack", "--ignore-scripts", "--loglevel=error"],
            Client::Pip => &["download", "--no-deps", "--quiet", "--dest=."],
        };
        let wheel: &[&str] = match self.client {
            Client::Npm => &[],
            Client::Pip => &WHEEL,
        };
        let words = fixed.iter().chain(wheel).map(|&word| word.to_owned());
        words.chain([self.request()]).collect()
    }
}

/// Downloads `package` into the empty `folder`, and returns the path of the archive. Programs are searched in
/// `search_path`, by default that of this process.
pub(crate) fn download(
    package: &Package,
    folder: &Path,
    search_path: Option<&OsString>,
) -> Result<PathBuf, FetchError> {
    for program in package.client.programs() {
        let mut command = Command::new(program[0]);
        command.args(&program[1..]).args(package.args());
        command.current_dir(folder).stdin(Stdio::null());
        if let Some(path) = search_path {
            command.env("PATH", path);
        }
        match command.output() {
            Err(error) if error.kind() == ErrorKind::NotFound => {}
            Err(error) => return Err(FetchError::Failed(error.to_string())),
            Ok(output) if output.status.success() => {
                let archive = only_file(folder);
                return archive.map_err(|error| FetchError::Failed(error.to_string()));
            }
            Ok(output) => {
                let message = String::from_utf8_lossy(&output.stderr).into_owned();
                // Python without pip is no client.
                if program.len() > 1 && message.contains("No module named pip") {
                    continue;
                }
                let lines = message.lines().map(str::trim);
                let lines: Vec<&str> = lines.filter(|line| !line.is_empty()).collect();
                let shown: String = lines.join("; ").chars().take(MAX_MESSAGE).collect();
                return Err(FetchError::Failed(one_line(&shown)));
            }
        }
    }
    Err(FetchError::NoClient)
}

/// The only file in `folder`.
fn only_file(folder: &Path) -> io::Result<PathBuf> {
    let entries = folder.read_dir()?.collect::<io::Result<Vec<_>>>()?;
    match entries.as_slice() {
        [file] => Ok(file.path()),
        files => {
            let problem = format!("the client wrote {} files, expected 1", files.len());
            Err(io::Error::new(ErrorKind::InvalidData, problem))
        }
    }
}
