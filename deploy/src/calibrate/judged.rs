//! Whether a run can use a calibration that was just found: the same questions that `check` and `run` ask of it.

use std::fmt::Write as _;
use std::path::Path;

use farfield_calibration::points::PointCalibration;
use farfield_calibration::report::{CameraReport, PeopleReport};
use farfield_proto::calibration::Calibration;
use farfield_proto::plausibility;
use farfield_proto::venue::Venue;

/// What was found, the file of it, and all that speaks against it.
pub(super) struct JudgedCalibration<'a> {
    pub(super) found: &'a PointCalibration,
    /// The calibration file.
    pub(super) text: String,
    /// Why a run would refuse it.
    pub(super) refusals: Vec<String>,
    /// What else a run would say of it.
    pub(super) doubts: Vec<String>,
}

impl<'a> JudgedCalibration<'a> {
    /// Judges what was found; `path` is only named in what is said.
    pub(super) fn of(found: &'a PointCalibration, path: &Path) -> Self {
        let written = found.toml().map_err(|error| error.to_string());
        let text = written.clone().unwrap_or_default();
        let (mut refusals, mut doubts) = (Vec::new(), Vec::new());
        match written.and_then(|text| venue_of_all(found, &text, path)) {
            Err(refusal) => refusals.push(refusal),
            Ok(venue) => {
                for finding in plausibility::of_venue(&venue) {
                    let list = if finding.is_wrong() {
                        &mut refusals
                    } else {
                        &mut doubts
                    };
                    list.push(finding.to_string());
                }
            }
        }
        Self {
            found,
            text,
            refusals,
            doubts,
        }
    }

    /// Whether nothing speaks against using it.
    pub(super) fn passes(&self) -> bool {
        self.found.report.passes() && self.refusals.is_empty()
    }
}

/// A venue of all cameras, each at a corner of its own.
fn venue_of_all(found: &PointCalibration, text: &str, path: &Path) -> Result<Venue, String> {
    let calibration = Calibration::parse(text, path).map_err(|error| error.to_string())?;
    let mut venue =
        "name = \"calibrated\"\nrate_hz = 30.0\ncalibration = \"calibration.toml\"\n".to_owned();
    for (number, camera) in found.cameras.iter().enumerate() {
        let name = toml::Value::from(camera.name.as_str());
        // Writing to a string does not fail.
        writeln!(
            venue,
            "[[viewpoint]]\nname = \"v{number}\"\n[[viewpoint.camera]]\nname = {name}\n\
             source = {{ kind = \"keypoints\", path = \"none.jsonl\" }}"
        )
        .ok();
    }
    Venue::parse(&venue, path, calibration).map_err(|error| error.to_string())
}

/// What stands in place of a number that the sights do not tell.
pub(super) const NOT_DETERMINED: &str = "not determined";

/// How tall people come out.
pub(super) fn people_in_words(people: &PeopleReport) -> String {
    format!(
        "People come out {:.2} m tall at the median (world_scale {:.3}: the factor that would make them as tall as given, or as usual \
         adults).",
        people.stature_m, people.world_scale
    )
}

/// How far the halves of the data are apart, and what of that is seen, where both could be solved.
pub(super) fn halves(camera: &CameraReport) -> String {
    let (mm, degrees) = (1000.0 * camera.halves_m, camera.halves_deg);
    if mm.is_finite() && degrees.is_finite() {
        format!(
            "{mm:.1} mm, {degrees:.3} degrees apart ({:.1} px, {:.1} mm in the field)",
            camera.halves_px,
            1000.0 * camera.halves_across_m
        )
    } else {
        "not checked".to_owned()
    }
}
