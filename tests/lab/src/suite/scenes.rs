//! The scenes of the suites, and their files: the fixed ones next to the recordings, else a smaller suite of the project's own
//! motion clips.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::Context as _;

use farfield_proto::toml_file::FileError;
use farfield_sim::embedded;
use farfield_sim::motion::Clip;
use farfield_sim::scene::Scene;
use farfield_sim::scene::file::SceneFile;

use crate::conditions::Cuts;

/// A suite with a name.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Suite {
    /// Its name.
    pub name: &'static str,
    /// The fixed scenes, by file name without extension.
    pub fixed: &'static [&'static str],
    /// The project's own scenes that replace them.
    pub own: &'static [&'static str],
    /// The project's own scenes that always run, since no fixed scene tests the same.
    pub probes: &'static [&'static str],
}

/// A scene with an addition: of a fixed scene, or of the project's own.
struct SceneVariant {
    name: &'static str,
    base: &'static str,
    /// TOML that is added to the file.
    added: &'static str,
    /// Duration of each of ten cuts of all links, seconds.
    cut_s: Option<f64>,
}

const fn added(name: &'static str, base: &'static str, added: &'static str) -> SceneVariant {
    SceneVariant {
        name,
        base,
        added,
        cut_s: None,
    }
}

const fn cut(name: &'static str, base: &'static str, cut_s: f64) -> SceneVariant {
    SceneVariant {
        name,
        base,
        added: "",
        cut_s: Some(cut_s),
    }
}

const VARIANTS: [SceneVariant; 11] = [
    added(
        "futsal-lost",
        "futsal",
        include_str!("../../../../sim/scenes/lost-in-futsal.toml"),
    ),
    added("h-lost", "h", ALL_LOST),
    added("five-inverted-lost", "five-inverted", ALL_LOST),
    cut("futsal-cut-0.3", "futsal", 0.3),
    cut("futsal-cut-0.7", "futsal", 0.7),
    cut("futsal-cut-1", "futsal", 1.0),
    cut("futsal-cut-3", "futsal", 3.0),
    cut("five-cut-0.3", "five", 0.3),
    cut("five-cut-0.7", "five", 0.7),
    cut("five-cut-1", "five", 1.0),
    cut("five-cut-3", "five", 3.0),
];

const ALL_LOST: &str = include_str!("../../../../sim/scenes/all-lost.toml");

/// Number of cuts.
const CUTS: f64 = 10.0;
/// Time between cuts, seconds: longer than it takes to recognise all people again.
const HOLD_S: f64 = 1.8;

