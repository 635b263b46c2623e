//! Edges and fusion in one process, in lock-step and without a network: for studies that inspect messages, and for tests of
//! the cores together.

use std::collections::VecDeque;
use std::ops::Range;
use std::path::Path;

use anyhow::{Context as _, ensure};
use farfield_edge::detector::OnnxDetector;
use farfield_edge::inference::{KeypointNetwork, PersonDetector};
use farfield_edge::network::OnnxKeypointNetwork;
use farfield_edge::pipeline::{EdgeOutput, StandIn, StepRequest};
use farfield_edge::source::{Frame, FrameSource, SourceError, Sources as _, common_ticks};
use farfield_fusion::align::TickGroup;
use farfield_fusion::body::skeleton::{Joints, N_JOINTS};
use farfield_fusion::boxes::{BoxShape, Boxes};
use farfield_fusion::camera_agreement::AgreementReport;
use farfield_fusion::identity::track::Track;
use farfield_proto::camera::CameraModel;
use farfield_proto::id::{CameraIndex, SessionId, ViewpointIndex};
use farfield_proto::keypoints::KeypointSet;
use farfield_proto::message::identity_event::IdentityEvent;
use farfield_proto::message::{BoxSet, Order, PatchSet, PersonBoxes, PoseSet};
use farfield_proto::model_card::HeatmapCard;
use farfield_proto::patch::CompressionLevel;
use farfield_proto::tick::Tick;
use farfield_proto::venue::Venue;
use nalgebra::Vector3;

use crate::conditions::{Cuts, FarLinks, InFlight};
use farfield_sim::simulated::VenueSources;

/// One source per camera.
type FrameSources = Vec<Box<dyn FrameSource>>;

/// One viewpoint: its cameras' sources and its pipeline.
struct ViewpointEdge {
    sources: FrameSources,
    pipeline: farfield_edge::pipeline::EdgePipeline,
}

/// All nodes of a venue.
pub struct InProcess {
    venue: Venue,
    edges: Vec<ViewpointEdge>,
    fusion: farfield_fusion::pipeline::Pipeline,
    boxes: Vec<BoxSet>,
    ticks: Range<Tick>,
    cuts: Option<Cuts>,
    links: InFlight,
    /// Late patches in flight to fusion.
    late: VecDeque<PatchSet>,
}

/// Results of one tick.
pub struct TickTrace {
    /// The tick.
    pub tick: Tick,
    /// Outputs of the edges by viewpoint.
    pub edges: Vec<EdgeOutput>,
    /// Live poses of this tick.
    pub poses: PoseSet,
    /// Ticks whose poses have become final.
    pub finished: Vec<PoseSet>,
    /// Smoothed poses that left the delay, if there is one.
    pub smoothed: Vec<PoseSet>,
    /// Identity events, in order.
    pub events: Vec<IdentityEvent>,
}

impl InProcess {
    /// Opens the venue file at `path` for the ticks that all its sources have.
    ///
    /// # Errors
    /// The venue's files, networks or sources are refused.
    pub fn open(path: &Path) -> anyhow::Result<Self> {
        Self::open_venue(farfield_node::files::load_venue(path)?)
    }

    /// As [`Self::open`], for a venue in memory.
    ///
    /// # Errors
    /// As [`Self::open`].
    pub fn open_venue(venue: Venue) -> anyhow::Result<Self> {
        let (sources, ticks) = opened_sources(&venue)?;
        Self::new(venue, sources, ticks)
    }

    /// From now on each camera shows its next frame at all of `n_ticks`.
    ///
    /// # Errors
    /// A frame cannot be read.
    pub fn hold_still(&mut self, n_ticks: i64) -> anyhow::Result<()> {
        self.ticks.end = self.ticks.start + n_ticks;
        self.edges
            .iter_mut()
            .try_for_each(ViewpointEdge::hold_still)
    }

