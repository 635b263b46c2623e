//! Output of a calibration: its files, and the report on it as text and JSON.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use clap::Args;
use farfield_calibration::points::PointCalibration;
use farfield_calibration::report::{CameraReport, FieldReport, PeopleReport, PictureEdge};
use farfield_node::process::{EXIT_FAILED, LineKind, NodeError, say_as};
use farfield_proto::calibration::Calibration;
use farfield_proto::plausibility;
use farfield_proto::venue::Venue;
use serde::Serialize;

use super::{Judged, refuse_existing, sheet, write};

/// Output options of a calibration.
#[derive(Debug, Args)]
pub(super) struct OutputArgs {
    /// Output file. Default: calibration.toml.
    ///
    /// Its sheet is an HTML file next to it. A calibration that does not pass is written to NAME.failed.toml and
    /// replaces none.
    #[arg(
        long,
        value_name = "FILE",
        default_value = "calibration.toml",
        hide_default_value = true
    )]
    pub(super) out: PathBuf,
    /// Replace existing files.
    #[arg(long)]
    pub(super) replace: bool,
    /// Print the result or the error as JSON.
    #[arg(long)]
    pub(super) json: bool,
}

impl OutputArgs {
    /// Refuses to overwrite a calibration and its sheet.
    pub(super) fn refuse_existing(&self) -> Result<(), NodeError> {
        for path in [&self.out, &self.out.with_extension("html")] {
            refuse_existing(path, self.replace)?;
        }
        Ok(())
    }
}

/// Message for a calibration that should not be used.
const DOES_NOT_PASS: &str = "the calibration does not pass: see the reasons in its sheet";

/// The JSON output.
#[derive(Debug, Serialize)]
struct Found<'a> {
    passes: bool,
    #[serde(skip_serializing_if = "Option::is_none")]
    error: Option<&'static str>,
    exit_code: u8,
    cameras: Vec<Camera<'a>>,
    without_pose: Vec<&'a str>,
    known_places_rms_m: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    people: Option<People>,
    field: Option<Field>,
    findings: Vec<FindingLine<'a>>,
    /// Why a run would refuse it.
    refused: &'a [String],
    /// Warnings that a run would print.
    doubtful: &'a [String],
    /// Origin of the scale, and what checks it.
    metres: &'a str,
    files: [&'a Path; 2],
}

#[derive(Debug, Serialize)]
struct Camera<'a> {
    name: &'a str,
    sights: usize,
    used_share: f64,
    rms_px: f64,
    position_sigma_mm: f64,
    /// `None` if it is not determined.
    rotation_sigma_deg: Option<f64>,
    halves_mm: f64,
    halves_deg: f64,
    /// Difference of the two halves of the data in its image (95th percentile), pixels; and in the field.
    halves_px: f64,
    halves_field_mm: f64,
    /// Number of sights that fit, over the image: rows from the upper edge, each from the left.
    picture: &'a [[usize; 6]; 4],
    picture_empty_share: f64,
    empty_edges: Vec<&'static str>,
    focal_ratio: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    offset_s: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    rate_hz: Option<f64>,
}

/// Measured height of people, and the factor on all distances that would give them their true or a usual height.
#[derive(Debug, Serialize)]
struct People {
    stature_m: f64,
    world_scale: f64,
}

impl People {
    fn new(found: PeopleReport) -> Self {
        Self {
            stature_m: found.stature_m,
            world_scale: found.world_scale,
        }
    }
}

/// The map of the field.
#[derive(Debug, Serialize)]
struct Field {
    step_m: f64,
    height_m: f64,
    sight_sigma_px: f64,
    /// The court in it; `None`: it is only the area where people were.
    court: Option<&'static str>,
    seen_by_two_share: f64,
    median_mm: Option<f64>,
    share_95_mm: Option<f64>,
    cells: Vec<Cell>,
}

#[derive(Debug, Serialize)]
struct Cell {
    x_m: f64,
    y_m: f64,
    cameras: usize,
    sigma_mm: Option<f64>,
}

