//! `farfield calibrate points`: where cameras stand, from a single moving point that they saw.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use anyhow::{bail, ensure};
use clap::{Args, ValueEnum};
use farfield_calibration::points::{
    Lenses, PointCalibration, PointCamera, PointRequest, Stage, Timing, calibrate, parse,
};
use farfield_calibration::report::CameraReport;
use farfield_node::process::{EXIT_FAILED, NodeError, say};
use serde::Serialize;

use super::judged::{JudgedCalibration, halves};
use super::known::KnownArgs;
use super::lenses::{LensFile, lenses};
use super::{Judged, named, read, refuse_existing, sheet, write};
use crate::output;

/// What `farfield calibrate points` is told.
#[derive(Debug, Args)]
pub(super) struct PointsArgs {
    /// Where each camera saw the point: NAME.txt, with `frame x y` on each line.
    ///
    /// Distorted pixels, the centre of the first is (0, 0); the file's name is the camera's. More than one in a frame is not
    /// allowed: the detector decides, and up to a tenth may be wrong.
    #[arg(required = true)]
    seen: Vec<PathBuf>,
    /// Lenses: a calibration of any format, or NAME=FILE for one camera.
    #[arg(long, value_name = "[NAME=]FILE", required = true)]
    lens: Vec<LensFile>,
    /// Whether frames are of one moment: synchronised, given, unknown.
    ///
    /// synchronised: frames of one number; given: by --rate-hz and --offset-s; unknown: rates are about right, offsets are
    /// looked for.
    #[arg(
        long,
        value_name = "HOW",
        default_value = "synchronised",
        hide_possible_values = true
    )]
    clocks: Clocks,
    /// Frames per second: of all cameras, or NAME=HZ.
    #[arg(long, value_name = "[NAME=]HZ", value_parser = rate)]
    rate_hz: Vec<(Option<String>, f64)>,
    /// Time of a camera's frame 0, seconds, on a clock that all share.
    #[arg(long, value_name = "NAME=S", value_parser = offset)]
    offset_s: Vec<(String, f64)>,
    #[command(flatten)]
    known: KnownArgs,
    /// What of the lenses may move: none, focal, all.
    #[arg(
        long,
        value_name = "WHAT",
        default_value = "none",
        hide_possible_values = true
    )]
    free: FreeLens,
    /// Distance in pixels within which sights agree while poses are rough.
    #[arg(long, value_name = "PX", default_value_t = 3.0, hide_short_help = true)]
    gate_px: f64,
    /// Seed of the random samples.
    #[arg(long, value_name = "N", default_value_t = 1, hide_short_help = true)]
    seed: u64,
    /// The calibration to write; its sheet goes beside it, as HTML.
    ///
    /// One that does not pass is called NAME.failed.toml instead, and takes the place of none.
    #[arg(long, value_name = "FILE", default_value = "calibration.toml")]
    out: PathBuf,
    /// Replace files that are there already.
    #[arg(long)]
    replace: bool,
    /// Print what was found, or what went wrong, as JSON.
    #[arg(long)]
    pub(super) json: bool,
}

/// What is known of when frames were taken.
#[derive(Debug, Clone, Copy, ValueEnum)]
pub(super) enum Clocks {
    Synchronised,
    Given,
    Unknown,
}

impl Clocks {
    /// The same as calibrations take it.
    pub(super) fn timing(self) -> Timing {
        match self {
            Self::Synchronised => Timing::Synchronised,
            Self::Given => Timing::Clocks,
            Self::Unknown => Timing::Unknown,
        }
    }
}

/// What of the lenses may move.
#[derive(Debug, Clone, Copy, ValueEnum)]
enum FreeLens {
    None,
    Focal,
    All,
}

pub(super) fn rate(word: &str) -> Result<(Option<String>, f64), String> {
    let expected = "HZ or NAME=HZ, for example 59.94 or north=59.94";
    if word.contains('=') {
        let (name, hz) = named(word, expected)?;
        return Ok((Some(name), hz));
    }
    let hz = word
        .parse()
        .map_err(|_| format!("found `{word}`, expected {expected}"))?;
    Ok((None, hz))
}

