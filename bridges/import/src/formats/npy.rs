//! `NumPy`'s `.npy` arrays of floating-point numbers: magic, version, a heading in Python syntax,
//! then the numbers. Source: `numpy.lib.format`, versions 1.0 to 3.0.

use std::path::Path;

use farfield_proto::toml_file::FileError;

const MAGIC: &[u8] = b"\x93NUMPY";
/// Maximum length of the heading, bytes; plain arrays have about a hundred.
const MAX_HEADING: usize = 1 << 14;
/// Maximum number of axes.
const MAX_AXES: usize = 8;

/// Whether the bytes start like such a file.
pub(super) fn is_npy(bytes: &[u8]) -> bool {
    bytes.starts_with(MAGIC)
}

/// An array that borrows its numbers from the file.
#[derive(Debug)]
pub(super) struct Array<'a> {
    pub(super) shape: Vec<usize>,
    strides: Vec<usize>,
    data: &'a [u8],
    kind: Kind,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Kind {
    bytes: usize,
    is_big_endian: bool,
}

impl<'a> Array<'a> {
    /// Parses the heading and checks that the numbers are complete.
    ///
    /// # Errors
    /// [`FileError`] if it is not such a file, or one of another kind.
    pub(super) fn parse(bytes: &'a [u8], path: &Path) -> Result<Self, FileError> {
        Self::read(bytes).map_err(|problem| FileError::new(path, problem))
    }

    fn read(bytes: &'a [u8]) -> Result<Self, String> {
        let rest = bytes.strip_prefix(MAGIC).ok_or("found no array of NumPy")?;
        let (length, rest) = match rest {
            [1, _, a, b, rest @ ..] => (usize::from(u16::from_le_bytes([*a, *b])), rest),
            [2 | 3, _, a, b, c, d, rest @ ..] => {
                (u32::from_le_bytes([*a, *b, *c, *d]) as usize, rest)
            }
            [major, ..] => {
                return Err(format!(
                    "found version {major} of the file, expected 1 to 3"
                ));
            }
            [] => return Err("the file ends in its heading".to_owned()),
        };
        if length > MAX_HEADING {
            return Err(format!(
                "found a heading of {length} bytes, expected at most {MAX_HEADING}"
            ));
        }
        let (heading, data) = rest
            .split_at_checked(length)
            .ok_or("the file ends in its heading")?;
        let heading = std::str::from_utf8(heading).map_err(|_| "the heading is no text")?;
        let kind = kind(value(heading, "descr")?)?;
        let is_fortran = value(heading, "fortran_order")?.starts_with("True");
        let shape = shape(value(heading, "shape")?)?;
        let count = shape
            .iter()
            .try_fold(kind.bytes, |all, axis| all.checked_mul(*axis));
        if count != Some(data.len()) {
            return Err(format!(
                "found {} bytes of numbers, expected those of an array {shape:?} of {} bytes each",
                data.len(),
                kind.bytes
            ));
        }
        let mut strides = vec![0; shape.len()];
        let mut stride = kind.bytes;
        let mut axes: Vec<usize> = (0..shape.len()).collect();
        if !is_fortran {
            axes.reverse();
        }
        for axis in axes {
            strides[axis] = stride;
            // Cannot overflow: the product of all axes was checked above.
            stride = stride.saturating_mul(shape[axis]);
        }
        Ok(Self {
            shape,
            strides,
            data,
            kind,
        })
    }

    /// The number at `place`, one index per axis; `None` outside the array.
    pub(super) fn at(&self, place: &[usize]) -> Option<f64> {
        if place.len() != self.shape.len() || place.iter().zip(&self.shape).any(|(i, n)| i >= n) {
            return None;
        }
        let start: usize = place.iter().zip(&self.strides).map(|(i, s)| i * s).sum();
        let bytes = self.data.get(start..start + self.kind.bytes)?;
        let big = self.kind.is_big_endian;
        if let Ok(bytes) = <[u8; 8]>::try_from(bytes) {
            let read = if big {
                f64::from_be_bytes
            } else {
                f64::from_le_bytes
            };
            return Some(read(bytes));
        }
        let bytes = <[u8; 4]>::try_from(bytes).ok()?;
        let read = if big {
            f32::from_be_bytes
        } else {
            f32::from_le_bytes
        };
        Some(f64::from(read(bytes)))
    }
}

