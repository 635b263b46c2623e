//! OpenCV's YAML and JSON, with one or several cameras per file. Field names follow OpenCV's samples, common use, and ROS.

use std::fmt::Write as _;
use std::path::Path;

use farfield_proto::camera::Intrinsics;
use farfield_proto::toml_file::FileError;
use nalgebra::{Matrix3, Vector3};
use serde_json::Value;

use super::camera::{
    AmbiguousFour, CameraRecord, FileUnit, RawCamera, RawPose, RawSet, Remark, RemarkKind,
};
use super::toml_tables::lens;
use super::tree::{Node, Source, whole_size};
use super::{Format, ImportOptions, TextFile};

pub(super) const MATRIX: [&str; 11] = [
    "camera_matrix",
    "cameraMatrix",
    "K-matrix",
    "K",
    "intrinsic_matrix",
    "intrinsicMatrix",
    "intrinsicMat",
    "mtx",
    "CameraMatrix",
    "Camera_Matrix",
    "matrix",
];
pub(super) const DISTORTION: [&str; 11] = [
    "distortion_coefficients",
    "distCoeffs",
    "distCoeff",
    "dist_coeffs",
    "dist_coeff",
    "distortionCoefficients",
    "Distortion_Coefficients",
    "distortions",
    "dist",
    "D",
    "distortion",
];
const SIZE: [&str; 6] = [
    "image_size",
    "imageSize",
    "resolution",
    "size",
    "img_size",
    "image_shape",
];
const ROTATION: [&str; 6] = [
    "rvec",
    "rotation_vector",
    "rotation_matrix",
    "R",
    "rotation",
    "Rot",
];
const TRANSLATION: [&str; 5] = ["tvec", "translation_vector", "T", "t", "translation"];
/// Names of the fisheye model in the field `distortion_model`.
const FISHEYE: [&str; 5] = [
    "equidistant",
    "fisheye",
    "kannala_brandt",
    "kannala_brandt4",
    "opencv_fisheye",
];

/// The tree of a YAML or JSON text.
///
/// OpenCV's `%YAML:1.0` and its tags are accepted. Its spelling of NaN and infinity is invalid in both formats; these become
/// null, which a reader then refuses by field name.
pub(super) fn value(source: &Source<'_>) -> Result<Value, FileError> {
    let text = source.text.trim_start_matches('\u{feff}');
    if text.trim_start().starts_with(['{', '[']) {
        let text = without_bare_nan(text);
        return serde_json::from_str(&text).map_err(|error| {
            let problem = format!("not valid JSON: {error}");
            source.error(problem).at_line(error.line().max(1))
        });
    }
    let text = without_bare_nan(text);
    serde_saphyr::from_str(&text).map_err(|error| {
        let message = error.to_string();
        let first = message.lines().next().unwrap_or_default();
        let refused = source.error(format!("not valid YAML: {first}"));
        match error.location() {
            Some(location) => refused.at_line(usize::try_from(location.line()).unwrap_or(1)),
            None => refused,
        }
    })
}

/// OpenCV's spelling of NaN and infinity; no other writer uses it.
const NO_NUMBERS: [&str; 3] = ["-.Inf", ".Inf", ".Nan"];

/// Replaces [`NO_NUMBERS`] by `null`.
fn without_bare_nan(text: &str) -> String {
    let mut kept = String::with_capacity(text.len());
    for part in text.split_inclusive([' ', ',', '[', ']', '\n', '\r', '\t']) {
        let word = NO_NUMBERS.iter().find_map(|word| part.strip_prefix(word));
        match word.filter(|rest| rest.chars().count() <= 1) {
            Some(rest) => kept.extend(["null", rest]),
            None => kept.push_str(part),
        }
    }
    kept
}

