//! `farfield import FOLDER`: converts 2D keypoints of other programs to a venue.

use std::fmt::Write as _;
use std::path::PathBuf;

use clap::Args;
use farfield_import::ImportError;
use farfield_import::formats::Format;
use farfield_import::import::{ImportRequest, import};
use farfield_import::keypoints::Model;
use farfield_import::report::{CameraReport, Report};
use farfield_node::process::NodeError;

use super::target::check_folder;
use crate::output;

/// Arguments of `farfield import`.
#[derive(Debug, Args)]
pub(crate) struct ImportArgs {
    /// The folder of Pose2Sim, `FreeMoCap`, ..., or of keypoints.
    ///
    /// A folder per camera with a JSON file per frame (`OpenPose`, Pose2Sim), or a file per camera (`AlphaPose`, COCO, `MMPose`,
    /// `DeepLabCut`, SLEAP), or one file of all cameras (Caliscope, `FreeMoCap`).
    folder: PathBuf,
    /// The calibration, in any supported format.
    ///
    /// One file, or several if its format needs them: `--calibration intri.yml --calibration extri.yml`. Default: the
    /// only one in the folder, detected by content. `farfield calibrate convert --help` lists the formats.
    #[arg(long, value_name = "FILE")]
    calibration: Vec<PathBuf>,
    /// Frames per second.
    ///
    /// Default: the rate in Pose2Sim's Config.toml.
    #[arg(long, value_name = "HZ")]
    rate: Option<f64>,
    /// Format of the keypoints. Default: detected.
    ///
    /// openpose (also for Pose2Sim), alphapose, coco-results, coco, mmpose, deeplabcut, sleap, caliscope, freemocap.
    #[arg(long, value_name = "FORMAT", value_parser = format)]
    format: Option<Format>,
    /// Keypoint model: `BODY_25B`, `HALPE_26`, ...
    ///
    /// `BODY_25`, `BODY_25B`, `BODY_135`, `COCO_18`, `MPII`, `COCO_17`, `COCO_23`, `COCO_133`, `HALPE_26`, `HALPE_68`,
    /// `HALPE_136`, BLAZEPOSE. Default: detected by number, names, or Config.toml.
    #[arg(long, value_name = "MODEL", value_parser = model)]
    keypoints: Option<Model>,
    /// A camera of the calibration and its keypoints.
    ///
    /// A file, or a folder with a file per frame; only the listed cameras are used. Default: matched by name.
    #[arg(long, value_name = "NAME=FOLDER", value_parser = camera)]
    camera: Vec<(String, PathBuf)>,
    /// Folder to create. Default: `farfield` in the folder.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Print the result or the error as JSON.
    #[arg(long)]
    pub(crate) json: bool,
}

fn format(word: &str) -> Result<Format, String> {
    Format::from_name(word).ok_or_else(|| {
        let names: Vec<&str> = Format::ALL.iter().map(|format| format.name()).collect();
        format!("`{word}` is not one of {}", names.join(", "))
    })
}

fn model(word: &str) -> Result<Model, String> {
    Model::from_name(word).ok_or_else(|| format!("`{word}` is not one of {}", Model::list()))
}

fn camera(word: &str) -> Result<(String, PathBuf), String> {
    match word.split_once('=') {
        Some((name, folder)) if !name.trim().is_empty() && !folder.is_empty() => {
            Ok((name.trim().to_owned(), folder.into()))
        }
        _ => Err(format!(
            "found `{word}`, expected NAME=FOLDER, for example cam01=pose/cam01_json"
        )),
    }
}

/// Creates the whole venue or nothing, and prints its content.
///
/// # Errors
/// [`NodeError::Refused`] for wrong files or options, [`NodeError::Failed`] if nothing can be written.
pub(crate) fn import_folder(args: &ImportArgs) -> Result<(), NodeError> {
    if let Some(out) = &args.out {
        check_folder("--out", out).map_err(NodeError::Refused)?;
    }
    let request = ImportRequest {
        folder: args.folder.clone(),
        calibration: args.calibration.clone(),
        rate_hz: args.rate,
        format: args.format,
        model: args.keypoints,
        cameras: args.camera.clone(),
        out: args.out.clone(),
    };
    let report = import(&request).map_err(node_error)?;
    let text = if args.json {
        serde_json::to_string_pretty(&report).map_err(NodeError::failed)? + "\n"
    } else {
        lines(&report)
    };
    output::print(&text).map_err(NodeError::Failed)
}

