//! The messages of a simulated venue's edges, recorded in memory. Measurements of fusion then
//! include neither simulator nor network.
//!
//! [`RecordedVenue::record`] runs edges and fusion in lock-step in this process. A fresh
//! [`Pipeline`] over the recorded groups gives the same result bit for bit, so its boxes are those
//! that the groups answer.

use std::fmt::{self, Write as _};
use std::path::Path;
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
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use crate::embedded;
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
        let scene = Arc::new(crowd_scene(size, ticks)?);
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

/// Ticks per second.
pub const RATE_HZ: f64 = 60.0;
/// Floor area per person, square metres.
const AREA_M2: f64 = 20.0;
/// Ratio of the field's length to its width.
const ASPECT: f64 = 1.5;
/// Smallest field, metres.
const SMALLEST_M: [f64; 2] = [12.0, 8.0];
/// Distance of the cameras from the field, relative to its length. One camera then sees the whole
/// field, also from the middle of its long side.
const SETBACK_OF_LENGTH: f64 = 0.5;
/// Smallest distance of paths from the field's edge, metres.
const EDGE_M: f64 = 1.0;
/// Largest distance of a start from the middle of the person's part of the field, relative to the
/// size of that part.
const SCATTER: f64 = 0.2;
/// Minimum number of corners of a path.
const CORNERS: usize = 12;
/// Smallest mean distance between corners, metres; random points of the smallest field give 4.
const FROM_CORNER_TO_CORNER_M: f64 = 3.0;
/// Slowest and fastest person, metres per second.
const SPEEDS_M_S: [f64; 2] = [1.0, 5.0];
/// Shortest and tallest person, metres.
const STATURES_M: [f64; 2] = [1.6, 1.95];
/// The clips, each with its largest speed, metres per second.
const CLIPS: [(f64, &str); 3] = [(2.0, "walk"), (3.0, "jog"), (f64::INFINITY, "run")];
/// Seed of all draws.
const SEED: u64 = 17;

/// The scene of `size` with `ticks` ticks; deterministic.
///
/// # Errors
/// [`FileError`] for more people, viewpoints or ticks than a scene allows.
fn crowd_scene(size: VenueSize, ticks: u32) -> Result<Scene, FileError> {
    let mut text = String::new();
    // Writing to a String cannot fail.
    let _infallible = write_scene(&mut text, size, ticks);
    embedded::with_clips(&text, Path::new("scenes/crowd.toml"))
}

fn write_scene(text: &mut String, size: VenueSize, ticks: u32) -> fmt::Result {
    let [length_m, width_m] = field_m(size.people);
    writeln!(
        text,
        "rate_hz = {RATE_HZ:?}\nseconds = {:?}\nseed = {SEED}\nsize_m = [{length_m:.1}, {width_m:.1}]\n\n\
         [cameras]\nviewpoints = {}\nper_viewpoint = 1\nheight_m = 4.0\nsetback_m = {:.1}\n\n\
         [faults]\nprofile = \"standard\"",
        f64::from(ticks) / RATE_HZ,
        size.viewpoints,
        SETBACK_OF_LENGTH * length_m,
    )?;
    let mut rng = ChaCha8Rng::seed_from_u64(SEED);
    let half_m = [length_m / 2.0 - EDGE_M, width_m / 2.0 - EDGE_M];
    for person in 0..size.people {
        let speed_m_s: f64 = rng.random_range(SPEEDS_M_S[0]..SPEEDS_M_S[1]);
        let stature_m: f64 = rng.random_range(STATURES_M[0]..STATURES_M[1]);
        let clip = CLIPS.iter().find(|(up_to, _)| speed_m_s < *up_to);
        let clip = clip.map_or("run", |(_, clip)| clip);
        let at_m = first_place_m(person, size.people, half_m, &mut rng);
        write!(
            text,
            "\n[[person]]\nname = \"{}\"\nclips = [\"../clips/{clip}.bvh\"]\nat_m = {at_m:.2?}\n\
             heading_rad = 0.0\nheight_m = {stature_m:.2}\n\n[person.path]\nspeed_m_s = {speed_m_s:.2}\n\
             points_m = [{at_m:.2?}",
            person + 1,
        )?;
        let way_m = speed_m_s * f64::from(ticks) / RATE_HZ;
        let corners = (way_m / FROM_CORNER_TO_CORNER_M).ceil() as usize;
        for _ in 0..corners.max(CORNERS) {
            let corner_m = half_m.map(|half_m| rng.random_range(-half_m..half_m));
            write!(text, ", {corner_m:.2?}")?;
        }
        writeln!(text, "]")?;
    }
    Ok(())
}

/// Length and width of the field of `people`, metres.
fn field_m(people: usize) -> [f64; 2] {
    let length_m = (ASPECT * AREA_M2 * people as f64).sqrt();
    [
        length_m.max(SMALLEST_M[0]),
        (length_m / ASPECT).max(SMALLEST_M[1]),
    ]
}

/// The start of `person` of `people`: each has its own part of the field, so people never start
/// inside each other.
fn first_place_m(person: usize, people: usize, half_m: [f64; 2], rng: &mut ChaCha8Rng) -> [f64; 2] {
    let columns = ((people as f64 * ASPECT).sqrt().ceil() as usize).max(1);
    let rows = people.div_ceil(columns);
    let mut place_m = |index: usize, count: usize, half_m: f64| {
        let middle = index as f64 + 0.5 + rng.random_range(-SCATTER..SCATTER);
        half_m * (2.0 * middle / count as f64 - 1.0)
    };
    [
        place_m(person % columns, columns, half_m[0]),
        place_m(person / columns, rows, half_m[1]),
    ]
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

    #[test]
    fn a_field_has_room_for_its_people_and_is_never_tiny() {
        for (people, expected_m) in [(2, SMALLEST_M), (30, [30.0, 20.0])] {
            let [length_m, width_m] = field_m(people);
            assert!((length_m - expected_m[0]).abs() < 1e-9, "{length_m}");
            assert!((width_m - expected_m[1]).abs() < 1e-9, "{width_m}");
        }
    }

    #[test]
    fn every_size_up_to_the_largest_makes_a_scene() {
        for (viewpoints, people) in [(2, 1), (4, 5), (12, 22), (28, 30), (64, 200)] {
            let size = VenueSize { viewpoints, people };
            let scene = crowd_scene(size, 120).unwrap();
            assert_eq!(scene.viewpoints().len(), viewpoints);
            assert_eq!(scene.cameras().len(), viewpoints);
            assert_eq!(scene.people().len(), people);
            assert_eq!(scene.ticks().end.0, 120);
        }
    }
}
