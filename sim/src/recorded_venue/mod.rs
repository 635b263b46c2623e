//! The messages of a simulated venue's edges, recorded in memory. Measurements of fusion then
//! include neither simulator nor network.
//!
//! [`RecordedVenue::record`] runs edges and fusion in lock-step in this process. A fresh
//! [`Pipeline`] over the recorded groups gives the same result bit for bit, so its boxes are those
//! that the groups answer.

mod crowd_scene;

use std::sync::Arc;

use farfield_edge::pipeline::{EdgeOutput, EdgePipeline, PipelineError, StepRequest};
use farfield_edge::source::{FrameSource, SourceError};
use farfield_fusion::align::TickGroup;
use farfield_fusion::pipeline::Pipeline;
use farfield_proto::id::{SessionId, ViewpointIndex};
use farfield_proto::message::{BoxSet, Order, SightingSet};
use farfield_proto::patch::CompressionLevel;
use farfield_proto::tick::Tick;
use farfield_proto::toml_file::FileError;
use farfield_proto::venue::{Parameters, Venue};
use rayon::prelude::*;

pub use self::crowd_scene::RATE_HZ;
use crate::scene::Scene;
use crate::simulated::in_memory::{Input, sources_of, venue_of};

/// The session of the groups.
const SESSION: SessionId = SessionId(1);

/// The size of a venue.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct VenueSize {
    /// Viewpoints around the field, of one camera each.
    pub viewpoints: usize,
    /// People on it.
    pub people: usize,
}

