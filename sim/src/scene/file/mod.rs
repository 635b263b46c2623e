//! The scene file: people, cameras and faults.
//!
//! The parser is strict. An unknown field is refused with the nearest known name; a number out of
//! range is refused with file, line and field. The parser opens no other file; it resolves paths
//! relative to the scene file.

mod check;
mod entries;

use std::path::{Path, PathBuf};

use self::check::Check;
use self::entries::SceneTable;
pub use self::entries::{
    CameraSource, GeneratedCameras, LostEntry, MirrorEntry, PathEntry, PersonEntry, PosterEntry,
};
use crate::fault_profile::FaultProfile;
use farfield_proto::toml_file::{FileError, TomlFile};

/// Largest number of people of a scene.
pub const MAX_PEOPLE: usize = 200;
/// Largest number of mirrors.
pub const MAX_MIRRORS: usize = 8;
/// Largest number of people, reflections and posters together.
pub const MAX_FIGURES: usize = 400;
/// Largest number of cameras.
pub const MAX_CAMERAS: usize = 64;
/// Largest number of ticks: an hour at 60 Hz.
pub const MAX_TICKS: f64 = 216_000.0;
/// Largest sum of all people's seconds; paths are planned when a scene is loaded.
pub const MAX_PERSON_SECONDS: f64 = 20_000.0;

/// The content of a scene file, with all numbers in range.
#[derive(Debug, Clone)]
pub struct SceneFile {
    /// Ticks per second.
    pub rate_hz: f64,
    /// Length, seconds.
    pub seconds: f64,
    /// Seed of every draw.
    pub seed: u64,
    /// Size of the field, x by y, centred on the origin, metres.
    pub size_m: [f64; 2],
    /// Height of the floor under the people above the ground, metres, for a stage. Other heights
    /// are relative to the ground.
    pub floor_m: f64,
    /// The origin of the cameras.
    pub cameras: CameraSource,
    /// The people, in file order.
    pub people: Vec<PersonEntry>,
    /// Mirrors.
    pub mirrors: Vec<MirrorEntry>,
    /// Posters of people.
    pub posters: Vec<PosterEntry>,
    /// Times at which people are hidden.
    pub lost: Vec<LostEntry>,
    /// Whether there is a ball.
    pub ball: bool,
    /// Faults of maps made without pixels.
    pub faults: FaultProfile,
}

impl SceneFile {
    /// All motion clips of the scene.
    pub fn clips(&self) -> impl Iterator<Item = &Path> {
        let of_people = self.people.iter().flat_map(|person| &person.clips);
        let of_posters = self.posters.iter().map(|poster| &poster.clip);
        of_people.chain(of_posters).map(PathBuf::as_path)
    }

