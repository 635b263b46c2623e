//! The file of marks that were clicked in pictures.
//!
//! ```toml
//! court = "futsal"                 # marks and lines by name; `farfield_proto::court::Court`
//! size_m = [38.0, 20.0]            # of the court, if it is not the usual one
//! click_sigma_px = 1.0             # standard deviations of clicks and places; these are the defaults
//! place_sigma_m = 0.005
//! floor = ["scratch", "tape"]      # unknown points on the floor
//!
//! [places]                         # other known places, metres
//! door_post = [3.1, -10.2, 0.0]
//!
//! [[lengths]]                      # a wand, or a distance along the floor
//! between = ["wand_red_1", "wand_blue_1"]
//! length_m = 1.0
//!
//! [camera.north]                   # distorted pixels; (0, 0) is the centre of the first
//! corner_north_west = [512.5, 388.0]
//! touchline_north = [[400.0, 361.0], [900.0, 352.5]]   # a line: any number of points on it
//! scratch = [801.0, 640.0]
//! ```

use std::collections::BTreeMap;
use std::path::Path;

use farfield_proto::court::Court;
use farfield_proto::toml_file::{FileError, Place, TomlFile, unknown_name};
use serde::{Deserialize, Serialize};

use super::marks::{Click, ClickedLength, ClickedPoint, Known, KnownMark, Marks};

/// Most clicks in a file.
const MOST_CLICKS: usize = 10_000;
/// Largest coordinate, pixels.
const LARGEST_PX: f64 = 1e6;
/// Largest coordinate of a place, metres.
const FARTHEST_M: f64 = 1e4;
/// Default standard deviation of a click.
const CLICK_SIGMA_PX: f64 = 1.0;
/// Default standard deviation of a place.
const PLACE_SIGMA_M: f64 = 0.005;
/// Allowed standard deviations of a click.
const CLICK_SIGMAS_PX: [f64; 2] = [0.01, 50.0];
/// Allowed standard deviations of a place.
const PLACE_SIGMAS_M: [f64; 2] = [1e-5, 1.0];

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Raw {
    pub(super) court: Option<String>,
    pub(super) size_m: Option<[f64; 2]>,
    pub(super) click_sigma_px: Option<f64>,
    pub(super) place_sigma_m: Option<f64>,
    #[serde(default)]
    pub(super) floor: Vec<String>,
    #[serde(default)]
    pub(super) places: BTreeMap<String, [f64; 3]>,
    #[serde(default)]
    pub(super) lengths: Vec<LengthBetween>,
    #[serde(default)]
    camera: BTreeMap<String, BTreeMap<String, toml::Value>>,
}

/// A known length between two clicked points.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LengthBetween {
    /// The names of the points.
    pub between: [String; 2],
    /// Metres.
    pub length_m: f64,
}

/// Clicks of one camera: pixels by the name of the mark, one of a point, several of a line.
pub(super) type Clicked = BTreeMap<String, Vec<[f64; 2]>>;

impl Marks {
    /// Reads the text of a file of marks; `path` is only for errors.
    ///
    /// # Errors
    /// [`FileError`] with line and field: not TOML, an unknown court, a name that is neither a mark nor a line nor defined in
    /// the file, a name with two meanings, invalid pixels or metres, a point of floor or length that fewer than two cameras
    /// saw, no clicks at all.
    pub fn parse(text: &str, path: &Path) -> Result<Self, FileError> {
        Reader::new(text, path)?.marks()
    }
}

fn court(file: &TomlFile<'_>, raw: &Raw) -> Result<Option<Court>, FileError> {
    let Some(name) = &raw.court else {
        if raw.size_m.is_some() {
            let problem = "found a size, expected a `court` that has it";
            return Err(file.error(&Place::field("size_m"), problem));
        }
        return Ok(None);
    };
    if !Court::names().contains(&name.as_str()) {
        let problem = unknown_name("court", name, &Court::names());
        return Err(file.error(&Place::field("court"), problem));
    }
    let found = Court::of(name, raw.size_m);
    found
        .map(Some)
        .map_err(|problem| file.error(&Place::field("size_m"), problem))
}

/// A file of marks that may be incomplete.
pub(super) struct Reader<'a> {
    file: TomlFile<'a>,
    pub(super) raw: Raw,
    pub(super) court: Option<Court>,
    /// By camera.
    pub(super) clicked: BTreeMap<String, Clicked>,
}

