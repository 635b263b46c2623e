//! The newest generations of a venue's keys. A renewal that restarted the count would make replaced keys valid again.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail, ensure};
use farfield_node::certificate::common_name_in;
use farfield_node::keys::node_of;
use farfield_proto::transport::{GENERATIONS_FILE, Generations};

use super::files::Folder;

/// Remedy for a lost or outdated file.
const REMEDY: &str = "otherwise replaced keys would be valid again: copy the newest file here, for example from fusion's machine";

/// The newest generations in `folder`, for a renewal of keys of `venue`. Without the file, the keys were made by an
/// earlier release, which had no generations.
///
/// # Errors
/// When the file is missing, or is older than the certificates in the folder.
pub(super) fn known(folder: &Path, venue: &str) -> anyhow::Result<Generations> {
    let path = folder.join(GENERATIONS_FILE);
    let text = Folder::new(folder).read_if_there(GENERATIONS_FILE)?;
    let known = match &text {
        Some(text) => Generations::parse(text, &path)?,
        None => Generations::default(),
    };
    let mut n_nodes = 0;
    for certificate in certificates(folder)? {
        let name = match common_name_in(&certificate) {
            Ok(name) => name,
            // An unreadable certificate may be the reason for its renewal.
            Err(_) if text.is_some() => continue,
            Err(error) => return Err(error.into()),
        };
        let Some((node, generation)) = node_of(venue, &name) else {
            continue;
        };
        n_nodes += 1;
        let newest = known.of(node);
        if generation > newest {
            let found = match &text {
                Some(_) => format!("found {newest} as the newest generation of {node}"),
                None => "found no such file".to_owned(),
            };
            bail!(
                "{}: {found}, expected {generation} or more, as in {}; {REMEDY}",
                path.display(),
                certificate.display()
            );
        }
    }
    ensure!(
        text.is_some() || n_nodes > 0,
        "{}: found neither this file nor certificates of venue {venue} in the folder; {REMEDY}",
        path.display()
    );
    Ok(known)
}

/// The certificates in `folder`, by name.
fn certificates(folder: &Path) -> anyhow::Result<Vec<PathBuf>> {
    let read = || {
        let paths = std::fs::read_dir(folder)?.map(|entry| entry.map(|entry| entry.path()));
        paths.collect::<std::io::Result<Vec<PathBuf>>>()
    };
    let mut paths = read().with_context(|| format!("reading the folder {}", folder.display()))?;
    paths.retain(|path| path.extension().is_some_and(|it| it == "pem"));
    paths.sort();
    Ok(paths)
}
