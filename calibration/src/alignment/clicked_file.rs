//! The file of what was clicked, while it is being clicked: read, changed and written again, whole or not.
//!
//! What [`Marks::parse`] takes must be whole: a point of the floor that one camera has is refused. Here it may be on its way. The
//! text that is written is what is read by both.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;

use farfield_proto::court::Court;
use farfield_proto::toml_file::FileError;
use serde::{Deserialize, Serialize};

use super::mark_file::{Clicked, LengthBetween, Reader};
use super::marks::{KnownMark, Marks};

/// Longest name of a place or point, bytes, and of a file with this many names nobody will think.
const LONGEST_NAME: usize = 64;
const MOST_NAMES: usize = 1000;

/// What was clicked so far. As JSON it is what a page and the command say to each other.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ClickedFile {
    /// Whose marks and lines may be clicked by name.
    pub court: Option<String>,
    /// Length and width of the court where they are not the usual ones, metres.
    pub size_m: Option<[f64; 2]>,
    /// How well is clicked, pixels, where the file says it.
    pub click_sigma_px: Option<f64>,
    /// How well places are known, metres, where the file says it.
    pub place_sigma_m: Option<f64>,
    /// Names of points on the floor.
    pub floor: Vec<String>,
    /// Places that are known, metres.
    pub places: BTreeMap<String, [f64; 3]>,
    /// Lengths between clicked points.
    pub lengths: Vec<LengthBetween>,
    /// Distorted pixels by camera and name: one of a point, one or more of a line.
    pub camera: BTreeMap<String, BTreeMap<String, Vec<[f64; 2]>>>,
}

/// All that was clicked, as a page says it, and of what it is a change.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ClickedChange {
    /// Of which revision it is a change.
    pub revision: u64,
    /// What is clicked now.
    pub clicked: ClickedFile,
}

impl ClickedChange {
    /// Reads the JSON of a page. What is clicked is not checked yet: [`ClickedFile::checked`].
    ///
    /// # Errors
    /// In words, where it is none.
    pub fn parse(json: &[u8]) -> Result<Self, String> {
        let read = serde_json::from_slice(json);
        read.map_err(|error| format!("what was clicked cannot be read: {error}"))
    }
}

impl ClickedFile {
    /// Reads the text of a file; `path` is only named in errors. An empty text is a file in which nothing is clicked yet.
    ///
    /// # Errors
    /// [`FileError`] as of [`Marks::parse`], but for points that too few cameras saw, and names that nobody can read.
    pub fn parse(text: &str, path: &Path) -> Result<Self, FileError> {
        let reader = Reader::of(text, path)?;
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

    /// Whether a file can hold this name of a place, point or camera.
    ///
    /// # Errors
    /// In words, where it is empty, too long or cannot be read.
    pub fn check_name(name: &str) -> Result<(), String> {
        let is_name = !name.trim().is_empty() && !name.chars().any(char::is_control);
        if is_name && name.len() <= LONGEST_NAME {
            return Ok(());
        }
        let shown: String = name.chars().take(LONGEST_NAME).collect();
        Err(format!(
            "found the name {shown:?}, expected 1 to {LONGEST_NAME} characters that can be read"
        ))
    }

    /// Names that were given and not taken from a court: what stands in a file and on a page, cameras' too.
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

    /// The text of the file. Pixels are rounded to hundredths, which no eye can click.
    pub fn text(&self) -> String {
        let mut text = "# Clicked with `farfield calibrate marks`; docs/calibration.md says what it may hold.\n".to_owned();
        // Writing to a string does not fail.
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

    /// What was said so far, checked: the same after it was written and read. `path` is only named in errors.
    ///
    /// # Errors
    /// In words, with the field, where [`Self::parse`] would not take it.
    pub fn checked(&self, path: &Path) -> Result<Self, String> {
        Self::parse(&self.text(), path).map_err(said_of_no_text)
    }

    /// This in the place of `before`, where the pictures of some cameras alone were shown: what was clicked in the others stays as
    /// it was, and so do the names that were clicked there.
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

    /// Whether a place, a point of the floor or the end of a length is given by this name.
    fn gives(&self, name: &str) -> bool {
        let mut ends = self.lengths.iter().flat_map(|it| &it.between);
        self.places.contains_key(name)
            || self.floor.iter().any(|it| it == name)
            || ends.any(|end| end == name)
    }

    /// Takes over all that `other` gives by `name`.
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

    /// Why `--marks` would refuse it as it is; `None` where it would not.
    pub fn problem(&self, path: &Path) -> Option<String> {
        let read = Marks::parse(&self.text(), path);
        read.err().map(said_of_no_text)
    }

    /// The court that it names.
    ///
    /// # Errors
    /// In words: an unknown name, or a size that its rules do not allow.
    pub fn court(&self) -> Result<Option<Court>, String> {
        let court = self.court.as_deref();
        court.map(|name| Court::of(name, self.size_m)).transpose()
    }

    /// What one camera saw of what is known: marks, lines and places. `path` is only named in errors.
    ///
    /// # Errors
    /// As [`Self::checked`].
    pub fn marks_of(&self, camera: &str, path: &Path) -> Result<Marks, String> {
        let mut alone = self.clone();
        alone.camera.retain(|name, _| name == camera);
        let text = alone.text();
        let reader = Reader::of(&text, path).map_err(said_of_no_text)?;
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
            click_sigma_px: reader.click_sigma_px().map_err(said_of_no_text)?,
            place_sigma_m: reader.place_sigma_m().map_err(said_of_no_text)?,
            court: reader.court,
        })
    }
}

