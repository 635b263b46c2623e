//! The calibration file: the pose and lens of every camera.
//!
//! Two formats of other tools are supported. The first has one table per camera (aniposelib,
//! Pose2Sim, FreeMoCap), with a `name` and a Rodrigues `rotation`. The second is Caliscope's:
//! `[cameras.0]` or `[cam_0]`, with a `cam_id` and a 3 x 3 `rotation`; its cameras are named
//! `cam_<id>` after its video files. Other fields and tables are ignored. With `fisheye = true`,
//! the four distortions of a camera are k1 to k4 of OpenCV's fisheye model.

mod file_text;

use std::collections::BTreeMap;
use std::path::Path;

use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};
use toml::{Table, Value};

use crate::camera::{
    CameraError, CameraModel, Distortion, Intrinsics, LensModel, MAX_TRANSLATION_M,
};
use crate::frames::Transform;
use crate::plain_text::is_plain;
use crate::toml_file::{FileError, Place, TomlFile};

pub use self::file_text::{FORMATS_READ, text_of};

/// Largest distance of two cameras of one venue, metres; a larger one indicates other units.
pub const MAX_DISTANCE_M: f64 = 500.0;

/// Longest name of a camera. With a prefix, a tick and an extension it fits the 255 bytes of a file
/// name, even if every byte is escaped as `%2F`.
const MOST_CAMERA_NAME_BYTES: usize = 64;

/// Largest deviation of R R' of a 3 x 3 rotation from the identity: files have six digits or more.
const ROTATION_TOLERANCE: f64 = 1e-3;

/// Longest Rodrigues vector, radians: a full turn, with room for rounding. Tools write at most half
/// of it.
const MAX_ROTATION_RAD: f64 = std::f64::consts::TAU + 1e-3;

/// The fields that identify the table of a camera.
const CAMERA_FIELDS: [&str; 5] = ["size", "matrix", "distortions", "rotation", "translation"];

/// All calibrated cameras of a file.
#[derive(Debug, Clone, PartialEq)]
pub struct Calibration {
    /// The cameras by their names.
    pub cameras: BTreeMap<String, CameraModel>,
    /// Fingerprint of the file's text: 16 hexadecimal digits.
    pub hash: String,
    /// Length of every rotation given as a Rodrigues vector, by camera name, radians.
    pub rotation_lengths_rad: BTreeMap<String, f64>,
}

impl Calibration {
    /// Parses the text of a calibration file; errors name `path`.
    ///
    /// # Errors
    /// [`FileError`] with file, line, table and field: broken syntax, missing or impossible
    /// numbers, a lens model that folds, cameras too far apart for metres.
    pub fn parse(text: &str, path: &Path) -> Result<Self, FileError> {
        let file = TomlFile::parse(text, path).map_err(|error| foreign_format(error, path))?;
        let root: Table = file.read()?;
        let mut cameras = BTreeMap::new();
        let mut rotation_lengths_rad = BTreeMap::new();
        let mut entries = Vec::new();
        for (place, name, table) in camera_tables(&root) {
            let entry = Entry {
                file: &file,
                table,
                place,
            };
            if !entry.flag("ignore")? {
                entries.push((name, entry));
            }
        }
        check_origin(&entries)?;
        for (name, entry) in entries {
            check_camera_name(&name).map_err(|problem| entry.error("name", problem))?;
            let model = entry.camera(&name)?;
            if let Some(length_rad) = entry.rotation_length_rad()? {
                rotation_lengths_rad.insert(model.name().to_owned(), length_rad);
            }
            if cameras.insert(model.name().to_owned(), model).is_some() {
                return Err(entry.error("name", format!("a second camera is called `{name}`")));
            }
        }
        if cameras.is_empty() {
            return Err(FileError::new(
                path,
                "no camera is in this file; expected one table per camera",
            ));
        }
        check_distances(&cameras, path)?;
        Ok(Self {
            cameras,
            hash: file.fingerprint(),
            rotation_lengths_rad,
        })
    }
}

/// Terminals print the names of cameras, and files are named after them.
fn check_camera_name(name: &str) -> Result<(), String> {
    if name.len() > MOST_CAMERA_NAME_BYTES {
        let n = name.len();
        return Err(format!(
            "found a name of {n} bytes, expected at most {MOST_CAMERA_NAME_BYTES}: shorten it here and in the venue file"
        ));
    }
    if name.trim().is_empty() || !name.chars().all(is_plain) {
        return Err(format!(
            "found {name:?}, expected a name without control characters and marks of direction: rename the camera here and in the venue file"
        ));
    }
    Ok(())
}

