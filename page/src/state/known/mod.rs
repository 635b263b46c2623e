//! State derived from all messages so far: takes one message, returns what changed. Pure and cheap
//! to clone, so that a recording can be entered at any place.

mod alarms;
pub(crate) mod context;
pub(super) mod evidence;
pub(crate) mod frame;
mod latency;
mod nodes;

use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;

use farfield_proto::id::{SessionId, ViewpointIndex};
use farfield_proto::message::identity_event::{
    Change, DropReason, IdentityEvent, IdentityEventSet,
};
use farfield_proto::message::naming::NamingSet;
use farfield_proto::message::{BoxSet, PatchSet, PoseSet, SightingSet, Status};
use farfield_proto::tick::{Micros, SECOND_US, Tick};
use farfield_proto::wire::{self, WireError};

use crate::protocol::status::{Alarm, PageCounts, People, RecordingState, StatusDocument};
use crate::protocol::text::EventLine;
use alarms::{Circumstances, Growth};
use context::{Context, Topic};
use evidence::Evidence;
use frame::{Frame, SharedFrame};
use latency::{LatencyWindow, Stage, tick_time_us};
use nodes::Nodes;

/// Maximum number of pose times kept for the last second.
const MAX_POSE_TIMES: usize = 2048;

/// The current state.
#[derive(Debug, Clone)]
pub(crate) struct Known {
    context: Arc<Context>,
    session: Option<SessionId>,
    nodes: Nodes,
    evidence: Evidence,
    latency: LatencyWindow,
    epoch_us: Option<u64>,
    newest: Option<SharedFrame>,
    /// Arrival times of the poses of the last second.
    pose_times: VecDeque<Micros>,
    now_us: Micros,
    /// Start time of each active alarm.
    since: BTreeMap<String, Micros>,
    growth: Growth,
    unreadable: u64,
}

/// What a message changed.
#[derive(Debug)]
pub(crate) enum News {
    /// The people of a tick.
    Frame(SharedFrame),
    /// Identity events.
    Events(Vec<EventLine>),
    /// The status of a node.
    Status,
    /// Nothing to report at once.
    Nothing,
}

/// Status inputs that do not come from messages.
#[derive(Debug, Clone, Default)]
pub(crate) struct External {
    pub(crate) recording: Option<RecordingState>,
    pub(crate) counts: PageCounts,
}

impl Known {
    pub(crate) fn new(context: Arc<Context>) -> Self {
        Self {
            context,
            session: None,
            nodes: Nodes::default(),
            evidence: Evidence::default(),
            latency: LatencyWindow::default(),
            epoch_us: None,
            newest: None,
            pose_times: VecDeque::new(),
            now_us: 0,
            since: BTreeMap::new(),
            growth: Growth::default(),
            unreadable: 0,
        }
    }

    /// Current time, microseconds of Unix time.
    pub(crate) fn now_us(&self) -> Micros {
        self.now_us
    }

    /// The state without data that one second of messages restores. It is small, so a recording
    /// stores many of them.
    pub(crate) fn checkpoint(&self) -> Self {
        Self {
            context: Arc::clone(&self.context),
            session: self.session,
            nodes: self.nodes.clone(),
            evidence: self.evidence.checkpoint(),
            latency: LatencyWindow::default(),
            epoch_us: self.epoch_us,
            newest: None,
            pose_times: self.pose_times.back().copied().into_iter().collect(),
            now_us: self.now_us,
            since: self.since.clone(),
            growth: self.growth.clone(),
            unreadable: self.unreadable,
        }
    }

    /// Advances the clock without a message.
    pub(crate) fn wait(&mut self, us: Micros) {
        if self.now_us > 0 {
            self.now_us = self.now_us.saturating_add(us);
        }
    }

    /// Processes a wire message.
    pub(crate) fn take(&mut self, topic: Topic, bytes: &[u8], at_us: Micros) -> News {
        self.now_us = self.now_us.max(at_us);
        self.read(topic, bytes, at_us).unwrap_or_else(|_| {
            self.unreadable += 1;
            News::Nothing
        })
    }

