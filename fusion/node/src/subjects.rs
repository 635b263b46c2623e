//! The subjects of a venue file: known people. Their profiles are read from files, or from the recording that contains them.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use farfield_node::files::read_text_bounded;
use farfield_proto::toml_file::FileError;
use farfield_proto::venue::{KnownBy, Venue, VenueSubject};

use farfield_fusion::body::prior::BodyPrior;
use farfield_fusion::identity::subjects::Subject;
use farfield_fusion::recording::attached::Attached;
use farfield_fusion::recording::subject_file;

/// Most bytes of a profile; ours have three thousand.
const MAX_PROFILE_BYTES: u64 = 1 << 18;

/// The subjects of a venue.
#[derive(Debug, Clone, Default)]
pub struct KnownSubjects {
    /// In the order of the venue file.
    pub subjects: Vec<Subject>,
    /// The text of their profiles, by the file names in a recording. The files may change after they were read.
    pub(super) profiles: Vec<(String, String)>,
}

/// Reads the subjects of `venue`.
///
/// # Errors
/// A profile cannot be read or is invalid, or two subjects have the same name.
pub fn load_subjects(venue: &Venue) -> Result<KnownSubjects, FileError> {
    let mut profiles = Vec::new();
    let subjects = subjects(venue, |number, subject, path| {
        let text = read_text_bounded(path, MAX_PROFILE_BYTES)
            .map_err(|error| subject.error(format!("cannot read {}: {error}", path.display())))?;
        profiles.push((subject_file(number), text.clone()));
        Ok((text, path.to_owned()))
    })?;
    Ok(KnownSubjects { subjects, profiles })
}

/// The subjects of the recorded `venue`, from the profiles attached to the recording `file`.
///
/// # Errors
/// A profile is missing or invalid.
pub(super) fn recorded_subjects(
    file: &Path,
    recording: &Attached,
    venue: &Venue,
) -> Result<Vec<Subject>, FileError> {
    subjects(venue, |number, _, _| {
        let name = subject_file(number);
        let text = recording.file(&name).ok_or_else(|| {
            FileError::new(file, format!("the recording does not contain {name}"))
        })?;
        Ok((text.to_owned(), file.join(name)))
    })
}

/// The subjects, numbered from 1; `profile` returns the text of one and its file.
fn subjects(
    venue: &Venue,
    mut profile: impl FnMut(usize, &VenueSubject, &Path) -> Result<(String, PathBuf), FileError>,
) -> Result<Vec<Subject>, FileError> {
    let mut subjects: Vec<Subject> = Vec::new();
    for (number, known) in (1..).zip(&venue.subjects) {
        let (name, body) = match &known.known_by {
            KnownBy::Profile(path) => {
                let (text, path) = profile(number, known, path)?;
                BodyPrior::parse(&text, &path)?
            }
            KnownBy::Stature { name, stature_m } => {
                (name.clone(), BodyPrior::from_stature(*stature_m))
            }
        };
        if subjects.iter().any(|other| other.name == name) {
            let problem = format!("found {name:?} a second time, expected names that differ");
            return Err(known.error(problem));
        }
        let body = Arc::new(body);
        subjects.push(Subject { name, body });
    }
    Ok(subjects)
}

#[cfg(test)]
mod tests {
    use std::fs;

    use farfield_proto::calibration::Calibration;
    use farfield_proto::keypoints::KeypointSet;
    use farfield_proto::transport::FUSION;

    use super::*;
    use crate::recording::head;
    use farfield_fusion::body::fixture::{profile, profile_text};
    use farfield_fusion::body::skeleton::Proportions;

    const CALIBRATION: &str = "[a]\nname = \"a\"\nsize = [64, 48]\nmatrix = [[50.0, 0.0, 32.0], \
        [0.0, 50.0, 24.0], [0.0, 0.0, 1.0]]\ndistortions = [0.0, 0.0, 0.0, 0.0]\n\
        rotation = [0.0, 0.0, 0.0]\ntranslation = [0.0, 0.0, 0.0]\n";

    fn venue_text(subjects: &str) -> String {
        format!(
            "name = \"hall\"\nrate_hz = 50.0\ncalibration = \"calibration.toml\"\n{subjects}\n\
             [[viewpoint]]\nname = \"v\"\n[[viewpoint.camera]]\nname = \"a\"\n\
             source = {{ kind = \"keypoints\", path = \"a.jsonl\" }}\n"
        )
    }

    fn venue(folder: &Path, subjects: &str) -> Venue {
        let text = venue_text(subjects);
        let calibration = Calibration::parse(CALIBRATION, Path::new("calibration.toml")).unwrap();
        Venue::parse(&text, &folder.join("hall.toml"), calibration).unwrap()
    }

    #[test]
    fn invalid_profiles_are_refused_by_file_and_missing_ones_by_line() {
        let folder = tempfile::tempdir().unwrap();
        let named = venue(folder.path(), "[[subject]]\nprofile = \"anna.toml\"");
        let error = load_subjects(&named).unwrap_err();
        assert_eq!(error.line, Some(5), "{error}");
        assert_eq!(
            error.field.as_deref(),
            Some("subject[0].profile"),
            "{error}"
        );
        fs::write(folder.path().join("anna.toml"), "name = \"Anna\"\n").unwrap();
        let error = load_subjects(&named).unwrap_err();
        assert_eq!(error.path, folder.path().join("anna.toml"));
        assert!(error.to_string().contains("stature_m"), "{error}");
        let recording = Attached::default();
        let error = recorded_subjects(Path::new("hall.mcap"), &recording, &named).unwrap_err();
        assert_eq!(
            error.to_string(),
            "hall.mcap: the recording does not contain subject-1.toml"
        );
    }

    #[test]
    fn a_name_and_a_stature_are_a_subject() {
        let text = "[[subject]]\nname = \"Anna\"\nstature_m = 1.7";
        let known = load_subjects(&venue(Path::new(""), text)).unwrap();
        assert_eq!(known.subjects.len(), 1);
        assert_eq!(known.subjects[0].name, "Anna");
        assert!(known.profiles.is_empty());
    }

    #[test]
    fn a_recording_has_the_profiles_as_they_were_read() {
        let folder = tempfile::tempdir().unwrap();
        let text = profile_text(&profile(&Proportions::from_stature(1.7), 0.002));
        let file = folder.path().join("anna.toml");
        fs::write(&file, &text).unwrap();
        let profiles =
            "[[subject]]\nname = \"Bo\"\nstature_m = 1.9\n[[subject]]\nprofile = \"anna.toml\"";
        let named = venue(folder.path(), profiles);
        for (name, text) in [
            ("calibration.toml", CALIBRATION),
            ("hall.toml", &venue_text(profiles)),
        ] {
            fs::write(folder.path().join(name), text).unwrap();
        }
        let known = load_subjects(&named).unwrap();
        fs::write(&file, "name = \"Cy\"\n").unwrap();
        let path = folder.path().join("hall.toml");
        let head = head(&named, &path, &KeypointSet::coco17(), FUSION, &known).unwrap();
        let attached = head.files.iter().find(|(name, _)| name == "subject-2.toml");
        assert_eq!(
            attached.map(|(_, bytes)| bytes.as_slice()),
            Some(text.as_bytes())
        );
        assert!(!head.files.iter().any(|(name, _)| name == "subject-1.toml"));
    }
}
