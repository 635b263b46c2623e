//! What a scene file names and numbers: its text, cameras, clips, posters, and who is who in the truth.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use farfield_proto::calibration::Calibration;
use farfield_proto::toml_file::{FileError, Place, TomlFile, unknown_name};
use rand::RngExt as _;

use super::SceneViewpoint;
use super::cameras::{self, CameraRig};
use super::draws::{Purpose, draws};
use super::file::{CameraSource, MAX_PEOPLE, SceneFile};
use super::poster::Poster;
use crate::motion::Clip;

/// The text of a file.
pub(super) fn read(path: &Path) -> Result<String, FileError> {
    fs::read_to_string(path).map_err(|e| FileError::new(path, format!("cannot be read: {e}")))
}

/// The cameras of a scene.
pub(super) fn mount(file: &SceneFile, toml: &TomlFile<'_>) -> Result<CameraRig, FileError> {
    let (calibration, viewpoints) = match &file.cameras {
        CameraSource::Generated(wanted) => {
            return cameras::generate(wanted, (file.size_m, file.floor_m), file.seed)
                .map_err(|problem| toml.error(&Place::field("cameras"), problem));
        }
        CameraSource::Calibrated {
            calibration,
            viewpoints,
        } => (calibration, viewpoints),
    };
    let calibration = Calibration::parse(&read(calibration)?, calibration)?;
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

/// How a clip is read.
type LoadClip<'a> = &'a mut dyn FnMut(&Path) -> Result<Arc<Clip>, FileError>;

/// The clips of a scene, each file read once.
pub(super) struct Clips<'a> {
    load: LoadClip<'a>,
    loaded: BTreeMap<PathBuf, Arc<Clip>>,
}

impl<'a> Clips<'a> {
    pub(super) fn new(load: LoadClip<'a>) -> Self {
        let loaded = BTreeMap::new();
        Self { load, loaded }
    }

    fn get(&mut self, path: &Path) -> Result<Arc<Clip>, FileError> {
        if let Some(clip) = self.loaded.get(path) {
            return Ok(Arc::clone(clip));
        }
        let clip = (self.load)(path)?;
        self.loaded.insert(path.to_owned(), Arc::clone(&clip));
        Ok(clip)
    }

    /// Those of every person.
    pub(super) fn of_people(&mut self, file: &SceneFile) -> Result<Vec<Vec<Arc<Clip>>>, FileError> {
        let people = file.people.iter();
        people
            .map(|person| person.clips.iter().map(|path| self.get(path)).collect())
            .collect()
    }
}

/// The posters, whose people are built by draws that no person of the scene has.
pub(super) fn posters_of(
    file: &SceneFile,
    clips: &mut Clips<'_>,
) -> Result<Vec<Poster>, FileError> {
    let posters = file.posters.iter().enumerate();
    posters
        .map(|(index, entry)| {
            let seed = draws(file.seed, Purpose::Build, MAX_PEOPLE + index).random();
            Ok(Poster::new(entry, &*clips.get(&entry.clip)?, seed))
        })
        .collect()
}

/// The numbers of people in truth files.
pub(super) fn numbers_of(file: &SceneFile) -> Vec<u32> {
    let written: Option<Vec<u32>> = file
        .people
        .iter()
        .map(|person| person.name.parse().ok().filter(|n| *n > 0))
        .collect();
    let counted = || (1..).take(file.people.len()).collect();
    // "1" and "01" are two names, and one number.
    let distinct = |numbers: &Vec<u32>| {
        let unique: std::collections::BTreeSet<_> = numbers.iter().collect();
        unique.len() == numbers.len()
    };
    written.filter(distinct).unwrap_or_else(counted)
}
