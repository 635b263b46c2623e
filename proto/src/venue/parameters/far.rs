//! Detects parameters far from their defaults: inside their ranges, but hardly intended.

use std::fmt;

use toml::Value;

use super::{Audience, Parameter, Parameters, Range};

/// Largest usual factor between a number of the method and its default, either way.
const FAR: f64 = 5.0;
/// Largest usual factor of a user's choice over its default; small values are intended.
const USERS_FAR: f64 = 20.0;
/// From this factor on, an end of a range is also reported.
const AT_AN_END: f64 = 2.0;
/// Tables of choices that cost bytes and time, and do not change skeletons.
const OF_RESOURCES: [&str; 2] = ["link", "recording"];

/// A parameter that is far from its default.
#[derive(Debug, Clone, PartialEq)]
pub struct FarParameter {
    parameter: &'static Parameter,
    value: Value,
    default: String,
}

impl fmt::Display for FarParameter {
    /// Format: `[tuning] ik.change_sigma_rad is 100.0 rad, the default 0.25`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            parameter,
            value,
            default,
        } = self;
        let unit = parameter.range.map_or("", |range| range.unit);
        let space = if unit.is_empty() { "" } else { " " };
        let stands = parameter.stands();
        write!(f, "{stands} is {value}{space}{unit}, the default {default}")
    }
}

impl Parameters {
    /// Numbers of the method more than five times their default, or less than a fifth of it; users'
    /// choices more than twenty times their default. Also numbers at an end of their range that are
    /// twice the default, or half. Not reported: choices of bytes and time, a 0 that disables a
    /// feature, and, for users' choices, a 0 and a share of one.
    pub fn far_from_defaults(&self) -> Vec<FarParameter> {
        let defaults = Self::default().in_order().into_iter();
        let values = self.values().zip(defaults);
        let far = values.filter_map(|((parameter, value), default)| {
            let default = default.or_else(|| parameter.unset?.example.parse().ok())?;
            let range = parameter.range?;
            let value = value?;
            is_far(parameter, range, [number(&value)?, number(&default)?]).then(|| FarParameter {
                parameter,
                value,
                default: match parameter.unset {
                    Some(unset) => unset.words.to_owned(),
                    None => default.to_string(),
                },
            })
        });
        far.collect()
    }
}

fn number(value: &Value) -> Option<f64> {
    value
        .as_float()
        .or_else(|| value.as_integer().map(|i| i as f64))
}

fn is_far(parameter: &Parameter, range: Range, [value, default]: [f64; 2]) -> bool {
    let is_switched_off = value <= 0.0 && parameter.sentence.contains("0:");
    // A default of 0 has no factor.
    if default <= 0.0 || is_switched_off || OF_RESOURCES.contains(&parameter.table) {
        return false;
    }
    let factor = (value / default).max(default / value);
    let is_at_an_end = value <= range.min || value >= range.max;
    let is_at_an_end = is_at_an_end && factor >= AT_AN_END;
    match parameter.audience {
        Audience::Tuning => factor > FAR || is_at_an_end,
        Audience::User => {
            let is_share = range.unit.is_empty() && range.max <= 1.0;
            let is_meant = value <= 0.0 || is_share;
            !is_meant && (value > USERS_FAR * default || is_at_an_end)
        }
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::toml_file::TomlFile;

    /// The reports for a venue with this text.
    fn reports(text: &str) -> Vec<String> {
        let file = TomlFile::parse(text, Path::new("hall.toml")).unwrap();
        let parameters = Parameters::read(&file).unwrap();
        parameters.check(&file).unwrap();
        let far = parameters.far_from_defaults();
        far.iter().map(ToString::to_string).collect()
    }

    #[test]
    fn implausible_values_inside_a_range_are_reported() {
        for (text, expected) in [
            (
                "[tuning]\nik.change_sigma_rad = 100.0",
                "[tuning] ik.change_sigma_rad is 100.0 rad, the default 0.25",
            ),
            (
                "[tuning]\nik.iterations = 1",
                "[tuning] ik.iterations is 1, the default 10",
            ),
            (
                "[tuning]\nlattice.min_support = 0.0",
                "[tuning] lattice.min_support is 0.0, the default 0.08",
            ),
            (
                "[tuning]\nocclusion.weight = 1.0",
                "[tuning] occlusion.weight is 1.0, the default 0.4",
            ),
            (
                "[boxes]\nmargin = 4.0",
                "[boxes] margin is 4.0, the default the network card's `box_margin`, else 1.25",
            ),
            (
                "[births]\ncoast_s = 3600.0",
                "[births] coast_s is 3600.0 s, the default 1.0",
            ),
        ] {
            assert_eq!(reports(text), [expected], "{text}");
        }
    }

    #[test]
    fn plausible_values_are_not_reported() {
        for text in [
            "",
            // Half, twice and thrice.
            "[tuning]\nik.change_sigma_rad = 0.7\nbirths.flat_m = 0.02",
            // Disabled.
            "[tuning]\ncontact.yield_share = 0.0\nbirths.measure_s = 0.0",
            // A user's choices.
            "[births]\ncoast_s = 10.0\nreturn_s = 600.0\nlook_share = 1.0\ntiles_per_look = 0\nsight_every_s = 0.0",
            "[link]\nlockstep_timeout_s = 3600.0\ndeadline_ms = 5000.0\n[recording]\nring_mib = 65536",
            "[smoothing]\ndelay_ms = 2000.0\n[range_of_motion]\nfactor = 1.3",
        ] {
            assert_eq!(reports(text), [""; 0], "{text}");
        }
    }

    #[test]
    fn the_defaults_are_near_themselves() {
        assert_eq!(Parameters::default().far_from_defaults(), []);
    }
}
