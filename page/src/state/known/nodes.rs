//! Statuses reported by the venue's nodes, as lines of the page's status.

use std::collections::BTreeMap;

use farfield_proto::id::ViewpointIndex;
use farfield_proto::message::Status;
use farfield_proto::message::agreement::CameraAgreement;
use farfield_proto::message::health::LinkHealth;
use farfield_proto::message::live::{CameraHealth, CameraStatus, EdgeLink, LiveStatus};
use farfield_proto::tick::{Micros, SECOND_US, Tick};
use farfield_proto::venue::{Source, VenueCamera};

use super::context::Context;
use super::frame::Frame;
use crate::protocol::status::{CameraLine, ClockLine, Condition, LinkLine, NodeLine, StageLine};

/// Nodes send a status once a second; a node that is silent this long is unhealthy.
pub(super) const SILENT_US: Micros = 3 * SECOND_US;
/// Minimum time between two statuses to derive a rate.
const SHORTEST_US: Micros = SECOND_US / 10;

/// Latest report by node; the key `None` is fusion.
#[derive(Debug, Clone, Default)]
pub(super) struct Nodes {
    reports: BTreeMap<Option<ViewpointIndex>, NodeReport>,
}

/// The latest status of a node.
#[derive(Debug, Clone)]
pub(super) struct NodeReport {
    pub(super) status: Status,
    pub(super) at_us: Micros,
    /// Time of the first status.
    pub(super) first_us: Micros,
    /// When the process first reported the time of tick 0.
    pub(super) ticks_since_us: Option<Micros>,
    /// Counters of an earlier status of the same process, and its time.
    before: Option<(Counts, Micros)>,
}

/// Counters of a status from which rates are derived.
#[derive(Debug, Clone)]
struct Counts {
    tick: Option<i64>,
    /// Ticks that the node skipped.
    missed: Option<u64>,
    /// Late and missing sets, by link.
    links: Vec<[u64; 2]>,
    /// Messages dropped by fusion for lack of room, by link.
    dropped: Vec<u64>,
}

impl Counts {
    fn from_status(status: &Status) -> Self {
        let edges = status.live.iter().flat_map(|live| &live.edges);
        Self {
            tick: status.tick.map(|tick| tick.0),
            missed: status.live.as_ref().map(|live| live.missed_ticks),
            links: edges.map(|edge| [edge.late, edge.missing]).collect(),
            dropped: status.health.links.iter().map(|it| it.dropped).collect(),
        }
    }
}

impl NodeReport {
    fn live(&self) -> Option<&LiveStatus> {
        self.status.live.as_ref()
    }

    /// Growth of a number per second since the earlier status; `None` if unknown or restarted.
    fn rate(&self, now: i64, before: i64, before_us: Micros) -> Option<f64> {
        let (grown, us) = (
            now.checked_sub(before)?,
            self.at_us.saturating_sub(before_us),
        );
        (grown >= 0 && us >= SHORTEST_US).then(|| grown as f64 * 1e6 / us as f64)
    }

    /// Ticks per second that the node processed.
    fn ticks_per_s(&self) -> Option<f64> {
        let (before, before_us) = self.before.as_ref()?;
        let (tick, missed) = (Tick(before.tick?), before.missed.unwrap_or(0));
        let done = self.status.ticks_done_since(tick, missed)?;
        self.rate(done, 0, *before_us)
    }

    /// Growth of a counter per second.
    fn grown_per_s(&self, count: impl Fn(&Counts) -> Option<u64>) -> Option<f64> {
        let (before, before_us) = self.before.as_ref()?;
        let now = count(&Counts::from_status(&self.status))?;
        self.rate(
            i64::try_from(now).ok()?,
            i64::try_from(count(before)?).ok()?,
            *before_us,
        )
    }

    /// Late and missing sets per second of a link.
    pub(super) fn losses_per_s(&self, link: usize) -> [Option<f64>; 2] {
        let of_link = |which: usize| {
            self.grown_per_s(|counts| counts.links.get(link).map(|losses| losses[which]))
        };
        [of_link(0), of_link(1)]
    }

