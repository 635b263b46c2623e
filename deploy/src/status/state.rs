//! The state of a venue from its statuses: a row for every expected node, and whether it needs attention.

use std::time::Duration;

use farfield_fusion::live::cameras::in_words;
use farfield_node::clock;
use farfield_proto::message::Status;
use farfield_proto::message::agreement::{AgreementOfCamera, CameraAgreement};
use farfield_proto::message::health::{LinkHealth, SystemClock};
use farfield_proto::message::live::{CameraHealth, EdgeLink, LiveStatus};
use farfield_proto::tick::Tick;
use farfield_proto::transport::FUSION;
use farfield_proto::venue::Venue;
use serde::Serialize;

use super::listen::{Received, ReceivedNode};

/// A node sends one status per second; after this time without any it counts as silent.
const SILENT: Duration = Duration::from_secs(3);
/// A certificate that ends in fewer days is a warning; the nodes print it, too.
const ENDS_SOON_DAYS: i64 = 30;
const DAY_S: i64 = 86_400;
/// The stage of fusion's times from the capture of images to their poses.
const CAPTURE_TO_POSE: &str = "capture_to_pose";

/// State of a node, from best to worst.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum Mark {
    /// It is healthy.
    Ok,
    /// It works, with a warning.
    Warning,
    /// It needs attention.
    Red,
}

/// State of a venue.
#[derive(Debug, Clone, Serialize)]
pub(super) struct VenueState {
    pub(super) venue: String,
    /// Fusion, then the viewpoints in the venue file's order.
    pub(super) nodes: Vec<NodeState>,
}

#[derive(Debug, Clone, Serialize)]
pub(super) struct NodeState {
    pub(super) node: String,
    pub(super) mark: Mark,
    /// A few words.
    pub(super) state: String,
    /// Whether it has sent a status.
    #[serde(skip)]
    pub(super) has_status: bool,
    /// Its farfield version; empty if unknown.
    pub(super) version: String,
    pub(super) ticks_per_s: Option<f64>,
    /// Fusion: delay from the capture of images to their poses since its start; median and 99th percentile.
    pub(super) delay_ms: Option<[f64; 2]>,
    /// Edge: how it sends its patches.
    pub(super) patches: Option<PatchState>,
    /// Payload received from an edge; for fusion, from all edges.
    pub(super) bytes_per_s: Option<u64>,
    /// Round trip between fusion and an edge.
    pub(super) round_trip_ms: Option<f64>,
    pub(super) clock: Option<ClockState>,
    pub(super) cameras: Vec<CameraState>,
    /// Days until the node's certificate ends.
    pub(super) certificate_days: Option<i64>,
    /// Faults and warnings.
    pub(super) notices: Vec<String>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub(super) struct PatchState {
    /// 0 lossless to 6 smallest.
    pub(super) compression_level: u8,
    /// Maximum; `None`: all.
    pub(super) persons_per_tick: Option<u16>,
    pub(super) every_nth_tick: u16,
    /// Sets that came too late, and ticks without any set, since the start.
    pub(super) late: u64,
    pub(super) missing: u64,
}

#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub(super) struct ClockState {
    /// Measured offset to fusion's clock.
    pub(super) offset_ms: Option<f64>,
    /// Uncertainty of the offset; for fusion, of its system clock.
    pub(super) uncertainty_ms: Option<f64>,
    /// Whether NTP or PTP synchronises it, as the system reports; `None` if unknown.
    pub(super) synchronised: Option<bool>,
}

#[derive(Debug, Clone, PartialEq, Serialize)]
pub(super) struct CameraState {
    pub(super) name: String,
    pub(super) health: CameraHealth,
    /// Its health, with the reason if known.
    pub(super) words: String,
    pub(super) frames_per_s: f32,
    /// Whether it is recorded or simulated and not yet played: without images it has not failed.
    #[serde(skip)]
    pub(super) is_not_begun: bool,
    /// Agreement with the other cameras, measured by fusion.
    pub(super) agreement: Option<CameraAgreement>,
}

