//! Qualisys' `.qca.txt` and Theia's variant: one XML schema, two meanings of the pose.
//!
//! Both: focal lengths and principal point in 1/64 pixel, the point counted from the sensor's corner and not from that of the
//! field of view; millimetres; distortion coefficients as in OpenCV, *not* scaled (Pose2Sim divides them by 64).
//! Qualisys: x, y, z is the camera's *position*; the rows of r are the camera's axes with y up and z backwards, so that a turn
//! by pi about x gives OpenCV's. Theia: x, y, z and r are the rigid motion itself, camera = r world + (x, y, z).

use std::fmt::Write as _;

use farfield_proto::camera::{Distortion, Intrinsics};
use farfield_proto::toml_file::FileError;
use nalgebra::{Matrix3, Vector3};

use super::camera::{
    CameraRecord, FileUnit, LensModel, RawCamera, RawPose, RawSet, Remark, RemarkKind, all_zero,
};
use super::tree::{Source, orthonormal, whole_size};
use super::xml::{Element, Films, escaped, parse, select_filming, words};
use super::{ExportError, Format, placed};

/// Lengths on the sensor are in this fraction of a pixel.
const PARTS: f64 = 64.0;
/// No sensor is this wide in pixels, and none this narrow in 64ths of a pixel.
const WIDEST_IN_PIXELS: f64 = 20_000.0;

/// A rotation by pi about x.
fn half_turn() -> Matrix3<f64> {
    Matrix3::from_diagonal(&Vector3::new(1.0, -1.0, -1.0))
}

/// Distinguishes the two: Theia's root element has no attributes.
pub(super) fn guess(source: &Source<'_>) -> Option<Format> {
    let document = parse(source).ok()?;
    let root = document.root_element();
    let is_calibration =
        root.has_tag_name("calibration") && root.children().any(|n| n.has_tag_name("cameras"));
    let without = root.attributes().next().is_none();
    is_calibration.then_some(if without {
        Format::Theia
    } else {
        Format::Qualisys
    })
}

pub(super) fn read(source: &Source<'_>, format: Format) -> Result<RawSet, FileError> {
    let document = parse(source)?;
    let root = Element {
        source: *source,
        node: document.root_element(),
    };
    let mut remarks = Vec::new();
    let is_off =
        |it: &Element<'_, '_>| it.text("active").is_some_and(|active| active.trim() == "0");
    let all = root.need_child("cameras")?.children("camera").into_iter();
    let (off, on): (Vec<_>, Vec<_>) = all.partition(is_off);
    for element in &off {
        let text = "the file marks it as not active: left out";
        remarks.push(Remark::of_camera(
            RemarkKind::Assumed,
            element.need_text("serial")?,
            text,
        ));
    }
    let mut described = Vec::new();
    for element in &on {
        let model = element.text("model").unwrap_or_default();
        described.push((
            element.need_text("serial")?,
            model.to_owned(),
            films(element)?,
        ));
    }
    let selected = select_filming(&described, &mut remarks);
    let mut cameras = Vec::new();
    for ((element, (name, ..)), is_selected) in on.iter().zip(described).zip(selected) {
        if is_selected {
            cameras.push(camera(name.to_owned(), element, format, &mut remarks)?);
        }
    }
    Ok(RawSet {
        cameras,
        unit: FileUnit::Millimetres,
        remarks,
    })
}

/// Decides by the file's fields about video, or else by the model.
fn films(camera: &Element<'_, '_>) -> Result<Films, FileError> {
    let states_video = |name: &str| {
        camera
            .text(name)
            .is_some_and(|text| text.starts_with(|c: char| c.is_ascii_digit()))
    };
    if let Some(view) = camera.child("fov_video") {
        let is_empty = view.number("right")? <= view.number("left")?
            || view.number("bottom")? <= view.number("top")?;
        if is_empty {
            return Ok(Films::Never);
        }
    }
    let model = camera.text("model").unwrap_or_default().to_lowercase();
    let words = words(&model);
    let has = |word: &str| words.iter().any(|it| it == word);
    // Hybrids film and see markers. An Oqus whose number ends in c films in colour.
    let is_colour = |word: &String| {
        word.strip_suffix('c')
            .is_some_and(|number| number.parse::<u32>().is_ok())
    };
    let is_miqus = |word: &String| {
        ["m1", "m3", "m5"]
            .iter()
            .any(|it| word.trim_end_matches('u') == *it)
    };
    let video = model.contains("video")
        || model.contains("hybrid")
        || has("oqus") && words.iter().any(is_colour);
    Ok(match model.trim() {
        "" | "none" => Films::Known,
        _ if video || states_video("videoresolution") => Films::Known,
        _ if has("arqus") || has("oqus") || has("proreflex") || words.iter().any(is_miqus) => {
            Films::Never
        }
        _ => Films::Perhaps,
    })
}