    /// Messages per second of a link that fusion dropped for lack of room.
    pub(super) fn dropped_per_s(&self, link: usize) -> Option<f64> {
        self.grown_per_s(|counts| counts.dropped.get(link).copied())
    }

    /// Ticks per second that were due and that the node skipped.
    pub(super) fn missed_per_s(&self) -> Option<f64> {
        self.grown_per_s(|counts| counts.missed)
    }
}

impl Nodes {
    pub(super) fn take(&mut self, node: Option<ViewpointIndex>, status: Status, at_us: Micros) {
        let before = self.reports.get(&node);
        let first_us = before.map_or(at_us, |before| before.first_us);
        let before = before.filter(|before| before.status.process == status.process);
        let has_ticks = status
            .live
            .as_ref()
            .is_some_and(|live| live.epoch_us.is_some());
        let ticks_since_us = has_ticks.then(|| {
            let since_us = before.and_then(|before| before.ticks_since_us);
            since_us.unwrap_or(at_us)
        });
        // A status shortly after another gives no rate; the counters before that one are still
        // used.
        let before = before.and_then(|before| {
            let is_apart = at_us.saturating_sub(before.at_us) >= SHORTEST_US;
            if is_apart {
                Some((Counts::from_status(&before.status), before.at_us))
            } else {
                before.before.clone()
            }
        });
        let report = NodeReport {
            status,
            at_us,
            first_us,
            ticks_since_us,
            before,
        };
        self.reports.insert(node, report);
    }

    pub(super) fn get(&self, node: Option<ViewpointIndex>) -> Option<&NodeReport> {
        self.reports.get(&node)
    }

    /// Fusion and the edges of the venue.
    pub(super) fn expected(
        context: &Context,
    ) -> impl Iterator<Item = Option<ViewpointIndex>> + use<> {
        let n = context.venue.viewpoints.len();
        [None]
            .into_iter()
            .chain((0..n).map(|index| Some(ViewpointIndex(index as u16))))
    }

    /// Fusion's live status.
    pub(super) fn fusion_live(&self) -> Option<&LiveStatus> {
        self.get(None)?.live()
    }

    /// Whether fusion waits for nodes before recordings are played, so that tick times are unknown.
    pub(super) fn fusion_waits(&self) -> bool {
        let fusion = self.get(None);
        let fusion = fusion.filter(|fusion| fusion.status.failure.is_none());
        let live = fusion.and_then(NodeReport::live);
        live.is_some_and(|live| live.epoch_us.is_none())
    }