impl VenueState {
    /// From everything received; `now_s`: Unix time in seconds.
    pub(super) fn new(venue: &Venue, received: &Received, now_s: i64) -> Self {
        let fusion = received.nodes.get(FUSION);
        let phase = RunPhase::new(venue, received);
        let mut nodes = vec![Row::new(FUSION, received, &phase, now_s).fusion(fusion, &phase)];
        let live = fusion.and_then(|fusion| fusion.status.live.as_ref());
        for viewpoint in &venue.viewpoints {
            let name = viewpoint.name.as_str();
            let edges = live.map(|live| live.edges.as_slice()).unwrap_or_default();
            let link = edges
                .iter()
                .enumerate()
                .find(|(_, link)| link.viewpoint == name);
            let health = link.and_then(|(index, _)| fusion?.status.health.links.get(index));
            let row = Row::new(name, received, &phase, now_s);
            let link = link.map(|(_, link)| link);
            let mut edge = row.edge(venue, &phase, (link, health));
            let found = fusion.map(|fusion| fusion.status.agreement.as_slice());
            take_agreement(&mut edge.cameras, venue, found.unwrap_or_default());
            nodes.push(edge);
        }
        Self {
            venue: venue.name.clone(),
            nodes,
        }
    }

    /// The nodes that need attention, and why.
    pub(super) fn attention(&self) -> Option<String> {
        let red = self.nodes.iter().filter(|node| node.mark == Mark::Red);
        let red: Vec<String> = red
            .map(|node| match node.notices.first() {
                Some(first) if node.has_status => {
                    format!("{} ({}: {first})", node.node, node.state)
                }
                _ => format!("{} ({})", node.node, node.state),
            })
            .collect();
        (!red.is_empty()).then(|| format!("these nodes need attention: {}", red.join("; ")))
    }
}

/// Phase of a live run.
#[derive(Debug, Clone, PartialEq, Eq)]
enum RunPhase {
    /// Recordings are not yet played: fusion waits for these viewpoints.
    Waiting(Vec<String>),
    /// The first tick was a moment ago or is still to come: recordings and simulations take time to start.
    Beginning,
    /// Ticks pass, or nothing is known.
    UnderWay,
    Ended,
}

impl RunPhase {
    fn new(venue: &Venue, received: &Received) -> Self {
        let fusion = received.nodes.get(FUSION).map(|fusion| &fusion.status);
        let fusion = fusion.filter(|fusion| fusion.failure.is_none());
        let Some((fusion, live)) = fusion.and_then(|it| Some((it, it.live.as_ref()?))) else {
            return Self::UnderWay;
        };
        let is_ready = |name: &str| received.nodes.get(name).is_some_and(|it| it.status.ready);
        match live.epoch_us {
            Some(_) if !fusion.ready => Self::Ended,
            Some(_) if has_just_begun(venue, received, fusion.tick) => Self::Beginning,
            Some(_) => Self::UnderWay,
            None => {
                let names = venue.viewpoints.iter().map(|viewpoint| &viewpoint.name);
                let missing = names.filter(|name| !is_ready(name));
                Self::Waiting(missing.cloned().collect())
            }
        }
    }
}

/// Whether the first tick was not longer ago, at fusion's `tick`, than a node may be silent (as on the page). No status
/// has the first tick, so that of the recordings is used.
fn has_just_begun(venue: &Venue, received: &Received, tick: Option<Tick>) -> bool {
    let recorded = received.nodes.values().filter_map(|node| node.status.ticks);
    let first = recorded.map(|[first, _]| first.0).min().unwrap_or(0);
    tick.is_none_or(|tick| {
        let passed = Tick(tick.0.saturating_sub(first));
        passed.seconds(venue.rate_hz) < SILENT.as_secs_f64()
    })
}

/// A row in construction.
struct Row<'a> {
    received: Option<&'a ReceivedNode>,
    is_present: bool,
    state: NodeState,
}