impl Field {
    fn new(field: &FieldReport) -> Self {
        let mm = |m: f64| 1000.0 * m;
        let cells = field.cells.iter().map(|it| Cell {
            x_m: it.position_m[0],
            y_m: it.position_m[1],
            cameras: it.cameras,
            sigma_mm: it.sigma_m.map(mm),
        });
        Self {
            step_m: field.step_m,
            height_m: field.height_m,
            sight_sigma_px: field.sight_sigma_px,
            court: field.court.as_ref().map(|it| it.name),
            seen_by_two_share: field.share_seen_by(2),
            median_mm: field.sigma_m(0.5).map(mm),
            share_95_mm: field.sigma_m(0.95).map(mm),
            cells: cells.collect(),
        }
    }
}

#[derive(Debug, Serialize)]
struct FindingLine<'a> {
    camera: Option<&'a str>,
    is_wrong: bool,
    found: &'a str,
    expected: &'a str,
    remedy: &'a str,
}

/// Facts on the request that the report repeats.
pub(super) struct RequestFacts<'a> {
    /// The names of all cameras.
    pub(super) names: Vec<&'a str>,
    /// Whether cameras have separate clocks.
    pub(super) has_clocks: bool,
    /// Origin of the scale, in sentences.
    pub(super) metres: String,
}

/// Writes the calibration and its sheet to `output.out`, or to another file if it does not pass, and prints the report.
///
/// # Errors
/// [`NodeError::Failed`] for errors of the disk.
pub(super) fn write_results(
    found: &PointCalibration,
    request: &RequestFacts<'_>,
    output: &OutputArgs,
) -> Result<Judged, NodeError> {
    let judged = JudgedCalibration::new(found, &output.out);
    let out = if judged.passes() {
        output.out.clone()
    } else {
        output.out.with_extension("failed.toml")
    };
    let sheet = out.with_extension("html");
    let facts = sheet::SheetFacts {
        metres: &request.metres,
        has_clocks: request.has_clocks,
    };
    write(&sheet, &sheet::html(&out, &judged, &facts))?;
    write(&out, &judged.text)?;
    let files = [out.as_path(), sheet.as_path()];
    let text = if output.json {
        json(&judged, request, files)?
    } else {
        lines(&judged, request, files)
    };
    crate::output::print(&text).map_err(NodeError::Failed)?;
    if judged.passes() {
        return Ok(Judged::Passes);
    }
    say_as(LineKind::Error, format_args!("{DOES_NOT_PASS}"));
    Ok(Judged::Fails)
}

/// The cameras among `names` without a pose.
pub(super) fn without_pose<'a>(found: &PointCalibration, names: &[&'a str]) -> Vec<&'a str> {
    let has_none = |name: &&str| found.cameras.iter().all(|it| it.name != *name);
    names.iter().copied().filter(has_none).collect()
}

fn json(
    judged: &JudgedCalibration<'_>,
    request: &RequestFacts<'_>,
    files: [&Path; 2],
) -> Result<String, NodeError> {
    let report = &judged.found.report;
    let has_clocks = request.has_clocks;
    let cameras = report.cameras.iter().map(|it| Camera {
        name: &it.name,
        sights: it.sights,
        used_share: it.used_share,
        rms_px: it.rms_px,
        position_sigma_mm: 1000.0 * it.position_sigma_m,
        rotation_sigma_deg: it.determined_rotation_deg(),
        halves_mm: 1000.0 * it.halves_m,
        halves_deg: it.halves_deg,
        halves_px: it.halves_px,
        halves_field_mm: 1000.0 * it.halves_across_m,
        picture: &it.coverage.cells,
        picture_empty_share: it.coverage.empty_share(),
        empty_edges: it
            .coverage
            .empty_edges()
            .into_iter()
            .map(PictureEdge::name)
            .collect(),
        focal_ratio: it.focal_ratio,
        offset_s: has_clocks.then_some(it.offset_s),
        rate_hz: has_clocks.then_some(it.rate_hz),
    });
    let findings = report.findings.iter().map(|it| FindingLine {
        camera: it.camera.as_deref(),
        is_wrong: it.is_wrong(),
        found: &it.found,
        expected: &it.expected,
        remedy: &it.remedy,
    });
    let passes = judged.passes();
    let document = Found {
        passes,
        error: (!passes).then_some(DOES_NOT_PASS),
        exit_code: if passes { 0 } else { EXIT_FAILED },
        cameras: cameras.collect(),
        without_pose: without_pose(judged.found, &request.names),
        known_places_rms_m: report.anchors_rms_m,
        people: report.people.map(People::new),
        field: report.field.as_ref().map(Field::new),
        findings: findings.collect(),
        refused: &judged.refusals,
        doubtful: &judged.warnings,
        metres: &request.metres,
        files,
    };
    let text = serde_json::to_string_pretty(&document).map_err(NodeError::failed)?;
    Ok(text + "\n")
}

