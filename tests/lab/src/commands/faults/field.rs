//! The scenes of the faults as maps, with their truth: four people who walk, or eight who run.

use std::cell::OnceCell;
use std::path::{Path, PathBuf};

use anyhow::Context as _;

use crate::commands::made_maps::{self, MadeMaps};
use crate::live_venue::RepeatingTruth;
use farfield_sim::embedded;

/// Four people, each in a corner of their own.
const SCENE: &str = include_str!("walkers.toml");
/// Eight people who run across each other's paths at 1.2 to 3.6 m/s, one of them at 8.3 m/s.
const RUNNERS: &str = "futsal";
/// The person in that scene who is faster than 4 m/s.
pub(super) const SPRINTER: u32 = 8;
/// One camera per viewpoint is enough, and one machine plays all of them.
const ONE_CAMERA: [&str; 2] = ["per_viewpoint = 3", "per_viewpoint = 1"];

/// Maps and truth of a scene.
pub(super) struct Field {
    pub(super) maps: MadeMaps,
    pub(super) truth: RepeatingTruth,
    pub(super) is_quick: bool,
    folder: PathBuf,
    /// The runners, made on first use.
    runners: OnceCell<Box<Self>>,
}

impl Field {
    /// Makes the maps in `folder`.
    pub(super) fn make(folder: &Path, is_quick: bool) -> anyhow::Result<Self> {
        Self::of_scene(SCENE, "walkers", folder, is_quick)
    }

    /// The scene of eight people who run.
    pub(super) fn runners(&self) -> anyhow::Result<&Self> {
        if let Some(field) = self.runners.get() {
            return Ok(field);
        }
        let mut scenes = embedded::SCENES.iter();
        let found = scenes.find(|(name, _)| *name == RUNNERS);
        let (_, text) = found.context("the scene of the runners is embedded")?;
        let text = text.replace(ONE_CAMERA[0], ONE_CAMERA[1]);
        let folder = self.folder("runners")?;
        let field = Self::of_scene(&text, "runners", &folder, self.is_quick)?;
        Ok(self.runners.get_or_init(|| Box::new(field)))
    }

    fn of_scene(text: &str, name: &str, folder: &Path, is_quick: bool) -> anyhow::Result<Self> {
        let scene = embedded::write_scene_with_clips(text, name, folder)?;
        let maps = made_maps::make(Some(&scene), folder, &["--there-and-back"], "")?;
        Ok(Self {
            truth: RepeatingTruth::read(&maps.truth)?,
            maps,
            is_quick,
            folder: folder.to_owned(),
            runners: OnceCell::new(),
        })
    }

    /// Duration of an observation, seconds: `whole`, or `quick` with `--quick`.
    pub(super) fn whole_or_quick(&self, whole: f64, quick: f64) -> f64 {
        if self.is_quick { quick } else { whole }
    }

    /// A new folder of that name.
    pub(super) fn folder(&self, name: &str) -> std::io::Result<PathBuf> {
        let folder = self.folder.join("drives").join(name);
        std::fs::create_dir_all(&folder)?;
        Ok(folder)
    }
}
