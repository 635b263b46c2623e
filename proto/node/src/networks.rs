//! Where installed networks lie: a folder per user, with a folder per network.
//!
//! A venue file names an installed network by its name alone: `network = "blazepose"`.

use std::env;
use std::path::{Path, PathBuf};

/// The variable with the folder of installed networks; it has priority.
pub const FOLDER_VARIABLE: &str = "FARFIELD_NETWORKS";

/// The folder of installed networks: `$FARFIELD_NETWORKS`, else `farfield/networks` in `$XDG_DATA_HOME`, else in
/// `~/.local/share`; `None` if none of these is set.
pub fn folder() -> Option<PathBuf> {
    let set = |name: &str| env::var_os(name).filter(|value| !value.is_empty());
    let below = |folder: PathBuf| folder.join("farfield/networks");
    let data = || set("XDG_DATA_HOME").map(PathBuf::from);
    let home = || set("HOME").map(|home| PathBuf::from(home).join(".local/share"));
    set(FOLDER_VARIABLE)
        .map(PathBuf::from)
        .or_else(|| data().or_else(home).map(below))
}

/// The folder of networks that an edge received from fusion, next to the venue file.
pub const RECEIVED: &str = "networks";

/// Whether `text` names an installed network and not a file: ASCII letters, digits, `-` and `_`.
pub fn is_installed_name(text: &str) -> bool {
    let is_allowed = |c: char| c.is_ascii_alphanumeric() || "-_".contains(c);
    !text.is_empty() && !text.starts_with('-') && text.chars().all(is_allowed)
}

/// The card of the network `name` in the folder of installed networks.
pub fn card_in(folder: &Path, name: &str) -> PathBuf {
    folder.join(name).join(format!("{name}.toml"))
}

/// Where an edge keeps the card of an installed network that it received from fusion, relative to
/// the folder of the venue file.
pub fn received_card(name: &str) -> PathBuf {
    card_in(Path::new(RECEIVED), name)
}

/// The card of the installed network `name` of the venue file `venue`: the received one, else that
/// of this user. `None` if `name` is a path, or no variable names the user's folder.
pub fn installed_card(venue: &Path, name: &str) -> Option<PathBuf> {
    if !is_installed_name(name) {
        return None;
    }
    let received = venue.with_file_name(received_card(name));
    if received.exists() {
        return Some(received);
    }
    folder().map(|folder| card_in(&folder, name))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_without_separators_is_an_installed_network() {
        for name in ["blazepose", "blazepose-heavy", "net_2"] {
            assert!(is_installed_name(name), "{name}");
        }
        for path in ["", "-x", "net.toml", "./net", "models/net", "..", "/net"] {
            assert!(!is_installed_name(path), "{path}");
        }
    }

    #[test]
    fn a_received_network_has_priority() {
        let folder = tempfile::tempdir().unwrap();
        let venue = folder.path().join("hall.toml");
        let received = folder.path().join("networks/net/net.toml");
        assert_ne!(installed_card(&venue, "net"), Some(received.clone()));
        std::fs::create_dir_all(received.parent().unwrap()).unwrap();
        std::fs::write(&received, "").unwrap();
        assert_eq!(installed_card(&venue, "net"), Some(received));
        assert_eq!(installed_card(&venue, "net.toml"), None);
    }
}
