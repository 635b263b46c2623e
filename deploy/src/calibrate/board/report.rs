//! The report on a lens from boards, as text and JSON.

use std::fmt::Write as _;
use std::path::PathBuf;

use farfield_calibration::board::BoardCalibration;
use farfield_node::process::NodeError;
use serde::Serialize;

/// The JSON output.
#[derive(Debug, Serialize)]
struct Found<'a> {
    camera: &'a str,
    size_px: [u32; 2],
    rms_px: f64,
    corner_sigma_px: f64,
    parameters: Vec<Parameter>,
    pictures: Vec<Picture<'a>>,
    left_out: Vec<&'a (String, String)>,
    remarks: &'a [String],
    files: Vec<PathBuf>,
}

#[derive(Debug, Serialize)]
struct Parameter {
    name: &'static str,
    value: f64,
    sigma: f64,
}

#[derive(Debug, Serialize)]
struct Picture<'a> {
    name: &'a str,
    corners: usize,
    rms_px: f64,
    hurts: bool,
}

/// The parameters with their standard deviations.
fn parameters(found: &BoardCalibration) -> Vec<Parameter> {
    let i = &found.intrinsics;
    let values = [i.fx_px, i.fy_px, i.cx_px, i.cy_px];
    let values = values.into_iter().chain(found.lens.coefficients());
    let named = found.parameters.iter().zip(values).zip(found.sigmas());
    named
        .map(|((name, value), sigma)| Parameter { name, value, sigma })
        .collect()
}

/// The JSON document.
///
/// # Errors
/// When a number cannot be written.
pub(super) fn json(
    camera: &str,
    found: &BoardCalibration,
    files: Vec<PathBuf>,
) -> Result<String, NodeError> {
    let pictures = found.pictures.iter().map(|it| Picture {
        name: &it.name,
        corners: it.corners,
        rms_px: it.rms_px,
        hurts: it.hurts,
    });
    let document = Found {
        camera,
        size_px: found.size_px,
        rms_px: found.rms_px,
        corner_sigma_px: found.corner_sigma_px,
        parameters: parameters(found),
        pictures: pictures.collect(),
        left_out: found.left_out.iter().collect(),
        remarks: &found.remarks,
        files,
    };
    let text = serde_json::to_string_pretty(&document).map_err(NodeError::failed)?;
    Ok(text + "\n")
}

/// A line for each parameter and each image.
pub(super) fn lines(camera: &str, found: &BoardCalibration, files: &[PathBuf]) -> String {
    let mut text = String::new();
    let [w, h] = found.size_px;
    // Writing to a string does not fail.
    writeln!(
        text,
        "camera {camera}, {w}x{h}: {:.3} px between projected and detected corners, over {} images",
        found.rms_px,
        found.pictures.len()
    )
    .ok();
    for it in parameters(found) {
        let digits = if it.name.len() == 2 && !it.name.starts_with(['k', 'p']) {
            1
        } else {
            4
        };
        writeln!(
            text,
            "  {:<3} {:>11.digits$} +- {:.digits$}",
            it.name, it.value, it.sigma
        )
        .ok();
    }
    for picture in &found.pictures {
        let word = if picture.hurts {
            "  HURTS: check it, or remove it"
        } else {
            ""
        };
        writeln!(
            text,
            "  {:.3} px, {} corners  {}{word}",
            picture.rms_px, picture.corners, picture.name
        )
        .ok();
    }
    for (name, reason) in &found.left_out {
        writeln!(text, "  not used: {name}: {reason}").ok();
    }
    for remark in &found.remarks {
        writeln!(text, "{remark}").ok();
    }
    writeln!(
        text,
        "the side of a square has no effect on a lens: the scale comes from positions, distances or marks when camera poses are computed"
    )
    .ok();
    for path in files {
        writeln!(text, "{}", path.display()).ok();
    }
    text
}
