//! A person's body in a file, as measured in a run: `farfield people ... save` writes it; exports
//! and fusion read it.
//!
//! Links are text here; the caller, who knows the model, passes the names of the joints.

use std::collections::BTreeMap;
use std::ops::RangeInclusive;
use std::path::Path;

use nalgebra::Vector3;
use serde::Deserialize;

use crate::person_name::check_name;
use crate::toml_file::{FileError, Place, TomlFile};

/// Longest link of a person, metres; also the largest standard deviation.
const LONGEST_M: f64 = 2.0;
/// Plausible statures, metres.
const STATURES_M: RangeInclusive<f64> = 0.4..=2.8;

/// A known person with the body.
#[derive(Debug, Clone, PartialEq)]
pub struct SubjectProfile {
    /// Name of the person.
    pub name: String,
    /// Height of an upright person from the soles to the top of the head, metres.
    pub stature_m: f64,
    /// Every link of the model, by the joint at its end.
    pub links: BTreeMap<String, SubjectLink>,
}

/// A link of a known body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SubjectLink {
    /// Position of its joint relative to the parent joint, metres: x forward, y left, z up, for an
    /// upright person with hanging arms.
    pub offset_m: Vector3<f64>,
    /// One standard deviation per axis over the ticks of the measuring run, metres.
    pub sigma_m: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Fields {
    name: String,
    stature_m: f64,
    link: BTreeMap<String, LinkFields>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
#[expect(clippy::struct_field_names, reason = "the names are those of the file")]
struct LinkFields {
    offset_m: [f64; 3],
    /// For people; it follows from the offset.
    length_m: f64,
    sigma_m: f64,
}

impl LinkFields {
    /// An impossible field, with the found and expected value.
    fn check(&self) -> Result<(), (&'static str, String)> {
        let is_length = |length_m: f64| length_m > 0.0 && length_m <= LONGEST_M;
        let expected = format!("expected a length above 0 and up to {LONGEST_M} m");
        if !is_length(Vector3::from(self.offset_m).norm()) {
            return Err(("offset_m", format!("found {:?}, {expected}", self.offset_m)));
        }
        if !is_length(self.length_m) {
            return Err(("length_m", format!("found {:?}, {expected}", self.length_m)));
        }
        if !(0.0..=LONGEST_M).contains(&self.sigma_m) {
            let problem = format!(
                "found {:?}, expected metres from 0 to {LONGEST_M}",
                self.sigma_m
            );
            return Err(("sigma_m", problem));
        }
        Ok(())
    }
}

impl SubjectProfile {
    /// The profile in `text`, the content of `path`. Its links must end in `joints`: each once, and
    /// no other.
    ///
    /// # Errors
    /// Line and field, found and expected value.
    pub fn parse(text: &str, path: &Path, joints: &[&str]) -> Result<Self, FileError> {
        let file = TomlFile::parse(text, path)?;
        let fields: Fields = file.read()?;
        check_required_name(&file, &Place::field("name"), &fields.name)?;
        check_stature(&file, &Place::field("stature_m"), fields.stature_m)?;
        let all = Place::field("link");
        let is_unknown = |name: &&String| !joints.contains(&name.as_str());
        if let Some(name) = fields.link.keys().find(is_unknown) {
            let problem = "found no joint of this name that ends a link, expected those of poses.jsonl except the pelvis";
            return Err(file.error(&all.key(name), problem));
        }
        let mut links = BTreeMap::new();
        for joint in joints {
            let place = all.key(joint);
            let link = fields.link.get(*joint);
            let link = link.ok_or_else(|| file.error(&place, "missing, expected every link"))?;
            link.check()
                .map_err(|(field, problem)| file.error(&place.key(field), problem))?;
            let link = SubjectLink {
                offset_m: Vector3::from(link.offset_m),
                sigma_m: link.sigma_m,
            };
            links.insert((*joint).to_owned(), link);
        }
        Ok(Self {
            name: fields.name,
            stature_m: fields.stature_m,
            links,
        })
    }
}

/// Refuses an invalid name, or none.
pub(crate) fn check_required_name(
    file: &TomlFile<'_>,
    place: &Place,
    name: &str,
) -> Result<(), FileError> {
    if name.is_empty() {
        let problem = "found none, expected the person's name";
        return Err(file.error(place, problem));
    }
    check_name(name).map_err(|problem| file.error(place, problem))
}

/// Refuses an implausible stature.
pub(crate) fn check_stature(
    file: &TomlFile<'_>,
    place: &Place,
    stature_m: f64,
) -> Result<(), FileError> {
    if STATURES_M.contains(&stature_m) {
        return Ok(());
    }
    let problem = format!(
        "found {stature_m:?}, expected metres from {} to {}",
        STATURES_M.start(),
        STATURES_M.end()
    );
    Err(file.error(place, problem))
}
