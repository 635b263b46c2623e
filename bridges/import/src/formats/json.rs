//! JSON as Python programs write it: `NaN` means not detected. Errors contain line and field.

use std::borrow::Cow;
use std::fmt;
use std::path::Path;

use farfield_proto::toml_file::FileError;
use serde::Deserialize;
use serde::de::{DeserializeOwned, Deserializer, IgnoredAny, MapAccess, SeqAccess, Visitor};

use super::Format;
use crate::keypoints::{Keypoints, MAX_KEYPOINTS, Mapping};
use crate::person::{Candidate, Person};

/// A number of a file; `None` for `null` and `NaN`.
pub(super) type Number = Option<f64>;

/// Parses the whole text as a `T`.
///
/// # Errors
/// [`FileError`] with line and field.
pub(super) fn read<T: DeserializeOwned>(text: &str, path: &Path) -> Result<T, FileError> {
    let text = without_nan(text);
    let mut reader = serde_json::Deserializer::from_str(&text);
    let value = serde_path_to_error::deserialize(&mut reader).map_err(|error| {
        let field = error.path().to_string();
        let error = problem(error.inner(), path);
        if field == "." {
            error
        } else {
            error.at_field(field)
        }
    })?;
    reader.end().map_err(|error| problem(&error, path))?;
    Ok(value)
}

fn problem(error: &serde_json::Error, path: &Path) -> FileError {
    let message = error.to_string();
    let message = message.split(" at line ").next().unwrap_or_default();
    let what = if error.is_data() {
        message
            .replacen("invalid type: ", "found ", 1)
            .replacen("invalid value: ", "found ", 1)
    } else {
        format!("not JSON: {message}")
    };
    let problem = FileError::new(path, what);
    match error.line() {
        0 => problem,
        line => problem.at_line(line),
    }
}

/// Replaces `NaN` and `Infinity`, which Python writes and JSON lacks, by `null`.
fn without_nan(text: &str) -> Cow<'_, str> {
    const WORDS: [&str; 3] = ["NaN", "-Infinity", "Infinity"];
    if !text.contains("NaN") && !text.contains("Infinity") {
        return Cow::Borrowed(text);
    }
    let mut replaced = String::with_capacity(text.len() + 16);
    let mut rest = text;
    let mut is_quoted = false;
    while let Some(at) = rest.find(['"', '\\', 'N', 'I', '-']) {
        let (before, here) = rest.split_at(at);
        replaced.push_str(before);
        let word = WORDS
            .iter()
            .find(|word| !is_quoted && here.starts_with(**word));
        let length = if let Some(word) = word {
            replaced.push_str("null");
            word.len()
        } else {
            // An escaped character does not end the string.
            let escaped = is_quoted && here.starts_with('\\');
            let length: usize = here
                .chars()
                .take(if escaped { 2 } else { 1 })
                .map(char::len_utf8)
                .sum();
            is_quoted ^= here.starts_with('"');
            replaced.push_str(&here[..length]);
            length
        };
        rest = &here[length..];
    }
    replaced.push_str(rest);
    Cow::Owned(replaced)
}

/// The person of a flat list x, y, score, x, y, score, ...; `None` for an empty list.
///
/// # Errors
/// If the list is invalid.
pub(super) fn flat_person(
    keypoints: &mut Keypoints,
    names: Option<&[String]>,
    flat: &[Number],
) -> Result<Option<Person>, String> {
    if flat.is_empty() {
        return Ok(None);
    }
    if !flat.len().is_multiple_of(3) || flat.len() > 3 * MAX_KEYPOINTS {
        return Err(format!(
            "found {} numbers, expected three per keypoint: x, y, score",
            flat.len()
        ));
    }
    let mapping = mapping(keypoints, names, flat.len() / 3)?;
    let at = |i: usize| flat.get(i).copied().flatten();
    let person = mapping.person(|place| {
        Candidate::from_numbers(at(3 * place), at(3 * place + 1), at(3 * place + 2))
    })?;
    Ok(Some(person))
}

/// Maps by the names if there are as many as keypoints, otherwise by count.
pub(super) fn mapping<'a>(
    keypoints: &'a mut Keypoints,
    names: Option<&[String]>,
    count: usize,
) -> Result<&'a Mapping, String> {
    match names {
        Some(names) if names.len() == count => keypoints.by_names(names),
        _ => keypoints.by_count(count),
    }
}

