//! `[field]`: the tracked box, and the court on its floor.

use super::check::MAX_COORDINATE_M;
use super::raw::RawField;
use super::{Field, VenueCamera};
use crate::court::{Court, PlacedCourt};
use crate::toml_file::{FileError, Place, TomlFile, unknown_name};

/// Margin of the default field around the cameras, metres.
const FIELD_MARGIN_M: f64 = 5.0;
/// Height range of the default field, metres.
const FIELD_HEIGHT_M: [f64; 2] = [-0.3, 2.6];
/// Largest rotation of a court, degrees.
const MAX_TURN_DEG: f64 = 360.0;

/// The tracked box.
pub(super) fn field(
    file: &TomlFile<'_>,
    raw: Option<&RawField>,
    cameras: &[VenueCamera],
) -> Result<Field, FileError> {
    let Some(raw) = raw else {
        return Ok(default_field(cameras));
    };
    let place = Place::field("field");
    let (min_m, max_m) = match (raw.min_m, raw.max_m) {
        (Some(min_m), Some(max_m)) => (min_m, max_m),
        (None, None) => {
            let Field { min_m, max_m, .. } = default_field(cameras);
            (min_m, max_m)
        }
        (Some(_), None) => {
            let problem = "found no `max_m`, expected it together with `min_m`";
            return Err(file.error(&place, problem));
        }
        (None, Some(_)) => {
            let problem = "found no `min_m`, expected it together with `max_m`";
            return Err(file.error(&place, problem));
        }
    };
    for (name, corner) in [("min_m", min_m), ("max_m", max_m)] {
        if let Some(wrong) = corner.iter().find(|v| !is_coordinate(**v)) {
            return Err(file.error(&place.key(name), coordinate_expected(*wrong)));
        }
    }
    if let Some(axis) = (0..3).find(|&axis| min_m[axis] >= max_m[axis]) {
        let problem = format!(
            "found {:?}, expected more than `min_m` ({:?})",
            max_m[axis], min_m[axis]
        );
        return Err(file.error(&place.key("max_m").index(axis), problem));
    }
    let floor_m = raw.floor_m.unwrap_or(0.0_f64.clamp(min_m[2], max_m[2]));
    if !(min_m[2]..=max_m[2]).contains(&floor_m) {
        let problem = format!(
            "found {floor_m:?}, expected a height of the field, {:?} to {:?}",
            min_m[2], max_m[2]
        );
        return Err(file.error(&place.key("floor_m"), problem));
    }
    Ok(Field {
        min_m,
        max_m,
        floor_m,
    })
}

/// The court, if the file names one.
pub(super) fn court(
    file: &TomlFile<'_>,
    raw: Option<&RawField>,
) -> Result<Option<PlacedCourt>, FileError> {
    let Some(raw) = raw else {
        return Ok(None);
    };
    let place = Place::field("field");
    let Some(name) = &raw.court else {
        let settings = [
            ("court_size_m", raw.court_size_m.is_some()),
            ("court_centre_m", raw.court_centre_m.is_some()),
            ("court_turn_deg", raw.court_turn_deg.is_some()),
        ];
        return match settings.iter().find(|(_, is_given)| *is_given) {
            Some((name, _)) => {
                let problem = "found it without a court, expected a `court` that it applies to";
                Err(file.error(&place.key(name), problem))
            }
            None => Ok(None),
        };
    };
    if !Court::names().contains(&name.as_str()) {
        let problem = unknown_name("court", name, &Court::names());
        return Err(file.error(&place.key("court"), problem));
    }
    let court = Court::of(name, raw.court_size_m);
    let court = court.map_err(|problem| file.error(&place.key("court_size_m"), problem))?;
    let centre_m = raw.court_centre_m.unwrap_or_default();
    if let Some(wrong) = centre_m.iter().find(|v| !is_coordinate(**v)) {
        return Err(file.error(&place.key("court_centre_m"), coordinate_expected(*wrong)));
    }
    let turn_deg = raw.court_turn_deg.unwrap_or_default();
    if turn_deg.is_nan() || turn_deg.abs() > MAX_TURN_DEG {
        let problem =
            format!("found {turn_deg:?}, expected degrees from -{MAX_TURN_DEG} to {MAX_TURN_DEG}");
        return Err(file.error(&place.key("court_turn_deg"), problem));
    }
    Ok(Some(PlacedCourt {
        court,
        centre_m,
        turn_rad: turn_deg.to_radians(),
    }))
}

fn is_coordinate(metres: f64) -> bool {
    metres.abs() <= MAX_COORDINATE_M
}

fn coordinate_expected(found: f64) -> String {
    format!(
        "found {found:?}, expected metres from {} to {MAX_COORDINATE_M}",
        -MAX_COORDINATE_M
    )
}

fn default_field(cameras: &[VenueCamera]) -> Field {
    let [low, high] = FIELD_HEIGHT_M;
    let mut field = Field {
        min_m: [f64::INFINITY, f64::INFINITY, low],
        max_m: [f64::NEG_INFINITY, f64::NEG_INFINITY, high],
        floor_m: 0.0,
    };
    for camera in cameras {
        let center = camera.model.center().coordinates_m();
        for axis in 0..2 {
            field.min_m[axis] = field.min_m[axis].min(center[axis] - FIELD_MARGIN_M);
            field.max_m[axis] = field.max_m[axis].max(center[axis] + FIELD_MARGIN_M);
        }
    }
    field
}