    /// Starts a venue that need not be a file. `sources` has one entry per camera of the venue, in its order, each with its next
    /// frame at the start of `ticks`.
    ///
    /// # Errors
    /// A network or detector cannot be loaded, its maps do not fit the wire, or the number of sources is not that of the cameras.
    pub fn new(venue: Venue, sources: FrameSources, ticks: Range<Tick>) -> anyhow::Result<Self> {
        let (got, expected) = (sources.len(), venue.cameras.len());
        ensure!(got == expected, "{got} sources for {expected} cameras");
        let mut sources: Vec<Option<Box<dyn FrameSource>>> =
            sources.into_iter().map(Some).collect();
        let edges = (0..venue.viewpoints.len())
            .map(|index| ViewpointEdge::new(&venue, ViewpointIndex(index as u16), &mut sources))
            .collect::<anyhow::Result<Vec<_>>>()?;
        let card = venue.network.as_deref().map(read_card).transpose()?;
        let mut fusion =
            farfield_fusion::pipeline::Pipeline::new(&venue, card.as_ref(), SessionId(1));
        Ok(Self {
            boxes: fusion.first_boxes(ticks.start),
            venue,
            edges,
            fusion,
            ticks,
            cuts: None,
            links: InFlight::new(FarLinks::default()),
            late: VecDeque::new(),
        })
    }

    /// Cuts fusion off from all edges in periods.
    #[must_use]
    pub fn with_cuts(mut self, cuts: Option<Cuts>) -> Self {
        self.cuts = cuts;
        self
    }

    /// Adds far and lossy links between all edges and fusion, from the first tick on.
    #[must_use]
    pub fn with_links(mut self, links: FarLinks) -> Self {
        let horizons = vec![links.ahead as f64; self.edges.len()];
        self.fusion.set_horizons(&horizons);
        self.links = InFlight::new(links);
        self
    }

    /// The venue.
    pub fn venue(&self) -> &Venue {
        &self.venue
    }

    /// The names of the network's keypoints.
    pub fn keypoints(&self) -> &KeypointSet {
        self.fusion.keypoints()
    }

    /// Makes every edge use a codec of `stand_in` instead of ours.
    pub fn set_stand_in(&mut self, stand_in: &dyn Fn() -> Box<dyn StandIn>) {
        for edge in &mut self.edges {
            edge.pipeline.set_stand_in(stand_in());
        }
    }

    /// Sets the compression level of every edge.
    pub fn set_compression_level(&mut self, level: CompressionLevel) {
        for edge in &mut self.edges {
            edge.pipeline.set_compression_level(level);
        }
    }

    /// All tracks of fusion after the last tick, including tentative ones.
    pub fn tracks(&self) -> &[Track] {
        self.fusion.tracks()
    }

    /// The agreement of the cameras so far.
    pub fn agreement(&self) -> AgreementReport {
        self.fusion.agreement().report()
    }

    /// Computes the next tick; `None` at the end of the recording.
    ///
    /// # Errors
    /// A source or a network fails.
    pub fn step(&mut self) -> anyhow::Result<Option<TickTrace>> {
        let tick = self.ticks.start;
        if tick >= self.ticks.end {
            return Ok(None);
        }
        self.ticks.start = tick + 1;
        let boxes = &self.boxes;
        let outputs: Vec<anyhow::Result<EdgeOutput>> = std::thread::scope(|scope| {
            let work: Vec<_> = self
                .edges
                .iter_mut()
                .zip(boxes)
                .map(|(edge, boxes)| scope.spawn(move || edge.step(tick, boxes)))
                .collect();
            work.into_iter()
                .map(|thread| {
                    thread
                        .join()
                        .unwrap_or_else(|_| Err(anyhow::anyhow!("an edge panicked")))
                })
                .collect()
        });
        let mut edges = outputs.into_iter().collect::<anyhow::Result<Vec<_>>>()?;
        self.links.lose(&mut edges);
        let mut group = TickGroup {
            tick,
            ..TickGroup::default()
        };
        let is_cut = self.cuts.is_some_and(|cuts| cuts.contains(tick));
        let late = self.cuts.filter(|_| is_cut).and_then(|cuts| cuts.late);
        if late.is_some() {
            let sets = edges.iter().flat_map(|edge| &edge.patch_sets);
            self.late.extend(sets.cloned());
        }
        let late = self.cuts.and_then(|cuts| cuts.late).unwrap_or_default();
        while let Some(set) = self.late.pop_front_if(|set| set.tick + late <= tick) {
            self.fusion.add_late(&set);
        }
        for output in edges.iter().filter(|_| !is_cut) {
            group.patch_sets.extend(output.patch_sets.iter().cloned());
            group
                .sighting_sets
                .extend(output.sighting_sets.iter().cloned());
        }
        let step = self.fusion.step(&group, &mut |_| {});
        self.links.send_boxes(step.boxes, &mut self.boxes);
        Ok(Some(TickTrace {
            tick,
            edges,
            poses: step.poses,
            finished: step.finished,
            smoothed: step.smoothed,
            events: step.events,
        }))
    }

