//! The files that may be fetched: those named by the fetched venue file and its cards, and none
//! among the keys. Without keys, any program that answers first defines the list.

use std::collections::BTreeMap;
use std::io;
use std::path::{Component, Path, PathBuf};

use anyhow::{Context as _, ensure};
use farfield_node::networks::{is_installed_name, received_card};
use farfield_proto::message::handout::{FileKind, SharedFile};
use farfield_proto::model_card::ModelCard;
use farfield_proto::toml_file::TomlFile;
use serde::Deserialize;

/// Longest venue file, calibration or card that is fetched, bytes.
const MAX_TEXT_BYTES: u64 = 16 << 20;
/// Longest network that is fetched, bytes; ONNX files are not longer.
const MAX_NETWORK_BYTES: u64 = 2 << 30;

/// The order of fetching: files that name others come first.
pub(super) fn order(kind: FileKind) -> u8 {
    match kind {
        FileKind::Venue => 0,
        FileKind::Calibration | FileKind::NetworkCard | FileKind::DetectorCard => 1,
        FileKind::Network | FileKind::Detector => 2,
    }
}

/// Whether a file of this kind names others.
pub(super) fn names_others(kind: FileKind) -> bool {
    matches!(
        kind,
        FileKind::Venue | FileKind::NetworkCard | FileKind::DetectorCard
    )
}

/// The fields of a venue file that name other files.
#[derive(Debug, Deserialize)]
struct VenueExcerpt {
    calibration: String,
    network: Option<String>,
    detector: Option<String>,
    #[serde(default)]
    security: SecurityExcerpt,
}

#[derive(Debug, Default, Deserialize)]
struct SecurityExcerpt {
    certificates: Option<String>,
}

/// The files named so far.
#[derive(Debug)]
pub(super) struct VenueFileNames {
    /// The folder of the venue file.
    folder: PathBuf,
    /// Paths relative to the folder, by kind.
    named: BTreeMap<FileKind, PathBuf>,
    /// Folders of keys.
    keys: Vec<PathBuf>,
}

impl VenueFileNames {
    /// Only the venue file in `folder` is known yet. No file is written into `keys`.
    pub(super) fn new(folder: &Path, keys: Vec<PathBuf>) -> Self {
        Self {
            folder: folder.to_owned(),
            named: BTreeMap::new(),
            keys,
        }
    }

    /// Adds the files that `file` with the content `text` names.
    ///
    /// # Errors
    /// If `file` does not have the listed content.
    pub(super) fn learn(&mut self, file: &SharedFile, text: &str) -> anyhow::Result<()> {
        let what = || format!("fusion's {}", file.kind.name());
        match file.kind {
            FileKind::Venue => {
                let path = Path::new("venue.toml");
                let venue =
                    TomlFile::parse(text, path).and_then(|file| file.read::<VenueExcerpt>());
                let venue = venue.with_context(what)?;
                let named = [
                    (FileKind::Calibration, Some(venue.calibration.into())),
                    (FileKind::NetworkCard, venue.network.map(card_path)),
                    (FileKind::DetectorCard, venue.detector.map(card_path)),
                ];
                let named = named.into_iter();
                self.named
                    .extend(named.filter_map(|(kind, path)| Some((kind, path?))));
                let keys = venue.security.certificates;
                self.keys.extend(keys.map(|keys| self.folder.join(keys)));
            }
            FileKind::NetworkCard | FileKind::DetectorCard => {
                let path = self.named.get(&file.kind).cloned().unwrap_or_default();
                let card = ModelCard::parse(text, &path).with_context(what)?;
                let (kind, model) = match card {
                    ModelCard::Heatmap(card) => (FileKind::Network, card.file),
                    ModelCard::Detector(card) => (FileKind::Detector, card.file),
                };
                self.named.insert(kind, model);
            }
            FileKind::Calibration | FileKind::Network | FileKind::Detector => {}
        }
        Ok(())
    }

    /// Checks that `file` may be written to `target`.
    ///
    /// # Errors
    /// If no file names it, `target` is among the keys, or it is too long.
    pub(super) fn check(&self, file: &SharedFile, target: &Path) -> anyhow::Result<()> {
        let name = file.kind.name();
        let most = match file.kind {
            FileKind::Network | FileKind::Detector => MAX_NETWORK_BYTES,
            _ => MAX_TEXT_BYTES,
        };
        ensure!(
            file.bytes <= most,
            "fusion's {name} has {} bytes; at most {most} are fetched",
            file.bytes
        );
        if file.kind == FileKind::Venue {
            return Ok(());
        }
        let named = self.named.get(&file.kind);
        ensure!(
            named.is_some_and(|named| plain(named) == plain(Path::new(&file.path))),
            "fusion hands out a {name} at `{}`, which its venue file does not name",
            file.path
        );
        for keys in &self.keys {
            let (target, keys) = real(target)
                .and_then(|target| Ok((target, real(keys)?)))
                .with_context(|| format!("finding {}", target.display()))?;
            ensure!(
                !target.starts_with(&keys),
                "fusion's {name} would be among the keys in {}, where no file is written",
                keys.display()
            );
        }
        Ok(())
    }
}

