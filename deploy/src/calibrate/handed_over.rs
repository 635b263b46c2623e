//! A calibration that was found, handed over: its files, and what is said of it.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use clap::Args;
use farfield_calibration::points::PointCalibration;
use farfield_calibration::report::{CameraReport, FieldReport, PeopleReport, PictureEdge};
use farfield_node::process::{EXIT_FAILED, NodeError, say};
use serde::Serialize;

use super::judged::{JudgedCalibration, NOT_DETERMINED, halves, people_in_words};
use super::{Judged, refuse_existing, sheet, write};
use crate::output;

/// Where a calibration goes, and how it is told.
#[derive(Debug, Args)]
pub(super) struct FoundArgs {
    /// What to write. Default: calibration.toml.
    ///
    /// Its sheet goes beside it, as HTML.
    /// One that does not pass is called NAME.failed.toml instead, and takes the place of none.
    #[arg(
        long,
        value_name = "FILE",
        default_value = "calibration.toml",
        hide_default_value = true
    )]
    pub(super) out: PathBuf,
    /// Replace files that are there already.
    #[arg(long)]
    pub(super) replace: bool,
    /// Print what was found or went wrong as JSON.
    #[arg(long)]
    pub(super) json: bool,
}

impl FoundArgs {
    /// Refuses to write over a calibration and its sheet.
    pub(super) fn refuse_existing(&self) -> Result<(), NodeError> {
        for path in [&self.out, &self.out.with_extension("html")] {
            refuse_existing(path, self.replace)?;
        }
        Ok(())
    }
}

/// What is said of a calibration that is written and should not be used.
const DOES_NOT_PASS: &str = "the calibration does not pass: its sheet says why";

/// What is printed as JSON.
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
    /// Why a run would not take it.
    refused: &'a [String],
    /// What a run would say of it.
    doubtful: &'a [String],
    /// Where metres come from, and what checks them.
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
    /// `None` where it is not determined.
    rotation_sigma_deg: Option<f64>,
    halves_mm: f64,
    halves_deg: f64,
    /// How far the halves draw apart what it saw, 95 % of it by less; and in the field.
    halves_px: f64,
    halves_field_mm: f64,
    /// Sights that fit, by where they are in the picture: rows from the upper edge, each from the left.
    picture: &'a [[usize; 6]; 4],
    picture_empty_share: f64,
    empty_edges: Vec<&'static str>,
    focal_ratio: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    offset_s: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    rate_hz: Option<f64>,
}

/// How tall people come out, and the factor on all distances that would make them as tall as they are, or as usual.
#[derive(Debug, Serialize)]
struct People {
    stature_m: f64,
    world_scale: f64,
}

impl People {
    fn of(found: PeopleReport) -> Self {
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
    /// The court that is part of it; else it is only where somebody was.
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
    fn of(field: &FieldReport) -> Self {
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

/// What was asked for, as far as it is said again.
pub(super) struct Asked<'a> {
    /// The names of all cameras.
    pub(super) names: Vec<&'a str>,
    /// Whether cameras have clocks of their own.
    pub(super) has_clocks: bool,
    /// Where metres come from, in sentences.
    pub(super) metres: String,
}

/// Writes what was found and its sheet to `told.out`, or beside it where it does not pass, and says how good it is.
///
/// # Errors
/// [`NodeError::Failed`] where the disk is in the way.
pub(super) fn hand_over(
    found: &PointCalibration,
    asked: &Asked<'_>,
    told: &FoundArgs,
) -> Result<Judged, NodeError> {
    let judged = JudgedCalibration::of(found, &told.out);
    let out = if judged.passes() {
        told.out.clone()
    } else {
        told.out.with_extension("failed.toml")
    };
    let sheet = out.with_extension("html");
    let facts = sheet::SheetFacts {
        metres: &asked.metres,
        has_clocks: asked.has_clocks,
    };
    write(&sheet, &sheet::html(&out, &judged, &facts))?;
    write(&out, &judged.text)?;
    let files = [out.as_path(), sheet.as_path()];
    let text = if told.json {
        json(&judged, asked, files)?
    } else {
        lines(&judged, asked, files)
    };
    output::print(&text).map_err(NodeError::Failed)?;
    if judged.passes() {
        return Ok(Judged::Passes);
    }
    say(format_args!("error: {DOES_NOT_PASS}"));
    Ok(Judged::Fails)
}

/// Those of the cameras `names` that have no pose.
pub(super) fn without_pose<'a>(found: &PointCalibration, names: &[&'a str]) -> Vec<&'a str> {
    let has_none = |name: &&str| found.cameras.iter().all(|it| it.name != *name);
    names.iter().copied().filter(has_none).collect()
}

fn json(
    judged: &JudgedCalibration<'_>,
    asked: &Asked<'_>,
    files: [&Path; 2],
) -> Result<String, NodeError> {
    let report = &judged.found.report;
    let has_clocks = asked.has_clocks;
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
        without_pose: without_pose(judged.found, &asked.names),
        known_places_rms_m: report.anchors_rms_m,
        people: report.people.map(People::of),
        field: report.field.as_ref().map(Field::of),
        findings: findings.collect(),
        refused: &judged.refusals,
        doubtful: &judged.doubts,
        metres: &asked.metres,
        files,
    };
    let text = serde_json::to_string_pretty(&document).map_err(NodeError::failed)?;
    Ok(text + "\n")
}

fn lines(judged: &JudgedCalibration<'_>, asked: &Asked<'_>, files: [&Path; 2]) -> String {
    let report = &judged.found.report;
    let mut text = String::new();
    // Writing to a string does not fail.
    for camera in &report.cameras {
        writeln!(text, "camera {}: {}", camera.name, in_words(camera)).ok();
    }
    for name in without_pose(judged.found, &asked.names) {
        writeln!(text, "camera {name}: no pose").ok();
    }
    if let Some(rms_m) = report.anchors_rms_m {
        writeln!(
            text,
            "known places: {:.0} mm from where they were found",
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
    writeln!(text, "{}", asked.metres).ok();
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
    for doubt in &judged.doubts {
        writeln!(text, "warning: {doubt}").ok();
    }
    for path in files {
        writeln!(text, "{}", path.display()).ok();
    }
    text
}

/// How far noise alone moves a camera.
fn by_noise(camera: &CameraReport) -> String {
    camera.determined_rotation_deg().map_or_else(
        || format!("how far noise alone moves it is {NOT_DETERMINED}"),
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
