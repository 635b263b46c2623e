//! The file of clicked marks while it is being clicked: read, changed and written again, complete or not.
//!
//! [`Marks::parse`] refuses an incomplete file, such as a point of the floor that only one camera has. [`ClickedFile`] accepts
//! it. Both read the same text.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;

use farfield_proto::court::Court;
use farfield_proto::toml_file::FileError;
use serde::{Deserialize, Serialize};

use super::mark_file::{Clicked, LengthBetween, Reader};
use super::marks::{KnownMark, Marks};

/// Longest name of a place or point, bytes.
const LONGEST_NAME: usize = 64;
/// Most names in a file.
const MOST_NAMES: usize = 1000;

/// All clicks so far. As JSON, the page and the command exchange it.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ClickedFile {
    /// The court whose marks and lines can be clicked by name.
    pub court: Option<String>,
    /// Length and width of the court if they differ from the usual ones, metres.
    pub size_m: Option<[f64; 2]>,
    /// Standard deviation of a click, pixels, if the file has it.
    pub click_sigma_px: Option<f64>,
    /// Standard deviation of a place, metres, if the file has it.
    pub place_sigma_m: Option<f64>,
    /// Names of points on the floor.
    pub floor: Vec<String>,
    /// Known places, metres.
    pub places: BTreeMap<String, [f64; 3]>,
    /// Lengths between clicked points.
    pub lengths: Vec<LengthBetween>,
    /// Distorted pixels by camera and name: one of a point, one or more of a line.
    pub camera: BTreeMap<String, BTreeMap<String, Vec<[f64; 2]>>>,
}

/// All clicks as the page sends them, and the revision that they change.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ClickedChange {
    /// The revision that this changes.
    pub revision: u64,
    /// The clicks after the change.
    pub clicked: ClickedFile,
}

impl ClickedChange {
    /// Reads the JSON of a page. [`ClickedFile::checked`] checks the clicks.
    ///
    /// # Errors
    /// A message if it is invalid.
    pub fn parse(json: &[u8]) -> Result<Self, String> {
        let read = serde_json::from_slice(json);
        read.map_err(|error| format!("the clicked marks cannot be read: {error}"))
    }
}

impl ClickedFile {
    /// Reads the text of a file; `path` is only for errors. An empty text is a file without clicks.
    ///
    /// # Errors
    /// [`FileError`] as in [`Marks::parse`], except for points in too few cameras; also for unreadable names.
    pub fn parse(text: &str, path: &Path) -> Result<Self, FileError> {
        let reader = Reader::new(text, path)?;
        reader.click_sigma_px()?;
        reader.place_sigma_m()?;
        let raw = reader.raw;
        let read = Self {
            court: raw.court,
            size_m: raw.size_m,
            click_sigma_px: raw.click_sigma_px,
            place_sigma_m: raw.place_sigma_m,
            floor: raw.floor,
            places: raw.places,
            lengths: raw.lengths,
            camera: reader.clicked,
        };
        read.check_given_names()
            .map_err(|problem| FileError::new(path, problem))?;
        Ok(read)
    }

    /// Checks a name of a place, point or camera.
    ///
    /// # Errors
    /// A message if it is empty, too long or not printable.
    pub fn check_name(name: &str) -> Result<(), String> {
        let is_name = !name.trim().is_empty() && !name.chars().any(char::is_control);
        if is_name && name.len() <= LONGEST_NAME {
            return Ok(());
        }
        let shown: String = name.chars().take(LONGEST_NAME).collect();
        Err(format!(
            "found the name {shown:?}, expected 1 to {LONGEST_NAME} printable characters"
        ))
    }

    /// Checks all names that do not come from a court, including names of cameras.
    fn check_given_names(&self) -> Result<(), String> {
        let ends = self.lengths.iter().flat_map(|it| &it.between);
        let given = self.floor.iter().chain(self.places.keys()).chain(ends);
        let given = given.chain(self.camera.keys());
        let mut count = 0;
        for name in given {
            count += 1;
            Self::check_name(name)?;
        }
        if count > MOST_NAMES {
            return Err(format!(
                "found {count} names of places, points, lengths and cameras, expected at most {MOST_NAMES}"
            ));
        }
        Ok(())
    }

