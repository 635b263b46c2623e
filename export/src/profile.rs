//! A person's body as a run came to know it, in a file of its own: for the next session.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::ops::RangeInclusive;
use std::path::Path;

use farfield_fusion::body::skeleton::{Joint, N_JOINTS};
use farfield_proto::toml_file::{FileError, Place, TomlFile};
use nalgebra::Vector3;
use serde::Deserialize;

use crate::edits::change::check_name;
use crate::error::ExportError;
use crate::files;
use crate::formats::osim::stature_m;
use crate::run::PersonSurvey;
use crate::skeleton::Offsets;

/// Links longer than this are none of a person, metres; nor do lengths of one link differ by more.
const LONGEST_M: f64 = 2.0;
/// Statures that people have, metres.
const STATURES_M: RangeInclusive<f64> = 0.4..=2.8;

/// What is kept of a person.
#[derive(Debug, Clone, PartialEq)]
pub struct SubjectProfile {
    /// What the person is called: by it exports know whose profile it is.
    pub name: String,
    /// From the soles to the top of the head, of somebody who stands upright, metres.
    pub stature_m: f64,
    /// Where each joint lies from its parent joint.
    pub offsets: Offsets,
    /// One standard deviation of each over the ticks of the run, per axis, metres: while a run learns a body lengths change.
    pub sigma_m: [f64; N_JOINTS],
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
    /// For people: it follows from the offset.
    length_m: f64,
    sigma_m: f64,
}

impl LinkFields {
    /// The field that no link of a person has, and what was found and expected.
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
    /// The profile of somebody of a run, who is called `name`.
    pub fn of(survey: &PersonSurvey, name: &str) -> Self {
        Self {
            name: name.to_owned(),
            stature_m: stature_m(&survey.offsets),
            offsets: survey.offsets.clone(),
            sigma_m: survey.sigma_m,
        }
    }

    /// The profile of `text`, the content of `path`.
    ///
    /// # Errors
    /// The line and the field, what was found and expected.
    pub fn parse(text: &str, path: &Path) -> Result<Self, FileError> {
        let file = TomlFile::parse(text, path)?;
        let fields: Fields = file.read()?;
        if fields.name.is_empty() {
            let problem = "found none, expected what the person is called";
            return Err(file.error(&Place::field("name"), problem));
        }
        check_name(&fields.name).map_err(|problem| file.error(&Place::field("name"), problem))?;
        if !STATURES_M.contains(&fields.stature_m) {
            let problem = format!(
                "found {:?}, expected metres from {} to {}",
                fields.stature_m,
                STATURES_M.start(),
                STATURES_M.end()
            );
            return Err(file.error(&Place::field("stature_m"), problem));
        }
        let links = Place::field("link");
        let unknown = fields.link.keys().find(|name| {
            let joint = Joint::from_name(name);
            joint.is_none_or(|joint| joint.parent().is_none())
        });
        if let Some(name) = unknown {
            let problem = "found no joint of this name that ends a link, expected those of poses.jsonl but the pelvis";
            return Err(file.error(&links.key(name), problem));
        }
        let mut offsets = Offsets([Vector3::zeros(); N_JOINTS]);
        let mut sigma_m = [0.0; N_JOINTS];
        for joint in Joint::ALL {
            if joint.parent().is_none() {
                continue;
            }
            let place = links.key(joint.name());
            let link = fields.link.get(joint.name());
            let link = link.ok_or_else(|| file.error(&place, "missing, expected every link"))?;
            let offset_m = Vector3::from(link.offset_m);
            link.check()
                .map_err(|(field, problem)| file.error(&place.key(field), problem))?;
            offsets.0[joint.index()] = offset_m;
            sigma_m[joint.index()] = link.sigma_m;
        }
        Ok(Self {
            name: fields.name,
            stature_m: fields.stature_m,
            offsets,
            sigma_m,
        })
    }

    /// Reads the file at `path`.
    ///
    /// # Errors
    /// When it cannot be read, and as [`Self::parse`].
    pub fn read(path: &Path) -> Result<Self, ExportError> {
        Ok(Self::parse(&files::read_text(path)?, path)?)
    }