/// Why a venue cannot be recorded.
#[derive(Debug, thiserror::Error)]
pub enum RecordVenueError {
    /// No scene of this size is possible.
    #[error(transparent)]
    Scene(#[from] FileError),
    /// A simulated camera failed.
    #[error(transparent)]
    Source(#[from] SourceError),
    /// An edge failed.
    #[error(transparent)]
    Edge(#[from] PipelineError),
}

/// A venue and the input of its fusion.
pub struct RecordedVenue {
    scene: Arc<Scene>,
    venue: Venue,
    groups: Vec<TickGroup>,
    sightings: Vec<Vec<SightingSet>>,
}

/// Which detection passes are recorded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RecordedPasses {
    /// The passes that fusion requests.
    Requested,
    /// Also a pass of all cameras at every tick, because live fusion requests passes at other
    /// ticks.
    AtEveryTick,
}

impl RecordedVenue {
    /// Records the first `ticks` ticks of a venue of `size`. Maps are made from the truth with the
    /// faults of networks and packed at `level`. The same arguments give the same groups. `done` is
    /// called after each tick.
    ///
    /// # Errors
    /// [`RecordVenueError`] when no scene of this size is possible.
    pub fn record(
        size: VenueSize,
        ticks: u32,
        level: CompressionLevel,
        done: &mut dyn FnMut(),
    ) -> Result<Self, RecordVenueError> {
        Self::record_with(size, ticks, level, RecordedPasses::Requested, done)
    }

    /// As [`Self::record`], with the detection passes in `passes`.
    ///
    /// # Errors
    /// As [`Self::record`].
    pub fn record_with(
        size: VenueSize,
        ticks: u32,
        level: CompressionLevel,
        passes: RecordedPasses,
        done: &mut dyn FnMut(),
    ) -> Result<Self, RecordVenueError> {
        let scene = Arc::new(crowd_scene::crowd_scene(size, ticks)?);
        let venue = venue_of(&scene, &Input::Maps, Parameters::default());
        let mut edges = build_edges(&scene, &venue, level)?;
        let mut lookouts = match passes {
            RecordedPasses::Requested => Vec::new(),
            RecordedPasses::AtEveryTick => build_edges(&scene, &venue, level)?,
        };
        let (mut fusion, mut boxes) = fusion_of(&venue);
        let (mut groups, mut sightings) = (Vec::new(), Vec::new());
        for tick in (0..i64::from(ticks)).map(Tick) {
            // Edges share no state; their outputs stay in the order of viewpoints.
            let outputs: Vec<EdgeOutput> = edges
                .par_iter_mut()
                .zip(&boxes)
                .map(|(edge, boxes)| edge.step(tick, boxes))
                .collect::<Result<_, _>>()?;
            let mut group = TickGroup {
                tick,
                ..TickGroup::default()
            };
            for output in outputs {
                group.patch_sets.extend(output.patch_sets);
                group.sighting_sets.extend(output.sighting_sets);
            }
            boxes = fusion.step(&group, &mut |_| {}).boxes;
            groups.push(group);
            if passes == RecordedPasses::AtEveryTick {
                sightings.push(sighted(&venue, &mut lookouts, tick)?);
            }
            done();
        }
        Ok(Self {
            scene,
            venue,
            groups,
            sightings,
        })
    }

    /// A pipeline for the groups, from the first on.
    pub fn fusion(&self) -> Pipeline {
        fusion_of(&self.venue).0
    }

    /// The simulated scene.
    pub fn scene(&self) -> &Arc<Scene> {
        &self.scene
    }

    /// By tick, the result of a detection pass of all cameras; empty unless recorded with
    /// [`RecordedPasses::AtEveryTick`].
    pub fn sightings(&self) -> &[Vec<SightingSet>] {
        &self.sightings
    }

    /// Fusion's input, by tick.
    pub fn groups(&self) -> &[TickGroup] {
        &self.groups
    }
}

/// One edge for every viewpoint of `venue`, in order.
fn build_edges(
    scene: &Arc<Scene>,
    venue: &Venue,
    level: CompressionLevel,
) -> Result<Vec<MapEdge>, RecordVenueError> {
    let sources = sources_of(scene, &Input::Maps)?.into_iter().enumerate();
    let edges = sources
        .map(|(index, source)| MapEdge::new(venue, ViewpointIndex(index as u16), source, level));
    Ok(edges.collect::<Result<_, _>>()?)
}

/// The result of a detection pass of all cameras at `tick`.
fn sighted(
    venue: &Venue,
    lookouts: &mut [MapEdge],
    tick: Tick,
) -> Result<Vec<SightingSet>, RecordVenueError> {
    let pairs = lookouts.par_iter_mut().zip(&venue.viewpoints).enumerate();
    let sets = pairs.map(|(index, (edge, viewpoint))| {
        let boxes = BoxSet {
            session: SESSION,
            tick,
            viewpoint: ViewpointIndex(index as u16),
            part: 0,
            parts: 1,
            order: Order::Track,
            live: None,
            detection_cameras: viewpoint.cameras.clone(),
            persons: Vec::new(),
        };
        Ok(edge.step(tick, &boxes)?.sighting_sets)
    });
    let sets: Vec<Vec<SightingSet>> = sets.collect::<Result<_, RecordVenueError>>()?;
    Ok(sets.into_iter().flatten().collect())
}

/// Fusion at the first tick, and its first boxes.
fn fusion_of(venue: &Venue) -> (Pipeline, Vec<BoxSet>) {
    let mut fusion = Pipeline::new(venue, None, SESSION);
    let boxes = fusion.first_boxes(Tick(0));
    (fusion, boxes)
}

/// The edge of a viewpoint with one camera whose maps are painted.
struct MapEdge {
    source: Box<dyn FrameSource>,
    pipeline: EdgePipeline,
}

impl MapEdge {
    fn new(
        venue: &Venue,
        viewpoint: ViewpointIndex,
        source: Box<dyn FrameSource>,
        level: CompressionLevel,
    ) -> Result<Self, PipelineError> {
        let mut pipeline = EdgePipeline::new(venue, viewpoint, None, None)?;
        pipeline.set_compression_level(level);
        Ok(Self { source, pipeline })
    }

    fn step(&mut self, tick: Tick, boxes: &BoxSet) -> Result<EdgeOutput, RecordVenueError> {
        let frames = [self.source.next_frame()?];
        let request = StepRequest {
            tick,
            boxes,
            detection_cameras: &boxes.detection_cameras,
            detections: None,
            persons: None,
            timing: None,
        };
        Ok(self.pipeline.step(&frames, &request, &mut |_| {})?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: VenueSize = VenueSize {
        viewpoints: 3,
        people: 2,
    };

    fn recorded(level: CompressionLevel) -> RecordedVenue {
        RecordedVenue::record(SIZE, 20, level, &mut || {}).unwrap()
    }

    fn bytes(venue: &RecordedVenue) -> usize {
        let sets = venue.groups().iter().flat_map(|group| &group.patch_sets);
        let patches = sets.flat_map(|set| &set.persons);
        patches.map(|patch| patch.maps.bytes.len()).sum()
    }

    #[test]
    fn recording_is_deterministic() {
        let once = recorded(CompressionLevel::DEFAULT);
        assert_eq!(once.groups().len(), 20);
        assert_eq!(once.groups(), recorded(CompressionLevel::DEFAULT).groups());
    }

    #[test]
    fn a_fresh_fusion_uses_all_recorded_groups() {
        let venue = recorded(CompressionLevel::DEFAULT);
        let mut fusion = venue.fusion();
        let steps = venue.groups().iter().map(|g| fusion.step(g, &mut |_| {}));
        let steps: Vec<_> = steps.collect();
        assert!(
            steps
                .iter()
                .all(|s| s.unusable_patches == 0 && s.unusable_sightings == 0)
        );
        assert_eq!(steps[19].poses.persons.len(), SIZE.people);
    }

    #[test]
    fn without_loss_patches_are_larger() {
        let [default, lossless] = [CompressionLevel::DEFAULT, CompressionLevel::LOSSLESS]
            .map(|level| bytes(&recorded(level)));
        assert!(default > 0 && default < lossless, "{default} {lossless}");
    }
}