    /// The text of the file. Pixels are rounded to hundredths: no click is more accurate.
    pub fn text(&self) -> String {
        let mut text = "# Clicked with `farfield calibrate marks`; docs/calibration.md describes the fields.\n".to_owned();
        // Writing to a string cannot fail.
        if let Some(court) = &self.court {
            writeln!(text, "court = {}", quoted(court)).ok();
        }
        if let Some([length, width]) = self.size_m {
            writeln!(text, "size_m = [{length:?}, {width:?}]").ok();
        }
        if let Some(sigma_px) = self.click_sigma_px {
            writeln!(text, "click_sigma_px = {sigma_px:?}").ok();
        }
        if let Some(sigma_m) = self.place_sigma_m {
            writeln!(text, "place_sigma_m = {sigma_m:?}").ok();
        }
        if !self.floor.is_empty() {
            let names: Vec<String> = self.floor.iter().map(|name| quoted(name)).collect();
            writeln!(text, "floor = [{}]", names.join(", ")).ok();
        }
        if !self.places.is_empty() {
            text.push_str("\n[places]\n");
        }
        for (name, [x, y, z]) in &self.places {
            writeln!(text, "{} = [{x:?}, {y:?}, {z:?}]", key(name)).ok();
        }
        for length in &self.lengths {
            let [a, b] = length.between.each_ref().map(|name| quoted(name));
            let metres = length.length_m;
            writeln!(
                text,
                "\n[[lengths]]\nbetween = [{a}, {b}]\nlength_m = {metres:?}"
            )
            .ok();
        }
        for (camera, clicked) in &self.camera {
            if clicked.values().any(|pixels| !pixels.is_empty()) {
                writeln!(text, "\n[camera.{}]", key(camera)).ok();
                clicked_lines(&mut text, clicked);
            }
        }
        text
    }

    /// This file, checked and rounded as if written and read. `path` is only for errors.
    ///
    /// # Errors
    /// A message with the field if [`Self::parse`] would refuse it.
    pub fn checked(&self, path: &Path) -> Result<Self, String> {
        Self::parse(&self.text(), path).map_err(message_without_line)
    }

    /// Replaces `before`, of which only some cameras were shown. Clicks in the other cameras are kept, and the names that they
    /// use.
    #[must_use]
    pub fn in_place_of(&self, before: &Self, is_shown: impl Fn(&str) -> bool) -> Self {
        let mut merged = self.clone();
        merged.camera.retain(|name, _| is_shown(name));
        for (camera, clicked) in &before.camera {
            if is_shown(camera) {
                continue;
            }
            for name in clicked.keys().filter(|name| !self.gives(name)) {
                merged.take_name(name, before);
            }
            merged.camera.insert(camera.clone(), clicked.clone());
        }
        merged
    }

    /// Whether this file defines a place, a point of the floor or the end of a length of this name.
    fn gives(&self, name: &str) -> bool {
        let mut ends = self.lengths.iter().flat_map(|it| &it.between);
        self.places.contains_key(name)
            || self.floor.iter().any(|it| it == name)
            || ends.any(|end| end == name)
    }

    /// Copies all that `other` defines under `name`.
    fn take_name(&mut self, name: &str, other: &Self) {
        if let Some(at_m) = other.places.get(name) {
            self.places.insert(name.to_owned(), *at_m);
        }
        let floor = other.floor.iter().filter(|it| *it == name);
        for point in floor {
            if !self.floor.contains(point) {
                self.floor.push(point.clone());
            }
        }
        let ends_there = |it: &&LengthBetween| it.between.iter().any(|end| end == name);
        for length in other.lengths.iter().filter(ends_there) {
            if !self.lengths.contains(length) {
                self.lengths.push(length.clone());
            }
        }
    }

    /// The error with which `--marks` would refuse the file; `None` if it would not.
    pub fn problem(&self, path: &Path) -> Option<String> {
        let read = Marks::parse(&self.text(), path);
        read.err().map(message_without_line)
    }

    /// The court of the file.
    ///
    /// # Errors
    /// A message: an unknown name, or a size that its rules do not allow.
    pub fn court(&self) -> Result<Option<Court>, String> {
        let court = self.court.as_deref();
        court.map(|name| Court::of(name, self.size_m)).transpose()
    }