    /// Smooths in two passes, from the first tick on.
    #[must_use]
    pub fn in_two_passes(mut self) -> Self {
        self.fusion.smooth_in_two_passes();
        self
    }

    /// The smoothed poses of the last ticks, if there is a delay.
    pub fn finish_smoothed(&mut self) -> Vec<PoseSet> {
        self.fusion.finish_smoothed()
    }

    /// The poses that were undecided when the recording ended.
    pub fn finish(&mut self) -> Vec<PoseSet> {
        self.fusion.finish()
    }
}

impl ViewpointEdge {
    /// Takes the sources of its cameras out of `sources`.
    fn new(
        venue: &Venue,
        viewpoint: ViewpointIndex,
        sources: &mut [Option<Box<dyn FrameSource>>],
    ) -> anyhow::Result<Self> {
        let cameras = &venue.viewpoints[usize::from(viewpoint.0)].cameras;
        let models = cameras.iter().filter_map(|index| venue.camera(*index));
        let pictures = models.into_iter().any(|c| c.source.gives_pictures());
        let network = venue.network.as_deref().filter(|_| pictures);
        let network = network.map(OnnxKeypointNetwork::load).transpose()?;
        let detector = venue.detector.as_deref().filter(|_| pictures);
        let detector = detector.map(OnnxDetector::load).transpose()?;
        let pipeline = farfield_edge::pipeline::EdgePipeline::new(
            venue,
            viewpoint,
            network.map(|n| Box::new(n) as Box<dyn KeypointNetwork>),
            detector.map(|d| Box::new(d) as Box<dyn PersonDetector>),
        )?;
        let sources = cameras
            .iter()
            .map(|index| {
                let source = sources.get_mut(usize::from(index.0));
                source
                    .and_then(Option::take)
                    .context("a camera belongs to one viewpoint and has one source")
            })
            .collect::<anyhow::Result<Vec<_>>>()?;
        Ok(Self { sources, pipeline })
    }

    fn hold_still(&mut self) -> anyhow::Result<()> {
        for source in &mut self.sources {
            let frame = source.next_frame()?.context("a source without a frame")?;
            *source = Box::new(StillSource(frame));
        }
        Ok(())
    }

    fn step(&mut self, tick: Tick, boxes: &BoxSet) -> anyhow::Result<EdgeOutput> {
        let frames = self
            .sources
            .iter_mut()
            .map(|source| source.next_frame())
            .collect::<Result<Vec<_>, _>>()?;
        let is_of_tick = boxes.tick == tick;
        let request = StepRequest {
            tick,
            boxes,
            detection_cameras: if is_of_tick {
                &boxes.detection_cameras
            } else {
                &[]
            },
            detections: None,
            persons: None,
            timing: None,
        };
        Ok(self.pipeline.step(&frames, &request, &mut |_| {})?)
    }
}

