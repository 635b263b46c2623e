//! `[[subject]]`: expected people, by a stored profile or by name and stature. Fusion recognises
//! them by their bodies.
//!
//! A profile is a separate file ([`crate::subject`]); fusion opens it. An edge that receives the
//! venue file ignores it.

use std::path::PathBuf;

use super::raw::RawSubject;
use crate::subject::{check_required_name, check_stature};
use crate::toml_file::{FileError, Place, TomlFile};

/// Most subjects of a venue.
const MAX_SUBJECTS: usize = 256;

/// An expected person.
#[derive(Debug, Clone, PartialEq)]
pub struct VenueSubject {
    /// The known data.
    pub known_by: KnownBy,
    /// The file, and the line of the field with the body.
    stands: FileError,
}

/// The known data of a subject.
#[derive(Debug, Clone, PartialEq)]
pub enum KnownBy {
    /// A profile, as `farfield people ... save` writes it.
    Profile(PathBuf),
    /// A name and a stature, metres; the rest of the body is average.
    Stature {
        /// Name of the person.
        name: String,
        /// From the soles to the top of the head, metres.
        stature_m: f64,
    },
}

impl VenueSubject {
    /// An error about it, found by code that reads profiles.
    pub fn error(&self, problem: impl Into<String>) -> FileError {
        FileError {
            problem: problem.into(),
            ..self.stands.clone()
        }
    }
}

pub(super) fn subjects(
    file: &TomlFile<'_>,
    raw: Vec<RawSubject>,
) -> Result<Vec<VenueSubject>, FileError> {
    let all = Place::field("subject");
    if raw.len() > MAX_SUBJECTS {
        let problem = format!("found {}, expected at most {MAX_SUBJECTS}", raw.len());
        return Err(file.error(&all, problem));
    }
    let subjects = raw.into_iter().enumerate();
    let mut subjects = subjects
        .map(|(i, raw)| subject(file, &all.index(i), raw))
        .collect::<Result<Vec<_>, _>>()?;
    for i in 1..subjects.len() {
        let (before, from_here) = subjects.split_at_mut(i);
        let is_same = |other: &VenueSubject| match (&other.known_by, &from_here[0].known_by) {
            (KnownBy::Stature { name, .. }, KnownBy::Stature { name: other, .. }) => name == other,
            (known, other) => known == other,
        };
        if before.iter().any(is_same) {
            return Err(from_here[0].error("found a second time, expected each subject once"));
        }
    }
    Ok(subjects)
}

fn subject(file: &TomlFile<'_>, place: &Place, raw: RawSubject) -> Result<VenueSubject, FileError> {
    let (known_by, field) = match raw {
        RawSubject {
            profile: Some(profile),
            name: None,
            stature_m: None,
        } => {
            if profile.is_empty() {
                let problem = "found \"\", expected the name of a file";
                return Err(file.error(&place.key("profile"), problem));
            }
            (KnownBy::Profile(file.resolve(&profile)), "profile")
        }
        RawSubject {
            profile: None,
            name: Some(name),
            stature_m: Some(stature_m),
        } => {
            check_required_name(file, &place.key("name"), &name)?;
            check_stature(file, &place.key("stature_m"), stature_m)?;
            (KnownBy::Stature { name, stature_m }, "name")
        }
        _ => {
            let problem = "expected `profile` alone, or `name` and `stature_m`";
            return Err(file.error(place, problem));
        }
    };
    Ok(VenueSubject {
        known_by,
        stands: file.error(&place.key(field), String::new()),
    })
}
