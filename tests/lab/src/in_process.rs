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
use farfield_edge::source::{FrameSource, Sources as _, common_ticks};
use farfield_fusion::align::TickGroup;
use farfield_fusion::camera_agreement::AgreementReport;
use farfield_fusion::identity::track::Track;
use farfield_proto::id::{SessionId, ViewpointIndex};
use farfield_proto::keypoints::KeypointSet;
use farfield_proto::message::identity_event::IdentityEvent;
use farfield_proto::message::{BoxSet, PatchSet, PoseSet};
use farfield_proto::model_card::HeatmapCard;
use farfield_proto::patch::CompressionLevel;
use farfield_proto::tick::Tick;
use farfield_proto::venue::Venue;

use crate::conditions::{Cuts, FarLinks, InFlight};
use farfield_sim::simulated::VenueSources;

/// One viewpoint: its cameras' sources and its pipeline.
struct ViewpointEdge {
    sources: Vec<Box<dyn FrameSource>>,
    pipeline: farfield_edge::pipeline::EdgePipeline,
}

/// All nodes of a venue.
pub struct InProcess {
    venue: Venue,
    edges: Vec<ViewpointEdge>,
    fusion: farfield_fusion::pipeline::Pipeline,
    boxes: Vec<BoxSet>,
    ticks: Range<Tick>,
    /// The viewpoint whose patches and sightings fusion does not receive.
    withheld: Option<ViewpointIndex>,
    cuts: Option<Cuts>,
    links: InFlight,
    /// Late patches in flight to fusion.
    late: VecDeque<PatchSet>,
}

/// Results of one tick.
pub struct TickTrace {
    /// The tick.
    pub tick: Tick,
    /// Outputs of the edges by viewpoint, including the withheld one.
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
    pub fn open(path: &Path, withheld: Option<ViewpointIndex>) -> anyhow::Result<Self> {
        let venue = farfield_node::files::load_venue(path)?;
        let known = VenueSources::default();
        let infos = venue
            .cameras
            .iter()
            .map(|camera| Ok((camera.model.name().to_owned(), known.probe(camera, &venue)?)))
            .collect::<anyhow::Result<Vec<_>>>()?;
        let ticks = common_ticks(&infos, None)?;
        let sources = venue
            .cameras
            .iter()
            .map(|camera| Ok(known.open(camera, &venue, ticks.start)?))
            .collect::<anyhow::Result<Vec<_>>>()?;
        let mut this = Self::new(venue, sources, ticks)?;
        this.withheld = withheld;
        Ok(this)
    }

    /// Starts a venue that need not be a file. `sources` has one entry per camera of the venue, in its order, each with its next
    /// frame at the start of `ticks`.
    ///
    /// # Errors
    /// A network or detector cannot be loaded, its maps do not fit the wire, or the number of sources is not that of the cameras.
    pub fn new(
        venue: Venue,
        sources: Vec<Box<dyn FrameSource>>,
        ticks: Range<Tick>,
    ) -> anyhow::Result<Self> {
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
            withheld: None,
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
        let received = edges
            .iter()
            .enumerate()
            .filter(|(i, _)| self.withheld != Some(ViewpointIndex(*i as u16)));
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
        for (_, output) in received.filter(|_| !is_cut) {
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

fn read_card(path: &Path) -> anyhow::Result<HeatmapCard> {
    let text =
        std::fs::read_to_string(path).with_context(|| format!("reading {}", path.display()))?;
    Ok(HeatmapCard::parse(&text, path)?)
}