/// The path of the card that a venue file names: an installed network of fusion's machine gets a
/// place in the venue's folder.
fn card_path(name: String) -> PathBuf {
    if is_installed_name(&name) {
        received_card(&name)
    } else {
        name.into()
    }
}

/// `path` without `.` components.
fn plain(path: &Path) -> PathBuf {
    let parts = path.components();
    parts.filter(|part| *part != Component::CurDir).collect()
}

/// The real path: links are resolved in the existing part; the rest is kept.
fn real(path: &Path) -> io::Result<PathBuf> {
    let path = std::path::absolute(path)?;
    for there in path.ancestors() {
        if let Ok(real) = there.canonicalize() {
            let rest = path.strip_prefix(there).unwrap_or(Path::new(""));
            return Ok(if rest.as_os_str().is_empty() {
                real
            } else {
                real.join(plain(rest))
            });
        }
    }
    Ok(plain(&path))
}

#[cfg(test)]
mod tests {
    use super::*;

    const VENUE: &str = "name = \"hall\"\ncalibration = \"./sub/c.toml\"\nnetwork = \"models/card.toml\"\n[security]\ncertificates = \"keys\"\n";

    fn shared(kind: FileKind, path: &str) -> SharedFile {
        SharedFile {
            kind,
            path: path.to_owned(),
            bytes: 7,
            blake3: [0; 32],
        }
    }

    fn names(folder: &Path, venue: &str) -> VenueFileNames {
        let mut names = VenueFileNames::new(folder, vec![folder.join("certs")]);
        names.learn(&shared(FileKind::Venue, ""), venue).unwrap();
        names
    }

    fn check(names: &VenueFileNames, file: &SharedFile) -> Result<(), String> {
        let target = names.folder.join(&file.path);
        names
            .check(file, &target)
            .map_err(|error| error.to_string())
    }

    #[test]
    fn only_files_named_by_the_venue_file_are_accepted() {
        let folder = tempfile::tempdir().unwrap();
        let names = names(folder.path(), VENUE);
        check(&names, &shared(FileKind::Calibration, "sub/c.toml")).unwrap();
        check(&names, &shared(FileKind::NetworkCard, "models/card.toml")).unwrap();
        for (kind, path) in [
            (FileKind::Calibration, "c.toml"),
            (FileKind::Calibration, "start.sh"),
            (FileKind::NetworkCard, "sub/c.toml"),
            (FileKind::DetectorCard, "models/card.toml"),
            (FileKind::Network, "models/net.onnx"),
        ] {
            let refused = check(&names, &shared(kind, path)).unwrap_err();
            assert!(refused.contains("does not name"), "{path}: {refused}");
        }
    }

    #[test]
    fn an_installed_network_of_fusion_gets_a_place_in_the_venues_folder() {
        let folder = tempfile::tempdir().unwrap();
        let venue = VENUE.replace("models/card.toml", "blazepose");
        let mut names = names(folder.path(), &venue);
        let card = shared(FileKind::NetworkCard, "networks/blazepose/blazepose.toml");
        check(&names, &card).unwrap();
        check(&names, &shared(FileKind::NetworkCard, "blazepose")).unwrap_err();
        let text = "kind = \"detector\"\nfile = \"net.onnx\"\ndecode = \"yolox\"\n\
            input = { name = \"images\", width = 416, height = 416, channels = \"bgr\" }\n\
            normalize = { scale = 1.0, mean = [0.0, 0.0, 0.0], std = [1.0, 1.0, 1.0] }\n\
            output = { name = \"output\", person_class = 0 }\n";
        names.learn(&card, text).unwrap();
        let model = shared(FileKind::Detector, "networks/blazepose/net.onnx");
        check(&names, &model).unwrap();
    }

    #[test]
    fn nothing_is_written_among_the_keys() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::create_dir(folder.path().join("certs")).unwrap();
        let link = folder.path().join("link");
        std::os::unix::fs::symlink(folder.path().join("certs"), link).unwrap();
        for path in ["certs/ca.pem", "keys/ca.pem", "link/ca.pem", "certs/new/c"] {
            let venue = VENUE.replace("./sub/c.toml", path);
            let names = names(folder.path(), &venue);
            let refused = check(&names, &shared(FileKind::Calibration, path)).unwrap_err();
            assert!(refused.contains("keys"), "{path}: {refused}");
        }
    }

    #[test]
    fn a_file_too_large_for_its_kind_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let names = names(folder.path(), VENUE);
        let file = SharedFile {
            bytes: MAX_TEXT_BYTES + 1,
            ..shared(FileKind::Calibration, "sub/c.toml")
        };
        assert!(check(&names, &file).unwrap_err().contains("at most"));
    }
}