    /// Names of the viewpoints that have not reported that they are ready.
    pub(super) fn not_ready<'a>(&self, context: &'a Context) -> Vec<&'a str> {
        let edges = Self::expected(context).flatten();
        let is_ready =
            |edge: ViewpointIndex| self.get(Some(edge)).is_some_and(|edge| edge.status.ready);
        let missing = edges.filter(|edge| !is_ready(*edge));
        missing.map(|edge| context.node_name(Some(edge))).collect()
    }

    /// Whether fusion reported its end; nodes that are silent afterwards have not failed.
    pub(super) fn has_ended(&self) -> bool {
        self.get(None).is_some_and(|fusion| {
            let status = &fusion.status;
            let has_begun = fusion.live().is_some_and(|live| live.epoch_us.is_some());
            has_begun && !status.ready && status.failure.is_none()
        })
    }

    /// Whether a camera without images has failed. Recorded and simulated sources start with
    /// fusion's first tick and need time to begin.
    pub(super) fn expects_pictures(&self, source: &Source, now_us: Micros) -> bool {
        !self.has_ended() && (source.is_live() || self.have_ticks_begun(now_us))
    }

    /// Whether ticks have run long enough for all nodes to have started.
    fn have_ticks_begun(&self, now_us: Micros) -> bool {
        let since_us = self.get(None).and_then(|fusion| fusion.ticks_since_us);
        since_us.is_some_and(|us| now_us.saturating_sub(us) >= SILENT_US)
    }

    /// Whether a viewpoint must be sending: its edge has reported, and both the edge and the ticks
    /// had time to start.
    pub(super) fn expects_link(&self, viewpoint: ViewpointIndex, now_us: Micros) -> bool {
        let edge = self.get(Some(viewpoint));
        let is_up = edge.is_some_and(|edge| now_us.saturating_sub(edge.first_us) >= SILENT_US);
        is_up && self.have_ticks_begun(now_us)
    }

    /// Agreement of a camera with the others as fusion measures it; `None` if unknown.
    fn agreement(&self, camera: u16) -> Option<CameraAgreement> {
        let known = &self.get(None)?.status.agreement;
        let own = known.iter().find(|known| known.camera.0 == camera)?;
        own.agreement.is_known().then_some(own.agreement)
    }

    /// An edge's live status.
    pub(super) fn edge_live(&self, viewpoint: ViewpointIndex) -> Option<&LiveStatus> {
        self.get(Some(viewpoint))?.live()
    }

    /// Fusion's links: index, viewpoint, status, and health.
    pub(super) fn links<'a>(
        &'a self,
        context: &'a Context,
    ) -> impl Iterator<Item = (usize, ViewpointIndex, &'a EdgeLink, LinkHealth)> {
        let health = self.get(None).map(|fusion| &fusion.status.health.links);
        let edges = self.fusion_live().into_iter().flat_map(|live| &live.edges);
        edges.enumerate().filter_map(move |(index, link)| {
            let viewpoint = context.venue.viewpoint_named(&link.viewpoint)?;
            let health = health.and_then(|links| links.get(index)).copied();
            Some((index, viewpoint, link, health.unwrap_or_default()))
        })
    }

    /// The status of a camera from its edge.
    pub(super) fn camera(&self, context: &Context, index: u16) -> Option<&CameraStatus> {
        let viewpoint = context.venue.cameras.get(usize::from(index))?.viewpoint;
        let mut cameras = self.edge_live(viewpoint)?.cameras.iter();
        cameras.find(|camera| camera.camera.0 == index)
    }

    pub(super) fn node_line(
        &self,
        context: &Context,
        node: Option<ViewpointIndex>,
        state: Condition,
        now_us: Micros,
    ) -> NodeLine {
        let report = self.get(node);
        let status = report.map(|report| &report.status);
        let text = |field: fn(&Status) -> &String| {
            status
                .map(|status| field(status).clone())
                .unwrap_or_default()
        };
        let system = status.and_then(|status| status.health.system_clock);
        NodeLine {
            name: context.node_name(node).to_owned(),
            kind: if node.is_none() { "fusion" } else { "edge" },
            viewpoint: node.map(|viewpoint| viewpoint.0),
            state: if report.is_some() {
                state
            } else {
                Condition::Unknown
            },
            heard_ago_s: report
                .map(|report| now_us.saturating_sub(report.at_us).max(0) as f64 / 1e6),
            release: text(|status| &status.release),
            ready: status.is_some_and(|status| status.ready),
            tick: status.and_then(|status| status.tick),
            ticks_per_s: report.and_then(NodeReport::ticks_per_s),
            backend: text(|status| &status.backend),
            failure: status.and_then(|status| status.failure.clone()),
            notices: status
                .map(|status| status.health.notices.clone())
                .unwrap_or_default(),
            unreadable: status.map_or(0, |status| status.unreadable),
            missed_ticks: report
                .and_then(|report| report.live())
                .map(|live| live.missed_ticks),
            clock: system.map(|system| ClockLine {
                synchronised: system.synchronised,
                max_error_us: system.max_error_us,
            }),
            certificate_ends_s: status.and_then(|status| status.health.certificate_ends_s),
            stages: status
                .map(|status| status.stages.iter().map(StageLine::from).collect())
                .unwrap_or_default(),
        }
    }

    pub(super) fn link_lines(
        &self,
        context: &Context,
        state: impl Fn(ViewpointIndex) -> Condition,
        now_us: Micros,
    ) -> Vec<LinkLine> {
        let lines = self.links(context).map(|(index, viewpoint, link, health)| {
            let edge = self.edge_live(viewpoint);
            let [late_per_s, missing_per_s] = self
                .get(None)
                .map_or([None; 2], |fusion| fusion.losses_per_s(index));
            LinkLine {
                viewpoint: viewpoint.0,
                name: link.viewpoint.clone(),
                state: match state(viewpoint) {
                    Condition::Failed => Condition::Failed,
                    _ if !link.live && !self.expects_link(viewpoint, now_us) => Condition::Unknown,
                    // The alarm may belong to the edge.
                    _ if !link.live => Condition::Failed,
                    state => state,
                },
                live: link.live,
                refused: link.refused.clone(),
                round_trip_us: link.round_trip_us,
                clock_offset_us: link.clock_offset_us,
                clock_uncertainty_us: health.clock_uncertainty_us,
                clock_correction_us: health.clock_correction_us,
                horizon_ticks: link.horizon_ticks,
                bytes_per_s: link.bytes_per_s,
                budget_bytes_per_s: context.budget_bytes_per_s(),
                compression_level: edge.map(|edge| edge.quality),
                usual_level: context.usual_level(),
                persons_per_tick: edge.and_then(|edge| edge.persons_per_tick),
                every_nth_tick: edge.map(|edge| edge.every_nth_tick),
                held_back: edge.map(|edge| edge.held_back),
                late: link.late,
                missing: link.missing,
                late_per_s,
                missing_per_s,
                unreadable: link.unreadable,
                dropped: health.dropped,
            }
        });
        lines.collect()
    }

    pub(super) fn camera_lines(
        &self,
        context: &Context,
        newest: Option<&Frame>,
        now_us: Micros,
    ) -> Vec<CameraLine> {
        let lines = context.venue.cameras.iter().enumerate();
        let line = |(index, camera): (usize, &VenueCamera)| {
            let index = index as u16;
            let status = self.camera(context, index);
            let is_known = |health: CameraHealth| {
                health != CameraHealth::Silent || self.expects_pictures(&camera.source, now_us)
            };
            let health = status
                .map(|status| status.health)
                .filter(|it| is_known(*it));
            CameraLine {
                camera: index,
                name: camera.model.name().to_owned(),
                state: health.map_or("unknown", health_name),
                frames_per_s: status.map(|status| status.frames_per_s),
                capture_offset_us: status.map(|status| status.capture_offset_us),
                reason: status.and_then(|status| status.reason.clone()),
                agreement: self.agreement(index),
                persons: newest
                    .map(|frame| frame.persons_of(farfield_proto::id::CameraIndex(index)))
                    .unwrap_or_default(),
            }
        };
        lines.map(line).collect()
    }
}