fn camera(
    name: String,
    element: &Element<'_, '_>,
    format: Format,
    remarks: &mut Vec<Remark>,
) -> Result<RawCamera, FileError> {
    let lens = element.need_child("intrinsic")?;
    let sensor = [lens.number("sensorMaxU")?, lens.number("sensorMaxV")?];
    let view = element
        .child("fov_video")
        .or_else(|| element.child("fov_video_max"));
    // A view is in pixels. Without one, compare with the widest possible sensor.
    let widest = match &view {
        Some(view) => 8.0 * (view.number("right")?.max(view.number("bottom")?) + 1.0),
        None => WIDEST_IN_PIXELS,
    };
    let parts = if sensor[0].max(sensor[1]) > widest {
        PARTS
    } else {
        let text = "its sensor is too narrow for 64ths of a pixel: focal lengths and principal point were taken as pixels";
        remarks.push(Remark::of_camera(RemarkKind::Corrected, &name, text));
        1.0
    };
    let least = [
        lens.number_or_zero("sensorMinU")?,
        lens.number_or_zero("sensorMinV")?,
    ];
    let (corner, size) = match &view {
        Some(view) => {
            let corner = [view.number("left")?, view.number("top")?];
            let last = [view.number("right")?, view.number("bottom")?];
            (
                corner,
                [last[0] - corner[0] + 1.0, last[1] - corner[1] + 1.0],
            )
        }
        None => (
            [0.0; 2],
            [0, 1].map(|i| ((sensor[i] - least[i]) / parts).round() + 1.0),
        ),
    };
    let size_px = whole_size(size).ok_or_else(|| {
        lens.error(
            "sensorMaxU",
            format!("found a picture of {size:?} pixels, expected whole ones above 0"),
        )
    })?;
    if let Some(turn) = element
        .text("viewrotation")
        .filter(|turn| turn.trim() != "0")
    {
        let text = format!(
            "the program shows its picture turned by {turn} degrees; the calibration is of the picture as the camera takes it"
        );
        remarks.push(Remark::of_camera(RemarkKind::Assumed, &name, text));
    }
    let skew = lens.number_or_zero("skew")?;
    if skew != 0.0 {
        return Err(lens.error(
            "skew",
            format!("found {skew}, expected 0: a skew is not supported"),
        ));
    }
    Ok(RawCamera {
        size_px: Some(size_px),
        intrinsics: Intrinsics {
            fx_px: lens.number("focalLengthU")? / parts,
            fy_px: lens.number("focalLengthV")? / parts,
            cx_px: lens.number("centerPointU")? / parts - corner[0],
            cy_px: lens.number("centerPointV")? / parts - corner[1],
        },
        lens: distortion(&lens)?,
        pose: Some(pose(&element.need_child("transform")?, format)?),
        name,
    })
}

fn distortion(lens: &Element<'_, '_>) -> Result<LensModel, FileError> {
    // The tag is usually written without its "i".
    let tangential = |i: u8| {
        let [usual, other] = [
            format!("tangentalDistortion{i}"),
            format!("tangentialDistortion{i}"),
        ];
        let written = if lens.text(&usual).is_some() {
            usual
        } else {
            other
        };
        lens.number_or_zero(&written)
    };
    Ok(LensModel::Rational(Distortion {
        k1: lens.number_or_zero("radialDistortion1")?,
        k2: lens.number_or_zero("radialDistortion2")?,
        p1: tangential(1)?,
        p2: tangential(2)?,
        k3: lens.number_or_zero("radialDistortion3")?,
        ..Distortion::default()
    }))
}