    /// Parses a scene. Paths inside `text` are relative to `path`, which errors also name.
    ///
    /// # Errors
    /// [`FileError`] with line and field for broken syntax, a missing, unknown or mistyped field, a
    /// number out of range, and duplicate names.
    pub fn parse(text: &str, path: &Path) -> Result<Self, FileError> {
        let file = TomlFile::parse(text, path)?;
        let raw: SceneTable = file.read()?;
        let check = Check { file: &file };
        check.scene(&raw)?;
        let cameras = check.cameras(&raw)?;
        check.people(&raw)?;
        check.surroundings(&raw)?;
        let leave_default_s = raw.seconds;
        let people = raw.person.into_iter();
        let people = people.map(|person| PersonEntry {
            clips: person.clips.iter().map(|clip| file.resolve(clip)).collect(),
            name: person.name,
            blend_s: person.blend_s,
            at_m: person.at_m,
            heading_rad: person.heading_rad,
            height_m: person.height_m,
            keep_inside: person.keep_inside,
            group: person.group,
            enter_s: person.enter_s,
            leave_s: person.leave_s.unwrap_or(leave_default_s),
            path: person.path,
            seen_by: person.seen_by,
        });
        let posters = raw.poster.into_iter().map(|poster| PosterEntry {
            clip: file.resolve(&poster.clip),
            at_m: poster.at_m,
            heading_rad: poster.heading_rad,
            height_m: poster.height_m,
            time_s: poster.time_s,
        });
        Ok(Self {
            rate_hz: raw.rate_hz,
            seconds: raw.seconds,
            seed: raw.seed,
            size_m: raw.size_m,
            floor_m: raw.floor_m,
            cameras,
            people: people.collect(),
            mirrors: raw.mirror,
            posters: posters.collect(),
            lost: raw.lost,
            ball: raw.ball.is_some(),
            faults: raw.faults,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CAMERAS: &str = "[cameras]\nviewpoints = 4\nper_viewpoint = 2\n";
    const PERSON: &str = "[[person]]\nname = \"1\"\nclips = [\"a.bvh\"]\nheight_m = 1.8\n";

    fn parse(top: &str, rest: &str) -> Result<SceneFile, FileError> {
        let text =
            format!("rate_hz = 60\nseconds = 20\nsize_m = [7, 5]\n{top}{CAMERAS}{PERSON}{rest}");
        SceneFile::parse(&text, Path::new("scenes/a.toml"))
    }

    fn refusal(top: &str, rest: &str) -> String {
        parse(top, rest).unwrap_err().to_string()
    }

    #[test]
    fn omitted_fields_have_their_defaults() {
        let scene = parse("", "").unwrap();
        let CameraSource::Generated(cameras) = &scene.cameras else {
            panic!("{:?}", scene.cameras);
        };
        assert_eq!(cameras.size_px, [1920, 1200]);
        let person = &scene.people[0];
        assert_eq!(person.clips, [Path::new("scenes/a.bvh")]);
        assert!(person.keep_inside && person.path.is_none() && person.group.is_none());
        assert!((person.blend_s - 0.3).abs() < 1e-12 && (person.leave_s - 20.0).abs() < 1e-12);
        assert!(!scene.ball);
        assert_eq!(scene.faults, FaultProfile::none());
    }

    #[test]
    fn an_unknown_field_is_refused_with_the_nearest_name() {
        assert_eq!(
            refusal("", "heigth_m = 1.7\n"),
            "scenes/a.toml:11: `person[0].heigth_m`: unknown field `heigth_m`, did you mean `height_m`?"
        );
        let message = refusal("", "path = { points = [[0, 0]], speed_m_s = 1 }\n");
        assert!(message.contains("did you mean `points_m`?"), "{message}");
        let message = refusal("sed = 3\n", "");
        assert!(message.contains("did you mean `seed`?"), "{message}");
        assert!(refusal("", "[ball]\ncolour = 1\n").contains("unknown field `colour`"));
        assert!(refusal("", "[faults]\nprofil = \"none\"\n").contains("did you mean `profile`?"));
    }

    #[test]
    fn a_number_out_of_its_range_is_refused_with_line_and_field() {
        assert_eq!(
            refusal("", "blend_s = -1\n"),
            "scenes/a.toml:11: `person[0].blend_s`: found -1.0, expected a number from 0 to 10"
        );
        for (wrong, field) in [
            ("at_m = [nan, 0]\n", "person[0].at_m[0]"),
            ("heading_rad = inf\n", "person[0].heading_rad"),
            ("enter_s = 5\nleave_s = 3\n", "person[0].leave_s"),
            (
                "path = { points_m = [], speed_m_s = 1 }\n",
                "person[0].path.points_m",
            ),
            (
                "path = { points_m = [[0, 0]], speed_m_s = 50 }\n",
                "person[0].path.speed_m_s",
            ),
            (
                "path = { points_m = [[0, 0], [1e-3, 0]], speed_m_s = 9 }\n",
                "person[0].path.points_m",
            ),
        ] {
            let error = parse("", wrong).unwrap_err();
            assert_eq!(error.field.as_deref(), Some(field), "{error}");
        }
    }

    #[test]
    fn scenes_over_the_size_limits_are_refused() {
        let text = |rate: &str, seconds: &str| {
            format!("rate_hz = {rate}\nseconds = {seconds}\nsize_m = [7, 5]\n{CAMERAS}")
        };
        for (rate, seconds) in [
            ("0", "1"),
            ("60", "1e9"),
            ("nan", "1"),
            ("60", "-1"),
            ("60", "nan"),
        ] {
            assert!(SceneFile::parse(&text(rate, seconds), Path::new("a.toml")).is_err());
        }
        let crowd: String = (2..210)
            .map(|i| PERSON.replace("\"1\"", &format!("\"{i}\"")))
            .collect();
        assert!(refusal("", &crowd).contains("`person`: found 209, expected from 0 to 200"));
    }

    #[test]
    fn each_mirror_counts_once_per_person() {
        let people: String = (2..=50)
            .map(|i| PERSON.replace("\"1\"", &format!("\"{i}\"")))
            .collect();
        let mirror = "[[mirror]]\nfrom_m = [3, 2]\nto_m = [-3, 2]\nheight_m = 2\n";
        let crowd = |mirrors: usize| people.clone() + &mirror.repeat(mirrors);
        assert!(parse("", &crowd(7)).is_ok());
        let message = refusal("", &crowd(8));
        let expected =
            "`mirror`: found 8, which make 450 figures of 50 people, expected at most 400";
        assert!(message.contains(expected), "{message}");
        let poster =
            "[[poster]]\nat_m = [0, 0]\nheading_rad = 0\nheight_m = 1.8\nclip = \"a.bvh\"\n";
        let message = refusal("", &(crowd(7) + poster));
        assert!(
            message.contains("`poster`: found 1, expected from 0 to 0"),
            "{message}"
        );
    }

    #[test]
    fn names_are_unique() {
        assert!(refusal("", PERSON).contains("`person[1].name`: a second `1`"));
    }

    #[test]
    fn cameras_come_from_one_source() {
        let message = refusal("calibration = \"c.toml\"\n", "");
        assert!(message.contains("expected one of the two"), "{message}");
        let text = "rate_hz = 60\nseconds = 1\nsize_m = [7, 5]\n";
        let message = SceneFile::parse(text, Path::new("a.toml"))
            .unwrap_err()
            .to_string();
        assert!(message.contains("found neither"), "{message}");
    }

    #[test]
    fn viewpoints_have_the_form_of_a_venue_file() {
        let text = "rate_hz = 60\nseconds = 1\nsize_m = [7, 5]\ncalibration = \"c.toml\"\n\
                    [[viewpoint]]\nname = \"north\"\n[[viewpoint.camera]]\nname = \"n1\"\n\
                    source = { kind = \"video\", path = \"n1.mp4\" }\n[[viewpoint.camera]]\nname = \"n2\"\n";
        let scene = SceneFile::parse(text, Path::new("scenes/a.toml")).unwrap();
        let CameraSource::Calibrated {
            calibration,
            viewpoints,
        } = scene.cameras
        else {
            panic!("{:?}", scene.cameras);
        };
        assert_eq!(calibration, Path::new("scenes/c.toml"));
        assert_eq!(
            viewpoints,
            [("north".to_owned(), vec!["n1".to_owned(), "n2".to_owned()])]
        );
    }
}