/// Recognises a format; `None` if unknown.
///
/// # Errors
/// [`FileError`] if the text is not JSON.
pub(super) fn recognised(text: &str, path: &Path) -> Result<Option<Format>, FileError> {
    let Shape {
        is_list,
        keys,
        image_is_text,
    } = read(text, path)?;
    let has = |key: &str| keys.iter().any(|it| it == key);
    Ok(match is_list {
        false if has("people") => Some(Format::OpenPose),
        false if has("instance_info") => Some(Format::MmPose),
        false if has("annotations") && has("images") => Some(Format::CocoAnnotations),
        true if has("image_id") && has("keypoints") => Some(if image_is_text {
            Format::AlphaPose
        } else {
            Format::CocoResults
        }),
        true if has("instances") || has("keypoint_scores") => Some(Format::MmPose),
        _ => None,
    })
}

/// Top-level structure of an `MMPose` file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Top {
    Object,
    /// A list of entries with instances.
    ListOfFrames,
    /// Any other list.
    List,
}

/// Detects the top-level structure.
///
/// # Errors
/// [`FileError`] if the text is not JSON.
pub(super) fn top(text: &str, path: &Path) -> Result<Top, FileError> {
    let shape: Shape = read(text, path)?;
    Ok(match shape.is_list {
        false => Top::Object,
        true if shape.keys.iter().any(|key| key == "instances") => Top::ListOfFrames,
        true => Top::List,
    })
}

/// The top-level keys of a file, or those of the first entry of its list.
#[derive(Debug, Default)]
struct Shape {
    is_list: bool,
    keys: Vec<String>,
    image_is_text: bool,
}

impl<'de> Deserialize<'de> for Shape {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(ShapeVisitor)
    }
}

struct ShapeVisitor;

impl<'de> Visitor<'de> for ShapeVisitor {
    type Value = Shape;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("an object or a list of objects")
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Shape, A::Error> {
        let mut shape = Shape::default();
        while let Some(key) = map.next_key::<String>()? {
            if key == "image_id" {
                shape.image_is_text = map.next_value::<TextOrNot>()?.0;
            } else {
                map.next_value::<IgnoredAny>()?;
            }
            shape.keys.push(key);
        }
        Ok(shape)
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<Shape, A::Error> {
        let mut shape = list.next_element::<Shape>()?.unwrap_or_default();
        shape.is_list = true;
        while list.next_element::<IgnoredAny>()?.is_some() {}
        Ok(shape)
    }

    fn visit_unit<E>(self) -> Result<Shape, E> {
        Ok(Shape::default())
    }

    fn visit_bool<E>(self, _: bool) -> Result<Shape, E> {
        Ok(Shape::default())
    }

    fn visit_f64<E>(self, _: f64) -> Result<Shape, E> {
        Ok(Shape::default())
    }

    fn visit_i64<E>(self, _: i64) -> Result<Shape, E> {
        Ok(Shape::default())
    }

    fn visit_u64<E>(self, _: u64) -> Result<Shape, E> {
        Ok(Shape::default())
    }

    fn visit_str<E>(self, _: &str) -> Result<Shape, E> {
        Ok(Shape::default())
    }
}

/// Whether a value is a string.
struct TextOrNot(bool);

impl<'de> Deserialize<'de> for TextOrNot {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let value = serde_json::Value::deserialize(deserializer)?;
        Ok(Self(value.is_string()))
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn nan_becomes_null_except_in_strings() {
        let text = r#"{"NaN \" NaN": [NaN, -Infinity, Infinity, -1, "Infinity"]}"#;
        assert_eq!(
            without_nan(text),
            r#"{"NaN \" NaN": [null, null, null, -1, "Infinity"]}"#
        );
        assert!(matches!(without_nan("[1]"), Cow::Borrowed(_)));
    }

    proptest! {
        #[test]
        fn no_text_panics(text in "[\\PC\"NaIinfty\\\\-]{0,60}") {
            without_nan(&text);
            without_nan(&format!("NaN{text}"));
        }
    }
}
