//! Reads TOML so that every error names the file, the line and the field.
//!
//! [`TomlFile::read`] converts the text to a typed value and explains serde's errors.
//! [`TomlFile::error`] does the same for the errors of later checks.

use std::fmt::{self, Write as _};
use std::io;
use std::ops::Range;
use std::path::{Path, PathBuf};

use serde::de::DeserializeOwned;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

use crate::plain_text;

/// An error in a file, with its place.
///
/// Format: ``hall.toml:12: `rate_hz`: found -3, expected a number above 0``.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FileError {
    /// The path as given by the caller.
    pub path: PathBuf,
    /// Line, from 1, if known.
    pub line: Option<usize>,
    /// The field, from the file's root, if any.
    pub field: Option<String>,
    /// Found and expected value.
    pub problem: String,
}

impl FileError {
    /// An error of the file as a whole.
    pub fn new(path: impl Into<PathBuf>, problem: impl Into<String>) -> Self {
        Self {
            path: path.into(),
            line: None,
            field: None,
            problem: problem.into(),
        }
    }

    /// The same error for one field.
    #[must_use]
    pub fn at_field(self, field: impl Into<String>) -> Self {
        Self {
            field: Some(field.into()),
            ..self
        }
    }

    /// The same error for one line (from 1).
    #[must_use]
    pub fn at_line(self, line: usize) -> Self {
        Self {
            line: Some(line),
            ..self
        }
    }
}

impl fmt::Display for FileError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut text = self.path.display().to_string();
        if let Some(line) = self.line {
            write!(text, ":{line}")?;
        }
        if let Some(field) = &self.field {
            write!(text, ": `{field}`")?;
        }
        write!(text, ": {}", self.problem)?;
        // The file may contain any text.
        f.write_str(&plain_text::one_line(&text))
    }
}

impl std::error::Error for FileError {}

/// Why a text file could not be read; `expected` describes it. The system's messages for a folder,
/// or for bytes that are not text, do not explain what was wrong with the given name.
pub fn unread(error: &io::Error, expected: &str) -> String {
    match error.kind() {
        io::ErrorKind::InvalidData => format!("found bytes that are not text, expected {expected}"),
        io::ErrorKind::IsADirectory => format!("found a folder, expected {expected}"),
        _ => error.to_string(),
    }
}

/// One step from a value to a value inside it.
#[derive(Debug, Clone, PartialEq, Eq)]
enum Step {
    Key(String),
    Index(usize),
}

/// The place of a value in a TOML file: `viewpoint[0].camera[1].name`.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Place {
    steps: Vec<Step>,
}

impl Place {
    /// The field `name` of the file's root table.
    pub fn field(name: &str) -> Self {
        Self::default().key(name)
    }

    /// The field `name` inside this table.
    #[must_use]
    pub fn key(&self, name: &str) -> Self {
        self.then(Step::Key(name.to_owned()))
    }

    /// The element at `index` (from 0) of this array.
    #[must_use]
    pub fn index(&self, index: usize) -> Self {
        self.then(Step::Index(index))
    }

    fn then(&self, step: Step) -> Self {
        let mut steps = self.steps.clone();
        steps.push(step);
        Self { steps }
    }
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (i, step) in self.steps.iter().enumerate() {
            match step {
                Step::Key(name) if i == 0 => write!(f, "{name}")?,
                Step::Key(name) => write!(f, ".{name}")?,
                Step::Index(index) => write!(f, "[{index}]")?,
            }
        }
        Ok(())
    }
}

/// A syntactically valid TOML text, with the place of every value.
pub struct TomlFile<'a> {
    path: &'a Path,
    text: &'a str,
    root: Spanned<DeTable<'a>>,
}

impl<'a> TomlFile<'a> {
    /// Parses the syntax of `text`; errors name `path`.
    ///
    /// # Errors
    /// [`FileError`] with the line when the text is not TOML.
    pub fn parse(text: &'a str, path: &'a Path) -> Result<Self, FileError> {
        match DeTable::parse(text) {
            Ok(root) => Ok(Self { path, text, root }),
            Err(error) => {
                let problem = format!("not valid TOML: {}", one_line(error.message()));
                let line = error.span().map(|span| line_of(text, span.start));
                Err(FileError {
                    line,
                    ..FileError::new(path, problem)
                })
            }
        }
    }

