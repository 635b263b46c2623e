//! What Pose2Sim's `Config.toml` says that the keypoints do not: frames per second, and the model.

use std::path::Path;

use farfield_proto::toml_file::{FileError, Place, TomlFile};
use toml::{Table, Value};

use crate::keypoints::Model;

/// What was said; what was not, or is `'auto'`, is `None`.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Settings {
    /// Frames per second, above 0.
    pub(crate) rate_hz: Option<f64>,
    /// Which keypoints the files have.
    pub(crate) model: Option<Model>,
}

impl Settings {
    /// Reads one; `path` is only named in errors.
    ///
    /// # Errors
    /// [`FileError`] where it is no TOML, or the rate is no number above 0 and no word.
    pub(crate) fn parse(text: &str, path: &Path) -> Result<Self, FileError> {
        let file = TomlFile::parse(text, path)?;
        let root: Table = file.read()?;
        let get = |table: &str, key: &str| root.get(table).and_then(|it| it.get(key));
        let rate_hz = match get("project", "frame_rate") {
            None | Some(Value::String(_)) => None,
            Some(value) => {
                let number = value.as_float().or(value.as_integer().map(|it| it as f64));
                let rate = number.filter(|it| it.is_finite() && *it > 0.0);
                Some(rate.ok_or_else(|| {
                    file.error(
                        &Place::field("project").key("frame_rate"),
                        format!("found {value}, expected frames per second or 'auto'"),
                    )
                })?)
            }
        };
        let model = get("pose", "pose_model").and_then(Value::as_str);
        Ok(Self {
            rate_hz,
            model: model.and_then(Model::from_name),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<Settings, FileError> {
        Settings::parse(text, Path::new("Config.toml"))
    }

    #[test]
    fn rate_and_model_are_read_and_auto_says_nothing() {
        let said = parse("[project]\nframe_rate = 60\n[pose]\npose_model = 'Body_with_feet'\n");
        let expected = Settings {
            rate_hz: Some(60.0),
            model: Some(Model::Halpe26),
        };
        assert_eq!(said, Ok(expected));
        let said = parse("[project]\nframe_rate = 'auto'\n");
        assert_eq!(said, Ok(Settings::default()));
    }

    #[test]
    fn a_rate_that_is_none_is_refused_by_line() {
        let said = parse("[project]\nframe_rate = -3\n")
            .unwrap_err()
            .to_string();
        assert!(
            said.contains("Config.toml:2") && said.contains("frame_rate"),
            "{said}"
        );
    }
}
