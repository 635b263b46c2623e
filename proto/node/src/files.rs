//! Reads the files that describe a venue, for the pure code that parses them.

use std::fs::{self, File};
use std::io::{self, ErrorKind, Read as _};
use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};

use farfield_proto::calibration::{Calibration, text_of};
use farfield_proto::toml_file::{FileError, unread};
use farfield_proto::transport::{GENERATIONS_FILE, Generations, Identity};
use farfield_proto::venue::{Venue, VenueFile};

use crate::networks::installed_card;
use crate::process::say;

/// The key file with which `farfield certs` signs certificates.
pub const AUTHORITY_KEY: &str = "ca.key";

/// Reads the file at `path` whole if it has at most `most_bytes`.
///
/// # Errors
/// When it cannot be read, is not a regular file (a pipe or a device may never end), or is longer,
/// also if it grows meanwhile.
pub fn read_bounded(path: &Path, most_bytes: u64) -> io::Result<Vec<u8>> {
    let refused = |problem| Err(io::Error::new(ErrorKind::InvalidData, problem));
    // Before the file is opened: opening a pipe may block for ever.
    if !fs::metadata(path)?.is_file() {
        return refused("found something other than a file".to_owned());
    }
    let mut bytes = Vec::new();
    let bounded = File::open(path)?.take(most_bytes.saturating_add(1));
    { bounded }.read_to_end(&mut bytes)?;
    if bytes.len() as u64 > most_bytes {
        return refused(format!("found more than {most_bytes} bytes"));
    }
    Ok(bytes)
}

/// As [`read_bounded`], for text.
///
/// # Errors
/// As [`read_bounded`], and when it is not UTF-8.
pub fn read_text_bounded(path: &Path, most_bytes: u64) -> io::Result<String> {
    let text = String::from_utf8(read_bounded(path, most_bytes)?);
    text.map_err(|error| io::Error::new(ErrorKind::InvalidData, error))
}

/// The lowest existing ancestor of `folder` (or `folder` itself), if it is not a folder: it
/// prevents the creation of `folder`.
pub fn obstacle_of_folder(folder: &Path) -> Option<PathBuf> {
    // Without a trailing slash, which would hide a file.
    let folder: PathBuf = folder.components().collect();
    let is_there = |it: &&Path| it.symlink_metadata().is_ok();
    let there = folder.ancestors().find(is_there);
    there.filter(|it| !it.is_dir()).map(Path::to_path_buf)
}

/// Reads the venue file at `path` and its calibration.
///
/// # Errors
/// [`FileError`] when a file cannot be read, and as [`VenueFile::parse`], [`VenueFile::venue`] and
/// [`Calibration::parse`].
pub fn load_venue(path: &Path) -> Result<Venue, FileError> {
    let text = fs::read_to_string(path).map_err(|error| {
        let problem = unread(&error, "the venue file in it, such as venue.toml");
        FileError::new(path, format!("cannot read the venue file: {problem}"))
    })?;
    parse_venue(&text, path)
}

/// Parses `text` as the venue file at `path`, and reads its calibration. Names of installed networks
/// become the paths of their cards.
///
/// # Errors
/// As [`load_venue`].
pub fn parse_venue(text: &str, path: &Path) -> Result<Venue, FileError> {
    let file = VenueFile::parse(text, path)?;
    let calibration_path = file.calibration_path();
    let bytes = fs::read(&calibration_path).map_err(|error| {
        file.calibration_error(format!(
            "cannot read {}: {}",
            calibration_path.display(),
            unread(&error, "a calibration in TOML")
        ))
    })?;
    let calibration_text = text_of(bytes.clone(), &calibration_path)?;
    // Nodes distribute and record the file unchanged.
    if calibration_text.as_bytes() != bytes {
        let problem = "found text that is not UTF-8, expected TOML: `farfield calibrate convert` writes it anew";
        return Err(FileError::new(calibration_path, problem));
    }
    let installed = |name: Option<&str>| name.and_then(|name| installed_card(path, name));
    let (network, detector) = (installed(file.network()), installed(file.detector()));
    let mut venue = file.venue(Calibration::parse(&calibration_text, &calibration_path)?)?;
    venue.network = network.or(venue.network);
    venue.detector = detector.or(venue.detector);
    Ok(venue)
}

/// The files in `folder` that prove the identity of `node`, and the list of outdated certificates.
///
/// # Errors
/// [`FileError`] with the first unreadable file, or with the key if users other than its owner can
/// read it.
pub fn load_identity(folder: &Path, node: &str) -> Result<Identity, FileError> {
    let mut identity = Identity::in_folder(folder, node);
    let files = [
        (
            &identity.authority,
            "the certificate of the venue's authority",
        ),
        (&identity.certificate, "the certificate of this node"),
        (&identity.key, "the key of this node"),
    ];
    for (path, what) in files {
        fs::File::open(path).map_err(|error| {
            let problem = format!("cannot read {what}: {error}; `farfield certs` makes it");
            FileError::new(path, problem)
        })?;
    }
    check_secret(&identity.key)?;
    warn_of_the_authoritys_key(folder);
    identity.generations = load_generations(folder)?;
    Ok(identity)
}

