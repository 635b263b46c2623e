//! Parameters that differ from the defaults, as a study is told them: TOML text such as
//! `smoothing.cutoff_hz = 6`.

use anyhow::{Context as _, bail};
use farfield_proto::venue::Parameters;
use toml::Table;

/// The default parameters with what `text` says changed: the tables of a venue file, of which those
/// of the method count. Ranges are not checked: a study may leave them.
///
/// # Errors
/// When the text is no TOML, or names a table or field that is not there.
pub fn parameters(text: &str) -> anyhow::Result<Parameters> {
    let mut changes: Table = text.parse().context("reading the overrides")?;
    let mut parameters = Parameters::default();
    macro_rules! take {
        ($($table:ident),*) => {$(
            if let Some(change) = changes.remove(stringify!($table)) {
                parameters.$table = change
                    .try_into()
                    .with_context(|| concat!("reading `", stringify!($table), "`"))?;
            }
        )*};
    }
    take!(
        lattice,
        occlusion,
        contact,
        ik,
        smoothing,
        prediction,
        range_of_motion,
        boxes,
        births,
        link,
        recording
    );
    if let Some(unknown) = changes.keys().next() {
        bail!("`{unknown}` is no table of parameters");
    }
    Ok(parameters)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_not_named_keeps_its_default() {
        let changed =
            parameters("smoothing.cutoff_hz = 4.5\nrange_of_motion.enabled = false").unwrap();
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
        for wrong in ["smooth.cutoff_hz = 4.5", "smoothing.cutof_hz = 4", "x"] {
            assert!(parameters(wrong).is_err(), "{wrong}");
        }
    }
}