fn health_name(health: CameraHealth) -> &'static str {
    match health {
        CameraHealth::Works => "works",
        CameraHealth::Frozen => "frozen",
        CameraHealth::Black => "black",
        CameraHealth::Silent => "silent",
        CameraHealth::Failed => "failed",
    }
}

#[cfg(test)]
mod tests {
    use farfield_proto::tick::Tick;
    use farfield_proto::wire;

    use super::*;
    use crate::state::fixture::synthetic;

    /// Regression: fusion's rates were almost always unknown, because its status was received twice
    /// and nothing grew between the two.
    #[test]
    fn a_duplicate_status_still_gives_rates() {
        let (mut nodes, synthetic) = (Nodes::default(), synthetic(1));
        for tick in [60, 120].map(Tick) {
            let mut passed = synthetic.messages(tick).into_iter();
            let found = passed.find(|(key, ..)| key.ends_with("/status/fusion"));
            let (_, bytes, at_us) = found.unwrap();
            let status: Status = wire::decode(&bytes).unwrap();
            for late_us in [0, 2_000] {
                nodes.take(None, status.clone(), at_us + late_us);
            }
        }
        let fusion = nodes.get(None).unwrap();
        assert!(fusion.losses_per_s(0).iter().all(Option::is_some));
        let ticks_per_s = fusion.ticks_per_s().unwrap();
        assert!((59.0..61.0).contains(&ticks_per_s), "{ticks_per_s}");
    }
}
