//! Values of TOML, YAML and JSON with one interface, so that every error names the file, the line and the field.

use std::path::Path;

use farfield_proto::camera::Intrinsics;
use farfield_proto::toml_file::FileError;
use nalgebra::{Matrix3, Rotation3, Vector3};
use serde_json::Value;

use super::camera::all_zero;

/// Largest deviation of R R' of a rotation from the identity: files keep six digits or more.
const ROTATION_TOLERANCE: f64 = 1e-3;
/// Longest Rodrigues vector, radians: a whole turn with room for rounding.
const MAX_ROTATION_RAD: f64 = std::f64::consts::TAU + 1e-3;
/// Widest picture, pixels.
const MAX_SIDE_PX: f64 = 65_536.0;

/// A file's text and its name.
#[derive(Clone, Copy)]
pub(super) struct Source<'a> {
    pub(super) path: &'a Path,
    pub(super) text: &'a str,
}

impl Source<'_> {
    /// An error about the file as a whole.
    pub(super) fn error(&self, problem: impl Into<String>) -> FileError {
        FileError::new(self.path, problem)
    }

    /// The line, from 1, of the last name of `place` that is found, if each name is searched after the previous one.
    fn line(&self, place: &[String]) -> Option<usize> {
        let mut from = 0;
        let mut found = None;
        for name in place {
            let Some(at) = find_word(self.text, from, name) else {
                break;
            };
            found = Some(at);
            from = at + name.len();
        }
        found.map(|at| 1 + self.text.bytes().take(at).filter(|&b| b == b'\n').count())
    }
}

/// The next occurrence of `word` that is not part of a longer word.
fn find_word(text: &str, from: usize, word: &str) -> Option<usize> {
    let is_part = |c: Option<char>| c.is_some_and(|c| c.is_alphanumeric() || c == '_');
    let rest = text.get(from..)?;
    rest.match_indices(word)
        .find(|(at, found)| {
            !is_part(rest.get(..*at).and_then(|s| s.chars().next_back()))
                && !is_part(rest.get(at + found.len()..).and_then(|s| s.chars().next()))
        })
        .map(|(at, _)| from + at)
}

/// A value and its path in the file.
#[derive(Clone)]
pub(super) struct Node<'a> {
    source: Source<'a>,
    place: Vec<String>,
    value: &'a Value,
}

impl<'a> Node<'a> {
    pub(super) fn root(source: Source<'a>, value: &'a Value) -> Self {
        Self {
            source,
            place: Vec::new(),
            value,
        }
    }

