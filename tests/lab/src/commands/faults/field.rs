//! The maps of four people that all drives play, and their truth.

use std::path::{Path, PathBuf};

use crate::commands::made_maps::{self, MadeMaps};
use crate::live_venue::RepeatingTruth;
use farfield_sim::embedded;

/// Four people, each in a corner of their own.
const SCENE: &str = include_str!("walkers.toml");

/// What drives play.
pub(super) struct Field {
    pub(super) maps: MadeMaps,
    pub(super) truth: RepeatingTruth,
    pub(super) is_quick: bool,
    folder: PathBuf,
}

impl Field {
    /// Makes it in `folder`.
    pub(super) fn make(folder: &Path, is_quick: bool) -> anyhow::Result<Self> {
        let scene = embedded::write_scene_with_clips(SCENE, "walkers", folder)?;
        let maps = made_maps::make(Some(&scene), folder, &["--there-and-back"], "")?;
        Ok(Self {
            truth: RepeatingTruth::read(&maps.truth)?,
            maps,
            is_quick,
            folder: folder.to_owned(),
        })
    }

    /// How long something is looked at, seconds: `whole`, or in a quick drive `quick`.
    pub(super) fn either(&self, whole: f64, quick: f64) -> f64 {
        if self.is_quick { quick } else { whole }
    }

    /// A folder of that name, empty.
    pub(super) fn folder(&self, name: &str) -> std::io::Result<PathBuf> {
        let folder = self.folder.join("drives").join(name);
        std::fs::create_dir_all(&folder)?;
        Ok(folder)
    }
}