pub(super) fn offset(word: &str) -> Result<(String, f64), String> {
    named(word, "NAME=SECONDS, for example north=-0.35")
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
    findings: Vec<FindingLine<'a>>,
    /// Why a run would not take it.
    refused: &'a [String],
    /// What a run would say of it.
    doubtful: &'a [String],
    files: [&'a Path; 2],
}

#[derive(Debug, Serialize)]
struct Camera<'a> {
    name: &'a str,
    sights: usize,
    used_share: f64,
    rms_px: f64,
    position_sigma_mm: f64,
    rotation_sigma_deg: f64,
    halves_mm: f64,
    halves_deg: f64,
    focal_ratio: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    offset_s: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    rate_hz: Option<f64>,
}

#[derive(Debug, Serialize)]
struct FindingLine<'a> {
    camera: Option<&'a str>,
    is_wrong: bool,
    found: &'a str,
    expected: &'a str,
    remedy: &'a str,
}

/// Finds the cameras, writes calibration and sheet, and says how good they are.
///
/// # Errors
/// [`NodeError::Refused`] where the input cannot carry a calibration, [`NodeError::Failed`] where the disk is in the way.
pub(super) fn from_points(args: &PointsArgs) -> Result<Judged, NodeError> {
    let request = request(args).map_err(NodeError::Refused)?;
    for path in [&args.out, &args.out.with_extension("html")] {
        refuse_existing(path, args.replace)?;
    }
    let told = &mut |stage: Stage| {
        say(format_args!(
            "{}",
            match stage {
                Stage::Clocks => "looking for the lags of the clocks",
                Stage::Poses => "looking for poses",
                Stage::Adjustment => "adjusting all to all",
                Stage::Report => "looking how good it is",
            }
        ));
    };
    let found = calibrate(&request, told).map_err(NodeError::refused)?;
    let asked = Asked {
        names: request.cameras.iter().map(|it| it.name.as_str()).collect(),
        has_clocks: request.timing != Timing::Synchronised,
    };
    hand_over(&found, &asked, &args.out, args.json)
}

/// What was asked for, as far as it is said again.
pub(super) struct Asked<'a> {
    /// The names of all cameras.
    pub(super) names: Vec<&'a str>,
    /// Whether cameras have clocks of their own.
    pub(super) has_clocks: bool,
}

