//! Which scenes a suite has, and where they are: the fixed ones beside the recordings, else a smaller
//! suite on the project's own motion clips.

use std::path::{Path, PathBuf};

use anyhow::Context as _;

use crate::embedded;
use crate::scene::Scene;
use crate::scene::file::SceneFile;

/// A suite with a name.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Suite {
    /// Its name.
    pub name: &'static str,
    /// The fixed scenes, by file name without the ending.
    pub fixed: &'static [&'static str],
    /// The project's own that stand in for them.
    pub own: &'static [&'static str],
}

/// All suites.
pub const SUITES: [Suite; 3] = [
    Suite {
        name: "paper",
        fixed: &["a", "b", "c", "d", "e", "f", "g", "h", "futsal", "sprint"],
        own: &OWN,
    },
    Suite {
        name: "identity",
        fixed: &["enter", "hug", "cross", "stadium"],
        own: &["enter", "cross"],
    },
    Suite {
        name: "own",
        fixed: &[],
        own: &OWN,
    },
];

const OWN: [&str; 8] = [
    "one",
    "inverted",
    "facing",
    "facing-inverted",
    "five",
    "five-inverted",
    "futsal",
    "sprint",
];

/// A scene with its name, before it is changed by whoever runs it.
pub struct Named {
    /// The file's name without its ending.
    pub name: String,
    /// The scene.
    pub scene: Scene,
}

/// The scenes that were asked for.
pub struct Chosen {
    /// In the order asked.
    pub scenes: Vec<Named>,
    /// What a reader of the figures must know: that other scenes stand in, and why.
    pub note: Option<String>,
}

/// The scenes of a suite's name, or of scene files. `root` holds the folder `scenes`.
///
/// # Errors
/// When neither a suite nor a file has the name, or a scene that is there cannot be read.
pub fn choose(asked: &[String], root: &Path) -> anyhow::Result<Chosen> {
    let mut chosen = Chosen {
        scenes: Vec::new(),
        note: None,
    };
    for name in asked {
        match SUITES.iter().find(|suite| suite.name == name) {
            Some(suite) => suite.add(root, &mut chosen)?,
            None => chosen.scenes.push(one(name)?),
        }
    }
    Ok(chosen)
}

impl Suite {
    fn add(&self, root: &Path, chosen: &mut Chosen) -> anyhow::Result<()> {
        let files: Vec<PathBuf> = self
            .fixed
            .iter()
            .map(|name| root.join("scenes").join(name).with_extension("toml"))
            .collect();
        let missing = files.iter().find_map(|file| missing_of(file));
        if self.fixed.is_empty() || missing.is_some() {
            chosen.note = missing.map(|path| {
                format!(
                    "{} is not there: the suite `{}` runs on {} scenes of the project's own motion clips instead (FARFIELD_DATA names the folder with `scenes` and `data`)",
                    path.display(),
                    self.name,
                    self.own.len()
                )
            });
            for name in self.own {
                let scene = embedded::scene(name)?;
                let name = format!("own {name}");
                chosen.scenes.push(Named { name, scene });
            }
            return Ok(());
        }
        for (name, file) in self.fixed.iter().zip(&files) {
            let scene = Scene::load(file)?;
            let name = (*name).to_owned();
            chosen.scenes.push(Named { name, scene });
        }
        Ok(())
    }
}

/// The first file that a scene needs and that is not there: itself or a clip.
fn missing_of(file: &Path) -> Option<PathBuf> {
    let Ok(text) = std::fs::read_to_string(file) else {
        return Some(file.to_owned());
    };
    // What is wrong in it is said when it is read.
    let scene = SceneFile::parse(&text, file).ok()?;
    let mut clips = scene.people.into_iter().flat_map(|person| person.clips);
    clips.find(|clip| !clip.exists())
}

fn one(name: &str) -> anyhow::Result<Named> {
    let path = Path::new(name);
    let suites = SUITES.map(|suite| suite.name).join(", ");
    if !path.exists() {
        let own = embedded::scene(name);
        let scene = own.ok().with_context(|| {
            format!("`{name}` is neither a suite ({suites}) nor a scene file that is there")
        })?;
        let name = format!("own {name}");
        return Ok(Named { name, scene });
    }
    let stem = path.file_stem().unwrap_or_default();
    Ok(Named {
        name: stem.to_string_lossy().into_owned(),
        scene: Scene::load(path)?,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn without_the_fixed_scenes_the_own_stand_in_and_it_is_said() {
        let chosen = choose(&["paper".to_owned()], Path::new("nowhere")).unwrap();
        assert_eq!(chosen.scenes.len(), OWN.len());
        let note = chosen.note.unwrap();
        assert!(note.contains("a.toml is not there"), "{note}");
        assert!(note.contains("own motion clips"), "{note}");
    }

    #[test]
    fn a_missing_clip_is_a_missing_scene() {
        let dir = tempfile::tempdir().unwrap();
        let scenes = dir.path().join("scenes");
        std::fs::create_dir(&scenes).unwrap();
        for name in SUITES[0].fixed {
            let text = crate::embedded::SCENES[0].1;
            std::fs::write(scenes.join(name).with_extension("toml"), text).unwrap();
        }
        let chosen = choose(&["paper".to_owned()], dir.path()).unwrap();
        assert!(chosen.note.unwrap().contains(".bvh is not there"));
    }

    #[test]
    fn the_own_suite_needs_no_excuse_and_an_unknown_name_is_refused() {
        let own = choose(&["own".to_owned()], Path::new("nowhere")).unwrap();
        assert!(own.note.is_none());
        let refused = choose(&["papr".to_owned()], Path::new("nowhere"));
        let refused = refused.err().unwrap().to_string();
        assert!(
            refused.contains("papr") && refused.contains("paper"),
            "{refused}"
        );
    }
}
