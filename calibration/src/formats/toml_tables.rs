//! TOML with one table per camera: Farfield, aniposelib, Pose2Sim, FreeMoCap (millimetres) and Caliscope (`cam_id`, 3 x 3
//! rotations).

use std::collections::BTreeMap;
use std::fmt::Write as _;

use farfield_proto::toml_file::{FileError, TomlFile};
use nalgebra::Matrix3;
use serde_json::Value;
use toml::de::DeTable;

use super::camera::{
    AmbiguousFour, CameraRecord, FileUnit, LensModel, RawCamera, RawPose, RawSet, Remark,
    RemarkKind,
};
use super::tree::{Node, Source};
use super::{ExportError, Format, ImportOptions, placed};

/// A table with one of these fields is a camera.
const CAMERA_FIELDS: [&str; 5] = ["size", "matrix", "distortions", "rotation", "translation"];

pub(super) fn value(source: &Source<'_>) -> Result<Value, FileError> {
    let file = TomlFile::parse(source.text, source.path)?;
    let root: toml::Table = file.read()?;
    serde_json::to_value(root).map_err(|error| source.error(error.to_string()))
}

/// Whether the tables have Caliscope's fields.
pub(super) fn is_caliscope(root: &Node<'_>) -> bool {
    tables(root)
        .iter()
        .any(|(_, table)| table.get("cam_id").is_some())
}

pub(super) fn read(
    source: &Source<'_>,
    format: Format,
    options: &ImportOptions,
) -> Result<RawSet, FileError> {
    let value = value(source)?;
    let root = Node::root(*source, &value);
    let mut remarks = Vec::new();
    let mut cameras = Vec::new();
    let mut ambiguous = AmbiguousFour::default();
    let starts = starts(source.text);
    let mut tables = tables(&root);
    tables.sort_by_key(|(_, table)| starts.get(table.place()).copied());
    for (name, table) in tables {
        if table.get("ignore").map_or(Ok(false), |flag| flag.flag())? {
            let text = "the file sets `ignore`: left out";
            remarks.push(Remark::of_camera(RemarkKind::Assumed, &name, text));
            continue;
        }
        cameras.push(camera(name, &table, options, &mut ambiguous)?);
    }
    remarks.extend(ambiguous.remark());
    let unit = if format == Format::FreeMoCap {
        FileUnit::Millimetres
    } else {
        FileUnit::Metres
    };
    Ok(RawSet {
        cameras,
        unit,
        remarks,
    })
}

/// The byte offset of every table, by its path of keys. TOML values are sorted by name, and some keypoint files know their
/// cameras only by the order of the file.
fn starts(text: &str) -> BTreeMap<Vec<String>, usize> {
    let mut starts = BTreeMap::new();
    // Invalid TOML was refused before.
    let Ok(root) = DeTable::parse(text) else {
        return starts;
    };
    for (key, value) in root.get_ref() {
        let place = vec![key.get_ref().to_string()];
        for (inner, _) in value.get_ref().as_table().into_iter().flatten() {
            let mut place = place.clone();
            place.push(inner.get_ref().to_string());
            starts.insert(place, inner.span().start);
        }
        starts.insert(place, key.span().start);
    }
    starts
}

/// All tables that describe a camera, with the camera's name.
fn tables<'a>(root: &Node<'a>) -> Vec<(String, Node<'a>)> {
    let is_camera = |table: &Node<'_>| CAMERA_FIELDS.iter().any(|field| table.get(field).is_some());
    let mut found = Vec::new();
    for (key, table) in root.fields() {
        if key == "metadata" {
            continue;
        }
        if is_camera(&table) {
            found.push((key.to_owned(), table));
        } else if key == "cameras" {
            let inner = table.fields().into_iter().filter(|(_, t)| is_camera(t));
            found.extend(inner.map(|(id, t)| (format!("cam_{id}"), t)));
        }
    }
    let name = |key: String, table: &Node<'_>| {
        let named = table.get("name").and_then(|name| name.text());
        let numbered = table.get("cam_id").and_then(|id| id.text());
        named
            .or(numbered.map(|id| format!("cam_{id}")))
            .unwrap_or(key)
    };
    found
        .into_iter()
        .map(|(key, table)| (name(key, &table), table))
        .collect()
}