/// Writes what was found and its sheet to `out`, or beside it where it does not pass, and says how good it is.
///
/// # Errors
/// [`NodeError::Failed`] where the disk is in the way.
pub(super) fn hand_over(
    found: &PointCalibration,
    asked: &Asked<'_>,
    out: &Path,
    is_json: bool,
) -> Result<Judged, NodeError> {
    let judged = JudgedCalibration::of(found, out);
    let out = if judged.passes() {
        out.to_owned()
    } else {
        out.with_extension("failed.toml")
    };
    let sheet = out.with_extension("html");
    write(&sheet, &sheet::html(&out, &judged))?;
    write(&out, &judged.text)?;
    let files = [out.as_path(), sheet.as_path()];
    let text = if is_json {
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

/// The cameras that have no pose.
fn without_pose<'a>(judged: &JudgedCalibration<'_>, asked: &Asked<'a>) -> Vec<&'a str> {
    let has_none = |name: &&str| judged.found.cameras.iter().all(|it| it.name != *name);
    asked.names.iter().copied().filter(has_none).collect()
}

/// What is given of clocks must be asked for.
fn refuse_unused(args: &PointsArgs) -> anyhow::Result<()> {
    let is_free = matches!(args.clocks, Clocks::Unknown);
    if matches!(args.clocks, Clocks::Synchronised) {
        ensure!(
            args.rate_hz.is_empty() && args.offset_s.is_empty(),
            "--rate-hz and --offset-s say nothing of cameras that are synchronised: give --clocks given, or unknown"
        );
    }
    ensure!(
        !is_free || args.offset_s.is_empty(),
        "--offset-s: offsets are looked for with --clocks unknown; give --clocks given where they are known"
    );
    Ok(())
}

fn request(args: &PointsArgs) -> anyhow::Result<PointRequest> {
    refuse_unused(args)?;
    let lenses = lenses(&args.lens)?;
    let mut seen = BTreeMap::new();
    for path in &args.seen {
        let name = path
            .file_stem()
            .and_then(|it| it.to_str())
            .unwrap_or_default();
        let sightings = parse(&read(path)?.text, path)?;
        if seen.insert(name.to_owned(), sightings).is_some() {
            bail!("{}: two files are of camera `{name}`", path.display());
        }
    }
    let known: Vec<&str> = seen.keys().map(String::as_str).collect();
    let is_known = |name: &str| {
        ensure!(
            known.contains(&name),
            "unknown camera `{name}`, expected one of {}",
            known.join(", ")
        );
        Ok(())
    };
    let rates = args.rate_hz.iter().filter_map(|(name, _)| name.as_ref());
    let offsets = args.offset_s.iter().map(|(name, _)| name);
    for name in rates.chain(offsets).chain(args.known.cameras()) {
        is_known(name)?;
    }
    let mut cameras = Vec::new();
    for (name, sightings) in seen {
        let Some(lens) = lenses.get(&name) else {
            let has: Vec<&str> = lenses.keys().map(String::as_str).collect();
            bail!(
                "no lens of camera `{name}`: found those of {}; give it by --lens {name}=FILE",
                has.join(", ")
            );
        };
        let of_all = args.rate_hz.iter().filter(|(of, _)| of.is_none());
        let own = args
            .rate_hz
            .iter()
            .filter(|(of, _)| of.as_deref() == Some(&name));
        let rate_hz = own.chain(of_all).map(|(_, hz)| *hz).next();
        let offset_s = args.offset_s.iter().find(|(of, _)| *of == name);
        cameras.push(PointCamera {
            size_px: lens.size_px,
            intrinsics: lens.intrinsics,
            distortion: lens.distortion,
            rate_hz,
            offset_s: offset_s.map(|(_, s)| *s),
            sightings,
            name,
        });
    }
    let timing = args.clocks.timing();
    Ok(PointRequest {
        lenses: match args.free {
            FreeLens::None => Lenses::Given,
            FreeLens::Focal => Lenses::Focal,
            FreeLens::All => Lenses::All,
        },
        gate_px: args.gate_px,
        seed: args.seed,
        anchors: args.known.anchors()?,
        ..PointRequest::new(cameras, timing)
    })
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
        rotation_sigma_deg: it.rotation_sigma_deg,
        halves_mm: 1000.0 * it.halves_m,
        halves_deg: it.halves_deg,
        focal_ratio: it.focal_ratio,
        offset_s: has_clocks.then_some(it.offset_s),
        rate_hz: has_clocks.then_some(it.rate_hz),
    });
    let findings = report.findings.iter().map(|it| FindingLine {
        camera: it.camera.as_deref(),
        is_wrong: it.is_wrong,
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
        without_pose: without_pose(judged, asked),
        known_places_rms_m: report.anchors_rms_m,
        findings: findings.collect(),
        refused: &judged.refusals,
        doubtful: &judged.doubts,
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
    for name in without_pose(judged, asked) {
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
    for finding in &report.findings {
        let word = if finding.is_wrong { "WRONG" } else { "warning" };
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

fn in_words(camera: &CameraReport) -> String {
    format!(
        "{:.2} px over {} sights, {:.0} % used; noise alone moves it by {:.1} mm and {:.3} degrees; halves of the data {}",
        camera.rms_px,
        camera.sights,
        100.0 * camera.used_share,
        1000.0 * camera.position_sigma_m,
        camera.rotation_sigma_deg,
        halves(camera)
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_known_of_cameras_is_understood_or_said() {
        assert_eq!(rate("59.94"), Ok((None, 59.94)));
        assert_eq!(rate("north=25"), Ok((Some("north".to_owned()), 25.0)));
        for wrong in [rate("fast").unwrap_err(), offset("0.3").unwrap_err()] {
            assert!(wrong.contains("expected"), "{wrong}");
        }
    }
}
