//! Which scenes a suite has, and where they are: the fixed ones beside the recordings, else a smaller
//! suite on the project's own motion clips.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::Context as _;

use farfield_sim::embedded;
use farfield_sim::motion::Clip;
use farfield_sim::scene::Scene;
use farfield_sim::scene::file::SceneFile;

/// A suite with a name.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Suite {
    /// Its name.
    pub name: &'static str,
    /// The fixed scenes, by file name without the ending.
    pub fixed: &'static [&'static str],
    /// The project's own that stand in for them.
    pub own: &'static [&'static str],
    /// The project's own that run in any case: what they probe no fixed scene does.
    pub probes: &'static [&'static str],
}

/// A fixed scene to which something is added.
struct SceneVariant {
    name: &'static str,
    of: &'static str,
    /// TOML that is added to the file's.
    added: &'static str,
}

const VARIANTS: [SceneVariant; 1] = [SceneVariant {
    name: "futsal-lost",
    of: "futsal",
    added: include_str!("../../../scenes/lost-in-futsal.toml"),
}];

/// All suites.
pub const SUITES: [Suite; 3] = [
    Suite {
        name: "paper",
        fixed: &["a", "b", "c", "d", "e", "f", "g", "h", "futsal", "sprint"],
        own: &OWN,
        probes: &[],
    },
    Suite {
        name: "identity",
        fixed: &["hug", "futsal-lost", "enter", "cross", "stadium"],
        own: &["hug", "lost", "enter", "cross"],
        probes: &["mirror", "poster", "return", "scrum", "blocked"],
    },
    Suite {
        name: "own",
        fixed: &[],
        own: &OWN,
        probes: &[],
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
pub struct NamedScene {
    /// The file's name without its ending.
    pub name: String,
    /// The scene.
    pub scene: Scene,
}

/// The scenes that were asked for.
pub struct ChosenScenes {
    /// In the order asked.
    pub scenes: Vec<NamedScene>,
    /// What a reader of the figures must know: that other scenes stand in or are left out, and why.
    pub note: Option<String>,
}

/// The scenes of a suite's name, of variants of fixed scenes, or of scene files. `root` holds the folder `scenes`.
///
/// # Errors
/// When neither a suite nor a file has the name, or a scene that is there cannot be read.
pub fn choose(asked: &[String], root: &Path) -> anyhow::Result<ChosenScenes> {
    let mut chosen = ChosenScenes {
        scenes: Vec::new(),
        note: None,
    };
    for name in asked {
        match SUITES.iter().find(|suite| suite.name == name) {
            Some(suite) => suite.add(root, &mut chosen)?,
            None if VARIANTS.iter().any(|variant| variant.name == name) => {
                chosen.scenes.push(fixed(root, name)?);
            }
            None => chosen.scenes.push(one(name)?),
        }
    }
    Ok(chosen)
}

impl ChosenScenes {
    /// Leaves out the scenes that pictures cannot show, those with mirrors, and says so in the note.
    pub fn leave_out_what_pictures_cannot_show(&mut self) {
        let mut left_out = Vec::new();
        self.scenes.retain(|NamedScene { name, scene }| {
            let is_shown = scene.mirrors().is_empty();
            if !is_shown {
                left_out.push(name.clone());
            }
            is_shown
        });
        if left_out.is_empty() {
            return;
        }
        let left_out = format!(
            "left out, as pictures cannot show mirrors: {}",
            left_out.join(", ")
        );
        self.note = Some(match self.note.take() {
            Some(note) => format!("{note}; {left_out}"),
            None => left_out,
        });
    }
}

impl Suite {
    fn add(&self, root: &Path, chosen: &mut ChosenScenes) -> anyhow::Result<()> {
        let own = |name: &&str| -> anyhow::Result<NamedScene> {
            let scene = embedded::scene(name)?;
            let name = format!("own {name}");
            Ok(NamedScene { name, scene })
        };
        for name in self.probes {
            chosen.scenes.push(own(name)?);
        }
        let missing = self.fixed.iter().find_map(|name| missing_of(root, name));
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
                chosen.scenes.push(own(name)?);
            }
            return Ok(());
        }
        for name in self.fixed {
            chosen.scenes.push(fixed(root, name)?);
        }
        Ok(())
    }
}

/// The file of a fixed scene or of a variant of one, and what is added to it.
fn file_of(root: &Path, name: &str) -> (PathBuf, &'static str) {
    let variant = VARIANTS.iter().find(|variant| variant.name == name);
    let (of, added) = variant.map_or((name, ""), |variant| (variant.of, variant.added));
    let file = root.join("scenes").join(of).with_extension("toml");
    (file, added)
}

fn fixed(root: &Path, name: &str) -> anyhow::Result<NamedScene> {
    let (file, added) = file_of(root, name);
    let text =
        std::fs::read_to_string(&file).with_context(|| format!("reading {}", file.display()))?;
    let text = format!("{text}\n{added}");
    let load = &mut |clip: &Path| Ok(Arc::new(Clip::load(clip)?));
    Ok(NamedScene {
        name: name.to_owned(),
        scene: Scene::parse(&text, &file, load)?,
    })
}

/// The first file that a fixed scene needs and that is not there: itself or a clip.
fn missing_of(root: &Path, name: &str) -> Option<PathBuf> {
    let (file, _) = file_of(root, name);
    let Ok(text) = std::fs::read_to_string(&file) else {
        return Some(file);
    };
    // What is wrong in it is said when it is read.
    let scene = SceneFile::parse(&text, &file).ok()?;
    let missing = scene.clips().find(|clip| !clip.exists());
    missing.map(Path::to_owned)
}

fn one(name: &str) -> anyhow::Result<NamedScene> {
    let path = Path::new(name);
    let suites = SUITES.map(|suite| suite.name).join(", ");
    if !path.exists() {
        let own = embedded::scene(name);
        let scene = own.ok().with_context(|| {
            format!("`{name}` is neither a suite ({suites}) nor a scene file that is there")
        })?;
        let name = format!("own {name}");
        return Ok(NamedScene { name, scene });
    }
    let stem = path.file_stem().unwrap_or_default();
    Ok(NamedScene {
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
    fn what_pictures_cannot_show_is_left_out_and_it_is_said() {
        let mut chosen = choose(&["identity".to_owned()], Path::new("nowhere")).unwrap();
        let all = chosen.scenes.len();
        chosen.leave_out_what_pictures_cannot_show();
        assert_eq!(chosen.scenes.len(), all - 1);
        let note = chosen.note.unwrap();
        assert!(note.contains("hug.toml is not there"), "{note}");
        assert!(note.ends_with("mirrors: own mirror"), "{note}");
        let mut shown = choose(&["hug".to_owned()], Path::new("nowhere")).unwrap();
        shown.leave_out_what_pictures_cannot_show();
        assert_eq!((shown.scenes.len(), shown.note), (1, None));
    }

    #[test]
    fn a_missing_clip_is_a_missing_scene() {
        let dir = tempfile::tempdir().unwrap();
        let scenes = dir.path().join("scenes");
        std::fs::create_dir(&scenes).unwrap();
        for name in SUITES[0].fixed {
            let text = farfield_sim::embedded::SCENES[0].1;
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