fn camera(
    name: String,
    table: &Node<'_>,
    options: &ImportOptions,
    ambiguous: &mut AmbiguousFour,
) -> Result<RawCamera, FileError> {
    let list = table.need(&["distortions"])?;
    let coefficients = list.numbers()?;
    let stated = table.get("fisheye").map(|flag| flag.flag()).transpose()?;
    let lens = lens(
        &list,
        &coefficients,
        stated.unwrap_or(options.four_are_fisheye),
    )?;
    let pose = match (table.get("rotation"), table.get("translation")) {
        (Some(rotation), Some(translation)) => Some(RawPose {
            rotation: rotation.rotation()?,
            translation: translation.vector()?,
        }),
        (None, None) => None,
        (Some(_), None) => {
            return Err(table
                .need(&["translation"])
                .err()
                .unwrap_or_else(|| table.error("no translation")));
        }
        (None, Some(_)) => {
            return Err(table
                .need(&["rotation"])
                .err()
                .unwrap_or_else(|| table.error("no rotation")));
        }
    };
    let camera = RawCamera {
        name,
        size_px: Some(table.need(&["size"])?.size()?),
        intrinsics: table.need(&["matrix"])?.intrinsics()?,
        lens,
        pose,
    };
    if stated.is_none() && !options.four_are_fisheye {
        ambiguous.note(&camera, &coefficients);
    }
    Ok(camera)
}

/// The lens of coefficients in OpenCV's order.
pub(super) fn lens(
    list: &Node<'_>,
    coefficients: &[f64],
    is_fisheye: bool,
) -> Result<LensModel, FileError> {
    if is_fisheye {
        let four = <[f64; 4]>::try_from(coefficients).map_err(|_| {
            list.error(format!(
                "found {} values, expected 4 of a fisheye lens",
                coefficients.len()
            ))
        })?;
        return Ok(LensModel::KannalaBrandt(four));
    }
    if !matches!(coefficients.len(), 0 | 2 | 4 | 5 | 8 | 12 | 14) {
        return Err(list.error(format!(
            "found {} values, expected 4, 5, 8, 12 or 14 in OpenCV's order",
            coefficients.len()
        )));
    }
    LensModel::rational(coefficients).ok_or_else(|| {
        list.error("it has thin prism or tilt coefficients other than 0, which are not supported")
    })
}

fn quoted(text: &str) -> String {
    toml::Value::String(text.to_owned()).to_string()
}

fn rows(m: &Matrix3<f64>) -> String {
    let rows: Vec<String> = (0..3)
        .map(|i| format!("[{:?}, {:?}, {:?}]", m[(i, 0)], m[(i, 1)], m[(i, 2)]))
        .collect();
    format!("[{}]", rows.join(", "))
}