/// All cameras of `sources`, which are of one format.
pub(super) fn read(sources: &[Source<'_>], options: &ImportOptions) -> Result<RawSet, FileError> {
    let mut cameras = Vec::new();
    let mut ambiguous = AmbiguousFour::default();
    let mut remarks = Vec::new();
    let values = sources.iter().map(value).collect::<Result<Vec<_>, _>>()?;
    let roots: Vec<Node<'_>> = sources
        .iter()
        .zip(&values)
        .map(|(source, value)| Node::root(*source, value))
        .collect();
    if let Some(pair) = stereo(&roots, options, &mut ambiguous)? {
        cameras.extend(pair);
    }
    for (root, source) in roots.iter().zip(sources) {
        for (name, table) in tables(root, source.path) {
            let mut camera = camera(name, &table, options, &mut ambiguous)?;
            if is_column(table.any(&SIZE)) {
                remarks.extend(height_first(&mut camera));
            }
            cameras.push(camera);
        }
    }
    remarks.extend(ambiguous.remark());
    Ok(RawSet {
        cameras,
        unit: FileUnit::Metres,
        remarks,
    })
}

fn tables<'a>(root: &Node<'a>, path: &Path) -> Vec<(String, Node<'a>)> {
    let name_of = |table: &Node<'_>, otherwise: &str| {
        table
            .any(&["camera_name", "name", "camera"])
            .and_then(|name| name.text())
            .unwrap_or_else(|| otherwise.to_owned())
    };
    if root.any(&MATRIX).is_some() {
        let stem = path
            .file_stem()
            .map(|stem| stem.to_string_lossy().into_owned());
        return vec![(name_of(root, &stem.unwrap_or_default()), root.clone())];
    }
    let mut found = Vec::new();
    for (key, table) in root.fields() {
        if table.any(&MATRIX).is_some() {
            found.push((name_of(&table, key), table));
        } else if key == "cameras" {
            let inner = table.fields().into_iter().chain(table.items());
            let inner = inner.filter(|(_, inner)| inner.any(&MATRIX).is_some());
            found.extend(inner.map(|(key, inner)| (name_of(&inner, key), inner)));
        }
    }
    found
}