fn pose(transform: &Element<'_, '_>, format: Format) -> Result<RawPose, FileError> {
    const NAMES: [&str; 9] = [
        "r11", "r12", "r13", "r21", "r22", "r23", "r31", "r32", "r33",
    ];
    let mut entries = [0.0; 9];
    for (entry, name) in entries.iter_mut().zip(NAMES) {
        *entry = transform.number(name)?;
    }
    let vector = Vector3::new(
        transform.number("x")?,
        transform.number("y")?,
        transform.number("z")?,
    );
    let rotation = orthonormal(Matrix3::from_row_slice(&entries)).ok_or_else(|| {
        transform.error("r11", format!("found {entries:?}, which is not a rotation"))
    })?;
    Ok(match format {
        Format::Theia => RawPose {
            rotation,
            translation: vector,
        },
        _ => RawPose::at(half_turn() * rotation, vector),
    })
}

/// One file in the variant `format` (Qualisys or Theia).
pub(super) fn write(cameras: &[CameraRecord], format: Format) -> Result<String, ExportError> {
    let root = match format {
        Format::Theia => "<calibration>",
        _ => {
            "<calibration created=\"\" source=\"\" qtm-version=\"none\" type=\"regular\" wandLength=\"none\" maximumFrames=\"none\" \
              shortArmEnd=\"none\" longArmEnd=\"none\" longArmMiddle=\"none\">"
        }
    };
    let mut text = format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n{root}\n  <results std-dev=\"0\" min-max-diff=\"0\"/>\n  <cameras>\n"
    );
    for camera in cameras {
        text.push_str(&camera_text(camera, format)?);
    }
    text.push_str("  </cameras>\n</calibration>\n");
    Ok(text)
}

fn camera_text(camera: &CameraRecord, format: Format) -> Result<String, ExportError> {
    let pose = placed(camera, format)?;
    let d = match camera.lens {
        LensModel::Rational(d) if all_zero(&[d.k4, d.k5, d.k6]) => d,
        _ => {
            return Err(ExportError::Lens {
                camera: camera.name.clone(),
                format,
                has: "k1, k2, p1, p2, k3",
            });
        }
    };
    let matrix = pose.rotation.to_rotation_matrix().into_inner();
    let (r, v) = match format {
        Format::Theia => (matrix, pose.translation.vector * 1e3),
        _ => (
            half_turn() * matrix,
            pose.inverse().translation.vector * 1e3,
        ),
    };
    let [right, bottom] = camera.size_px.map(|s| s - 1);
    let k = &camera.intrinsics;
    let mut text = format!(
        "    <camera active=\"1\" avg-residual=\"0\" serial=\"{}\" model=\"none\" viewrotation=\"0\" point-count=\"0\">\n",
        escaped(&camera.name)
    );
    for view in ["fov_marker", "fov_marker_max", "fov_video", "fov_video_max"] {
        // Writing into a string cannot fail.
        _ = writeln!(
            text,
            "      <{view} left=\"0\" top=\"0\" right=\"{right}\" bottom=\"{bottom}\"/>"
        );
    }
    _ = write!(
        text,
        "      <transform x=\"{:?}\" y=\"{:?}\" z=\"{:?}\"",
        v.x, v.y, v.z
    );
    for (i, j) in (0..3).flat_map(|i| (0..3).map(move |j| (i, j))) {
        _ = write!(text, " r{}{}=\"{:?}\"", i + 1, j + 1, r[(i, j)]);
    }
    _ = writeln!(
        text,
        "/>\n      <intrinsic focallength=\"0\" sensorMinU=\"0\" sensorMaxU=\"{}\" sensorMinV=\"0\" sensorMaxV=\"{}\" \
         focalLengthU=\"{:?}\" focalLengthV=\"{:?}\" centerPointU=\"{:?}\" centerPointV=\"{:?}\" skew=\"0\" \
         radialDistortion1=\"{:?}\" radialDistortion2=\"{:?}\" radialDistortion3=\"{:?}\" tangentalDistortion1=\"{:?}\" \
         tangentalDistortion2=\"{:?}\"/>\n    </camera>",
        right * 64,
        bottom * 64,
        k.fx_px * PARTS,
        k.fy_px * PARTS,
        k.cx_px * PARTS,
        k.cy_px * PARTS,
        d.k1,
        d.k2,
        d.k3,
        d.p1,
        d.p2,
    );
    Ok(text)
}
