//! What the statuses of a venue mean: a row for every node that it should have, and whether somebody must look after it.

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

use super::listen::{Heard, HeardNode};

/// A node that says once a second how it is, and is silent for so long, is not well.
const SILENT: Duration = Duration::from_secs(3);
/// A certificate that ends in fewer days is worth a word; the nodes themselves say so, too.
const ENDS_SOON_DAYS: i64 = 30;
const DAY_S: i64 = 86_400;
/// The stage of fusion's times from the capture of pictures to the poses made of them.
const CAPTURE_TO_POSE: &str = "capture_to_pose";

/// How a node is, the worst last.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum Mark {
    /// As it should be.
    Ok,
    /// It works, and somebody should know something.
    Warning,
    /// Somebody must look after it.
    Red,
}

/// A venue as its nodes say that it is.
#[derive(Debug, Clone, Serialize)]
pub(super) struct VenueState {
    pub(super) venue: String,
    /// Fusion, then the viewpoints in the venue file's order.
    pub(super) nodes: Vec<NodeState>,
}

/// One node.
#[derive(Debug, Clone, Serialize)]
pub(super) struct NodeState {
    pub(super) node: String,
    pub(super) mark: Mark,
    /// In a few words.
    pub(super) state: String,
    /// Whether it has said anything.
    #[serde(skip)]
    pub(super) is_heard: bool,
    /// Which farfield it runs; empty where it does not say.
    pub(super) version: String,
    pub(super) ticks_per_s: Option<f64>,
    /// Of fusion: from the capture of pictures to the poses made of them, since its start; median and 99th percentile.
    pub(super) delay_ms: Option<[f64; 2]>,
    /// Of an edge: how it sends its patches.
    pub(super) patches: Option<PatchState>,
    /// Payload that comes from an edge, or to fusion from all of them.
    pub(super) bytes_per_s: Option<u64>,
    /// Round trip of the network between fusion and an edge.
    pub(super) round_trip_ms: Option<f64>,
    pub(super) clock: Option<ClockState>,
    pub(super) cameras: Vec<CameraState>,
    /// Until when the node's certificate holds.
    pub(super) certificate_days: Option<i64>,
    /// What is not as it should be.
    pub(super) notices: Vec<String>,
}

/// How an edge sends its patches.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub(super) struct PatchState {
    /// 0 lossless to 6 fewest bytes.
    pub(super) compression_level: u8,
    /// At most; `None`: all.
    pub(super) persons_per_tick: Option<u16>,
    pub(super) every_nth_tick: u16,
    /// Sets that came too late, and ticks of which nothing came, since the start.
    pub(super) late: u64,
    pub(super) missing: u64,
}

/// A node's clock.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub(super) struct ClockState {
    /// Against fusion's, as measured.
    pub(super) offset_ms: Option<f64>,
    /// By how much that may be wrong; of fusion what its system says.
    pub(super) uncertainty_ms: Option<f64>,
    /// Whether NTP or PTP keeps it right, as the system says; `None` where it says nothing.
    pub(super) synchronised: Option<bool>,
}

/// A camera of an edge.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(super) struct CameraState {
    pub(super) name: String,
    pub(super) health: CameraHealth,
    /// In words, with the reason where one is known.
    pub(super) words: String,
    pub(super) frames_per_s: f32,
    /// Whether it is recorded or simulated, and not played yet: it gives no pictures, and has not failed.
    #[serde(skip)]
    pub(super) is_not_begun: bool,
    /// How it agrees with the other cameras, as fusion finds it.
    pub(super) agreement: Option<CameraAgreement>,
}