/// Every table that describes a camera, with its place and its name there.
fn camera_tables(root: &Table) -> Vec<(Place, String, &Table)> {
    let is_camera = |table: &Table| CAMERA_FIELDS.iter().any(|field| table.contains_key(*field));
    let mut found = Vec::new();
    for (key, value) in root {
        let Some(table) = value.as_table().filter(|_| key != "metadata") else {
            continue;
        };
        if is_camera(table) {
            found.push((Place::field(key), key.clone(), table));
        } else if key == "cameras" {
            let inner = table
                .iter()
                .filter_map(|(id, v)| Some((id, v.as_table().filter(|t| is_camera(t))?)));
            found.extend(inner.map(|(id, t)| (Place::field(key).key(id), format!("cam_{id}"), t)));
        }
    }
    found
        .into_iter()
        .map(|(place, key, table)| {
            let named = table.get("name").and_then(Value::as_str).map(str::to_owned);
            let numbered = table
                .get("cam_id")
                .and_then(Value::as_integer)
                .map(|id| format!("cam_{id}"));
            (place, named.or(numbered).unwrap_or(key), table)
        })
        .collect()
}

/// One camera's table.
struct Entry<'a> {
    file: &'a TomlFile<'a>,
    table: &'a Table,
    place: Place,
}