pub(super) fn write(cameras: &[CameraRecord], format: Format) -> Result<String, ExportError> {
    let units_per_metre = if format == Format::FreeMoCap {
        1e3
    } else {
        1.0
    };
    let mut text = String::new();
    for (i, camera) in cameras.iter().enumerate() {
        let pose = placed(camera, format)?;
        let rotation = pose.rotation.to_rotation_matrix();
        let (header, rotation) = if format == Format::Caliscope {
            (
                format!("[cameras.{i}]\ncam_id = {i}\nignore = false"),
                rows(rotation.matrix()),
            )
        } else {
            let name = quoted(&camera.name);
            let vector: [f64; 3] = pose.rotation.scaled_axis().into();
            (format!("[{name}]\nname = {name}"), format!("{vector:?}"))
        };
        let translation: [f64; 3] = (pose.translation.vector * units_per_metre).into();
        let k = &camera.intrinsics;
        let matrix = Matrix3::new(k.fx_px, 0.0, k.cx_px, 0.0, k.fy_px, k.cy_px, 0.0, 0.0, 1.0);
        // Writing into a string cannot fail.
        _ = writeln!(
            text,
            "{header}\nsize = {:?}\nmatrix = {}\ndistortions = {:?}\nrotation = {rotation}\ntranslation = {translation:?}\n\
             fisheye = {}\n",
            camera.size_px,
            rows(&matrix),
            camera.lens.coefficients(),
            camera.lens.is_fisheye(),
        );
    }
    if format != Format::Caliscope {
        text.push_str("[metadata]\nadjusted = false\nerror = 0.0\n");
    }
    Ok(text)
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    fn read_text(text: &str) -> Result<RawSet, FileError> {
        let source = Source {
            path: Path::new("Calib.toml"),
            text,
        };
        read(&source, Format::Farfield, &ImportOptions::default())
    }

    fn names(text: &str) -> Vec<String> {
        let cameras = read_text(text).unwrap().cameras.into_iter();
        cameras.map(|camera| camera.name).collect()
    }

    const FIELDS: &str = "size = [640, 480]\nmatrix = [[600, 0, 320], [0, 600, 240], [0, 0, 1]]\n\
                          distortions = [0, 0, 0, 0]\nrotation = [0, 0, 0]\ntranslation = [0, 0, 1]\n";

    #[test]
    fn cameras_come_in_the_order_of_the_file_not_of_the_alphabet() {
        let text = ["north", "metadata", "east", "Zenith"]
            .map(|name| format!("[{name}]\n{FIELDS}"))
            .concat();
        assert_eq!(names(&text), ["north", "east", "Zenith"]);
    }

    #[test]
    fn twelve_numbered_cameras_stay_in_their_order() {
        let expected: Vec<String> = (0..12).map(|i| format!("cam_{i}")).collect();
        let tables = |prefix: &str| -> String {
            let all = (0..12).map(|i| format!("[{prefix}{i}]\n{FIELDS}"));
            all.collect()
        };
        assert_eq!(names(&tables("cam_")), expected);
        assert_eq!(names(&tables("cameras.")), expected);
    }

    /// The table of a camera with these distortions and `more` fields.
    fn table(name: &str, distortions: &str, more: &str) -> String {
        let fields = FIELDS.replace("[0, 0, 0, 0]", distortions);
        format!("[{name}]\n{fields}{more}\n")
    }

    fn remarks(text: &str) -> Vec<String> {
        let remarks = read_text(text).unwrap().remarks.into_iter();
        remarks.map(|remark| remark.text).collect()
    }

    #[test]
    fn four_coefficients_without_a_model_are_browns_with_one_remark() {
        let four = "[-0.1, 0.02, 0.001, -0.002]";
        let text = table("north", four, "") + &table("east", four, "");
        let texts = remarks(&text);
        let [only] = texts.as_slice() else {
            panic!("{texts:?}")
        };
        assert!(
            only.contains("of `north`, `east` are a fisheye's"),
            "{only}"
        );
        assert!(only.contains("taken as k1, k2, p1, p2"), "{only}");
        let lens = read_text(&text).unwrap().cameras[0].lens;
        assert!(!lens.is_fisheye());
    }

    #[test]
    fn a_stated_model_and_unambiguous_coefficients_cause_no_remark() {
        let none: [String; 0] = [];
        let four = "[-0.1, 0.02, 0.001, -0.002]";
        for stated in ["fisheye = false", "fisheye = true"] {
            assert_eq!(remarks(&table("a", four, stated)), none);
        }
        // No lens at all; a fisheye that would fold inside its picture; more coefficients than a fisheye has.
        for distortions in [
            "[0, 0, 0, 0]",
            "[-3.0, 0, 0, 0]",
            "[-0.1, 0.02, 0.001, -0.002, 0.1]",
        ] {
            assert_eq!(remarks(&table("a", distortions, "")), none, "{distortions}");
        }
    }

    #[test]
    fn lists_of_other_lengths_are_refused_with_line_and_expected_length() {
        let refused = |distortions: &str, more: &str| {
            let error = read_text(&table("a", distortions, more)).unwrap_err();
            error.to_string()
        };
        for (distortions, count) in [("[0.1]", 1), ("[0, 0, 0]", 3), ("[0, 0, 0, 0, 0, 0]", 6)] {
            let message = refused(distortions, "");
            let found = format!("distortions`: found {count} values, expected 4, 5, 8, 12 or 14");
            assert!(message.contains(&found), "{message}");
        }
        for (distortions, count) in [("[0.1, 0.2, 0.3]", 3), ("[0, 0, 0, 0, 0]", 5)] {
            let message = refused(distortions, "fisheye = true");
            let found = format!("found {count} values, expected 4 of a fisheye lens");
            assert!(
                message.contains(&found) && message.contains("Calib.toml:4"),
                "{message}"
            );
        }
    }
}