    pub(super) fn value(&self) -> &'a Value {
        self.value
    }

    /// The names that lead to it from the root.
    pub(super) fn place(&self) -> &[String] {
        &self.place
    }

    pub(super) fn error(&self, problem: impl Into<String>) -> FileError {
        let error = self.source.error(problem);
        if self.place.is_empty() {
            return error;
        }
        let line = self.source.line(&self.place);
        let error = error.at_field(self.place.join("."));
        line.map_or(error.clone(), |line| error.at_line(line))
    }

    fn child(&self, name: &str, value: &'a Value) -> Self {
        let mut place = self.place.clone();
        place.push(name.to_owned());
        Self {
            source: self.source,
            place,
            value,
        }
    }

    /// The fields of a table; empty for other values.
    pub(super) fn fields(&self) -> Vec<(&'a str, Self)> {
        let table = self.value.as_object();
        let fields = table.into_iter().flatten();
        fields
            .map(|(key, value)| (key.as_str(), self.child(key, value)))
            .collect()
    }

    /// The elements of a list with their names; empty for other values.
    pub(super) fn items(&self) -> Vec<(&'a str, Self)> {
        let list = self.value.as_array().into_iter().flatten();
        list.map(|value| {
            let name = value
                .get("name")
                .or(value.get("camera_name"))
                .and_then(Value::as_str);
            let name = name.unwrap_or("without a name");
            (name, self.child(name, value))
        })
        .collect()
    }

    pub(super) fn get(&self, name: &str) -> Option<Self> {
        let value = self.value.get(name)?;
        Some(self.child(name, value))
    }

    /// The first of `names` that exists.
    pub(super) fn any(&self, names: &[&str]) -> Option<Self> {
        names.iter().find_map(|name| self.get(name))
    }

    pub(super) fn need(&self, names: &[&str]) -> Result<Self, FileError> {
        self.any(names).ok_or_else(|| {
            let name = names.first().copied().unwrap_or_default();
            self.child(name, self.value).error(format!(
                "the field is missing, expected `{}`",
                names.join("` or `")
            ))
        })
    }

    /// Text, or a whole number as text.
    pub(super) fn text(&self) -> Option<String> {
        match self.value {
            Value::String(text) => Some(text.clone()),
            Value::Number(number) => Some(number.to_string()),
            _ => None,
        }
    }

    pub(super) fn number(&self) -> Result<f64, FileError> {
        self.value.as_f64().ok_or_else(|| {
            self.error(format!(
                "found {}, expected a finite number",
                kind(self.value)
            ))
        })
    }

    /// Whether it is `true` or a number other than 0.
    pub(super) fn flag(&self) -> Result<bool, FileError> {
        match self.value {
            Value::Bool(flag) => Ok(*flag),
            Value::Number(number) => Ok(number.as_f64() != Some(0.0)),
            other => Err(self.error(format!("found {}, expected true or false", kind(other)))),
        }
    }

    /// All numbers of a list, of lists in a list, or of an OpenCV matrix, row by row.
    pub(super) fn numbers(&self) -> Result<Vec<f64>, FileError> {
        let mut all = Vec::new();
        let data = match self.value {
            Value::Object(_) => self.need(&["data"])?.value,
            other => other,
        };
        if !data.is_array() {
            return Err(self.error(format!("found {}, expected a list of numbers", kind(data))));
        }
        if let Err(found) = flatten(data, 3, &mut all) {
            return Err(self.error(format!("found {found}, expected finite numbers")));
        }
        self.check_shape(all.len())?;
        Ok(all)
    }

    /// Compares the data of an OpenCV matrix with its `rows` and `cols`.
    fn check_shape(&self, count: usize) -> Result<(), FileError> {
        let (Some(rows), Some(columns)) = (self.get("rows"), self.get("cols")) else {
            return Ok(());
        };
        let whole = |node: &Self| node.value.as_u64().filter(|&n| n <= 1_000_000);
        let (Some(rows), Some(columns)) = (whole(&rows), whole(&columns)) else {
            return Err(rows.error("expected `rows` and `cols` as whole numbers"));
        };
        // `2d` has two numbers per element.
        let element = self.get("dt").and_then(|dt| dt.text()).unwrap_or_default();
        let digits: String = element.chars().take_while(char::is_ascii_digit).collect();
        let channels: u64 = digits.parse().unwrap_or(1);
        if rows * columns * channels.min(16) == count as u64 {
            return Ok(());
        }
        Err(self.error(format!(
            "found {count} numbers, expected {rows} x {columns} as in `rows` and `cols`"
        )))
    }

    pub(super) fn fixed<const N: usize>(&self) -> Result<[f64; N], FileError> {
        let list = self.numbers()?;
        list.try_into().map_err(|list: Vec<f64>| {
            self.error(format!("found {} numbers, expected {N}", list.len()))
        })
    }

    pub(super) fn vector(&self) -> Result<Vector3<f64>, FileError> {
        self.fixed::<3>().map(Vector3::from)
    }

    pub(super) fn matrix(&self) -> Result<Matrix3<f64>, FileError> {
        self.fixed::<9>().map(|m| Matrix3::from_row_slice(&m))
    }

    /// Width and height, pixels.
    pub(super) fn size(&self) -> Result<[u32; 2], FileError> {
        let size = self.fixed::<2>()?;
        whole_size(size).ok_or_else(|| {
            self.error(format!(
                "found {size:?}, expected [width, height] in pixels above 0"
            ))
        })
    }

    /// A Rodrigues vector, or a 3 x 3 matrix with determinant 1 or -1.
    pub(super) fn rotation(&self) -> Result<Matrix3<f64>, FileError> {
        let list = self.numbers()?;
        match list.len() {
            3 => self.rodrigues(Vector3::from_column_slice(&list)),
            9 => self.orthonormal(Matrix3::from_row_slice(&list)),
            n => Err(self.error(format!(
                "found {n} numbers, expected a Rodrigues vector of 3 or a matrix of 9"
            ))),
        }
    }

    fn rodrigues(&self, vector: Vector3<f64>) -> Result<Matrix3<f64>, FileError> {
        let length = vector.norm();
        if length > MAX_ROTATION_RAD {
            return Err(self.error(format!(
                "found a vector of length {length:.1}, expected radians, at most 6.28: these look like degrees; multiply \
                 them by 0.017453"
            )));
        }
        Ok(*Rotation3::from_scaled_axis(vector).matrix())
    }

    /// `m` made exactly orthonormal; an error if it is off by more than the rounding of files.
    pub(super) fn orthonormal(&self, m: Matrix3<f64>) -> Result<Matrix3<f64>, FileError> {
        orthonormal(m).ok_or_else(|| {
            let rows: Vec<[f64; 3]> = (0..3).map(|i| [m[(i, 0)], m[(i, 1)], m[(i, 2)]]).collect();
            self.error(format!("found {rows:?}, which is not a rotation"))
        })
    }

    /// A pinhole matrix; focal lengths may be negative.
    pub(super) fn intrinsics(&self) -> Result<Intrinsics, FileError> {
        let m = self.matrix()?;
        let rows: Vec<[f64; 3]> = (0..3).map(|i| [m[(i, 0)], m[(i, 1)], m[(i, 2)]]).collect();
        let wrong = |what: &str| Err(self.error(format!("found {rows:?}: {what}")));
        if m.m13 == 0.0 && m.m23 == 0.0 && (m.m31 != 0.0 || m.m32 != 0.0) {
            return wrong(
                "it is written for row vectors (MATLAB, JARVIS), expected [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]; \
                 transpose it, and the rotation as well",
            );
        }
        if !all_zero(&[m.m21, m.m31, m.m32, m.m33 - 1.0]) {
            return wrong("expected [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]");
        }
        if m.m11 * m.m22 == 0.0 {
            return wrong("the matrix is singular, expected focal lengths other than 0");
        }
        if m.m12.abs() > 1e-9 * m.m11.abs() {
            return wrong("it has a skew, which is not supported");
        }
        Ok(Intrinsics {
            fx_px: m.m11,
            fy_px: m.m22,
            cx_px: m.m13,
            cy_px: m.m23,
        })
    }
}