    fn read(&mut self, topic: Topic, bytes: &[u8], at_us: Micros) -> Result<News, WireError> {
        Ok(match topic {
            Topic::Poses => self.poses(wire::decode(bytes)?, at_us),
            Topic::Events => self.events(&wire::decode(bytes)?, at_us),
            Topic::Namings => self.namings(&wire::decode(bytes)?, at_us),
            Topic::Patches(viewpoint) => {
                let set: PatchSet = wire::decode(bytes)?;
                self.patches(viewpoint, &set, at_us);
                News::Nothing
            }
            Topic::Sightings(viewpoint) => {
                let set: SightingSet = wire::decode(bytes)?;
                if self.is_of_session(set.session) && set.viewpoint == viewpoint {
                    self.evidence.take_sightings(set);
                }
                News::Nothing
            }
            Topic::Boxes(viewpoint) => {
                let set: BoxSet = wire::decode(bytes)?;
                self.enter(set.session);
                self.epoch_us = set.live.map_or(self.epoch_us, |live| Some(live.epoch_us));
                self.evidence.take_boxes(viewpoint, set);
                News::Nothing
            }
            Topic::Status(node) => {
                let status: Status = wire::decode(bytes)?;
                if status.node == self.context.node_name(node) {
                    self.nodes.take(node, status, at_us);
                }
                News::Status
            }
        })
    }

    fn is_of_session(&self, session: SessionId) -> bool {
        self.session.is_none_or(|known| known == session)
    }

    /// Ids of another session refer to other people.
    fn enter(&mut self, session: SessionId) {
        if !self.is_of_session(session) {
            self.evidence = Evidence::default();
            self.latency = LatencyWindow::default();
            self.newest = None;
            self.pose_times.clear();
        }
        self.session = Some(session);
    }

    fn patches(&mut self, viewpoint: ViewpointIndex, set: &PatchSet, at_us: Micros) {
        if !self.is_of_session(set.session) || set.viewpoint != viewpoint {
            return;
        }
        // Only the last message of a tick contains the time that all of them took.
        let is_last = set.part.saturating_add(1) == set.parts;
        if let (Some(timing), Some(epoch_us), true) = (set.timing, self.epoch_us, is_last) {
            let tick_us = tick_time_us(epoch_us, set.tick, self.context.venue.rate_hz);
            let sent_after_us = Micros::from(timing.sent_after_us);
            let captures = set.persons.iter().map(|patch| patch.capture_offset_us);
            let captured_us = Micros::from(captures.min().unwrap_or(0));
            let to_send_us = sent_after_us.saturating_sub(captured_us);
            self.latency.note(Stage::CaptureToSend, at_us, to_send_us);
            let sent_us = tick_us.saturating_add(sent_after_us);
            self.latency
                .note(Stage::Link, at_us, at_us.saturating_sub(sent_us));
        }
        self.evidence.take_patches(set, at_us);
    }

    fn poses(&mut self, set: PoseSet, at_us: Micros) -> News {
        self.enter(set.session);
        let evidence = self.evidence.take_tick(set.tick);
        if let Some(patch_us) = evidence.newest_patch_us {
            self.latency
                .note(Stage::Fusion, at_us, at_us.saturating_sub(patch_us));
        }
        if let (Some(epoch_us), Some(captured_us)) = (self.epoch_us, evidence.earliest_capture_us) {
            let tick_us = tick_time_us(epoch_us, set.tick, self.context.venue.rate_hz);
            let capture_us = tick_us.saturating_add(Micros::from(captured_us));
            self.latency.note(
                Stage::CaptureToPose,
                at_us,
                at_us.saturating_sub(capture_us),
            );
        }
        self.note_poses(set.session, at_us);
        let frame = Arc::new(Frame::new(&self.context, set, at_us, evidence));
        self.newest = Some(Arc::clone(&frame));
        News::Frame(frame)
    }

    /// Records that poses arrived, without their content.
    pub(crate) fn note_poses(&mut self, session: SessionId, at_us: Micros) {
        self.enter(session);
        self.now_us = self.now_us.max(at_us);
        // A recording is entered one second before a part.
        while self
            .pose_times
            .back()
            .is_some_and(|last_us| *last_us > at_us)
        {
            self.pose_times.pop_back();
        }
        if self.pose_times.len() >= MAX_POSE_TIMES {
            self.pose_times.pop_front();
        }
        self.pose_times.push_back(at_us);
    }

