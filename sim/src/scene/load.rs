//! Loads the files of a scene (cameras, clips, posters) and numbers its people for the truth.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use farfield_proto::calibration::Calibration;
use farfield_proto::toml_file::{FileError, Place, TomlFile, unknown_name};
use rand::RngExt as _;

use super::SceneViewpoint;
use super::cameras::{self, CameraRig};
use super::file::{CameraSource, MAX_PEOPLE, SceneFile};
use super::poster::Poster;
use super::{Purpose, draws};
use crate::motion::Clip;

pub(super) fn read(path: &Path) -> Result<String, FileError> {
    fs::read_to_string(path).map_err(|e| FileError::new(path, format!("cannot be read: {e}")))
}

pub(super) fn mount(file: &SceneFile, toml: &TomlFile<'_>) -> Result<CameraRig, FileError> {
    let (calibration, viewpoints) = match &file.cameras {
        CameraSource::Generated(wanted) => {
            return cameras::generate(wanted, file.size_m, file.floor_m, file.seed)
                .map_err(|problem| toml.error(&Place::field("cameras"), problem));
        }
        CameraSource::Calibrated {
            calibration,
            viewpoints,
        } => (calibration, viewpoints),
    };
    let text = read(calibration).map_err(|error| {
        let problem = format!("{error}; its path is relative to the folder of the scene file");
        toml.error(&Place::field("calibration"), problem)
    })?;
    let calibration = Calibration::parse(&text, calibration)?;
    let mut rig = CameraRig::default();
    for (i, (name, cameras)) in viewpoints.iter().enumerate() {
        let first = rig.cameras.len();
        for (j, camera) in cameras.iter().enumerate() {
            let Some(model) = calibration.cameras.get(camera) else {
                let known: Vec<&str> = calibration.cameras.keys().map(String::as_str).collect();
                let place = Place::field("viewpoint").index(i).key("camera").index(j);
                return Err(toml.error(&place.key("name"), unknown_name("camera", camera, &known)));
            };
            rig.cameras.push(model.clone());
        }
        rig.viewpoints.push(SceneViewpoint {
            name: name.clone(),
            cameras: (first..rig.cameras.len()).collect(),
        });
    }
    Ok(rig)
}

type LoadClip<'a> = &'a mut dyn FnMut(&Path) -> Result<Arc<Clip>, FileError>;

/// The clips of a scene; each file is read once.
pub(super) struct Clips<'a> {
    load: LoadClip<'a>,
    loaded: BTreeMap<PathBuf, Arc<Clip>>,
}

impl<'a> Clips<'a> {
    pub(super) fn new(load: LoadClip<'a>) -> Self {
        let loaded = BTreeMap::new();
        Self { load, loaded }
    }

    /// The clip at `path`. `place` is its field in the scene file; errors name it, because many
    /// scenes may share a clip.
    fn get(
        &mut self,
        path: &Path,
        toml: &TomlFile<'_>,
        place: &Place,
    ) -> Result<Arc<Clip>, FileError> {
        if let Some(clip) = self.loaded.get(path) {
            return Ok(Arc::clone(clip));
        }
        let clip = (self.load)(path).map_err(|error| {
            let remedy = if path.is_file() {
                ""
            } else {
                "; the path of a clip is relative to the folder of the scene file"
            };
            toml.error(place, format!("{error}{remedy}"))
        })?;
        self.loaded.insert(path.to_owned(), Arc::clone(&clip));
        Ok(clip)
    }

    /// The clips of every person.
    pub(super) fn for_people(
        &mut self,
        file: &SceneFile,
        toml: &TomlFile<'_>,
    ) -> Result<Vec<Vec<Arc<Clip>>>, FileError> {
        let mut all = Vec::new();
        for (person, entry) in file.people.iter().enumerate() {
            let place = Place::field("person").index(person).key("clips");
            let clips = entry.clips.iter().enumerate();
            let clips = clips.map(|(i, path)| self.get(path, toml, &place.index(i)));
            all.push(clips.collect::<Result<_, _>>()?);
        }
        Ok(all)
    }
}