impl<'a> Row<'a> {
    /// The fields that all nodes have.
    fn new(node: &str, all: &'a Received, phase: &RunPhase, now_s: i64) -> Self {
        let received = all.nodes.get(node);
        let status = received.map(|received| &received.status);
        let health = status.map(|status| &status.health);
        let ends_s = health.and_then(|health| health.certificate_ends_s);
        let ends_s = ends_s.and_then(|ends_s| i64::try_from(ends_s).ok());
        let certificate_days = ends_s.map(|ends_s| ends_s.saturating_sub(now_s).div_euclid(DAY_S));
        let mut row = Self {
            received,
            is_present: all.present.contains(node),
            state: NodeState {
                node: node.to_owned(),
                mark: Mark::Ok,
                state: String::new(),
                has_status: received.is_some(),
                version: status
                    .map(|status| status.release.clone())
                    .unwrap_or_default(),
                ticks_per_s: received.and_then(|received| received.ticks_per_s),
                delay_ms: None,
                patches: None,
                bytes_per_s: None,
                round_trip_ms: None,
                clock: None,
                cameras: Vec::new(),
                certificate_days,
                notices: health
                    .map(|health| health.notices.clone())
                    .unwrap_or_default(),
            },
        };
        if !row.state.notices.is_empty() || certificate_days.is_some_and(|d| d < ENDS_SOON_DAYS) {
            row.worse(Mark::Warning);
        }
        row.judge(all, phase);
        row
    }

    fn judge(&mut self, all: &Received, phase: &RunPhase) {
        let unreadable = all.unreadable.get(&self.state.node);
        let Some(received) = self.received else {
            self.worse(Mark::Red);
            self.state.state = match (self.is_present, unreadable) {
                (_, Some(error)) => format!("cannot read its status: {error}"),
                (true, None) => "connected, without a status".to_owned(),
                (false, None) => "not connected".to_owned(),
            };
            return;
        };
        let status = &received.status;
        let silent = clock::now().duration_since(received.at);
        if let Some(failure) = &status.failure {
            self.red(failure.clone());
        } else if *phase == RunPhase::Ended {
            // A node that leaves after the end is healthy.
            "the run has ended".clone_into(&mut self.state.state);
        } else if silent >= SILENT && !self.is_present {
            self.red(format!("gone for {} s", silent.as_secs()));
        } else if silent >= SILENT {
            self.red(format!("silent for {} s", silent.as_secs()));
        } else if status.live.is_none() {
            "lock-step".clone_into(&mut self.state.state);
        } else {
            "live".clone_into(&mut self.state.state);
        }
        if let Some(failure) = status
            .live
            .as_ref()
            .and_then(|live| live.recording_failure.clone())
            && !self.state.notices.contains(&failure)
        {
            self.state.notices.push(failure);
            self.worse(Mark::Red);
        }
    }

    fn worse(&mut self, mark: Mark) {
        self.state.mark = self.state.mark.max(mark);
    }

    fn red(&mut self, state: String) {
        self.worse(Mark::Red);
        self.state.state = state;
    }

    fn fusion(mut self, received: Option<&ReceivedNode>, phase: &RunPhase) -> NodeState {
        let Some(status) = received.map(|received| &received.status) else {
            return self.state;
        };
        if let RunPhase::Waiting(missing) = phase
            && self.state.mark != Mark::Red
        {
            self.state.state = if missing.is_empty() {
                "about to begin".to_owned()
            } else {
                self.worse(Mark::Warning);
                format!("waiting for {}", missing.join(", "))
            };
        }
        self.state.delay_ms = delay_ms(status);
        let system = status.health.system_clock;
        self.state.clock = system.map(|system| ClockState {
            offset_ms: None,
            uncertainty_ms: system.max_error_us.map(|us| f64::from(us) / 1e3),
            synchronised: Some(system.synchronised),
        });
        let edges = status.live.iter().flat_map(|live| &live.edges);
        let bytes = edges.map(|edge| u64::from(edge.bytes_per_s)).sum();
        self.state.bytes_per_s = status.live.as_ref().map(|_| bytes);
        self.state
    }