    fn events(&mut self, set: &IdentityEventSet, at_us: Micros) -> News {
        self.enter(set.session);
        let lines = set.events.iter().map(|event| {
            self.evidence.take_event(event);
            EventLine {
                session: set.session.0 as u32,
                tick: set.tick,
                at_us,
                person: event.person.0,
                other: other(event),
                change: event.change.name(),
                text: event.to_string(),
            }
        });
        News::Events(lines.collect())
    }

    fn namings(&mut self, set: &NamingSet, at_us: Micros) -> News {
        self.enter(set.session);
        let lines = set.namings.iter().map(|naming| EventLine {
            session: set.session.0 as u32,
            tick: set.tick,
            at_us,
            person: naming.person.0,
            other: None,
            change: naming.finding.name(),
            text: naming.to_string(),
        });
        News::Events(lines.collect())
    }

    fn counts(&self, external: &External) -> PageCounts {
        PageCounts {
            unreadable: self.unreadable,
            ..external.counts
        }
    }

    /// Finds all alarms, and remembers when each started.
    pub(crate) fn note_alarms(&mut self, external: &External) -> Vec<Alarm> {
        let now_us = self.now_us;
        let mut alarms = alarms::find(
            &Circumstances {
                context: &self.context,
                nodes: &self.nodes,
                now_us,
                last_poses_us: self.pose_times.back().copied(),
                recording: external.recording.as_ref(),
                counts: self.counts(external),
            },
            &mut self.growth,
        );
        for alarm in &mut alarms {
            alarm.since_us = self.since.get(&alarm.key).copied().unwrap_or(now_us);
        }
        let keyed = alarms
            .iter()
            .map(|alarm| (alarm.key.clone(), alarm.since_us));
        self.since = keyed.collect();
        alarms.sort_by_key(|alarm| (alarm.severity, alarm.since_us));
        alarms
    }

    /// Builds the status, and remembers when each alarm started.
    pub(crate) fn status(&mut self, external: &External) -> StatusDocument {
        let alarms = self.note_alarms(external);
        let (now_us, counts) = (self.now_us, self.counts(external));
        let since_us = now_us.saturating_sub(SECOND_US);
        // The last time stays, to show how long ago it was.
        while self.pose_times.len() > 1
            && self
                .pose_times
                .front()
                .is_some_and(|at_us| *at_us <= since_us)
        {
            self.pose_times.pop_front();
        }
        let poses = self
            .pose_times
            .iter()
            .filter(|at_us| **at_us > since_us)
            .count();
        self.document(external, counts, alarms, poses)
    }

    fn document(
        &mut self,
        external: &External,
        counts: PageCounts,
        alarms: Vec<Alarm>,
        poses: usize,
    ) -> StatusDocument {
        let context = &self.context;
        let name = |node| context.node_name(node).to_owned();
        let worst = |node| {
            let keys =
                ["node", "clock", "key", "recording"].map(|kind| format!("{kind}/{}", name(node)));
            keys.iter()
                .filter_map(|prefix| alarms::worst(&alarms, prefix))
                .min()
        };
        let nodes = Nodes::expected(context).map(|node| {
            self.nodes
                .node_line(context, node, worst(node).into(), self.now_us)
        });
        let link_state =
            |viewpoint| alarms::worst(&alarms, &format!("link/{}", name(Some(viewpoint)))).into();
        let newest = self.newest.as_deref();
        let [tentative, tracked, coasting] = newest.map(Frame::phases).unwrap_or_default();
        StatusDocument {
            tick: newest.map(|frame| frame.tick),
            at_us: self.now_us,
            nodes: nodes.collect(),
            links: self.nodes.link_lines(context, link_state, self.now_us),
            cameras: self.nodes.camera_lines(context, newest, self.now_us),
            latency: self.latency.lines(self.now_us),
            people: People {
                tentative,
                tracked,
                coasting,
            },
            poses_per_s: poses as f64,
            recording: external.recording.clone(),
            page: counts,
            alarms,
        }
    }

    /// The newest tick with poses.
    pub(crate) fn newest_tick(&self) -> Option<Tick> {
        self.newest.as_ref().map(|frame| frame.tick)
    }
}

/// The second person of an event.
fn other(event: &IdentityEvent) -> Option<u32> {
    match event.change {
        Change::Recognise { old, .. } => Some(old.0),
        Change::StepBack { other, .. }
        | Change::Drop {
            reason: DropReason::SamePlace { other, .. },
        } => Some(other.0),
        _ => None,
    }
}