/// All suites.
pub const SUITES: [Suite; 4] = [
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
        name: "hiccups",
        fixed: &[
            "h-lost",
            "futsal-cut-0.3",
            "futsal-cut-0.7",
            "futsal-cut-1",
            "futsal-cut-3",
        ],
        own: &[
            "five-inverted-lost",
            "futsal-cut-0.3",
            "futsal-cut-0.7",
            "futsal-cut-1",
            "futsal-cut-3",
        ],
        probes: &["side-by-side", "long-hug", "stage"],
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

/// A scene with its name, before changes by its user.
pub struct NamedScene {
    /// The file name without extension.
    pub name: String,
    /// The scene.
    pub scene: Scene,
    /// Cuts of all links.
    pub cuts: Option<Cuts>,
}

/// The requested scenes.
pub struct ChosenScenes {
    /// In the requested order.
    pub scenes: Vec<NamedScene>,
    /// Note for readers of the figures: which scenes are replaced or left out, and why.
    pub note: Option<String>,
}

/// The scenes of suites, of variants of fixed scenes, or of scene files. `root` contains the folder `scenes`.
///
/// # Errors
/// There is neither a suite nor a file of that name, or a scene cannot be read.
pub fn choose(requested: &[String], root: &Path) -> anyhow::Result<ChosenScenes> {
    let mut chosen = ChosenScenes {
        scenes: Vec::new(),
        note: None,
    };
    for name in requested {
        match SUITES.iter().find(|suite| suite.name == name) {
            Some(suite) => suite.add(root, &mut chosen)?,
            None if variant(name).is_some() && missing_of(root, name).is_none() => {
                chosen.scenes.push(fixed(root, name)?);
            }
            None => chosen.scenes.push(one(name)?),
        }
    }
    Ok(chosen)
}

impl ChosenScenes {
    /// Removes scenes with mirrors, which images cannot show, and adds this to the note.
    pub fn leave_out_mirrors(&mut self) {
        let mut left_out = Vec::new();
        self.scenes.retain(|NamedScene { name, scene, .. }| {
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

fn variant(name: &str) -> Option<&'static SceneVariant> {
    VARIANTS.iter().find(|variant| variant.name == name)
}

impl SceneVariant {
    /// The scene file of the variant, from `text`; it lasts until all cuts are over.
    fn text(&self, text: &str) -> String {
        let Some(cut_s) = self.cut_s else {
            return format!("{text}\n{}", self.added);
        };
        let seconds = (CUTS + 1.0) * (cut_s + HOLD_S);
        let line = |line: &str| {
            if line.starts_with("seconds = ") {
                format!("seconds = {seconds:?}\n")
            } else {
                format!("{line}\n")
            }
        };
        text.lines().map(line).collect()
    }

    fn cuts(&self, rate_hz: f64) -> Option<Cuts> {
        let ticks = |seconds: f64| (seconds * rate_hz).round() as i64;
        let cut_s = self.cut_s?;
        Some(Cuts {
            every: ticks(cut_s + HOLD_S),
            lasts: ticks(cut_s),
            late: None,
        })
    }
}

/// The file of a fixed scene, or of the scene that `name` is a variant of.
fn file_of(root: &Path, name: &str) -> PathBuf {
    let base = variant(name).map_or(name, |variant| variant.base);
    root.join("scenes").join(base).with_extension("toml")
}

fn fixed(root: &Path, name: &str) -> anyhow::Result<NamedScene> {
    let file = file_of(root, name);
    let text =
        std::fs::read_to_string(&file).with_context(|| format!("reading {}", file.display()))?;
    let variant = variant(name);
    let text = variant.map_or(text.clone(), |variant| variant.text(&text));
    let load = &mut |clip: &Path| Ok(Arc::new(Clip::load(clip)?));
    let scene = Scene::parse(&text, &file, load)?;
    Ok(NamedScene {
        name: name.to_owned(),
        cuts: variant.and_then(|variant| variant.cuts(scene.rate_hz())),
        scene,
    })
}

/// The project's own scene, or a variant of one.
fn own(name: &str) -> Result<NamedScene, FileError> {
    let base = variant(name).map_or(name, |variant| variant.base);
    let known = embedded::SCENES.iter().find(|(known, _)| *known == base);
    let scene = match (variant(name), known) {
        (Some(variant), Some((_, text))) => {
            let path = Path::new("scenes").join(base).with_extension("toml");
            embedded::with_clips(&variant.text(text), &path)?
        }
        _ => embedded::scene(name)?,
    };
    Ok(NamedScene {
        name: format!("own {name}"),
        cuts: variant(name).and_then(|variant| variant.cuts(scene.rate_hz())),
        scene,
    })
}

/// The first missing file of a fixed scene: itself or a clip.
fn missing_of(root: &Path, name: &str) -> Option<PathBuf> {
    let file = file_of(root, name);
    let Ok(text) = std::fs::read_to_string(&file) else {
        return Some(file);
    };
    // Faults in it are reported when it is read.
    let scene = SceneFile::parse(&text, &file).ok()?;
    let missing = scene.clips().find(|clip| !clip.exists());
    missing.map(Path::to_owned)
}

fn one(name: &str) -> anyhow::Result<NamedScene> {
    let path = Path::new(name);
    let suites = SUITES.map(|suite| suite.name).join(", ");
    if !path.exists() {
        return own(name).ok().with_context(|| {
            format!("`{name}` is neither a suite ({suites}) nor a scene file that is there")
        });
    }
    let stem = path.file_stem().unwrap_or_default();
    Ok(NamedScene {
        name: stem.to_string_lossy().into_owned(),
        scene: Scene::load(path)?,
        cuts: None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn own_scenes_replace_missing_fixed_ones_with_a_note() {
        let chosen = choose(&["paper".to_owned()], Path::new("nowhere")).unwrap();
        assert_eq!(chosen.scenes.len(), OWN.len());
        let note = chosen.note.unwrap();
        assert!(note.contains("a.toml is not there"), "{note}");
    }

    #[test]
    fn scenes_with_mirrors_are_left_out_with_a_note() {
        let mut chosen = choose(&["identity".to_owned()], Path::new("nowhere")).unwrap();
        let all = chosen.scenes.len();
        chosen.leave_out_mirrors();
        assert_eq!(chosen.scenes.len(), all - 1);
        let note = chosen.note.unwrap();
        assert!(note.contains("hug.toml is not there"), "{note}");
        assert!(note.ends_with("mirrors: own mirror"), "{note}");
        let mut shown = choose(&["hug".to_owned()], Path::new("nowhere")).unwrap();
        shown.leave_out_mirrors();
        assert_eq!((shown.scenes.len(), shown.note), (1, None));
    }

    #[test]
    fn links_are_cut_ten_times_within_the_scene() {
        for name in ["futsal-cut-0.3", "futsal-cut-3"] {
            let chosen = choose(&[name.to_owned()], Path::new("nowhere")).unwrap();
            let [NamedScene { name, scene, cuts }] = chosen.scenes.as_slice() else {
                panic!("one scene");
            };
            assert!(name.starts_with("own futsal-cut"));
            let cuts: Vec<_> = cuts.unwrap().within(&scene.ticks()).collect();
            let whole = cuts.iter().filter(|[_, until]| *until < scene.ticks().end);
            assert_eq!(whole.count(), 10);
        }
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
    fn the_own_suite_has_no_note_and_unknown_names_are_refused() {
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