    fn edge(
        mut self,
        venue: &Venue,
        phase: &RunPhase,
        (link, health): (Option<&EdgeLink>, Option<&LinkHealth>),
    ) -> NodeState {
        let status = self.received.map(|received| &received.status);
        let live = status.and_then(|status| status.live.as_ref());
        if let Some(live) = live {
            self.take_live(venue, live, phase);
        }
        let system = status.and_then(|status| status.health.system_clock);
        if let Some(link) = link {
            self.take_link(link, health, live, system);
        }
        self.state
    }

    fn take_live(&mut self, venue: &Venue, live: &LiveStatus, phase: &RunPhase) {
        self.state.bytes_per_s = Some(u64::from(live.bytes_per_s));
        // Recordings and simulations are played between fusion's first and last tick.
        let is_played = *phase == RunPhase::UnderWay && live.epoch_us.is_some();
        for camera in &live.cameras {
            let known = venue.camera(camera.camera);
            let name = known.map(|known| known.model.name());
            let is_recorded = known.is_some_and(|known| !known.source.is_live());
            let is_not_begun = camera.health == CameraHealth::Silent && is_recorded && !is_played;
            let mut words = in_words(camera.health).to_owned();
            if let Some(reason) = camera
                .reason
                .as_ref()
                .filter(|_| camera.health != CameraHealth::Works)
            {
                words = format!("{words}: {reason}");
            }
            if is_not_begun {
                "is not played yet".clone_into(&mut words);
            } else if camera.health != CameraHealth::Works {
                self.worse(Mark::Red);
            }
            self.state.cameras.push(CameraState {
                name: name.unwrap_or("?").to_owned(),
                health: camera.health,
                words,
                frames_per_s: camera.frames_per_s,
                is_not_begun,
                agreement: None,
            });
        }
    }

    fn take_link(
        &mut self,
        link: &EdgeLink,
        health: Option<&LinkHealth>,
        live: Option<&LiveStatus>,
        system: Option<SystemClock>,
    ) {
        match &link.refused {
            Some(refused) if link.live => {
                self.worse(Mark::Warning);
                self.state.notices.push(refused.clone());
            }
            Some(refused) if self.received.is_some() => self.red(format!("refused: {refused}")),
            None if !link.live && self.received.is_some() => {
                self.red("not received by fusion".to_owned());
            }
            Some(_) | None => {}
        }
        self.state.round_trip_ms = link.round_trip_us.map(|us| f64::from(us) / 1e3);
        self.state.patches = live.map(|live| PatchState {
            compression_level: live.quality,
            persons_per_tick: live.persons_per_tick,
            every_nth_tick: live.every_nth_tick,
            late: link.late,
            missing: link.missing,
        });
        self.state.clock = Some(ClockState {
            offset_ms: link.clock_offset_us.map(|us| f64::from(us) / 1e3),
            uncertainty_ms: health
                .and_then(|health| health.clock_uncertainty_us)
                .map(|us| f64::from(us) / 1e3),
            synchronised: system.map(|system| system.synchronised),
        });
        if let Some(dropped) = health.map(|health| health.dropped).filter(|n| *n > 0) {
            self.worse(Mark::Warning);
            let notice = format!("fusion dropped {dropped} of its messages: its queue was full");
            self.state.notices.push(notice);
        }
    }
}

/// Adds the agreement of the cameras that fusion has measured.
fn take_agreement(cameras: &mut [CameraState], venue: &Venue, found: &[AgreementOfCamera]) {
    for AgreementOfCamera { camera, agreement } in found {
        let name = venue.camera(*camera).map(|known| known.model.name());
        let mut own = cameras.iter_mut();
        if let Some(camera) = own.find(|camera| Some(camera.name.as_str()) == name) {
            camera.agreement = Some(*agreement);
        }
    }
}

/// Median and 99th percentile of the delay of poses.
fn delay_ms(status: &Status) -> Option<[f64; 2]> {
    let stages = &mut status.stages.iter();
    let stage = stages.find(|stage| stage.stage == CAPTURE_TO_POSE)?;
    Some([stage.p50_us, stage.p99_us].map(|us| f64::from(us) / 1e3))
}

#[cfg(test)]
#[path = "tests.rs"]
mod tests;