impl Entry<'_> {
    fn error(&self, field: &str, problem: impl Into<String>) -> FileError {
        self.file.error(&self.place.key(field), problem)
    }

    fn camera(&self, name: &str) -> Result<CameraModel, FileError> {
        let size_px = self.size()?;
        let intrinsics = self.intrinsics()?;
        let lens = self.lens()?;
        let rotation = self.rotation()?;
        let translation = Translation3::from(Vector3::from(self.numbers::<3>("translation")?));
        // The file's extrinsics map world coordinates to camera coordinates.
        let camera_from_world = Transform::new(Isometry3::from_parts(translation, rotation));
        CameraModel::new(name, size_px, intrinsics, lens, camera_from_world).map_err(|error| {
            let field = match error {
                CameraError::EmptyImage { .. } => "size",
                CameraError::Intrinsics { .. } => "matrix",
                CameraError::Distortion { .. } | CameraError::Folds { .. } => "distortions",
                CameraError::Extrinsics { .. } => "rotation",
                CameraError::Translation { .. } => "translation",
            };
            self.error(field, error.to_string())
        })
    }

    fn get(&self, field: &str) -> Result<&Value, FileError> {
        self.table
            .get(field)
            .ok_or_else(|| self.error(field, "the field is missing"))
    }

    fn flag(&self, field: &str) -> Result<bool, FileError> {
        match self.table.get(field) {
            None => Ok(false),
            Some(Value::Boolean(flag)) => Ok(*flag),
            Some(other) => Err(self.error(
                field,
                format!("found {}, expected true or false", other.type_str()),
            )),
        }
    }

    fn size(&self) -> Result<[u32; 2], FileError> {
        let size = self.numbers::<2>("size").map_err(|error| {
            let problem = format!("{}: [width, height] in pixels above 0", error.problem);
            self.error("size", problem)
        })?;
        let whole = size
            .iter()
            .all(|&s| s.fract() == 0.0 && (1.0..=65536.0).contains(&s));
        if whole {
            Ok(size.map(|s| s as u32))
        } else {
            let problem = format!("found {size:?}, expected [width, height] in pixels above 0");
            Err(self.error("size", problem))
        }
    }

    fn intrinsics(&self) -> Result<Intrinsics, FileError> {
        let m = self.matrix("matrix")?;
        let wrong =
            |what: &str| Err(self.error("matrix", format!("found {}: {what}", rows_text(&m))));
        if m.fixed_view::<1, 3>(2, 0) != nalgebra::RowVector3::new(0.0, 0.0, 1.0) || m.m21 != 0.0 {
            return wrong("expected [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]");
        }
        if m.m11 * m.m22 == 0.0 {
            return wrong("the matrix is singular, expected focal lengths above 0");
        }
        if m.m12 != 0.0 {
            return wrong("it has a skew, which is not supported");
        }
        Ok(Intrinsics {
            fx_px: m.m11,
            fy_px: m.m22,
            cx_px: m.m13,
            cy_px: m.m23,
        })
    }

    fn lens(&self) -> Result<LensModel, FileError> {
        let list = self.list(self.get("distortions")?, "distortions")?;
        if self.flag("fisheye")? {
            let four = <[f64; 4]>::try_from(list).map_err(|list| {
                let problem = format!(
                    "found {} values, expected 4 of a fisheye lens: k1, k2, k3, k4 of OpenCV's fisheye model",
                    list.len()
                );
                self.error("distortions", problem)
            })?;
            return Ok(LensModel::KannalaBrandt(four));
        }
        let mut c = [0.0; 8];
        if !matches!(list.len(), 4 | 5 | 8) {
            return Err(self.error(
                "distortions",
                format!(
                    "found {} values, expected 4, 5 or 8 in OpenCV's order",
                    list.len()
                ),
            ));
        }
        c[..list.len()].copy_from_slice(&list);
        Ok(LensModel::Rational(Distortion {
            k1: c[0],
            k2: c[1],
            p1: c[2],
            p2: c[3],
            k3: c[4],
            k4: c[5],
            k5: c[6],
            k6: c[7],
        }))
    }

    /// Rodrigues vector or 3 x 3 matrix.
    fn rotation(&self) -> Result<UnitQuaternion<f64>, FileError> {
        if !self.has_rotation_matrix()? {
            return Ok(UnitQuaternion::from_scaled_axis(self.rotation_vector()?));
        }
        let m = self.matrix("rotation")?;
        let off = (m * m.transpose() - Matrix3::identity()).abs().max();
        if off > ROTATION_TOLERANCE || m.determinant() < 0.0 {
            return Err(self.error(
                "rotation",
                format!("found {}, which is not a rotation", rows_text(&m)),
            ));
        }
        Ok(UnitQuaternion::from_rotation_matrix(
            &Rotation3::from_matrix(&m),
        ))
    }

    fn has_rotation_matrix(&self) -> Result<bool, FileError> {
        let rows = self.get("rotation")?.as_array();
        Ok(rows.is_some_and(|rows| rows.iter().any(Value::is_array)))
    }

    /// Reads a Rodrigues vector; refuses one of more than a full turn, which no tool writes.
    fn rotation_vector(&self) -> Result<Vector3<f64>, FileError> {
        let vector = Vector3::from(self.numbers::<3>("rotation")?);
        let length = vector.norm();
        if length > MAX_ROTATION_RAD {
            let problem = format!(
                "found a vector of length {length:.1}, expected radians, at most 6.28: these look like degrees; \
                 multiply them by 0.017453"
            );
            return Err(self.error("rotation", problem));
        }
        Ok(vector)
    }

    /// `None` if the rotation is a matrix.
    fn rotation_length_rad(&self) -> Result<Option<f64>, FileError> {
        if self.has_rotation_matrix()? {
            return Ok(None);
        }
        Ok(Some(self.rotation_vector()?.norm()))
    }

    fn matrix(&self, field: &str) -> Result<Matrix3<f64>, FileError> {
        let wrong = |found: String| {
            self.error(
                field,
                format!("found {found}, expected 3 rows of 3 numbers"),
            )
        };
        let rows = self
            .get(field)?
            .as_array()
            .ok_or_else(|| wrong("no array".to_owned()))?;
        let rows = rows
            .iter()
            .map(|row| self.list(row, field))
            .collect::<Result<Vec<_>, _>>()?;
        if rows.len() != 3 || rows.iter().any(|row| row.len() != 3) {
            return Err(wrong(format!(
                "rows of {:?} numbers",
                rows.iter().map(Vec::len).collect::<Vec<_>>()
            )));
        }
        Ok(Matrix3::from_row_iterator(rows.into_iter().flatten()))
    }

    fn numbers<const N: usize>(&self, field: &str) -> Result<[f64; N], FileError> {
        let list = self.list(self.get(field)?, field)?;
        list.try_into().map_err(|list: Vec<f64>| {
            self.error(field, format!("found {} numbers, expected {N}", list.len()))
        })
    }

    /// An array of finite numbers.
    fn list(&self, value: &Value, field: &str) -> Result<Vec<f64>, FileError> {
        let wrong =
            |found: &str| self.error(field, format!("found {found}, expected finite numbers"));
        let array = value.as_array().ok_or_else(|| wrong(value.type_str()))?;
        array
            .iter()
            .map(|v| match v {
                Value::Float(number) if number.is_finite() => Ok(*number),
                Value::Float(number) => Err(wrong(&number.to_string())),
                Value::Integer(number) => Ok(*number as f64),
                other => Err(wrong(other.type_str())),
            })
            .collect()
    }
}