    /// The path as given by the caller.
    pub fn path(&self) -> &'a Path {
        self.path
    }

    /// The first 16 hexadecimal digits of the text's BLAKE3 hash.
    pub fn fingerprint(&self) -> String {
        blake3::hash(self.text.as_bytes()).to_hex()[..16].to_owned()
    }

    /// `name` relative to the folder of this file.
    pub fn resolve(&self, name: &str) -> PathBuf {
        self.path.parent().unwrap_or(Path::new("")).join(name)
    }

    /// The whole file as a `T`.
    ///
    /// # Errors
    /// [`FileError`] with line and field for a missing, unknown (with the nearest known name) or
    /// mistyped field.
    pub fn read<T: DeserializeOwned>(&self) -> Result<T, FileError> {
        toml::from_str(self.text).map_err(|error| self.explain(&error))
    }

    /// An error of the value at `place`; the line is that of the innermost part that exists.
    pub fn error(&self, place: &Place, problem: impl Into<String>) -> FileError {
        let error = FileError::new(self.path, problem).at_field(place.to_string());
        FileError {
            line: self.line(place),
            ..error
        }
    }

    /// Whether there is a value at `place`, which has no index.
    pub(crate) fn has(&self, place: &Place) -> bool {
        self.value(place).is_some()
    }

    /// The names in the table at `place`, which has no index, in no particular order; none if there
    /// is no table.
    pub(crate) fn keys(&self, place: &Place) -> Vec<&str> {
        let table = self.value(place).and_then(DeValue::as_table);
        let keys = table.into_iter().flat_map(DeTable::keys);
        keys.map(|key| key.get_ref().as_ref()).collect()
    }

    /// The value at `place`, which has no index.
    fn value(&self, place: &Place) -> Option<&DeValue<'a>> {
        let mut table = Some(self.root.get_ref());
        let mut value = None;
        for step in &place.steps {
            let Step::Key(name) = step else { return None };
            let found = table.and_then(|t| t.iter().find(|(key, _)| key.get_ref() == name));
            value = Some(found?.1.get_ref());
            table = value.and_then(DeValue::as_table);
        }
        value
    }

    /// The line of `place`, or of the innermost table around it that exists.
    fn line(&self, place: &Place) -> Option<usize> {
        let mut found = None;
        let mut table = Some(self.root.get_ref());
        let mut value: Option<&Spanned<DeValue<'_>>> = None;
        for step in &place.steps {
            let next = match step {
                Step::Key(name) => table
                    .and_then(|t| t.iter().find(|(key, _)| key.get_ref() == name))
                    .map(|(key, v)| {
                        found = Some(key.span().start);
                        v
                    }),
                Step::Index(index) => value
                    .and_then(|v| v.get_ref().as_array())
                    .and_then(|a| a.get(*index)),
            };
            let Some(next) = next else { break };
            if matches!(step, Step::Index(_)) {
                found = Some(next.span().start);
            }
            value = Some(next);
            table = next.get_ref().as_table();
        }
        found.map(|offset| line_of(self.text, offset))
    }

    fn explain(&self, error: &toml::de::Error) -> FileError {
        let message = one_line(error.message());
        let quoted = backquoted(&message);
        let span = error.span();
        let root = self.root.get_ref();
        let around = span
            .as_ref()
            .and_then(|span| find_in_table(root, &Place::default(), span));
        let around = around.unwrap_or_default();
        let (place, problem) = if message.starts_with("unknown field") && !quoted.is_empty() {
            (around, unknown_name("field", quoted[0], &quoted[1..]))
        } else if message.starts_with("missing field") && !quoted.is_empty() {
            (around.key(quoted[0]), "the field is missing".to_owned())
        } else if message.starts_with("unknown variant") && !quoted.is_empty() {
            (around, unknown_name("value", quoted[0], &quoted[1..]))
        } else {
            let problem = message
                .strip_prefix("invalid type: ")
                .or(message.strip_prefix("invalid value: "));
            (
                around,
                problem.map_or(message.clone(), |rest| format!("found {rest}")),
            )
        };
        let field = (!place.steps.is_empty()).then(|| place.to_string());
        let line = span.map(|span| line_of(self.text, span.start));
        FileError {
            path: self.path.to_owned(),
            line,
            field,
            problem,
        }
    }
}