/// The one or two files of OpenCV's stereo sample: M1, D1, M2, D2 and R, T from the first camera to the second.
fn stereo(
    roots: &[Node<'_>],
    options: &ImportOptions,
    ambiguous: &mut AmbiguousFour,
) -> Result<Option<[RawCamera; 2]>, FileError> {
    let find = |name: &str| roots.iter().find_map(|root| root.get(name));
    let (Some(m1), Some(m2)) = (find("M1"), find("M2")) else {
        return Ok(None);
    };
    let (Some(rotation), Some(translation)) = (find("R"), find("T")) else {
        return Err(
            m2.error("`M1` and `M2` without `R` and `T`: give the file of the extrinsics as well")
        );
    };
    let mut one = |name: &str, matrix: &Node<'_>, distortion: Option<Node<'_>>, pose| {
        let distortion =
            distortion.ok_or_else(|| matrix.error("expected `D1` and `D2` with `M1` and `M2`"))?;
        let coefficients = distortion.numbers()?;
        let camera = RawCamera {
            name: name.to_owned(),
            size_px: None,
            intrinsics: matrix.intrinsics()?,
            lens: lens(&distortion, &coefficients, options.four_are_fisheye)?,
            pose: Some(pose),
        };
        if !options.four_are_fisheye {
            ambiguous.note(&camera, &coefficients);
        }
        Ok(camera)
    };
    let first = RawPose {
        rotation: Matrix3::identity(),
        translation: Vector3::zeros(),
    };
    let second = RawPose {
        rotation: rotation.rotation()?,
        translation: translation.vector()?,
    };
    Ok(Some([
        one("1", &m1, find("D1"), first)?,
        one("2", &m2, find("D2"), second)?,
    ]))
}

fn camera(
    name: String,
    table: &Node<'_>,
    options: &ImportOptions,
    ambiguous: &mut AmbiguousFour,
) -> Result<RawCamera, FileError> {
    let matrix = table.need(&MATRIX)?;
    let list = table.need(&DISTORTION)?;
    let coefficients = list.numbers()?;
    let model = table
        .any(&["distortion_model", "model"])
        .and_then(|model| model.text());
    let flag = table
        .any(&["fisheye_model", "fisheye"])
        .map(|flag| flag.flag())
        .transpose()?;
    let named = model.map(|model| FISHEYE.contains(&model.to_lowercase().as_str()));
    let is_fisheye = named.or(flag).unwrap_or(options.four_are_fisheye);
    let pose = match (table.any(&ROTATION), table.any(&TRANSLATION)) {
        (Some(rotation), Some(translation)) => Some(RawPose {
            rotation: rotation.rotation()?,
            translation: translation.vector()?,
        }),
        // R alone is the rectification of ROS.
        _ => None,
    };
    let camera = RawCamera {
        name,
        size_px: size(table)?,
        intrinsics: matrix.intrinsics()?,
        lens: lens(&list, &coefficients, is_fisheye)?,
        pose,
    };
    if named.or(flag).is_none() && !options.four_are_fisheye {
        ambiguous.note(&camera, &coefficients);
    }
    Ok(camera)
}

/// Whether `NumPy` wrote a column: a list of lists of one number.
fn is_column(size: Option<Node<'_>>) -> bool {
    let rows = size.map_or_else(Vec::new, |size| size.items());
    rows.iter().any(|(_, row)| !row.items().is_empty())
}

/// Swaps a size that Python wrote as [rows, columns]: the principal point is far from the middle of the picture, and in the
/// middle of the swapped one.
fn height_first(camera: &mut RawCamera) -> Option<Remark> {
    /// Distance of a principal point from the middle, relative to the picture's side: larger than in any lens.
    const ABSURD: f64 = 0.25;
    /// The same distance, not exceeded by most lenses.
    const USUAL: f64 = 0.1;
    let [width, height] = camera.size_px?;
    let Intrinsics { cx_px, cy_px, .. } = camera.intrinsics;
    let off = |width: u32, height: u32| {
        let [x, y] = [cx_px / f64::from(width), cy_px / f64::from(height)];
        (x - 0.5).abs().max((y - 0.5).abs())
    };
    if off(width, height) < ABSURD || off(height, width) > USUAL {
        return None;
    }
    camera.size_px = Some([height, width]);
    let text = format!(
        "its size has the height first: taken as {height} x {width} pixels, with the principal point in the middle"
    );
    Some(Remark::of_camera(RemarkKind::Corrected, &camera.name, text))
}

fn size(table: &Node<'_>) -> Result<Option<[u32; 2]>, FileError> {
    let width = table.any(&["image_width", "imageWidth", "image_Width", "width"]);
    let height = table.any(&["image_height", "imageHeight", "image_Height", "height"]);
    if let (Some(width), Some(height)) = (width, height) {
        let size = [width.number()?, height.number()?];
        let size = whole_size(size)
            .ok_or_else(|| width.error(format!("found {size:?}, expected pixels above 0")))?;
        return Ok(Some(size));
    }
    table.any(&SIZE).map(|size| size.size()).transpose()
}

/// A matrix in OpenCV's YAML, indented by `indent`.
pub(super) fn yaml_matrix(name: &str, rows: usize, data: &[f64], indent: &str) -> String {
    let columns = data.len() / rows.max(1);
    let numbers: Vec<String> = data.iter().map(|v| format!("{v:?}")).collect();
    format!(
        "{indent}{name}: !!opencv-matrix\n{indent}   rows: {rows}\n{indent}   cols: {columns}\n{indent}   dt: d\n{indent}   \
         data: [ {} ]\n",
        numbers.join(", ")
    )
}

/// The matrices of a camera: name, rows, numbers.
fn matrices(camera: &CameraRecord) -> Vec<(&'static str, usize, Vec<f64>)> {
    let k = &camera.intrinsics;
    let matrix = vec![k.fx_px, 0.0, k.cx_px, 0.0, k.fy_px, k.cy_px, 0.0, 0.0, 1.0];
    let mut all = vec![
        ("camera_matrix", 3, matrix),
        ("distortion_coefficients", 1, camera.lens.coefficients()),
    ];
    if let Some(pose) = &camera.camera_from_world {
        let rotation = pose.rotation.to_rotation_matrix();
        let rows = rotation.matrix().transpose().iter().copied().collect();
        all.push(("rotation_matrix", 3, rows));
        all.push((
            "translation_vector",
            3,
            pose.translation.vector.iter().copied().collect(),
        ));
    }
    all
}

/// The file of one camera, as `cv::FileStorage` reads it.
pub(super) fn write(camera: &CameraRecord, format: Format) -> TextFile {
    let [width, height] = camera.size_px;
    let model = match camera.lens.is_fisheye() {
        true => "equidistant",
        false if camera.lens.coefficients().len() == 8 => "rational_polynomial",
        false => "plumb_bob",
    };
    let name = serde_json::Value::from(camera.name.as_str()).to_string();
    let mut text = String::new();
    let extension = if format == Format::OpenCvJson {
        let mut fields = vec![
            format!("    \"camera_name\": {name}"),
            format!("    \"image_width\": {width}"),
            format!("    \"image_height\": {height}"),
            format!("    \"distortion_model\": \"{model}\""),
        ];
        for (field, rows, data) in matrices(camera) {
            let columns = data.len() / rows;
            fields.push(format!(
                "    \"{field}\": {{\n        \"type_id\": \"opencv-matrix\",\n        \"rows\": {rows},\n        \"cols\": \
                 {columns},\n        \"dt\": \"d\",\n        \"data\": {data:?}\n    }}"
            ));
        }
        // Writing into a string cannot fail.
        _ = writeln!(text, "{{\n{}\n}}", fields.join(",\n"));
        "json"
    } else {
        _ = write!(
            text,
            "%YAML:1.0\n---\ncamera_name: {name}\nimage_width: {width}\nimage_height: {height}\ndistortion_model: {model}\n"
        );
        for (field, rows, data) in matrices(camera) {
            text.push_str(&yaml_matrix(field, rows, &data, ""));
        }
        "yml"
    };
    TextFile {
        path: super::file_name(&camera.name, extension),
        text,
    }
}
