//! The folder of installed networks: a folder per network with its card, ONNX file and licence.

use std::fs::{self, File, Permissions};
use std::io::{self, ErrorKind, Write as _};
use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};

use farfield_node::files::read_text_bounded;
use farfield_node::networks::{card_in, folder, is_installed_name};
use farfield_proto::model_card::ModelCard;

use crate::known::{KNOWN, KnownNetwork, Package, Task};

/// Name of the file with the licence.
const LICENCE: &str = "LICENCE.txt";
/// Name of the file with the licence of the package, if it differs.
const PACKAGE_LICENCE: &str = "LICENCE-OF-PACKAGE.txt";
/// Longest card that is read, bytes.
const MAX_CARD_BYTES: u64 = 1 << 20;
/// All users may read a network, as services run as other users.
const FOLDER_MODE: u32 = 0o755;

/// The folder of installed networks, which may not exist yet.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Store {
    folder: PathBuf,
}

/// A network in the folder.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Installed {
    /// Its name.
    pub name: String,
    /// The path of its card.
    pub card: PathBuf,
    /// Its task, or why its card or ONNX file cannot be read.
    pub task: Result<Task, String>,
}

impl Store {
    /// The store in `folder`.
    pub fn in_folder(folder: impl Into<PathBuf>) -> Self {
        Self {
            folder: folder.into(),
        }
    }

    /// The store of this user; `None` if no variable names its folder.
    pub fn of_user() -> Option<Self> {
        folder().map(Self::in_folder)
    }

    /// Its folder.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// The installed networks: known ones in the order of the table, then others by name.
    ///
    /// # Errors
    /// When the folder exists but cannot be read.
    pub fn installed(&self) -> io::Result<Vec<Installed>> {
        let entries = match fs::read_dir(&self.folder) {
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(Vec::new()),
            entries => entries?,
        };
        let mut all = Vec::new();
        for entry in entries {
            let name = entry?.file_name().into_string();
            // Unfinished installations begin with a dot.
            let name = name.ok().filter(|name| is_installed_name(name));
            all.extend(name.and_then(|name| self.network(&name)));
        }
        let place = |name: &str| KNOWN.iter().position(|known| known.name == name);
        all.sort_by_key(|it| (place(&it.name).unwrap_or(KNOWN.len()), it.name.clone()));
        Ok(all)
    }

    /// The installed network `name`.
    pub fn network(&self, name: &str) -> Option<Installed> {
        let card = card_in(&self.folder, name);
        let name = name.to_owned();
        card.exists().then(|| Installed {
            task: task(&card),
            name,
            card,
        })
    }

    /// Writes a network with its ONNX file. It replaces an installed one when all files are on the disk.
    ///
    /// # Errors
    /// When a file or folder cannot be written; the message names it.
    pub fn write(&self, network: &KnownNetwork, onnx: &[u8]) -> io::Result<Installed> {
        let name = network.name;
        at(&self.folder, fs::create_dir_all(&self.folder))?;
        let new = tempfile::Builder::new()
            .prefix(".new-")
            .tempdir_in(&self.folder);
        let new = at(&self.folder, new)?;
        let licence = licence_text(network);
        let mut files = vec![
            (format!("{name}.onnx"), onnx),
            (LICENCE.to_owned(), licence.as_bytes()),
            (format!("{name}.toml"), network.card.as_bytes()),
        ];
        if let Some(upstream) = network.upstream {
            let text = upstream.package_licence.text.as_bytes();
            files.push((PACKAGE_LICENCE.to_owned(), text));
        }
        for (file, bytes) in files {
            let path = new.path().join(file);
            at(&path, write_synced(&path, bytes))?;
        }
        let mode = Permissions::from_mode(FOLDER_MODE);
        at(new.path(), fs::set_permissions(new.path(), mode))?;
        let target = self.folder.join(name);
        // The old folder goes with this one.
        let old = tempfile::Builder::new()
            .prefix(".old-")
            .tempdir_in(&self.folder);
        let old = at(&self.folder, old)?;
        let replaced = old.path().join(name);
        if target.exists() {
            at(&target, fs::rename(&target, &replaced))?;
        }
        let named = fs::rename(new.path(), &target);
        if named.is_err() && replaced.exists() {
            at(&target, fs::rename(&replaced, &target))?;
        }
        at(&target, named)?;
        at(
            &self.folder,
            File::open(&self.folder).and_then(|it| it.sync_all()),
        )?;
        let card = card_in(&self.folder, name);
        Ok(Installed {
            name: name.to_owned(),
            task: task(&card),
            card,
        })
    }
}

fn write_synced(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let mut file = File::create_new(path)?;
    file.write_all(bytes)?;
    file.sync_all()
}

/// Adds the path to an error.
fn at<T>(path: &Path, outcome: io::Result<T>) -> io::Result<T> {
    outcome.map_err(|error| {
        let problem = format!("writing {}: {error}", path.display());
        io::Error::new(error.kind(), problem)
    })
}

/// The task of a network by its card.
fn task(card: &Path) -> Result<Task, String> {
    let text = read_text_bounded(card, MAX_CARD_BYTES)
        .map_err(|error| format!("reading {}: {error}", card.display()))?;
    let parsed = ModelCard::parse(&text, card).map_err(|error| error.to_string())?;
    let (task, file) = match parsed {
        ModelCard::Heatmap(card) => (Task::Keypoints, card.file),
        ModelCard::Detector(card) => (Task::Detection, card.file),
    };
    if file.is_file() {
        Ok(task)
    } else {
        Err(format!("{} does not exist", file.display()))
    }
}

/// Source, changes and licence of the network.
fn licence_text(network: &KnownNetwork) -> String {
    let files = network.files.iter();
    let files: Vec<String> = files
        .map(|it| format!("{} (SHA-256 {})", it.name, it.sha256))
        .collect();
    let upstream = network.upstream.map_or(String::new(), |upstream| {
        format!(
            "The network is by {}, published under this licence as {}.\nThe package itself is under the licence {}: \
             {PACKAGE_LICENCE}.\n",
            upstream.authors, upstream.published, upstream.package_licence.id
        )
    });
    let from = network.packages.iter().map(Package::to_string);
    let from: Vec<String> = from.collect();
    format!(
        "{}.onnx is made from {}\nof the package {}, under the licence {}.\n{upstream}Changes: converted to ONNX; only \
         the outputs that Farfield reads are kept.\n\n{}",
        network.name,
        files.join("\nand "),
        from.join(" or "),
        network.licence.id,
        network.licence.text
    )
}
