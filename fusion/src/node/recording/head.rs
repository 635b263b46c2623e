//! What a recording says of itself: the venue's files, versions, fingerprints.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::{Context as _, ensure};
use farfield_node::clock;
use farfield_node::files::read_bounded;
use farfield_proto::calibration::Calibration;
use farfield_proto::keypoints::KeypointSet;
use farfield_proto::venue::Venue;
use farfield_proto::venue::layout::LAYOUT;
use farfield_proto::wire;

use crate::node::output::exporter::layout;
use crate::node::subjects::KnownSubjects;
use crate::recording::writer::Head;
use crate::recording::{CALIBRATION_FILE, CARD_FILE, MAX_ATTACHED_BYTES, VENUE_FILE, VENUE_LAYOUT};

/// The head of a recording of `venue`, whose file is `path`, and to which `subjects` may come; `recorder` says who records.
///
/// # Errors
/// When a file cannot be read, or is not what it was when `venue` was read from it.
pub(in crate::node) fn head(
    (venue, path): (&Venue, &Path),
    keypoints: &KeypointSet,
    recorder: &str,
    subjects: &KnownSubjects,
) -> anyhow::Result<Head> {
    let mut files = vec![
        (VENUE_FILE.to_owned(), read(path)?),
        (CALIBRATION_FILE.to_owned(), read(&venue.calibration_path)?),
    ];
    check_unchanged(venue, path, &files)?;
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
        (VENUE_LAYOUT, LAYOUT.to_string()),
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

fn read(path: &Path) -> anyhow::Result<Vec<u8>> {
    let reading = || format!("reading {} for the recording", path.display());
    read_bounded(path, MAX_ATTACHED_BYTES).with_context(reading)
}

/// The files may have been edited since the node read them; a recording must not carry others.
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
    fn a_file_that_no_replay_would_take_is_refused_by_name() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("calibration.toml");
        let file = fs::File::create(&path).unwrap();
        file.set_len(MAX_ATTACHED_BYTES + 1).unwrap();
        let refused = format!("{:#}", read(&path).unwrap_err());
        assert!(
            refused.contains("calibration.toml") && refused.contains("more than"),
            "{refused}"
        );
        file.set_len(MAX_ATTACHED_BYTES).unwrap();
        assert_eq!(read(&path).unwrap().len() as u64, MAX_ATTACHED_BYTES);
    }
}