/// A viewpoint whose results fusion does not receive. It looks at the people of a run with the crops of their poses.
pub struct Onlooker {
    edge: ViewpointEdge,
    camera: CameraModel,
    boxes: Boxes,
    shape: BoxShape,
}

impl Onlooker {
    /// Opens the one viewpoint of `venue`, which has one camera.
    ///
    /// # Errors
    /// As [`InProcess::open`].
    pub fn open(venue: &Venue) -> anyhow::Result<Self> {
        let (sources, _) = opened_sources(venue)?;
        let mut sources: Vec<Option<Box<dyn FrameSource>>> =
            sources.into_iter().map(Some).collect();
        let camera = venue.cameras.first().context("a venue without cameras")?;
        let network = venue
            .network
            .as_deref()
            .context("a venue without a network")?;
        let of_card = read_card(network)?.box_margin;
        Ok(Self {
            edge: ViewpointEdge::new(venue, ViewpointIndex(0), &mut sources)?,
            camera: camera.model.clone(),
            boxes: Boxes::default(),
            shape: BoxShape {
                margin: venue.parameters.boxes.margin.unwrap_or(of_card),
                reach_m: 0.0,
                parameters: venue.parameters.boxes.clone(),
            },
        })
    }

    /// Its camera.
    pub fn camera(&self) -> &CameraModel {
        &self.camera
    }

    /// As [`InProcess::hold_still`].
    ///
    /// # Errors
    /// A frame cannot be read.
    pub fn hold_still(&mut self) -> anyhow::Result<()> {
        self.edge.hold_still()
    }

    /// The patches of the people with `poses`, at their tick, which is the next.
    ///
    /// # Errors
    /// The source or the network fails.
    pub fn look(&mut self, poses: &PoseSet) -> anyhow::Result<EdgeOutput> {
        let mut persons = Vec::new();
        for pose in &poses.persons {
            let mut joints_m: Joints = [Vector3::zeros(); N_JOINTS];
            for (joint_m, at_m) in joints_m.iter_mut().zip(&pose.joints_m) {
                *joint_m = at_m.map(f64::from).into();
            }
            let both = (&joints_m, &joints_m);
            let camera = CameraIndex(0);
            let own = self
                .boxes
                .camera_box(camera, &self.camera, both, &self.shape);
            persons.extend(own.map(|own| PersonBoxes {
                person: pose.person,
                cameras: vec![own],
            }));
        }
        let boxes = BoxSet {
            session: poses.session,
            tick: poses.tick,
            viewpoint: ViewpointIndex(0),
            part: 0,
            parts: 1,
            order: Order::Track,
            live: None,
            detection_cameras: Vec::new(),
            persons,
        };
        self.edge.step(poses.tick, &boxes)
    }
}

/// The sources of all cameras of `venue`, and the ticks that they have in common.
fn opened_sources(venue: &Venue) -> anyhow::Result<(FrameSources, Range<Tick>)> {
    let known = VenueSources::default();
    let infos = venue
        .cameras
        .iter()
        .map(|camera| Ok((camera.model.name().to_owned(), known.probe(camera, venue)?)))
        .collect::<anyhow::Result<Vec<_>>>()?;
    let ticks = common_ticks(&infos, None)?;
    let sources = venue
        .cameras
        .iter()
        .map(|camera| Ok(known.open(camera, venue, ticks.start)?))
        .collect::<anyhow::Result<Vec<_>>>()?;
    Ok((sources, ticks))
}

/// One frame for ever.
struct StillSource(Frame);

impl FrameSource for StillSource {
    fn next_frame(&mut self) -> Result<Option<Frame>, SourceError> {
        let frame = self.0.clone();
        self.0.tick = frame.tick + 1;
        Ok(Some(frame))
    }
}

fn read_card(path: &Path) -> anyhow::Result<HeatmapCard> {
    let text =
        std::fs::read_to_string(path).with_context(|| format!("reading {}", path.display()))?;
    Ok(HeatmapCard::parse(&text, path)?)
}
