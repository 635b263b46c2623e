//! Profile of a person's body as measured in a run, stored in a file for the next session.

use std::fmt::Write as _;
use std::path::Path;

use farfield_fusion::body::skeleton::{Joint, N_JOINTS};
use farfield_proto::subject;
use farfield_proto::toml_file::FileError;
use nalgebra::Vector3;

use crate::error::ExportError;
use crate::files;
use crate::formats::osim::stature_m;
use crate::run::PersonSurvey;
use crate::skeleton::Offsets;

/// The profile of a person.
#[derive(Debug, Clone, PartialEq)]
pub struct SubjectProfile {
    /// Name of the person; exports find the profile by it.
    pub name: String,
    /// From the soles to the top of the head when standing upright, metres.
    pub stature_m: f64,
    /// Offset of each joint from its parent joint.
    pub offsets: Offsets,
    /// One standard deviation of each offset over the ticks of the run, per axis, metres; lengths
    /// change while a run learns a body.
    pub sigma_m: [f64; N_JOINTS],
}

impl SubjectProfile {
    /// The profile of a person of a run, with the name `name`.
    pub fn from_survey(survey: &PersonSurvey, name: &str) -> Self {
        Self {
            name: name.to_owned(),
            stature_m: stature_m(&survey.offsets),
            offsets: survey.offsets.clone(),
            sigma_m: survey.sigma_m,
        }
    }

    /// Parses `text`, the content of `path`.
    ///
    /// # Errors
    /// Line and field, what was found and expected.
    pub fn parse(text: &str, path: &Path) -> Result<Self, FileError> {
        let read = subject::SubjectProfile::parse(text, path, &Joint::ends_of_links())?;
        let of_joint = |joint: Joint| read.links.get(joint.name());
        let offset_m = |joint| of_joint(joint).map_or_else(Vector3::zeros, |link| link.offset_m);
        Ok(Self {
            offsets: Offsets(Joint::ALL.map(offset_m)),
            sigma_m: Joint::ALL.map(|joint| of_joint(joint).map_or(0.0, |link| link.sigma_m)),
            name: read.name,
            stature_m: read.stature_m,
        })
    }

    /// Reads the file at `path`.
    ///
    /// # Errors
    /// If it cannot be read; otherwise as [`Self::parse`].
    pub fn read(path: &Path) -> Result<Self, ExportError> {
        Ok(Self::parse(&files::read_text(path)?, path)?)
    }

    /// The text of the file: TOML, lengths to a hundredth of a millimetre.
    pub fn to_toml(&self) -> String {
        let name = serde_json::Value::from(self.name.as_str());
        let mut text = format!(
            "# A body as measured in a run. Metres; x forward, y left, z up when standing upright with hanging arms.\n\
             name = {name}\nstature_m = {:.4}\n",
            self.stature_m
        );
        for joint in Joint::ALL {
            let Some(parent) = joint.parent() else {
                continue;
            };
            let offset_m = self.offsets.of_joint(joint);
            let [x, y, z] = offset_m.into();
            // Writing to a string cannot fail.
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

    /// Writes the file `path`, which must not exist, completely or not at all.
    ///
    /// # Errors
    /// If it exists or cannot be written, or the profile could not be read back.
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
        let offsets = Offsets::from_proportions(&Proportions::from_stature(1.75));
        let rounded = offsets.0.map(|at| at.map(|v| (v * 1e5).round() / 1e5));
        SubjectProfile {
            name: "Anna \"A\" Ž".to_owned(),
            stature_m: 1.75,
            offsets: Offsets(rounded),
            sigma_m: [0.0; N_JOINTS],
        }
    }

    #[test]
    fn profiles_round_trip() {
        let text = profile().to_toml();
        let read = SubjectProfile::parse(&text, Path::new("anna.toml")).unwrap();
        assert_eq!(read, profile());
        assert!((stature_m(&read.offsets) - 1.75).abs() < 0.02);
    }

    #[test]
    fn invalid_profiles_are_refused_with_line_and_field() {
        let text = profile().to_toml();
        let refused = |from: &str, to: &str| {
            let text = text.replacen(from, to, 1);
            let refused = SubjectProfile::parse(&text, Path::new("anna.toml"));
            refused.unwrap_err().to_string()
        };
        let error = refused("[link.left_knee]", "[link.left_tail]");
        assert!(
            error.contains("`link.left_tail`: found no joint"),
            "{error}"
        );
        let error = refused("length_m = ", "length = ");
        assert!(error.contains("length"), "{error}");
        let error = refused(
            "[link.spine] # from pelvis\noffset_m = [",
            "[link.spine]\noffset_m = [9",
        );
        assert!(error.contains("`link.spine.offset_m`: found"), "{error}");
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
            let error = refused(from, to);
            assert!(error.contains(expected), "{error}");
        }
        let error = refused("name = ", "name = \"\" # ");
        assert!(error.contains("`name`: found none"), "{error}");
    }
}