/// The text after `'key':` in the heading.
fn value<'a>(heading: &'a str, key: &str) -> Result<&'a str, String> {
    let quoted = [format!("'{key}':"), format!("\"{key}\":")];
    let found = quoted
        .iter()
        .find_map(|it| heading.find(it).and_then(|at| heading.get(at + it.len()..)));
    found
        .map(str::trim_start)
        .ok_or_else(|| format!("the heading has no `{key}`"))
}

fn kind(text: &str) -> Result<Kind, String> {
    let word = text.trim_start_matches(['\'', '"']);
    let word = word.split(['\'', '"']).next().unwrap_or("");
    let (bytes, is_big_endian) = match word {
        "<f8" | "=f8" => (8, false),
        "<f4" | "=f4" => (4, false),
        ">f8" => (8, true),
        ">f4" => (4, true),
        _ => {
            let shown: String = word.chars().take(20).collect();
            return Err(format!(
                "found numbers of the kind `{shown}`, expected floating point of 4 or 8 bytes"
            ));
        }
    };
    Ok(Kind {
        bytes,
        is_big_endian,
    })
}

fn shape(text: &str) -> Result<Vec<usize>, String> {
    let inside = text
        .strip_prefix('(')
        .and_then(|it| it.split(')').next())
        .ok_or("the heading has no shape such as (4, 100, 33, 2)")?;
    let words = inside.split(',').map(str::trim).filter(|it| !it.is_empty());
    let shape: Result<Vec<usize>, _> = words.take(MAX_AXES + 1).map(str::parse).collect();
    match shape {
        Ok(shape) if shape.len() <= MAX_AXES => Ok(shape),
        _ => Err(format!(
            "found the shape ({inside}), expected at most {MAX_AXES} numbers"
        )),
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::formats::writers::npy;

    #[test]
    fn both_memory_orders_are_read() {
        let numbers: Vec<f64> = (0..6).map(f64::from).collect();
        let bytes = npy(&[2, 3], &numbers);
        let array = Array::parse(&bytes, Path::new("a.npy")).unwrap();
        assert_eq!(array.at(&[1, 0]), Some(3.0));
        assert_eq!((array.at(&[2, 0]), array.at(&[0])), (None, None));
        let text = String::from_utf8_lossy(&bytes).into_owned();
        assert!(text.contains("False"));
        let at = bytes.windows(5).position(|it| it == b"False").unwrap();
        let mut fortran = bytes.clone();
        fortran.splice(at..at + 5, *b"True ");
        let array = Array::parse(&fortran, Path::new("a.npy")).unwrap();
        assert_eq!(array.at(&[1, 0]), Some(1.0));
    }

    #[test]
    fn truncated_and_other_arrays_are_refused() {
        let whole = npy(&[2, 3], &[0.0; 6]);
        for length in 0..whole.len() {
            assert!(
                Array::parse(&whole[..length], Path::new("a.npy")).is_err(),
                "{length}"
            );
        }
        let objects = String::from_utf8_lossy(&whole).replace("<f8", "|O8");
        assert!(Array::parse(objects.as_bytes(), Path::new("a.npy")).is_err());
    }

    proptest! {
        #[test]
        fn no_heading_panics(
            version in 0u8..5,
            heading in "[{'descrfotanhp_:<>=f48, ()TrueFals0-9]{0,80}",
            data in proptest::collection::vec(any::<u8>(), 0..64),
        ) {
            let mut bytes = MAGIC.to_vec();
            bytes.extend([version, 0]);
            bytes.extend((heading.len() as u16).to_le_bytes());
            bytes.extend(heading.as_bytes());
            bytes.extend(data);
            drop(Array::parse(&bytes, Path::new("a.npy")));
        }
    }
}