impl<'a> Reader<'a> {
    /// Reads a file without checking that points have clicks in several cameras.
    ///
    /// # Errors
    /// As [`Marks::parse`], except for points in too few cameras.
    pub(super) fn new(text: &'a str, path: &'a Path) -> Result<Self, FileError> {
        let file = TomlFile::parse(text, path)?;
        let raw: Raw = file.read()?;
        let mut reader = Self {
            court: court(&file, &raw)?,
            raw,
            file,
            clicked: BTreeMap::new(),
        };
        reader.check_names()?;
        reader.check_lengths()?;
        reader.clicked = reader.all_clicked()?;
        Ok(reader)
    }
}

impl Reader<'_> {
    /// The position of a name of the court.
    fn known_in_court(&self, name: &str) -> Option<Known> {
        let court = self.court.as_ref()?;
        let mark = court.mark(name).map(|mark| Known::Place(mark.position_m));
        mark.or_else(|| court.line(name).map(|line| Known::OnLine(line.shape)))
    }

    pub(super) fn known(&self, name: &str) -> Option<Known> {
        let place = self.raw.places.get(name).map(|at_m| Known::Place(*at_m));
        place.or_else(|| self.known_in_court(name))
    }

    /// Refuses names that are defined twice, and clicked names that are not defined.
    fn check_names(&self) -> Result<(), FileError> {
        let floor = self.raw.floor.iter().enumerate();
        let floor = floor.map(|(i, name)| (name, Place::field("floor").index(i)));
        let places = self.raw.places.keys();
        let places = places.map(|name| (name, Place::field("places").key(name)));
        for (name, place) in places.chain(floor) {
            if self.known_in_court(name).is_some() {
                let problem = format!("found `{name}`, which the court has, expected another name");
                return Err(self.file.error(&place, problem));
            }
        }
        for (name, at_m) in &self.raw.places {
            if at_m.iter().any(|v| v.is_nan() || v.abs() > FARTHEST_M) {
                let place = Place::field("places").key(name);
                let problem = format!("found {at_m:?}, expected metres up to {FARTHEST_M:e}");
                return Err(self.file.error(&place, problem));
            }
        }
        let ends = self.raw.lengths.iter().flat_map(|it| &it.between);
        let given: Vec<&str> = self
            .raw
            .floor
            .iter()
            .chain(ends)
            .map(String::as_str)
            .collect();
        for (camera, clicks) in &self.raw.camera {
            for name in clicks.keys() {
                if self.known(name).is_none() && !given.contains(&name.as_str()) {
                    let place = Place::field("camera").key(camera).key(name);
                    let problem = unknown_name("mark", name, &self.names(&given));
                    return Err(self.file.error(&place, problem));
                }
            }
        }
        Ok(())
    }

    /// All names that can be clicked.
    fn names<'b>(&'b self, given: &[&'b str]) -> Vec<&'b str> {
        let court = self.court.iter();
        let marks = court
            .clone()
            .flat_map(|c| c.marks.iter().map(|m| m.name.as_str()));
        let lines = court.flat_map(|c| c.lines.iter().map(|l| l.name.as_str()));
        let places = self.raw.places.keys().map(String::as_str);
        marks
            .chain(lines)
            .chain(places)
            .chain(given.iter().copied())
            .collect()
    }

    /// All pixels, by camera and mark.
    fn all_clicked(&self) -> Result<BTreeMap<String, Clicked>, FileError> {
        let mut all: BTreeMap<String, Clicked> = BTreeMap::new();
        let mut count = 0;
        for (camera, clicked) in &self.raw.camera {
            let of_camera = all.entry(camera.clone()).or_default();
            for (name, value) in clicked {
                let place = Place::field("camera").key(camera).key(name);
                let is_line = matches!(self.known(name), Some(Known::OnLine(_)));
                let pixels = self.pixels(&place, value, is_line)?;
                count += pixels.len();
                if count > MOST_CLICKS {
                    let problem = format!("found more than {MOST_CLICKS} clicks");
                    return Err(self.file.error(&place, problem));
                }
                of_camera.insert(name.clone(), pixels);
            }
        }
        Ok(all)
    }

    fn marks(&self) -> Result<Marks, FileError> {
        let mut clicks: BTreeMap<&str, Vec<Click>> = BTreeMap::new();
        for (camera, clicked) in &self.clicked {
            for (name, pixels) in clicked {
                let own = clicks.entry(name).or_default();
                own.extend(pixels.iter().map(|px| (camera.clone(), *px)));
            }
        }
        let known = clicks.iter().filter_map(|(name, clicks)| {
            Some(KnownMark {
                name: (*name).to_owned(),
                known: self.known(name)?,
                clicks: clicks.clone(),
            })
        });
        let known: Vec<KnownMark> = known.collect();
        // A court that is only named does not locate anything.
        let is_clicked = |_: &&Court| {
            known
                .iter()
                .any(|it| self.known_in_court(&it.name).is_some())
        };
        let marks = Marks {
            court: self.court.as_ref().filter(is_clicked).cloned(),
            known,
            floor: self.floor(&clicks)?,
            lengths: self.lengths(&clicks)?,
            click_sigma_px: self.click_sigma_px()?,
            place_sigma_m: self.place_sigma_m()?,
        };
        if marks.known.is_empty() && marks.floor.is_empty() && marks.lengths.is_empty() {
            let problem = "nothing is clicked in this file; expected tables `[camera.NAME]` with marks in pixels";
            return Err(FileError::new(self.file.path(), problem));
        }
        Ok(marks)
    }

    fn floor(&self, clicks: &BTreeMap<&str, Vec<Click>>) -> Result<Vec<ClickedPoint>, FileError> {
        let names = self.raw.floor.iter().enumerate();
        names
            .map(|(index, name)| self.point(clicks, name, &Place::field("floor").index(index)))
            .collect()
    }

    fn check_lengths(&self) -> Result<(), FileError> {
        for (index, it) in self.raw.lengths.iter().enumerate() {
            let is_length = it.length_m > 0.0 && it.length_m <= FARTHEST_M;
            if !is_length || it.between[0] == it.between[1] {
                let problem = format!(
                    "found {} m between `{}` and `{}`, expected more than 0 between two points",
                    it.length_m, it.between[0], it.between[1]
                );
                return Err(self
                    .file
                    .error(&Place::field("lengths").index(index), problem));
            }
        }
        Ok(())
    }

    fn lengths(
        &self,
        clicks: &BTreeMap<&str, Vec<Click>>,
    ) -> Result<Vec<ClickedLength>, FileError> {
        let lengths = self.raw.lengths.iter().enumerate().map(|(index, it)| {
            let place = Place::field("lengths").index(index);
            let place = place.key("between");
            let [first, second] = [0, 1].map(|end| self.point(clicks, &it.between[end], &place));
            Ok(ClickedLength {
                ends: [first?, second?],
                length_m: it.length_m,
            })
        });
        lengths.collect()
    }

    fn point(
        &self,
        clicks: &BTreeMap<&str, Vec<Click>>,
        name: &str,
        place: &Place,
    ) -> Result<ClickedPoint, FileError> {
        let own = clicks.get(name).cloned().unwrap_or_default();
        if own.len() < 2 || matches!(self.known(name), Some(Known::OnLine(_))) {
            let problem = format!(
                "found `{name}` clicked in {} cameras, expected a point clicked in two or more",
                own.len()
            );
            return Err(self.file.error(place, problem));
        }
        Ok(ClickedPoint {
            name: name.to_owned(),
            clicks: own,
        })
    }

    /// One pixel of a point, several of a line.
    fn pixels(
        &self,
        place: &Place,
        value: &toml::Value,
        is_line: bool,
    ) -> Result<Vec<[f64; 2]>, FileError> {
        let number = |value: &toml::Value| {
            let whole = value.as_integer().map(|v| v as f64);
            value.as_float().or(whole).filter(|v| v.abs() <= LARGEST_PX)
        };
        let pixel = |value: &toml::Value| match value.as_array().map(Vec::as_slice) {
            Some([x, y]) => Some([number(x)?, number(y)?]),
            _ => None,
        };
        let found = match (pixel(value), value.as_array()) {
            (Some(px), _) => Some(vec![px]),
            (None, Some(several)) if is_line && !several.is_empty() => {
                several.iter().map(pixel).collect()
            }
            _ => None,
        };
        found.ok_or_else(|| {
            let expected = if is_line {
                "a pixel [x, y], or several"
            } else {
                "one pixel [x, y]"
            };
            self.file
                .error(place, format!("found {value}, expected {expected}"))
        })
    }

    pub(super) fn click_sigma_px(&self) -> Result<f64, FileError> {
        let given = self.raw.click_sigma_px;
        self.sigma("click_sigma_px", given, CLICK_SIGMA_PX, CLICK_SIGMAS_PX)
    }

    pub(super) fn place_sigma_m(&self) -> Result<f64, FileError> {
        let given = self.raw.place_sigma_m;
        self.sigma("place_sigma_m", given, PLACE_SIGMA_M, PLACE_SIGMAS_M)
    }

    fn sigma(
        &self,
        field: &str,
        given: Option<f64>,
        default: f64,
        [least, most]: [f64; 2],
    ) -> Result<f64, FileError> {
        let sigma = given.unwrap_or(default);
        if (least..=most).contains(&sigma) {
            return Ok(sigma);
        }
        let problem = format!("found {sigma}, expected {least} to {most}");
        Err(self.file.error(&Place::field(field), problem))
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const SOUND: &str = r#"
court = "futsal"
floor = ["scratch"]
[places]
door_post = [3.1, -10.2, 0]
[[lengths]]
between = ["red", "blue"]
length_m = 1.0
[camera.north]
corner_north_west = [512.5, 388]
touchline_north = [[400, 361.0], [900.0, 352.5]]
scratch = [801.0, 640.0]
red = [1, 2]
blue = [3, 4]
[camera.south]
scratch = [8.0, 6.0]
red = [1, 2]
blue = [3, 4]
door_post = [7, 7]
"#;

    fn read(text: &str) -> Result<Marks, String> {
        Marks::parse(text, Path::new("marks.toml")).map_err(|error| error.to_string())
    }

    #[test]
    fn marks_lines_floor_and_lengths_are_read() {
        let marks = read(SOUND).unwrap();
        let names: Vec<&str> = marks.known.iter().map(|it| it.name.as_str()).collect();
        assert_eq!(names, ["corner_north_west", "door_post", "touchline_north"]);
        assert_eq!(marks.court.as_ref().map(|it| it.name), Some("futsal"));
        assert_eq!(marks.known[0].known, Known::Place([-20.0, 10.0, 0.0]));
        assert_eq!(marks.known[2].clicks.len(), 2);
        assert_eq!(marks.floor[0].clicks.len(), 2);
        assert_eq!(marks.lengths[0].ends[1].name, "blue");
        let left = marks.without(&["south"]);
        assert!(left.floor.is_empty() && left.lengths.is_empty() && left.known.len() == 2);
    }

    #[test]
    fn errors_have_line_and_field() {
        for (from, to, expected) in [
            (
                "futsal",
                "fustal",
                "marks.toml:2: `court`: unknown court `fustal`, did you mean `futsal`?",
            ),
            (
                "corner_north_west",
                "corner_nort_west",
                "unknown mark `corner_nort_west`, did you mean `corner_north_west`?",
            ),
            (
                "[512.5, 388]",
                "[512.5]",
                "marks.toml:10: `camera.north.corner_north_west`",
            ),
            (
                "[512.5, 388]",
                "[[1, 2], [3, 4]]",
                "expected one pixel [x, y]",
            ),
            ("[512.5, 388]", "[nan, 4]", "expected one pixel [x, y]"),
            (
                "length_m = 1.0",
                "length_m = 0.0",
                "`lengths[0]`: found 0 m",
            ),
            ("[3.1, -10.2, 0]", "[inf, -10.2, 0]", "`places.door_post`"),
            (
                "door_post = [3.1",
                "corner_south_west = [3.1",
                "which the court has",
            ),
            (
                "court = \"futsal\"",
                "court = \"futsal\"\nsize_m = [20, 40]",
                "`size_m`: found a futsal court",
            ),
            (
                "court = \"futsal\"",
                "court = \"futsal\"\nclick_sigma_px = 0",
                "`click_sigma_px`: found 0",
            ),
            (
                "court = \"futsal\"",
                "curt = \"futsal\"",
                "unknown field `curt`",
            ),
        ] {
            let error = read(&SOUND.replacen(from, to, 1)).unwrap_err();
            assert!(error.contains(expected), "{error}");
        }
        let unclicked = SOUND.replacen("[\"scratch\"]", "[\"scratch\", \"dent\"]", 1);
        assert!(
            read(&unclicked)
                .unwrap_err()
                .contains("`floor[1]`: found `dent` clicked in 0 cameras")
        );
        let twice = format!("{SOUND}\n[[lengths]]\nbetween = [\"red\", \"red\"]\nlength_m = 1\n");
        assert!(read(&twice).unwrap_err().contains("between two points"));
        assert!(read("").unwrap_err().contains("nothing is clicked"));
    }

    proptest! {
        #[test]
        fn no_text_causes_a_panic(text in "[a-z_\\[\\]=,.\"0-9 \n-]{0,200}") {
            // Both results are allowed.
            prop_assert!(read(&text).is_ok() || read(&text).is_err());
        }
    }
}
