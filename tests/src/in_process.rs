//! The loop of edges and fusion inside one process, in lock-step and without a network: for studies
//! that must see what the wire carries, and for tests of the cores together.

use std::ops::Range;
use std::path::Path;

use anyhow::Context as _;
use farfield_edge::detector::OnnxDetector;
use farfield_edge::network::OnnxKeypointNetwork;
use farfield_edge::pipeline::{EdgeOutput, KeypointNetwork, PersonDetector};
use farfield_edge::source::{self, FrameSource};
use farfield_fusion::align::TickGroup;
use farfield_proto::id::{SessionId, ViewpointIndex};
use farfield_proto::keypoints::KeypointSet;
use farfield_proto::message::{BoxSet, PoseSet};
use farfield_proto::model_card::HeatmapCard;
use farfield_proto::tick::Tick;
use farfield_proto::venue::Venue;

/// One viewpoint: its cameras' sources and its pipeline.
struct Edge {
    sources: Vec<Box<dyn FrameSource>>,
    pipeline: farfield_edge::pipeline::Pipeline,
}

/// All nodes of a venue, tick after tick.
pub struct InProcess {
    venue: Venue,
    edges: Vec<Edge>,
    fusion: farfield_fusion::pipeline::Pipeline,
    boxes: Vec<BoxSet>,
    ticks: Range<Tick>,
    /// The viewpoint whose patches and sightings fusion does not get.
    withheld: Option<ViewpointIndex>,
}

/// What one tick brought.
pub struct TickTrace {
    /// The tick.
    pub tick: Tick,
    /// What the edges made, the withheld one too, by viewpoint.
    pub edges: Vec<EdgeOutput>,
    /// Ticks whose poses have become final.
    pub finished: Vec<PoseSet>,
}

impl InProcess {
    /// Opens the venue file at `path` for the ticks that all its sources have.
    ///
    /// # Errors
    /// Whatever the venue's files, networks or sources are refused for.
    pub fn open(path: &Path, withheld: Option<ViewpointIndex>) -> anyhow::Result<Self> {
        let venue = Venue::load(path)?;
        let infos = venue
            .cameras
            .iter()
            .map(|camera| {
                Ok((
                    camera.model.name().to_owned(),
                    source::probe(camera, &venue)?,
                ))
            })
            .collect::<anyhow::Result<Vec<_>>>()?;
        let ticks = source::common_ticks(&infos, None)?;
        let edges = (0..venue.viewpoints.len())
            .map(|index| Edge::open(&venue, ViewpointIndex(index as u16), ticks.start))
            .collect::<anyhow::Result<Vec<_>>>()?;
        let card = venue.network.as_deref().map(read_card).transpose()?;
        let fusion = farfield_fusion::pipeline::Pipeline::new(&venue, card.as_ref(), SessionId(1));
        let mut this = Self {
            venue,
            edges,
            fusion,
            boxes: Vec::new(),
            ticks,
            withheld,
        };
        this.boxes = this.fusion.first_boxes(this.ticks.start);
        Ok(this)
    }

    /// The venue.
    pub fn venue(&self) -> &Venue {
        &self.venue
    }

    /// The names of the network's keypoints.
    pub fn keypoints(&self) -> &KeypointSet {
        self.fusion.keypoints()
    }

    /// Works on the next tick; `None` at the end of the recording.
    ///
    /// # Errors
    /// When a source or a network fails.
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
                .map(|(edge, boxes)| scope.spawn(move || edge.step(boxes)))
                .collect();
            work.into_iter()
                .map(|thread| {
                    thread
                        .join()
                        .unwrap_or_else(|_| Err(anyhow::anyhow!("an edge panicked")))
                })
                .collect()
        });
        let edges = outputs.into_iter().collect::<anyhow::Result<Vec<_>>>()?;
        let heard = edges
            .iter()
            .enumerate()
            .filter(|(i, _)| self.withheld != Some(ViewpointIndex(*i as u16)));
        let mut group = TickGroup {
            tick,
            ..TickGroup::default()
        };
        for (_, output) in heard {
            group.patch_sets.extend(output.patch_sets.iter().cloned());
            group
                .sighting_sets
                .extend(output.sighting_sets.iter().cloned());
        }
        let step = self.fusion.step(&group, &mut |_| {});
        self.boxes = step.boxes;
        Ok(Some(TickTrace {
            tick,
            edges,
            finished: step.finished,
        }))
    }

    /// The poses that were still undecided when the recording ended.
    pub fn finish(&mut self) -> Vec<PoseSet> {
        self.fusion.finish()
    }
}

impl Edge {
    fn open(venue: &Venue, viewpoint: ViewpointIndex, from: Tick) -> anyhow::Result<Self> {
        let network = venue
            .network
            .as_deref()
            .map(OnnxKeypointNetwork::load)
            .transpose()?;
        let detector = venue
            .detector
            .as_deref()
            .map(OnnxDetector::load)
            .transpose()?;
        let pipeline = farfield_edge::pipeline::Pipeline::new(
            venue,
            viewpoint,
            network.map(|n| Box::new(n) as Box<dyn KeypointNetwork>),
            detector.map(|d| Box::new(d) as Box<dyn PersonDetector>),
        )?;
        let cameras = &venue.viewpoints[usize::from(viewpoint.0)].cameras;
        let sources = cameras
            .iter()
            .map(|index| {
                let camera = venue
                    .camera(*index)
                    .context("a viewpoint names its cameras")?;
                Ok(source::open(camera, venue, from)?)
            })
            .collect::<anyhow::Result<Vec<_>>>()?;
        Ok(Self { sources, pipeline })
    }

    fn step(&mut self, boxes: &BoxSet) -> anyhow::Result<EdgeOutput> {
        let frames = self
            .sources
            .iter_mut()
            .map(|source| source.next_frame())
            .collect::<Result<Vec<_>, _>>()?;
        Ok(self.pipeline.step(&frames, boxes)?)
    }
}

fn read_card(path: &Path) -> anyhow::Result<HeatmapCard> {
    let text =
        std::fs::read_to_string(path).with_context(|| format!("reading {}", path.display()))?;
    Ok(HeatmapCard::parse(&text, path)?)
}