fn node_error(error: ImportError) -> NodeError {
    match error {
        error @ ImportError::Write { .. } => NodeError::failed(error),
        error => NodeError::refused(error),
    }
}

fn lines(report: &Report) -> String {
    let mut text = String::new();
    let last = report.first_frame + report.frames - 1;
    // Writing to a string does not fail.
    writeln!(
        text,
        "{} cameras of the format {}, calibrated in {}: frames {} to {last} at {} Hz",
        report.cameras.len(),
        report.format,
        report.calibration_format,
        report.first_frame,
        report.rate_hz
    )
    .ok();
    for file in &report.calibration {
        writeln!(text, "calibration: {}", file.display()).ok();
    }
    for camera in &report.cameras {
        writeln!(text, "{}", camera_line(camera)).ok();
    }
    writeln!(
        text,
        "keypoints of {}: contain {} of Farfield's keypoints{}",
        report.model,
        report.mapped.len(),
        listed(", but not ", &report.missing)
    )
    .ok();
    if !report.left_out.is_empty() {
        writeln!(text, "not used: {}", report.left_out.join(", ")).ok();
    }
    for remark in &report.remarks {
        let camera = remark.camera.as_deref();
        let camera = camera.map_or_else(String::new, |camera| format!("camera {camera}: "));
        writeln!(text, "{}: {camera}{}", remark.kind.name(), remark.text).ok();
    }
    let venue = report.venue.display();
    writeln!(
        text,
        "next: farfield check {venue}, then farfield run {venue}"
    )
    .ok();
    text
}

fn camera_line(camera: &CameraReport) -> String {
    let missing = match camera.missing_frames {
        0 => String::new(),
        missing => format!(", {missing} missing"),
    };
    format!(
        "camera {}: {}, frames {} to {}{missing}; {:.1} people in a frame, at most {}",
        camera.name,
        camera.source,
        camera.first_frame,
        camera.last_frame,
        camera.people_mean,
        camera.people_max
    )
}

/// Names after a word; empty without names.
fn listed(word: &str, names: &[&str]) -> String {
    if names.is_empty() {
        String::new()
    } else {
        format!("{word}{}", names.join(", "))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn formats_models_and_cameras_are_parsed_or_listed() {
        assert_eq!(format("pose2sim"), Ok(Format::OpenPose));
        assert!(format("vitpose").unwrap_err().contains("mmpose"));
        assert_eq!(model("body_25b"), Ok(Model::Body25B));
        assert!(model("ANIMAL2D_17").unwrap_err().contains("HALPE_26"));
        let expected = ("cam01".to_owned(), PathBuf::from("pose/a=b"));
        assert_eq!(camera("cam01=pose/a=b"), Ok(expected));
        for word in ["cam01", "=pose", "cam01="] {
            assert!(camera(word).unwrap_err().contains("NAME=FOLDER"), "{word}");
        }
    }

    #[test]
    fn read_errors_are_refusals_and_write_errors_are_failures() {
        let source = || std::io::Error::from(std::io::ErrorKind::PermissionDenied);
        let read = ImportError::Read {
            doing: "reading",
            path: PathBuf::from("a.json"),
            source: source(),
        };
        let write = ImportError::Write {
            doing: "writing",
            path: PathBuf::from("a.jsonl"),
            source: source(),
        };
        assert!(matches!(node_error(read), NodeError::Refused(_)));
        assert!(matches!(node_error(write), NodeError::Failed(_)));
    }

    #[test]
    fn the_report_names_the_calibration() {
        let report = Report {
            format: "openpose",
            calibration_format: "farfield",
            calibration: vec![PathBuf::from("above/Calib.toml")],
            venue: PathBuf::from("farfield/venue.toml"),
            rate_hz: 50.0,
            first_frame: 0,
            frames: 20,
            cameras: Vec::new(),
            model: "COCO_17".to_owned(),
            mapped: vec!["nose"],
            missing: Vec::new(),
            left_out: Vec::new(),
            remarks: Vec::new(),
        };
        let text = lines(&report);
        assert!(text.contains("calibration: above/Calib.toml"), "{text}");
    }
}