/// The nearest orthonormal matrix with the same handedness; `None` if `m` is not a rotation.
pub(super) fn orthonormal(m: Matrix3<f64>) -> Option<Matrix3<f64>> {
    let off = (m * m.transpose() - Matrix3::identity()).abs().max();
    if off.is_nan() || off > ROTATION_TOLERANCE {
        return None;
    }
    if off < 1e-14 {
        return Some(m);
    }
    let svd = m.svd(true, true);
    Some(svd.u? * svd.v_t?)
}

pub(super) fn whole_size(size: [f64; 2]) -> Option<[u32; 2]> {
    let whole = size
        .iter()
        .all(|&s| s.fract() == 0.0 && (1.0..=MAX_SIDE_PX).contains(&s));
    whole.then(|| size.map(|s| s as u32))
}

/// Appends all numbers below `value`; the error names a value that is not a finite number.
fn flatten(value: &Value, depth: usize, all: &mut Vec<f64>) -> Result<(), String> {
    match value {
        Value::Array(list) if depth > 0 => list.iter().try_for_each(|v| flatten(v, depth - 1, all)),
        Value::Number(number) => match number.as_f64() {
            Some(number) if number.is_finite() => {
                all.push(number);
                Ok(())
            }
            _ => Err(number.to_string()),
        },
        other => Err(kind(other).to_owned()),
    }
}

fn kind(value: &Value) -> &'static str {
    match value {
        Value::Null => "nothing or no finite number",
        Value::Bool(_) => "true or false",
        Value::Number(_) => "a number",
        Value::String(_) => "text",
        Value::Array(_) => "a list",
        Value::Object(_) => "a table",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(json: &str, read: impl Fn(Node<'_>) -> Option<String>) -> Option<String> {
        let value: Value = serde_json::from_str(json).expect("the test's own text");
        let source = Source {
            path: Path::new("a.json"),
            text: json,
        };
        read(Node::root(source, &value))
    }

    #[test]
    fn a_wrong_number_is_refused_with_its_line() {
        let text = "{\n\"left\": {\"K\": [1, 2]},\n\"K\": [1]}";
        let message = check(text, |root| {
            let left = root.get("left")?.get("K")?;
            left.intrinsics().err().map(|error| error.to_string())
        });
        assert_eq!(
            message.as_deref(),
            Some("a.json:2: `left.K`: found 2 numbers, expected 9")
        );
    }

    #[test]
    fn a_matrix_whose_rows_and_columns_contradict_its_data_is_refused() {
        let message = check(
            "{\"K\": {\"rows\": 3, \"cols\": 3, \"data\": [1, 2]}}",
            |root| root.get("K")?.numbers().err().map(|error| error.problem),
        );
        assert_eq!(
            message.as_deref(),
            Some("found 2 numbers, expected 3 x 3 as in `rows` and `cols`")
        );
    }

    #[test]
    fn a_matrix_for_row_vectors_is_recognised() {
        let message = check("{\"K\": [800, 0, 0, 0, 800, 0, 320, 240, 1]}", |root| {
            root.get("K")?.intrinsics().err().map(|error| error.problem)
        });
        assert!(message.is_some_and(|text| text.contains("row vectors")));
    }
}