    /// The clicks of one camera at known marks, lines and places. `path` is only for errors.
    ///
    /// # Errors
    /// As [`Self::checked`].
    pub fn marks_of(&self, camera: &str, path: &Path) -> Result<Marks, String> {
        let mut alone = self.clone();
        alone.camera.retain(|name, _| name == camera);
        let text = alone.text();
        let reader = Reader::new(&text, path).map_err(message_without_line)?;
        let clicked = reader.clicked.get(camera).into_iter().flatten();
        let known = clicked.filter_map(|(name, pixels)| {
            let own = pixels.iter().map(|px| (camera.to_owned(), *px));
            Some(KnownMark {
                name: name.clone(),
                known: reader.known(name)?,
                clicks: own.collect(),
            })
        });
        Ok(Marks {
            known: known.collect(),
            floor: Vec::new(),
            lengths: Vec::new(),
            click_sigma_px: reader.click_sigma_px().map_err(message_without_line)?,
            place_sigma_m: reader.place_sigma_m().map_err(message_without_line)?,
            court: reader.court,
        })
    }
}

/// The message of an error in a text that is not a file yet, so that its line has no meaning.
fn message_without_line(error: FileError) -> String {
    FileError {
        line: None,
        ..error
    }
    .to_string()
}

fn clicked_lines(text: &mut String, clicked: &Clicked) {
    for (name, pixels) in clicked {
        let pixels: Vec<String> = pixels
            .iter()
            .map(|[x, y]| format!("[{x:.2}, {y:.2}]"))
            .collect();
        match pixels.as_slice() {
            [] => {}
            [one] => {
                writeln!(text, "{} = {one}", key(name)).ok();
            }
            several => {
                writeln!(text, "{} = [{}]", key(name), several.join(", ")).ok();
            }
        }
    }
}

fn quoted(text: &str) -> String {
    toml::Value::from(text).to_string()
}

