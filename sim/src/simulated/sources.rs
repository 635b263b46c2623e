//! All kinds of sources: those that an edge supports by itself, and simulated ones.

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use farfield_edge::source::{
    FrameSource, RecordedSources, SourceError, SourceInfo, SourceOrigin, Sources,
};
use farfield_proto::camera::CameraModel;
use farfield_proto::tick::Tick;
use farfield_proto::toml_file::{FileError, unknown_name};
use farfield_proto::venue::{Source, Venue, VenueCamera};

use super::SimulatedSource;
use crate::faults::SceneCrowd;
use crate::maps_file::{MapsFile, MapsSource, load, same_rate, ticks_of};
use crate::scene::Scene;

/// Opens recorded, live and simulated sources, and precomputed maps. Scenes and maps are read once.
#[derive(Debug, Default)]
pub struct VenueSources {
    recorded: RecordedSources,
    /// The people of every scene, by its file.
    crowds: Mutex<BTreeMap<PathBuf, Arc<SceneCrowd>>>,
    /// Precomputed maps, by their file.
    maps: Mutex<BTreeMap<PathBuf, Arc<MapsFile>>>,
}

/// A camera of a scene that matches the venue's.
struct Simulated {
    crowd: Arc<SceneCrowd>,
    camera: usize,
    /// Ticks of the venue.
    ticks: Range<Tick>,
}

impl VenueSources {
    fn crowd(&self, path: &Path) -> Result<Arc<SceneCrowd>, FileError> {
        let mut crowds = self.crowds.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(crowd) = crowds.get(path) {
            return Ok(Arc::clone(crowd));
        }
        let crowd = Arc::new(SceneCrowd::new(Arc::new(Scene::load(path)?)));
        crowds.insert(path.to_owned(), Arc::clone(&crowd));
        Ok(crowd)
    }

    fn maps(
        &self,
        path: &Path,
        camera: &VenueCamera,
        venue: &Venue,
    ) -> Result<Arc<MapsFile>, SourceError> {
        let mut maps = self.maps.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(file) = maps.get(path) {
            return Ok(Arc::clone(file));
        }
        let file = Arc::new(load(path, camera, venue)?);
        maps.insert(path.to_owned(), Arc::clone(&file));
        Ok(file)
    }

    /// Finds the scene's camera and refuses one that does not match the venue.
    fn simulated(
        &self,
        path: &Path,
        camera: &VenueCamera,
        venue: &Venue,
    ) -> Result<Simulated, SourceError> {
        let name = camera.model.name();
        let wrong = |problem: String| SourceError::Scene {
            camera: name.to_owned(),
            problem,
        };
        let crowd = self.crowd(path).map_err(|error| wrong(error.to_string()))?;
        let scene = crowd.scene();
        let names: Vec<&str> = scene.cameras().iter().map(CameraModel::name).collect();
        let index = names.iter().position(|known| *known == name);
        let index = index.ok_or_else(|| {
            let problem = unknown_name("camera of the scene", name, &names);
            wrong(format!("{}: {problem}", path.display()))
        })?;
        let at = || SourceOrigin {
            camera: name.to_owned(),
            place: path.display().to_string(),
        };
        let (found_hz, expected_hz) = (scene.rate_hz(), venue.rate_hz);
        if !same_rate(found_hz, expected_hz) {
            return Err(SourceError::Rate {
                at: at(),
                found_hz,
                expected_hz,
            });
        }
        let (found_px, expected_px) = (scene.cameras()[index].size_px(), camera.model.size_px());
        if found_px != expected_px {
            return Err(SourceError::PixelSize {
                at: at(),
                found_px,
                expected_px,
            });
        }
        let first = venue.first_tick.0;
        let ticks = scene.ticks();
        Ok(Simulated {
            camera: index,
            ticks: ticks.start + first..ticks.end + first,
            crowd,
        })
    }
}

impl Sources for VenueSources {
    fn probe(&self, camera: &VenueCamera, venue: &Venue) -> Result<SourceInfo, SourceError> {
        if let Source::Maps { path, .. } = &camera.source {
            let file = self.maps(path, camera, venue)?;
            return Ok(SourceInfo {
                ticks: Some(ticks_of(&file, venue.first_tick)),
                size_px: Some(file.header().size_px),
                rate_hz: Some(file.header().rate_hz),
                ..SourceInfo::default()
            });
        }
        let Source::Simulated { path, .. } = &camera.source else {
            return self.recorded.probe(camera, venue);
        };
        let simulated = self.simulated(path, camera, venue)?;
        Ok(SourceInfo {
            ticks: Some(simulated.ticks),
            size_px: Some(camera.model.size_px()),
            rate_hz: Some(simulated.crowd.scene().rate_hz()),
            ..SourceInfo::default()
        })
    }

    fn open(
        &self,
        camera: &VenueCamera,
        venue: &Venue,
        from: Tick,
    ) -> Result<Box<dyn FrameSource>, SourceError> {
        if let Source::Maps { path, .. } = &camera.source {
            let file = self.maps(path, camera, venue)?;
            let source = MapsSource::new(file, path, camera, (venue.first_tick, from))?;
            return Ok(Box::new(source));
        }
        let Source::Simulated { path, content, .. } = &camera.source else {
            return self.recorded.open(camera, venue, from);
        };
        let Simulated {
            crowd,
            camera: index,
            ticks,
        } = self.simulated(path, camera, venue)?;
        if !ticks.contains(&from) {
            return Err(SourceError::OutsideClip {
                camera: camera.model.name().to_owned(),
                asked: from..from + 1,
                has: ticks,
            });
        }
        let first = venue.first_tick;
        let of_scene = Tick(from - first)..Tick(ticks.end - first);
        let source = SimulatedSource::new(&crowd, index, *content, of_scene, first)?;
        Ok(Box::new(source))
    }
}