/// Refuses cameras that are close together but farther from the origin than allowed.
fn check_origin(entries: &[(String, Entry<'_>)]) -> Result<(), FileError> {
    let mut far = None;
    let mut centers_m = Vec::new();
    for (_, entry) in entries {
        // Errors in these fields are reported when the camera is read.
        let (Ok(rotation), Ok(translation)) = (entry.rotation(), entry.numbers("translation"))
        else {
            return Ok(());
        };
        if translation.iter().any(|it| it.abs() > MAX_TRANSLATION_M) {
            far = far.or(Some(entry));
        }
        centers_m.push(-(rotation.inverse() * Vector3::from(translation)));
    }
    match (far, surveyed_place(&centers_m)) {
        (Some(entry), Some(place)) => Err(entry.error("translation", surveyed_refusal(place))),
        _ => Ok(()),
    }
}

/// A file that is not TOML may be a calibration of another program.
fn foreign_format(error: FileError, path: &Path) -> FileError {
    if path.extension().is_some_and(|is| is == "toml") {
        return error;
    }
    let problem = format!(
        "{}, expected a calibration in TOML; `farfield calibrate convert` makes one of those of other programs",
        error.problem
    );
    FileError { problem, ..error }
}

fn rows_text(m: &Matrix3<f64>) -> String {
    let rows: Vec<String> = m
        .row_iter()
        .map(|r| format!("[{:?}, {:?}, {:?}]", r[0], r[1], r[2]))
        .collect();
    format!("[{}]", rows.join(", "))
}

fn check_distances(cameras: &BTreeMap<String, CameraModel>, path: &Path) -> Result<(), FileError> {
    let centers: Vec<_> = cameras
        .values()
        .map(|c| (c.name(), c.center().coordinates_m()))
        .collect();
    for (i, (a, center_a)) in centers.iter().enumerate() {
        for (b, center_b) in &centers[i + 1..] {
            let distance_m = (center_a - center_b).norm();
            if distance_m > MAX_DISTANCE_M {
                let problem = format!(
                    "cameras `{a}` and `{b}` are {distance_m:.0} m apart, expected at most {MAX_DISTANCE_M:.0} m: \
                     the file looks like millimetres, expected metres"
                );
                return Err(FileError::new(path, problem).at_field("translation"));
            }
        }
    }
    Ok(())
}

/// Largest distance from the origin of coordinates on Earth, metres.
const FARTHEST_M: f64 = 2e7;
/// Rounding of the reported place, metres, so that it is easily added again.
const ROUNDED_M: f64 = 10.0;

/// The rounded common place of distant cameras, for example (500000, 5000000, 120). `None` if they
/// are scattered, which indicates another unit, or if a number is not finite.
fn surveyed_place(centers_m: &[Vector3<f64>]) -> Option<[f64; 3]> {
    let mean_m = centers_m.iter().sum::<Vector3<f64>>() / centers_m.len() as f64;
    let is_together = centers_m
        .iter()
        .all(|it| (it - mean_m).norm() < MAX_DISTANCE_M);
    let is_place = is_together && mean_m.norm() < FARTHEST_M;
    is_place.then(|| mean_m.map(|it| (it / ROUNDED_M).round() * ROUNDED_M).into())
}

/// The error for cameras at `place`, with the remedy.
fn surveyed_refusal([x, y, z]: [f64; 3]) -> String {
    format!(
        "the cameras stand at about ({x:.0}, {y:.0}, {z:.0}) m: these are surveyed coordinates (UTM, say), too far from the origin \
         to compute with; subtract an origin near the cameras, z being the height of the floor: `farfield calibrate convert FILE \
         --origin {x:.0},{y:.0},{z:.0} --out DIR`"
    )
}

#[cfg(test)]
mod tests;