/// A name as a TOML key, quoted if necessary.
fn key(name: &str) -> String {
    let is_bare = !name.is_empty()
        && name
            .bytes()
            .all(|b| b.is_ascii_alphanumeric() || b == b'_' || b == b'-');
    if is_bare {
        name.to_owned()
    } else {
        // A basic string: not all other strings are valid keys.
        serde_json::to_string(name).unwrap_or_else(|_| quoted(name))
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn read(text: &str) -> Result<ClickedFile, String> {
        let read = ClickedFile::parse(text, Path::new("clicked.toml"));
        read.map_err(|error| error.to_string())
    }

    const BEGUN: &str = "court = \"futsal\"\nfloor = [\"scratch\"]\n[places]\n\"door post\" = [3.1, -10.2, 0.0]\n\
        [[lengths]]\nbetween = [\"red\", \"blue\"]\nlength_m = 1.0\n\
        [camera.north]\ncorner_north_west = [512.5, 388.25]\ntouchline_north = [[400.0, 361.0], [900.0, 352.5]]\nscratch = [8.0, 6.0]\n";

    #[test]
    fn an_incomplete_file_is_read_and_its_problem_is_reported() {
        let begun = read(BEGUN).unwrap();
        assert_eq!(begun.camera["north"]["touchline_north"].len(), 2);
        let message = begun.problem(Path::new("clicked.toml")).unwrap();
        assert!(
            message.contains("`floor[0]`: found `scratch` clicked in 1 cameras"),
            "{message}"
        );
        assert_eq!(read("").unwrap(), ClickedFile::default());
        assert!(
            read("court = \"fustal\"")
                .unwrap_err()
                .contains("did you mean `futsal`?")
        );
    }

    #[test]
    fn a_complete_file_is_valid_for_marks() {
        let text = "court = \"futsal\"\n[camera.\"cam 1\"]\ncorner_north_west = [512.5, 388.0]\n";
        let whole = read(text).unwrap();
        assert_eq!(whole.problem(Path::new("clicked.toml")), None);
        let marks = whole.marks_of("cam 1", Path::new("clicked.toml")).unwrap();
        assert_eq!(
            marks.known[0].clicks,
            [("cam 1".to_owned(), [512.5, 388.0])]
        );
        assert!(
            whole
                .marks_of("cam 2", Path::new("clicked.toml"))
                .unwrap()
                .known
                .is_empty()
        );
    }

    #[test]
    fn errors_name_the_file_and_field_but_no_line() {
        let file = ClickedFile {
            court: Some("fustal".to_owned()),
            ..ClickedFile::default()
        };
        let path = Path::new("hall/marks.toml");
        let message = file.checked(path).unwrap_err();
        assert!(message.starts_with("hall/marks.toml: `court`"), "{message}");
        assert_eq!(file.marks_of("north", path).unwrap_err(), message);
    }

    #[test]
    fn cameras_that_are_not_shown_keep_their_clicks_and_their_names() {
        let before = read(&format!(
            "{BEGUN}[camera.south]\nscratch = [1, 2]\nred = [3, 4]\n\"door post\" = [5, 6]\n"
        ));
        let before = before.unwrap();
        let is_shown = |name: &str| name == "north";
        // The state before a name was given or the south was clicked.
        let older = read("court = \"futsal\"\n[camera.north]\ncorner_north_west = [1, 2]\n");
        let mut older = older.unwrap();
        let clicked = older.camera["north"].clone();
        older.camera.insert("east".to_owned(), clicked.clone());
        let merged = older.in_place_of(&before, is_shown);
        assert_eq!(merged.camera.len(), 2, "{merged:?}");
        assert_eq!(merged.camera["north"], clicked);
        assert_eq!(merged.camera["south"], before.camera["south"]);
        assert_eq!(
            (&merged.places, &merged.floor, &merged.lengths),
            (&before.places, &before.floor, &before.lengths)
        );
        assert_eq!(merged.checked(Path::new("clicked.toml")), Ok(merged));
        // If all cameras are shown, the file is replaced as a whole.
        assert_eq!(older.in_place_of(&before, |_| true), older);
    }

    #[test]
    fn unreadable_names_are_refused() {
        for name in ["", "  ", "a\u{7}b", &"x".repeat(65)] {
            let file = ClickedFile {
                floor: vec![name.to_owned()],
                ..ClickedFile::default()
            };
            let message = file.checked(Path::new("clicked.toml")).unwrap_err();
            assert!(message.contains("printable characters"), "{message}");
        }
    }

    #[test]
    fn an_unknown_mark_of_the_court_is_refused_with_its_field() {
        let mut file = read(BEGUN).unwrap();
        let north = file.camera.get_mut("north").unwrap();
        north.insert("corner_nort_west".to_owned(), vec![[1.0, 2.0]]);
        let message = file.checked(Path::new("clicked.toml")).unwrap_err();
        assert!(
            message.contains("camera.north.corner_nort_west"),
            "{message}"
        );
        assert!(
            message.contains("did you mean `corner_north_west`?"),
            "{message}"
        );
    }

    proptest! {
        #[test]
        fn a_written_file_is_read_again(
            names in prop::collection::btree_set("[ -~äß☃]{1,12}", 0..6),
            camera in "[ -~ß]{0,8}[!-~ß]",
            at in prop::array::uniform2(-1e5f64..1e5),
            place in prop::array::uniform3(-1e4f64..1e4),
        ) {
            let names: Vec<String> = names.into_iter().filter(|name| !name.trim().is_empty()).collect();
            let clicked = names.iter().map(|name| (name.clone(), vec![at]));
            let file = ClickedFile {
                places: names.iter().map(|name| (name.clone(), place)).collect(),
                camera: BTreeMap::from([(camera, clicked.collect())]),
                ..ClickedFile::default()
            };
            let once = file.checked(Path::new("clicked.toml"));
            prop_assert!(once.is_ok(), "{once:?}");
            let once = once.unwrap_or_default();
            prop_assert_eq!(&once.places, &file.places);
            prop_assert_eq!(once.checked(Path::new("clicked.toml")), Ok(once.clone()));
            for pixels in once.camera.values().flat_map(|it| it.values()) {
                prop_assert!((pixels[0][0] - at[0]).abs() <= 0.005 + 1e-9);
            }
        }
    }
}