/// "unknown `kind` `name`", with the nearest of `known` or all of them.
pub fn unknown_name(kind: &str, name: &str, known: &[&str]) -> String {
    match nearest(name, known) {
        Some(nearest) => format!("unknown {kind} `{name}`, did you mean `{nearest}`?"),
        None if known.is_empty() => format!("unknown {kind} `{name}`"),
        None => format!(
            "unknown {kind} `{name}`, expected one of `{}`",
            known.join("`, `")
        ),
    }
}

/// One letter may be wrong for each so many letters: one in a name of four, three in one of nine.
const LETTERS_PER_SLIP: usize = 3;

/// The one of `known` that `name` probably means: the same letters with other punctuation or
/// capitals, a name with one word more or less (`rate` for `rate_hz`), or a misspelling.
pub fn nearest<'a>(name: &str, known: &[&'a str]) -> Option<&'a str> {
    known
        .iter()
        .filter_map(|k| Some((distance(name, k)?, *k)))
        .min()
        .map(|(_, nearest)| nearest)
}

/// The distance of `known` from `name`: the kind of difference, then its size. `None` if they are
/// unrelated.
fn distance(name: &str, known: &str) -> Option<(u8, usize)> {
    let plain = |text: &str| -> String {
        let letters = text.chars().filter(|c| c.is_alphanumeric());
        letters.flat_map(char::to_lowercase).collect()
    };
    if plain(name) == plain(known) {
        return Some((0, 0));
    }
    let words = |text: &str| -> Vec<String> {
        let words = text.split(|c: char| !c.is_alphanumeric());
        words.map(str::to_lowercase).collect()
    };
    let (given, right) = (words(name), words(known));
    let apart = strsim::damerau_levenshtein(name, known);
    if right.starts_with(&given) || given.starts_with(&right) {
        return Some((1, apart));
    }
    let letters = name.chars().count();
    (apart <= 1.max(letters / LETTERS_PER_SLIP) && apart < letters).then_some((2, apart))
}

/// The names in backquotes in a message of serde.
fn backquoted(message: &str) -> Vec<&str> {
    message.split('`').skip(1).step_by(2).collect()
}

fn one_line(message: &str) -> String {
    message
        .lines()
        .map(str::trim)
        .filter(|line| !line.is_empty())
        .collect::<Vec<_>>()
        .join("; ")
}

/// Line, from 1, of a byte offset.
fn line_of(text: &str, offset: usize) -> usize {
    1 + text.bytes().take(offset).filter(|&b| b == b'\n').count()
}

/// The innermost field under `table`, which is at `around`, whose key or value covers `span`.
///
/// A table's own span may be its header alone, so every table is searched.
fn find_in_table(table: &DeTable<'_>, around: &Place, span: &Range<usize>) -> Option<Place> {
    table.iter().find_map(|(key, value)| {
        let place = around.key(key.get_ref());
        let inner = find_in_value(value, &place, span);
        inner.or_else(|| covers(&key.span(), span).then_some(place))
    })
}

fn find_in_value(value: &Spanned<DeValue<'_>>, at: &Place, span: &Range<usize>) -> Option<Place> {
    let inner = match value.get_ref() {
        DeValue::Table(table) => find_in_table(table, at, span),
        DeValue::Array(array) => {
            (0..array.len()).find_map(|i| find_in_value(&array[i], &at.index(i), span))
        }
        _ => None,
    };
    inner.or_else(|| covers(&value.span(), span).then(|| at.clone()))
}

fn covers(outer: &Range<usize>, inner: &Range<usize>) -> bool {
    outer.start <= inner.start && inner.end <= outer.end
}

#[cfg(test)]
mod tests;