impl VenueState {
    /// Of `venue`, by what was heard; `now_s`: Unix time in seconds.
    pub(super) fn new(venue: &Venue, heard: &Heard, now_s: i64) -> Self {
        let fusion = heard.nodes.get(FUSION);
        let phase = RunPhase::of(venue, heard);
        let mut nodes = vec![Row::new(FUSION, heard, &phase, now_s).fusion(fusion, &phase)];
        let live = fusion.and_then(|fusion| fusion.status.live.as_ref());
        for viewpoint in &venue.viewpoints {
            let name = viewpoint.name.as_str();
            let edges = live.map(|live| live.edges.as_slice()).unwrap_or_default();
            let link = edges
                .iter()
                .enumerate()
                .find(|(_, link)| link.viewpoint == name);
            let health = link.and_then(|(index, _)| fusion?.status.health.links.get(index));
            let row = Row::new(name, heard, &phase, now_s);
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

    /// Who must be looked after, and why.
    pub(super) fn attention(&self) -> Option<String> {
        let red = self.nodes.iter().filter(|node| node.mark == Mark::Red);
        let red: Vec<String> = red
            .map(|node| match node.notices.first() {
                Some(first) if node.is_heard => format!("{} ({}: {first})", node.node, node.state),
                _ => format!("{} ({})", node.node, node.state),
            })
            .collect();
        (!red.is_empty()).then(|| format!("to be looked after: {}", red.join("; ")))
    }
}

/// Where a live run is, as fusion says.
#[derive(Debug, Clone, PartialEq, Eq)]
enum RunPhase {
    /// No recording is played yet: fusion waits for these viewpoints.
    Waiting(Vec<String>),
    /// The first tick is not long gone, or still to come: what is recorded or simulated takes its time to begin.
    Beginning,
    /// Ticks pass, or nobody says anything of it.
    UnderWay,
    /// There are no more ticks.
    Ended,
}

impl RunPhase {
    fn of(venue: &Venue, heard: &Heard) -> Self {
        let fusion = heard.nodes.get(FUSION).map(|fusion| &fusion.status);
        let fusion = fusion.filter(|fusion| fusion.failure.is_none());
        let Some((fusion, live)) = fusion.and_then(|it| Some((it, it.live.as_ref()?))) else {
            return Self::UnderWay;
        };
        let is_ready = |name: &str| heard.nodes.get(name).is_some_and(|it| it.status.ready);
        match live.epoch_us {
            Some(_) if !fusion.ready => Self::Ended,
            Some(_) if has_just_begun(venue, heard, fusion.tick) => Self::Beginning,
            Some(_) => Self::UnderWay,
            None => {
                let names = venue.viewpoints.iter().map(|viewpoint| &viewpoint.name);
                let missing = names.filter(|name| !is_ready(name));
                Self::Waiting(missing.cloned().collect())
            }
        }
    }
}

/// Whether at fusion's `tick` its first is gone for no longer than a node may be silent, as the page has it, too. Which that was
/// nobody says: that of the recordings is taken for it.
fn has_just_begun(venue: &Venue, heard: &Heard, tick: Option<Tick>) -> bool {
    let recorded = heard.nodes.values().filter_map(|node| node.status.ticks);
    let first = recorded.map(|[first, _]| first.0).min().unwrap_or(0);
    tick.is_none_or(|tick| {
        let passed = Tick(tick.0.saturating_sub(first));
        passed.seconds(venue.rate_hz) < SILENT.as_secs_f64()
    })
}

/// A row under way.
struct Row<'a> {
    heard: Option<&'a HeardNode>,
    is_present: bool,
    state: NodeState,
}

impl<'a> Row<'a> {
    /// What holds for every node.
    fn new(node: &str, all: &'a Heard, phase: &RunPhase, now_s: i64) -> Self {
        let heard = all.nodes.get(node);
        let status = heard.map(|heard| &heard.status);
        let health = status.map(|status| &status.health);
        let ends_s = health.and_then(|health| health.certificate_ends_s);
        let ends_s = ends_s.and_then(|ends_s| i64::try_from(ends_s).ok());
        let certificate_days = ends_s.map(|ends_s| ends_s.saturating_sub(now_s).div_euclid(DAY_S));
        let mut row = Self {
            heard,
            is_present: all.present.contains(node),
            state: NodeState {
                node: node.to_owned(),
                mark: Mark::Ok,
                state: String::new(),
                is_heard: heard.is_some(),
                version: status
                    .map(|status| status.release.clone())
                    .unwrap_or_default(),
                ticks_per_s: heard.and_then(|heard| heard.ticks_per_s),
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

    fn judge(&mut self, all: &Heard, phase: &RunPhase) {
        let unreadable = all.unreadable.get(&self.state.node);
        let Some(heard) = self.heard else {
            self.worse(Mark::Red);
            self.state.state = match (self.is_present, unreadable) {
                (_, Some(error)) => format!("cannot be understood: {error}"),
                (true, None) => "there, and says nothing".to_owned(),
                (false, None) => "not there".to_owned(),
            };
            return;
        };
        let status = &heard.status;
        let silent = clock::now().duration_since(heard.at);
        if let Some(failure) = &status.failure {
            self.red(failure.clone());
        } else if *phase == RunPhase::Ended {
            // Whoever leaves now does as it should.
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

    fn fusion(mut self, heard: Option<&HeardNode>, phase: &RunPhase) -> NodeState {
        let Some(status) = heard.map(|heard| &heard.status) else {
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
        let status = self.heard.map(|heard| &heard.status);
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
        // What is recorded or simulated is played between fusion's first tick and its last.
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
                "is not played".clone_into(&mut words);
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
            Some(refused) if self.heard.is_some() => self.red(format!("refused: {refused}")),
            None if !link.live && self.heard.is_some() => {
                self.red("not heard by fusion".to_owned());
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
            let notice = format!("{dropped} of its messages found no place at fusion");
            self.state.notices.push(notice);
        }
    }
}

/// Sets what fusion finds of how the cameras agree.
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
