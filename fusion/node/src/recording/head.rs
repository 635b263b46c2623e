//! The head of a recording: the venue's files, versions and fingerprints.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::{Context as _, ensure};
use farfield_fusion::recording::writer::Head;
use farfield_fusion::recording::{CALIBRATION_FILE, CARD_FILE, MAX_ATTACHED_BYTES, VENUE_FILE};
use farfield_node::clock;
use farfield_node::files::read_bounded;
use farfield_proto::calibration::Calibration;
use farfield_proto::keypoints::KeypointSet;
use farfield_proto::secrets::Secrets;
use farfield_proto::venue::{Source, Venue};
use farfield_proto::wire;

use crate::output::exporter::layout;
use crate::subjects::KnownSubjects;

/// The head of a recording of `venue`, read from `path`, with its `subjects`; `recorder` is the name of the recording node.
///
/// # Errors
/// A file cannot be read, or has changed since `venue` was read from it.
pub(crate) fn head(
    venue: &Venue,
    path: &Path,
    keypoints: &KeypointSet,
    recorder: &str,
    subjects: &KnownSubjects,
) -> anyhow::Result<Head> {
    let mut files = vec![
        (VENUE_FILE.to_owned(), read(path)?),
        (CALIBRATION_FILE.to_owned(), read(&venue.calibration_path)?),
    ];
    check_unchanged(venue, path, &files)?;
    if let Some((_, text)) = files.first_mut() {
        *text = without_secrets(venue, text);
    }
    if let Some(card) = &venue.network {
        files.push((CARD_FILE.to_owned(), read(card)?));
    }
    let profiles = subjects.profiles.iter();
    files.extend(profiles.map(|(name, text)| (name.clone(), text.clone().into_bytes())));
    let viewpoints: Vec<String> = venue.viewpoints.iter().map(|v| v.name.clone()).collect();
    let facts = [
        ("venue", venue.name.clone()),
        ("viewpoints", viewpoints.join(" ")),
        ("rate_hz", venue.rate_hz.to_string()),
        ("venue_hash", venue.hashes.venue.clone()),
        ("calibration_hash", venue.hashes.calibration.clone()),
        ("farfield", env!("CARGO_PKG_VERSION").to_owned()),
        ("wire", wire::VERSION.to_string()),
        ("recorder", recorder.to_owned()),
    ];
    Ok(Head {
        venue: venue.name.clone(),
        viewpoints,
        rate_hz: venue.rate_hz,
        started_ns: u64::try_from(clock::unix_time().as_nanos()).unwrap_or(u64::MAX),
        files,
        facts: BTreeMap::from(facts.map(|(key, value)| (key.to_owned(), value))),
        json_poses: venue
            .parameters
            .recording
            .json_poses
            .then(|| layout(venue, keypoints)),
    })
}

/// The text of the venue file without the passwords of its cameras: recordings are passed on to others.
fn without_secrets(venue: &Venue, text: &[u8]) -> Vec<u8> {
    let mut text = String::from_utf8_lossy(text).into_owned();
    let urls = venue.cameras.iter().filter_map(|it| match &it.source {
        Source::Ffmpeg { url, .. } => Some(url),
        _ => None,
    });
    let mut urls: Vec<&String> = urls.collect();
    // One URL may be a prefix of another.
    urls.sort_by_key(|url| std::cmp::Reverse(url.len()));
    for url in urls {
        // Only the URL is replaced: the password may also be another word of the file.
        text = text.replace(url.as_str(), &Secrets::of(url).mask(url));
    }
    text.into_bytes()
}

fn read(path: &Path) -> anyhow::Result<Vec<u8>> {
    let reading = || format!("reading {} for the recording", path.display());
    read_bounded(path, MAX_ATTACHED_BYTES).with_context(reading)
}

/// Ensures that the recording contains the files that the node read: they may have been edited since.
fn check_unchanged(venue: &Venue, path: &Path, files: &[(String, Vec<u8>)]) -> anyhow::Result<()> {
    let text = |i: usize| {
        files
            .get(i)
            .map(|(_, bytes)| String::from_utf8_lossy(bytes))
    };
    let (venue_text, calibration_text) = text(0).zip(text(1)).context("the files are read")?;
    let calibration = Calibration::parse(&calibration_text, &venue.calibration_path)?;
    let again = Venue::parse(&venue_text, path, calibration)?;
    ensure!(
        again.hashes == venue.hashes,
        "{} or its calibration was changed while the node started",
        path.display()
    );
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    #[test]
    fn only_the_passwords_of_cameras_are_removed() {
        let calibration = "[a]\nname = \"a\"\nsize = [640, 480]\nmatrix = [[500.0, 0.0, 320.0], [0.0, 500.0, 240.0], [0.0, 0.0, 1.0]]\n\
                           distortions = [0.0, 0.0, 0.0, 0.0, 0.0]\nrotation = [1.5707963, 0.0, 0.0]\ntranslation = [0.0, 1.0, 5.0]\n";
        let path = Path::new("venue.toml");
        let calibration = Calibration::parse(calibration, path).unwrap();
        let text = |secret: &str| {
            format!(
                "name = \"hall\"\nrate_hz = 60.0\ncalibration = \"c.toml\"\nnetwork = \"n.toml\"\ndetector = \"d.toml\"\n\
                 [[viewpoint]]\nname = \"a\"\n[[viewpoint.camera]]\nname = \"a\"\n\
                 source = {{ kind = \"ffmpeg\", url = \"rtsp://admin:{secret}@cam/1?token={secret}\" }}\n"
            )
        };
        for password in ["geheim-42", "kind", "60"] {
            let written = text(password);
            let venue = Venue::parse(&written, path, calibration.clone()).unwrap();
            let recorded = without_secrets(&venue, written.as_bytes());
            assert_eq!(String::from_utf8(recorded).unwrap(), text("…"));
        }
    }

    #[test]
    fn a_file_too_large_for_a_replay_is_refused_by_name() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("calibration.toml");
        let file = fs::File::create(&path).unwrap();
        file.set_len(MAX_ATTACHED_BYTES + 1).unwrap();
        let refused = format!("{:#}", read(&path).unwrap_err());
        assert!(refused.contains("calibration.toml"), "{refused}");
        file.set_len(MAX_ATTACHED_BYTES).unwrap();
        assert_eq!(read(&path).unwrap().len() as u64, MAX_ATTACHED_BYTES);
    }
}