/// The certificate generations in the folder of keys; empty for a folder made before they were
/// counted.
///
/// # Errors
/// [`FileError`] when the file exists but cannot be read or parsed.
pub fn load_generations(folder: &Path) -> Result<Generations, FileError> {
    let path = folder.join(GENERATIONS_FILE);
    match fs::read_to_string(&path) {
        Ok(text) => Generations::parse(&text, &path),
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(Generations::default()),
        Err(error) => Err(FileError::new(
            &path,
            format!("cannot read which certificates are the newest: {error}"),
        )),
    }
}

/// Refuses a private key that users other than its owner can read or replace. A group may read
/// root's files: this is how systemd passes credentials to a service.
///
/// # Errors
/// [`FileError`] with the actual mode, or when there is no such file.
pub fn check_secret(path: &Path) -> Result<(), FileError> {
    let metadata = fs::metadata(path)
        .map_err(|error| FileError::new(path, format!("cannot read the key: {error}")))?;
    let (mode, is_of_root) = (metadata.mode() & 0o777, metadata.uid() == 0);
    let too_open = if is_of_root { 0o037 } else { 0o077 };
    if mode & too_open == 0 {
        return Ok(());
    }
    Err(FileError::new(
        path,
        format!(
            "found mode {mode:04o}, expected a private key for its owner alone (0600): others on this machine could copy it; `chmod 600 {}` protects it, and if it may have been copied, `farfield certs --renew` makes a new one",
            path.display()
        ),
    ))
}

/// Warns that this machine holds the key of the venue's authority.
fn warn_of_the_authoritys_key(folder: &Path) {
    let path = folder.join(AUTHORITY_KEY);
    if path.exists() {
        say(format_args!(
            "{}: the key of the venue's authority is in the folder of a node's keys, and a thief of this machine could make keys for all nodes: keep it elsewhere, and pass `--authority DIR` to `farfield certs`",
            path.display()
        ));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A folder of keys whose key has `mode`, with additional files `more`.
    fn identity(mode: u32, more: &[(&str, &str)]) -> Result<Identity, String> {
        use std::os::unix::fs::PermissionsExt as _;
        let folder = tempfile::tempdir().unwrap();
        let files = [("ca.pem", ""), ("ne.pem", ""), ("ne.key", "secret")];
        for (name, text) in files.iter().chain(more) {
            fs::write(folder.path().join(name), text).unwrap();
        }
        let key = folder.path().join("ne.key");
        fs::set_permissions(&key, fs::Permissions::from_mode(mode)).unwrap();
        load_identity(folder.path(), "ne").map_err(|error| error.to_string())
    }

    #[test]
    fn a_private_key_readable_by_others_is_refused_with_the_remedy() {
        identity(0o600, &[]).unwrap();
        identity(0o400, &[]).unwrap();
        for open in [0o604, 0o644, 0o660, 0o666, 0o602] {
            let refused = identity(open, &[]).unwrap_err();
            let mode = format!("found mode {open:04o}");
            assert!(
                refused.contains(&mode) && refused.contains("chmod 600 "),
                "{refused}"
            );
            assert!(!refused.contains("secret"), "{refused}");
        }
    }

    #[test]
    fn the_newest_generations_are_read_from_the_key_folder() {
        assert_eq!(identity(0o600, &[]).unwrap().generations.of("fusion"), 0);
        let known = [(GENERATIONS_FILE, "[generation]\nfusion = 3\n")];
        assert_eq!(identity(0o600, &known).unwrap().generations.of("fusion"), 3);
        let wrong = [(GENERATIONS_FILE, "[generation]\nfusion = -3\n")];
        let refused = identity(0o600, &wrong).unwrap_err();
        assert!(refused.contains("generations.toml:2"), "{refused}");
    }

    #[test]
    fn long_files_and_special_files_are_not_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.toml");
        fs::write(&path, "twelve bytes").unwrap();
        assert_eq!(read_text_bounded(&path, 12).unwrap(), "twelve bytes");
        let error = |path: &Path| read_text_bounded(path, 11).unwrap_err().to_string();
        assert_eq!(error(&path), "found more than 11 bytes");
        // A device reports length 0 and never ends.
        for none in [Path::new("/dev/zero"), folder.path()] {
            assert_eq!(error(none), "found something other than a file");
        }
        fs::write(&path, b"\xff").unwrap();
        assert!(error(&path).contains("utf-8"), "{}", error(&path));
    }

    #[test]
    fn an_unreadable_file_is_refused_by_name() {
        let refused = load_venue(Path::new("no/such/venue.toml"))
            .unwrap_err()
            .to_string();
        assert!(
            refused.starts_with("no/such/venue.toml: cannot read the venue file"),
            "{refused}"
        );
        let folder = tempfile::tempdir().unwrap();
        let refused = load_venue(folder.path()).unwrap_err().to_string();
        assert!(
            refused.contains("found a folder, expected the venue file in it"),
            "{refused}"
        );
    }
}