    /// The text of the file: TOML, lengths to a hundredth of a millimetre.
    pub fn to_toml(&self) -> String {
        let name = serde_json::Value::from(self.name.as_str());
        let mut text = format!(
            "# A body as a run came to know it. Metres; x forward, y left, z up of who stands upright with hanging arms.\n\
             name = {name}\nstature_m = {:.4}\n",
            self.stature_m
        );
        for joint in Joint::ALL {
            let Some(parent) = joint.parent() else {
                continue;
            };
            let offset_m = self.offsets.of_joint(joint);
            let [x, y, z] = offset_m.into();
            // Writing to a string does not fail.
            write!(
                text,
                "\n[link.{}] # from {}\noffset_m = [{x:.5}, {y:.5}, {z:.5}]\nlength_m = {:.5}\nsigma_m = {:.5}\n",
                joint.name(),
                parent.name(),
                offset_m.norm(),
                self.sigma_m[joint.index()]
            )
            .ok();
        }
        text
    }

    /// Writes the file `path`, which must not be there, whole or not at all.
    ///
    /// # Errors
    /// When it is there, or cannot be written; when it is no body that could be read again.
    pub fn write(&self, path: &Path) -> Result<(), ExportError> {
        let text = self.to_toml();
        Self::parse(&text, path)?;
        files::write_new(path, text.as_bytes())
    }
}

#[cfg(test)]
mod tests {
    use farfield_fusion::body::skeleton::Proportions;

    use super::*;

    fn profile() -> SubjectProfile {
        let offsets = Offsets::of(&Proportions::from_stature(1.75));
        let rounded = offsets.0.map(|at| at.map(|v| (v * 1e5).round() / 1e5));
        SubjectProfile {
            name: "Anna \"A\" Ž".to_owned(),
            stature_m: 1.75,
            offsets: Offsets(rounded),
            sigma_m: [0.0; N_JOINTS],
        }
    }

    #[test]
    fn a_profile_reads_back_as_it_was_written() {
        let text = profile().to_toml();
        let read = SubjectProfile::parse(&text, Path::new("anna.toml")).unwrap();
        assert_eq!(read, profile());
        assert!((stature_m(&read.offsets) - 1.75).abs() < 0.02);
    }

    #[test]
    fn what_is_no_body_is_refused_with_line_and_field() {
        let text = profile().to_toml();
        let refused = |from: &str, to: &str| {
            let text = text.replacen(from, to, 1);
            let refused = SubjectProfile::parse(&text, Path::new("anna.toml"));
            refused.unwrap_err().to_string()
        };
        let told = refused("[link.left_knee]", "[link.left_tail]");
        assert!(told.contains("`link.left_tail`: found no joint"), "{told}");
        let told = refused("length_m = ", "length = ");
        assert!(told.contains("length"), "{told}");
        let told = refused(
            "[link.spine] # from pelvis\noffset_m = [",
            "[link.spine]\noffset_m = [9",
        );
        assert!(told.contains("`link.spine.offset_m`: found"), "{told}");
        for (from, to, expected) in [
            (
                "stature_m = 1.7500",
                "stature_m = 0.3",
                ":3: `stature_m`: found 0.3, expected metres from 0.4 to 2.8",
            ),
            (
                "stature_m = 1.7500",
                "stature_m = nan",
                ":3: `stature_m`: found NaN",
            ),
            (
                "sigma_m = 0.00000",
                "sigma_m = -0.1",
                "`link.spine.sigma_m`: found -0.1",
            ),
            (
                "sigma_m = 0.00000",
                "sigma_m = inf",
                "`link.spine.sigma_m`: found inf",
            ),
            (
                "length_m = ",
                "length_m = -",
                "`link.spine.length_m`: found -",
            ),
            (
                "name = \"Anna",
                "name = \"\\u202eAnna",
                "`name`: found \"\\u{202e}Anna",
            ),
        ] {
            let told = refused(from, to);
            assert!(told.contains(expected), "{told}");
        }
        let told = refused("name = ", "name = \"\" # ");
        assert!(told.contains("`name`: found none"), "{told}");
    }
}
