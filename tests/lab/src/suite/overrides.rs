
use std::path::Path;

use farfield_proto::toml_file::{FileError, TomlFile};
use farfield_proto::venue::Parameters;

/// The default parameters changed by TOML `text` such as `tuning.smoothing.cutoff_hz = 6`: the parameters' tables of a venue
/// file, and its `[tuning]`. Ranges are not checked, so that a study may leave them.
///
/// # Errors
/// [`FileError`] if the text is no TOML, or has an unknown table or field.
pub fn parameters(text: &str) -> Result<Parameters, FileError> {
    Parameters::read(&TomlFile::parse(text, Path::new("the overrides"))?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unnamed_parameters_keep_their_defaults() {
        let changed =
            parameters("tuning.smoothing.cutoff_hz = 4.5\nrange_of_motion.enabled = false")
                .unwrap();
        let default = Parameters::default();
        assert!((changed.smoothing.cutoff_hz - 4.5).abs() < 1e-12);
        assert!(!changed.range_of_motion.enabled);
        let mut restored = changed.smoothing.clone();
        restored.cutoff_hz = default.smoothing.cutoff_hz;
        assert_eq!(restored, default.smoothing);
        assert_eq!(changed.ik, default.ik);
    }

    #[test]
    fn unknown_names_are_refused() {
        for wrong in [
            "smooth.delay_ms = 4.5",
            "smoothing.dellay_ms = 4",
            "tuning.smooth.cutoff_hz = 4.5",
            "tuning.smoothing.cutof_hz = 4",
            "smoothing.cutoff_hz = 4",
            "name = \"hall\"",
            "x",
        ] {
            assert!(parameters(wrong).is_err(), "{wrong}");
        }
    }
}