/// An error in a text that is in no file yet: no line of the file is meant.
fn said_of_no_text(error: FileError) -> String {
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

/// A name as a key: quoted where it has to be.
fn key(name: &str) -> String {
    let is_bare = !name.is_empty()
        && name
            .bytes()
            .all(|b| b.is_ascii_alphanumeric() || b == b'_' || b == b'-');
    if is_bare {
        name.to_owned()
    } else {
        // A basic string: of the other kinds some are no keys.
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
    fn what_is_half_clicked_is_read_and_what_it_lacks_is_said() {
        let begun = read(BEGUN).unwrap();
        assert_eq!(begun.camera["north"]["touchline_north"].len(), 2);
        let told = begun.problem(Path::new("clicked.toml")).unwrap();
        assert!(
            told.contains("`floor[0]`: found `scratch` clicked in 1 cameras"),
            "{told}"
        );
        assert_eq!(read("").unwrap(), ClickedFile::default());
        assert!(
            read("court = \"fustal\"")
                .unwrap_err()
                .contains("did you mean `futsal`?")
        );
    }

    #[test]
    fn what_is_whole_is_what_marks_takes() {
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
    fn what_is_wrong_is_said_of_the_file_that_is_meant_and_of_none_of_its_lines() {
        let file = ClickedFile {
            court: Some("fustal".to_owned()),
            ..ClickedFile::default()
        };
        let path = Path::new("hall/marks.toml");
        let told = file.checked(path).unwrap_err();
        assert!(told.starts_with("hall/marks.toml: `court`"), "{told}");
        assert_eq!(file.marks_of("north", path).unwrap_err(), told);
    }

    #[test]
    fn cameras_that_are_not_shown_keep_their_clicks_and_their_names() {
        let before = read(&format!(
            "{BEGUN}[camera.south]\nscratch = [1, 2]\nred = [3, 4]\n\"door post\" = [5, 6]\n"
        ));
        let before = before.unwrap();
        let is_shown = |name: &str| name == "north";
        // As it was before anybody gave a name or clicked in the south.
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
        // Where all are shown, all is as it is said.
        assert_eq!(older.in_place_of(&before, |_| true), older);
    }

    #[test]
    fn names_that_nobody_can_read_are_refused() {
        for name in ["", "  ", "a\u{7}b", &"x".repeat(65)] {
            let file = ClickedFile {
                floor: vec![name.to_owned()],
                ..ClickedFile::default()
            };
            let told = file.checked(Path::new("clicked.toml")).unwrap_err();
            assert!(told.contains("characters that can be read"), "{told}");
        }
    }

    #[test]
    fn a_name_that_is_none_of_the_court_is_refused_with_its_field() {
        let mut file = read(BEGUN).unwrap();
        let north = file.camera.get_mut("north").unwrap();
        north.insert("corner_nort_west".to_owned(), vec![[1.0, 2.0]]);
        let told = file.checked(Path::new("clicked.toml")).unwrap_err();
        assert!(told.contains("camera.north.corner_nort_west"), "{told}");
        assert!(told.contains("did you mean `corner_north_west`?"), "{told}");
    }

    proptest! {
        #[test]
        fn what_is_written_is_read_again(
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
