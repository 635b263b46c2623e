//! People in the venue file.
//!
//! `[[person]]` gives a person by hand at a tick, instead of detection. `[[subject]]` is an
//! expected person, by a stored profile or by name and stature; fusion recognises subjects by their
//! bodies. A profile is a separate file ([`crate::subject`]); fusion opens it. An edge that
//! receives the venue file ignores it.

use std::collections::BTreeMap;
use std::path::PathBuf;

use nalgebra::Vector3;

use super::check::{self, MAX_COORDINATE_M};
use super::raw::{RawPerson, RawSubject};
use super::{Field, GivenPerson};
use crate::keypoints::KeypointSet;
use crate::subject::{check_required_name, check_stature};
use crate::toml_file::{FileError, Place, TomlFile, unknown_name};

/// Minimum number of keypoints of a person given by hand: those of a trunk and one more.
const MIN_GIVEN_KEYPOINTS: usize = 5;
/// Range of the largest distance between the keypoints of a body: from a child with only the trunk
/// to a giant with raised arms, metres.
const LEAST_EXTENT_M: f64 = 0.15;
const MOST_EXTENT_M: f64 = 3.0;

impl GivenPerson {
    /// The centre of the keypoints, world, metres.
    pub fn middle_m(&self) -> Vector3<f64> {
        let sum_m: Vector3<f64> = self.keypoints_m.values().map(|m| Vector3::from(*m)).sum();
        sum_m / self.keypoints_m.len().max(1) as f64
    }
}

/// `keypoints` are those that exist; `None` if the card of a network has them.
pub(super) fn given_persons(
    file: &TomlFile<'_>,
    raw: Vec<RawPerson>,
    keypoints: Option<&KeypointSet>,
    field: &Field,
    margin_m: f64,
) -> Result<Vec<GivenPerson>, FileError> {
    let mut persons = Vec::new();
    for (i, RawPerson { tick, keypoints_m }) in raw.into_iter().enumerate() {
        let person = Place::field("person").index(i);
        let tick = check::tick(file, &person.key("tick"), tick)?;
        let place = person.key("keypoints_m");
        check_given(file, &place, &keypoints_m, keypoints)?;
        let given = GivenPerson { tick, keypoints_m };
        let inside = check_inside(&given.middle_m(), field, margin_m);
        inside.map_err(|problem| file.error(&place, problem))?;
        persons.push(given);
    }
    Ok(persons)
}

/// A person too far outside the field would be dropped at once.
fn check_inside(middle_m: &Vector3<f64>, field: &Field, margin_m: f64) -> Result<(), String> {
    let Field { min_m, max_m, .. } = field;
    let is_inside = |i: usize| (min_m[i] - margin_m..=max_m[i] + margin_m).contains(&middle_m[i]);
    if (0..3).all(is_inside) {
        return Ok(());
    }
    let [x, y, z]: [f64; 3] = (*middle_m).into();
    Err(format!(
        "found a body around ({x:.2}, {y:.2}, {z:.2}) m, expected one inside the field, {min_m:?} to {max_m:?}, or up to {margin_m} m \
         outside it (`births.outside_field_m`)"
    ))
}

fn check_given(
    file: &TomlFile<'_>,
    place: &Place,
    keypoints_m: &BTreeMap<String, [f64; 3]>,
    keypoints: Option<&KeypointSet>,
) -> Result<(), FileError> {
    for (name, position) in keypoints_m {
        if let Some(set) = keypoints.filter(|set| set.index_of(name).is_none()) {
            let known: Vec<&str> = set.names().iter().map(String::as_str).collect();
            return Err(file.error(&place.key(name), unknown_name("keypoint", name, &known)));
        }
        if let Some(wrong) = position
            .iter()
            .find(|v| v.is_nan() || v.abs() > MAX_COORDINATE_M)
        {
            return Err(file.error(&place.key(name), format!("found {wrong}, expected metres")));
        }
    }
    let checked = check_shows_a_body(keypoints_m).and_then(|()| check_size(keypoints_m));
    checked.map_err(|problem| file.error(place, problem))
}

/// A person in other units would never be tracked, or would be a ghost.
fn check_size(keypoints_m: &BTreeMap<String, [f64; 3]>) -> Result<(), String> {
    let places = || keypoints_m.values().map(|m| Vector3::from(*m));
    let apart = places().flat_map(|a| places().map(move |b| (a - b).norm()));
    let most_m = apart.fold(0.0, f64::max);
    if (LEAST_EXTENT_M..=MOST_EXTENT_M).contains(&most_m) {
        return Ok(());
    }
    Err(format!(
        "found keypoints up to {most_m:.2} m apart, expected those of one body, {LEAST_EXTENT_M} to {MOST_EXTENT_M} m: metres, in the \
         world of the calibration"
    ))
}

/// No body can be fitted to fewer keypoints; the person would be missing without an error.
fn check_shows_a_body(keypoints_m: &BTreeMap<String, [f64; 3]>) -> Result<(), String> {
    if keypoints_m.len() < MIN_GIVEN_KEYPOINTS {
        return Err(format!(
            "found {}, expected at least {MIN_GIVEN_KEYPOINTS} keypoints",
            keypoints_m.len()
        ));
    }
    let has_both = |left, right| keypoints_m.contains_key(left) && keypoints_m.contains_key(right);
    if has_both("left_shoulder", "right_shoulder") || has_both("left_hip", "right_hip") {
        return Ok(());
    }
    Err("found neither both shoulders nor both hips, expected `left_shoulder` and `right_shoulder`, or `left_hip` and `right_hip`".to_owned())
}

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