/// The posters. Their bodies use draws that no person of the scene uses.
pub(super) fn load_posters(
    file: &SceneFile,
    toml: &TomlFile<'_>,
    clips: &mut Clips<'_>,
) -> Result<Vec<Poster>, FileError> {
    let posters = file.posters.iter().enumerate();
    posters
        .map(|(index, entry)| {
            let seed = draws(file.seed, Purpose::Build, MAX_PEOPLE + index).random();
            let place = Place::field("poster").index(index).key("clip");
            let clip = clips.get(&entry.clip, toml, &place)?;
            Ok(Poster::new(entry, &clip, seed))
        })
        .collect()
}

/// The numbers of people in truth files: their names if all are distinct numbers, else 1, 2, ...
pub(super) fn truth_numbers(file: &SceneFile) -> Vec<u32> {
    let written: Option<Vec<u32>> = file
        .people
        .iter()
        .map(|person| person.name.parse().ok().filter(|n| *n > 0))
        .collect();
    let counted = || (1..).take(file.people.len()).collect();
    // "1" and "01" are two names but one number.
    let distinct = |numbers: &Vec<u32>| {
        let unique: std::collections::BTreeSet<_> = numbers.iter().collect();
        unique.len() == numbers.len()
    };
    written.filter(distinct).unwrap_or_else(counted)
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::super::Scene;
    use crate::embedded::CLIPS;

    /// The error for a scene with the text `added`, next to a clip `walk.bvh` with the text `walk`.
    fn refusal(walk: &str, added: &str) -> String {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("walk.bvh"), walk).unwrap();
        let scene = folder.path().join("scene.toml");
        let text = format!(
            "rate_hz = 60\nseconds = 4\nsize_m = [7, 5]\n{added}[[person]]\nname = \"1\"\nheight_m = 1.8\nclips = [\n\
             \"walk.bvh\",\n\"clips/runn.bvh\",\n]\n"
        );
        fs::write(&scene, text).unwrap();
        Scene::load(&scene).unwrap_err().to_string()
    }

    const CAMERAS: &str = "[cameras]\nviewpoints = 4\nper_viewpoint = 1\n";

    fn check(message: &str, parts: &[&str]) {
        for part in parts {
            assert!(message.contains(part), "{message}\nexpected: {part}");
        }
    }

    #[test]
    fn a_missing_clip_is_refused_with_line_and_searched_path() {
        let message = refusal(CLIPS[0].1, CAMERAS);
        check(
            &message,
            &[
                "scene.toml:12: `person[0].clips[1]`: ",
                "runn.bvh: cannot be read",
                "expected a motion clip (BVH)",
                "is relative to the folder of the scene file",
            ],
        );
        let poster =
            "[[poster]]\nat_m = [0, 0]\nheading_rad = 0\nheight_m = 1.8\nclip = \"none.bvh\"\n";
        let message = refusal(CLIPS[0].1, &format!("{CAMERAS}{poster}"));
        check(&message, &["scene.toml:11: `poster[0].clip`: ", "none.bvh"]);
    }

    #[test]
    fn an_invalid_clip_is_refused_with_the_line_of_the_scene() {
        let message = refusal("nothing\n", CAMERAS);
        check(
            &message,
            &["scene.toml:11: `person[0].clips[0]`: ", "walk.bvh"],
        );
        assert!(!message.contains("is relative to"), "{message}");
    }

    #[test]
    fn a_missing_calibration_is_refused_with_the_line_of_the_scene() {
        let cameras = "calibration = \"hall.toml\"\n[[viewpoint]]\nname = \"west\"\n[[viewpoint.camera]]\nname = \"a\"\n";
        let message = refusal(CLIPS[0].1, cameras);
        check(
            &message,
            &["scene.toml:4: `calibration`: ", "hall.toml: cannot be read"],
        );
    }
}