fn lines(judged: &JudgedCalibration<'_>, request: &RequestFacts<'_>, files: [&Path; 2]) -> String {
    let report = &judged.found.report;
    let mut text = String::new();
    // Writing to a string does not fail.
    for camera in &report.cameras {
        writeln!(text, "camera {}: {}", camera.name, in_words(camera)).ok();
    }
    for name in without_pose(judged.found, &request.names) {
        writeln!(text, "camera {name}: no pose").ok();
    }
    if let Some(rms_m) = report.anchors_rms_m {
        writeln!(
            text,
            "known places: {:.0} mm from their measured positions",
            1000.0 * rms_m
        )
        .ok();
    }
    if let Some(people) = &report.people {
        writeln!(text, "{}", people_in_words(people)).ok();
    }
    if let Some(field) = &report.field {
        writeln!(text, "{}", sheet::in_words(field)).ok();
    }
    writeln!(text, "{}", request.metres).ok();
    for finding in &report.findings {
        let word = if finding.is_wrong() {
            "WRONG"
        } else {
            "warning"
        };
        writeln!(text, "{word}: {finding}").ok();
    }
    for refusal in &judged.refusals {
        writeln!(text, "WRONG: a run refuses it: {refusal}").ok();
    }
    for warning in &judged.warnings {
        writeln!(text, "warning: {warning}").ok();
    }
    for path in files {
        writeln!(text, "{}", path.display()).ok();
    }
    text
}

/// The movement of a camera by noise alone.
fn by_noise(camera: &CameraReport) -> String {
    camera.determined_rotation_deg().map_or_else(
        || format!("its movement by noise alone is {NOT_DETERMINED}"),
        |deg| {
            let mm = 1000.0 * camera.position_sigma_m;
            format!("noise alone moves it by {mm:.1} mm and {deg:.3} degrees")
        },
    )
}

fn in_words(camera: &CameraReport) -> String {
    format!(
        "{:.2} px over {} sights, {:.0} % used; {}; halves of the data {}",
        camera.rms_px,
        camera.sights,
        100.0 * camera.used_share,
        by_noise(camera),
        halves(camera)
    )
}

/// A calibration with its file and its problems.
pub(super) struct JudgedCalibration<'a> {
    pub(super) found: &'a PointCalibration,
    /// The calibration file.
    pub(super) text: String,
    /// Why a run would refuse it.
    pub(super) refusals: Vec<String>,
    /// Warnings that a run would print.
    pub(super) warnings: Vec<String>,
}

impl<'a> JudgedCalibration<'a> {
    /// Checks a calibration; `path` is only for messages.
    pub(super) fn new(found: &'a PointCalibration, path: &Path) -> Self {
        let written = found.toml().map_err(|error| error.to_string());
        let text = written.clone().unwrap_or_default();
        let (mut refusals, mut warnings) = (Vec::new(), Vec::new());
        match written.and_then(|text| venue_of_all(found, &text, path)) {
            Err(refusal) => refusals.push(refusal),
            Ok(venue) => {
                for finding in plausibility::of_venue(&venue) {
                    let list = if finding.is_wrong() {
                        &mut refusals
                    } else {
                        &mut warnings
                    };
                    list.push(finding.to_string());
                }
            }
        }
        Self {
            found,
            text,
            refusals,
            warnings,
        }
    }

    /// Whether it can be used.
    pub(super) fn passes(&self) -> bool {
        self.found.report.passes() && self.refusals.is_empty()
    }
}

/// A venue with all cameras, each a viewpoint of its own.
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

/// Shown instead of a number that the sights do not determine.
pub(super) const NOT_DETERMINED: &str = "not determined";

/// The measured height of people, in words.
pub(super) fn people_in_words(people: &PeopleReport) -> String {
    format!(
        "People are {:.2} m tall at the median (world_scale {:.3}: the factor that would give them their known height, or that of usual \
         adults).",
        people.stature_m, people.world_scale
    )
}

/// Differences of the two halves of the data, if both could be solved.
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
