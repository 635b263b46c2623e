//! Alarms with their remedies: the table of `docs/failures.md`, derived from node statuses.

#[cfg(test)]
mod tests;

use std::collections::BTreeMap;

use farfield_proto::id::ViewpointIndex;
use farfield_proto::message::live::{CameraHealth, LiveStatus};
use farfield_proto::tick::{Micros, SECOND_US};

use super::context::Context;
use super::nodes::{NodeReport, Nodes, SILENT_US};
use crate::protocol::status::{Alarm, PageCounts, RecordingState, Severity};

/// Certificates that end sooner are reported, seconds.
const ENDS_SOON_S: i64 = 30 * 86_400;
const DAY_S: i64 = 86_400;
/// Missing ticks per second above which a link is reported.
const MISSING_PER_S: f64 = 2.0;
/// Start-up period of a venue after fusion's first status, microseconds. Nodes are started one
/// after another, and a busy machine needs half a minute to load a network. Until then, nodes
/// without a status are not failures.
const STARTING_US: Micros = 60 * SECOND_US;
/// Delay after which a node without a status is reported, microseconds.
const NAMED_AFTER_US: Micros = 10 * SECOND_US;

/// Offset uncertainty above which an unsynchronised clock is reported, microseconds. A runner at 8
/// m/s moves 16 mm in this time. Fusion corrects measured offsets, and nodes on one machine share a
/// clock.
const MATTERS_US: Micros = 2_000;
/// How long a loss is reported.
const LATELY_US: Micros = 60 * SECOND_US;

/// Value and time of the last growth of each counter, by alarm key.
#[derive(Debug, Clone, Default)]
pub(super) struct Growth(BTreeMap<String, (u64, Option<Micros>)>);

impl Growth {
    /// Whether a counter grew in the last minute. Its first value does not count as growth; a
    /// restarted node counts from 0.
    pub(super) fn has_grown(&mut self, key: &str, value: u64, now_us: Micros) -> bool {
        let Some((before, grown_us)) = self.0.get_mut(key) else {
            self.0.insert(key.to_owned(), (value, None));
            return false;
        };
        if value > *before {
            *grown_us = Some(now_us);
        }
        *before = value;
        grown_us.is_some_and(|grown_us| now_us.saturating_sub(grown_us) < LATELY_US)
    }
}

/// Inputs of the alarms.
pub(super) struct Circumstances<'a> {
    pub(super) context: &'a Context,
    pub(super) nodes: &'a Nodes,
    pub(super) now_us: Micros,
    /// Arrival of the last poses, microseconds of Unix time; `None` before the first.
    pub(super) last_poses_us: Option<Micros>,
    pub(super) recording: Option<&'a RecordingState>,
    pub(super) counts: PageCounts,
}

/// Collects alarms.
struct Finder<'a> {
    facts: &'a Circumstances<'a>,
    growth: &'a mut Growth,
    alarms: Vec<Alarm>,
}

/// Finds all current alarms; `since_us` is set to now for each.
pub(super) fn find<'a>(facts: &'a Circumstances<'a>, growth: &'a mut Growth) -> Vec<Alarm> {
    let mut finder = Finder {
        facts,
        growth,
        alarms: Vec::new(),
    };
    for node in Nodes::expected(facts.context) {
        finder.node(node);
    }
    if facts.nodes.has_ended() {
        finder.ended();
    } else {
        finder.links();
        finder.cameras();
        finder.poses();
    }
    finder.page();
    finder.alarms
}

impl Finder<'_> {
    fn add(
        &mut self,
        severity: Severity,
        key: String,
        subject: &str,
        text: impl Into<String>,
        remedy: impl Into<String>,
    ) {
        if self.alarms.iter().any(|alarm| alarm.key == key) {
            return;
        }
        self.alarms.push(Alarm {
            severity,
            key,
            subject: subject.to_owned(),
            text: text.into(),
            remedy: remedy.into(),
            since_us: self.facts.now_us,
        });
    }

    fn node(&mut self, node: Option<ViewpointIndex>) {
        let (context, nodes, now_us) = (self.facts.context, self.facts.nodes, self.facts.now_us);
        let name = context.node_name(node);
        let subject = subject(context, node);
        let key = format!("node/{name}");
        let Some(report) = nodes.get(node) else {
            self.never_reported(name, key, &subject);
            return;
        };
        let status = &report.status;
        let silent_us = now_us.saturating_sub(report.at_us);
        if let Some(failure) = &status.failure {
            let remedy = "fix the cause and start it again; the other nodes keep running";
            self.add(
                Severity::Failed,
                key,
                &subject,
                format!("{subject} failed: {failure}"),
                remedy,
            );
            return;
        }
        if nodes.has_ended() {
            self.recording(report, &subject);
            return;
        }
        // In lock-step, fusion sends no status during the run.
        let must_report = node.is_some() || status.live.is_some();
        if must_report && silent_us >= SILENT_US {
            let text = format!("{subject} has been silent for {} s", silent_us / 1_000_000);
            let remedy = if node.is_some() {
                "check its power, network and log; it reconnects by itself"
            } else {
                "check its log and start it again: edges continue alone for five seconds, and people keep their ids"
            };
            self.add(Severity::Failed, key, &subject, text, remedy);
            return;
        }
        let key = format!("{key}/unreadable");
        if self.growth.has_grown(&key, status.unreadable, now_us) {
            let text = format!(
                "{subject} received {} messages that it could not decode",
                status.unreadable
            );
            let remedy = "update the older node: fusion first, then edge by edge";
            self.add(Severity::Warning, key, &subject, text, remedy);
        }
        if node.is_none() {
            self.waiting(report);
        }
        self.recording(report, &subject);
        self.health(node, &subject);
    }

    /// Reports a node without any status; during start-up only as a warning, unless fusion's own
    /// waiting alarm names it.
    fn never_reported(&mut self, name: &str, key: String, subject: &str) {
        let nodes = self.facts.nodes;
        let fusion = nodes.get(None);
        let fusion = fusion.filter(|it| !nodes.has_ended() && it.status.live.is_some());
        let us = fusion.map_or(0, |it| self.facts.now_us.saturating_sub(it.first_us));
        let (severity, starting) = match us {
            STARTING_US.. => (Severity::Failed, ""),
            NAMED_AFTER_US.. if !nodes.fusion_waits() => (Severity::Warning, "starting: "),
            _ => return,
        };
        let text = format!("{starting}{subject} has not sent any status yet");
        let remedy = format!(
            "start it: `farfield edge VENUE --viewpoint {name}`; check its power and network"
        );
        self.add(severity, key, subject, text, remedy);
    }

    /// Reports that no more ticks come, in place of everything that is silent for this reason.
    fn ended(&mut self) {
        let remedy = "nothing is wrong: the page reconnects by itself when fusion starts again, as in a demo";
        self.add(
            Severity::Warning,
            "run/ended".to_owned(),
            "run",
            "the run has ended",
            remedy,
        );
    }

    /// Reports the edges that fusion waits for before recordings are played.
    fn waiting(&mut self, fusion: &NodeReport) {
        let nodes = self.facts.nodes;
        let missing = nodes.not_ready(self.facts.context);
        let waited_us = self.facts.now_us.saturating_sub(fusion.first_us);
        if nodes.fusion_waits() && !missing.is_empty() && waited_us >= SILENT_US {
            let starting = if waited_us < STARTING_US {
                "starting: "
            } else {
                ""
            };
            let text = format!("{starting}fusion waits for {}", missing.join(", "));
            let remedy = "start the missing edges (`farfield edge VENUE --viewpoint NAME`), or wait: fusion starts without them 20 s \
                          after the first is ready";
            let key = "node/fusion/waiting".to_owned();
            self.add(Severity::Warning, key, "fusion", text, remedy);
        }
    }

    /// Whether a node has failed according to the alarms so far.
    fn has_failed(&self, node: Option<ViewpointIndex>) -> bool {
        let key = format!("node/{}", self.facts.context.node_name(node));
        self.alarms
            .iter()
            .any(|alarm| alarm.severity == Severity::Failed && alarm.key == key)
    }

    /// Alarms from a node's clock, certificate and notices.
    fn health(&mut self, node: Option<ViewpointIndex>, subject: &str) {
        let name = self.facts.context.node_name(node).to_owned();
        let Some(report) = self.facts.nodes.get(node) else {
            return;
        };
        let health = &report.status.health;
        self.free_clock(node, subject);
        let ends_s = health
            .certificate_ends_s
            .and_then(|ends_s| i64::try_from(ends_s).ok());
        let left_s = ends_s.map(|ends_s| ends_s.saturating_sub(self.facts.now_us / 1_000_000));
        if let Some(left_s) = left_s.filter(|left_s| *left_s < ENDS_SOON_S) {
            let key = format!("key/{name}");
            let remedy = "create a new one with `farfield certs` and copy it there";
            if left_s < 0 {
                self.add(
                    Severity::Failed,
                    key,
                    subject,
                    format!("the certificate of {subject} has expired"),
                    remedy,
                );
            } else {
                let text = format!(
                    "the certificate of {subject} expires in {} days",
                    left_s / DAY_S
                );
                self.add(Severity::Warning, key, subject, text, remedy);
            }
        }
        for (index, notice) in health.notices.iter().enumerate() {
            let key = format!("node/{name}/notice/{index}");
            let (text, remedy) = text_and_remedy(notice);
            self.add(Severity::Warning, key, subject, text, remedy);
        }
    }

    /// Reports that a node stopped recording, or stopped storing what it sends.
    fn recording(&mut self, report: &NodeReport, subject: &str) {
        let live = report.status.live.as_ref();
        if let Some(failure) = live.and_then(|live| live.recording_failure.clone()) {
            let remedy = "free space on its disk; poses continue without it";
            let key = format!("recording/{}", report.status.node);
            self.add(Severity::Failed, key, subject, failure, remedy);
        }
    }

    fn links(&mut self) {
        let (context, nodes) = (self.facts.context, self.facts.nodes);
        for (index, viewpoint, link, health) in nodes.links(context) {
            let name = &link.viewpoint;
            let subject = format!("link to {name}");
            let key = format!("link/{name}");
            let is_expected = nodes.expects_link(viewpoint, self.facts.now_us);
            if let Some(refused) = &link.refused {
                let severity = if link.live {
                    Severity::Warning
                } else {
                    Severity::Failed
                };
                let remedy = "fix the cause: files, keys and clocks must match on both sides; it reconnects by itself";
                self.add(
                    severity,
                    key.clone(),
                    &subject,
                    format!("{name} is refused: {refused}"),
                    remedy,
                );
            } else if !link.live && is_expected && !self.has_failed(Some(viewpoint)) {
                let remedy = "check its network and its log; the other viewpoints keep working";
                self.add(
                    Severity::Failed,
                    key.clone(),
                    &subject,
                    format!("no data from {name}"),
                    remedy,
                );
            }
            if let Some(edge) = nodes.edge_live(viewpoint).filter(|_| link.live) {
                self.load(name, &subject, edge);
            }
            if link.live {
                self.missing(index, viewpoint, name, &subject);
            }
            let lost = format!("{key}/dropped");
            if self
                .growth
                .has_grown(&lost, health.dropped, self.facts.now_us)
            {
                let text = format!(
                    "fusion dropped {} messages of {name} for lack of room",
                    health.dropped
                );
                let remedy = "fusion is too slow, or the edge sends too much: check `farfield bench` and `farfield status`";
                self.add(Severity::Warning, lost, &subject, text, remedy);
            }
            self.clock(name, link.clock_offset_us, health.clock_uncertainty_us);
        }
    }

    /// Reports missing ticks of a viewpoint with the most frequent cause. Nodes count the ticks
    /// that they skip; the rest was lost on the way.
    fn missing(&mut self, link: usize, viewpoint: ViewpointIndex, name: &str, subject: &str) {
        let (context, nodes) = (self.facts.context, self.facts.nodes);
        let Some(fusion) = nodes.get(None) else {
            return;
        };
        let [late, missing] = fusion.losses_per_s(link).map(Option::unwrap_or_default);
        if missing < MISSING_PER_S {
            return;
        }
        let not_done = nodes.get(Some(viewpoint));
        let not_done = not_done.and_then(NodeReport::missed_per_s).unwrap_or(0.0);
        let every_nth = nodes.edge_live(viewpoint).map_or(1, |it| it.every_nth_tick);
        let left_out = context.venue.rate_hz * (1.0 - 1.0 / f64::from(every_nth.max(1)));
        let dropped = fusion.dropped_per_s(link).unwrap_or(0.0);
        let lost = missing - late - not_done - left_out - dropped;
        let most = [late, not_done, left_out, dropped, lost]
            .into_iter()
            .fold(0.0, f64::max);
        let is_most = |cause: f64| cause >= most;
        let (why, remedy) = if is_most(left_out) || is_most(dropped) {
            // These causes have their own alarms.
            return;
        } else if is_most(not_done) {
            (
                ", which it skipped",
                "its processor is too busy: end other programs there, or give it fewer cameras or a smaller network (`farfield bench`)",
            )
        } else if is_most(late) {
            (
                " in time",
                "none is lost: its processor or its link is too slow; `farfield status` shows its stages and round trip",
            )
        } else {
            (
                "",
                "the link loses messages: check its cable or radio, give it more bandwidth, or track fewer people",
            )
        };
        let text = format!("{missing:.0} ticks per second from {name} do not arrive{why}");
        let key = format!("link/{name}/missing");
        self.add(Severity::Warning, key, subject, text, remedy);
    }

    /// Reports what an edge omits because of its link. An edge raises the compression level first;
    /// one that does not is too slow, and sends a notice.
    fn load(&mut self, name: &str, subject: &str, edge: &LiveStatus) {
        let usual = self.facts.context.usual_level();
        if edge.quality <= usual {
            return;
        }
        let mut less = Vec::new();
        if edge.every_nth_tick > 1 {
            less.push(format!("only one of {} ticks", edge.every_nth_tick));
        }
        if let Some(persons) = edge.persons_per_tick {
            less.push(format!("{persons} people per tick"));
        }
        less.push(format!(
            "maps at compression level {} instead of {usual}",
            edge.quality
        ));
        let text = format!(
            "the link to {name} is too slow: it sends {}",
            less.join(", ")
        );
        let remedy = "give the link more bandwidth, or raise `[link] budget_bytes_per_s`; nothing queues up, and it recovers by itself";
        self.add(
            Severity::Warning,
            format!("link/{name}/load"),
            subject,
            text,
            remedy,
        );
    }

    fn cameras(&mut self) {
        let (context, nodes) = (self.facts.context, self.facts.nodes);
        for (index, camera) in context.venue.cameras.iter().enumerate() {
            let Some(status) = nodes.camera(context, index as u16) else {
                continue;
            };
            // One cause, one alarm: the last camera statuses of a failed node are outdated.
            if self.has_failed(Some(camera.viewpoint)) {
                continue;
            }
            let (what, remedy) = match status.health {
                CameraHealth::Works => continue,
                CameraHealth::Silent
                    if !nodes.expects_pictures(&camera.source, self.facts.now_us) =>
                {
                    continue;
                }
                CameraHealth::Frozen => (
                    "repeats the same image",
                    "disconnect and reconnect its power",
                ),
                CameraHealth::Black => (
                    "gives black images",
                    "check its lens cap, its exposure and the light",
                ),
                CameraHealth::Silent => ("gives no images", "check its cable and power"),
                CameraHealth::Failed => (
                    "has failed and is reopened until it works",
                    "check its cable, power and address",
                ),
            };
            let name = camera.model.name();
            let reason = status
                .reason
                .as_ref()
                .map_or(String::new(), |reason| format!(": {reason}"));
            let text = format!("camera {name} {what}{reason}");
            let remedy = format!("{remedy}; its viewpoint uses another camera until then");
            self.add(
                Severity::Failed,
                format!("camera/{name}"),
                &format!("camera {name}"),
                text,
                remedy,
            );
        }
    }

    fn poses(&mut self) {
        // Fusion publishes poses for every tick, also without people, once ticks have a time.
        let ticks_since_us = self
            .facts
            .nodes
            .get(None)
            .and_then(|fusion| fusion.ticks_since_us);
        let Some(ticks_since_us) = ticks_since_us.filter(|_| !self.has_failed(None)) else {
            return;
        };
        let since_us = self
            .facts
            .last_poses_us
            .map_or(ticks_since_us, |us| us.max(ticks_since_us));
        let us = self.facts.now_us.saturating_sub(since_us);
        if us >= SILENT_US {
            let text = format!("no poses for {} s", us / 1_000_000);
            let remedy = "check fusion's log and the load of its machine";
            self.add(Severity::Failed, "poses".to_owned(), "poses", text, remedy);
        }
    }

    fn page(&mut self) {
        if let Some(RecordingState {
            running: false,
            text,
            ..
        }) = self.facts.recording
            && text.starts_with("failed")
        {
            let remedy = "free space on the disk and start the recording again";
            self.add(
                Severity::Failed,
                "recording".to_owned(),
                "recording",
                text.clone(),
                remedy,
            );
        }
        let dropped = self.facts.counts.dropped;
        if self.growth.has_grown("page", dropped, self.facts.now_us) {
            let text = format!(
                "the page dropped {} messages: its display has gaps, the poses do not",
                self.facts.counts.dropped
            );
            let remedy = "the machine is too busy for the page";
            self.add(Severity::Warning, "page".to_owned(), "page", text, remedy);
        }
    }
}

/// Splits a node's notice into text and remedy at the first semicolon.
fn text_and_remedy(notice: &str) -> (&str, &str) {
    let usual = "see `farfield status` and `farfield doctor`";
    notice.split_once("; ").unwrap_or((notice, usual))
}

/// Display name of a node.
fn subject(context: &Context, node: Option<ViewpointIndex>) -> String {
    match node {
        None => "fusion".to_owned(),
        Some(_) => format!("edge {}", context.node_name(node)),
    }
}

/// The worst severity of the alarms with the key `prefix` or below it.
pub(super) fn worst(alarms: &[Alarm], prefix: &str) -> Option<Severity> {
    let is_below = |alarm: &&Alarm| {
        let rest = alarm.key.strip_prefix(prefix);
        rest.is_some_and(|rest| rest.is_empty() || rest.starts_with('/'))
    };
    alarms
        .iter()
        .filter(is_below)
        .map(|alarm| alarm.severity)
        .min()
}

impl Finder<'_> {
    /// Reports a clock that neither NTP nor PTP synchronises, if fusion's estimate of its offset is
    /// too uncertain.
    fn free_clock(&mut self, node: Option<ViewpointIndex>, subject: &str) {
        let Some(report) = self.facts.nodes.get(node) else {
            return;
        };
        let system = report.status.health.system_clock;
        let is_free = system.is_some_and(|system| !system.synchronised);
        if !is_free || report.status.live.is_none() || !self.is_badly_known(node) {
            return;
        }
        let name = self.facts.context.node_name(node).to_owned();
        self.add(
            Severity::Warning,
            format!("clock/{name}/free"),
            subject,
            format!("the clock of {subject} is not synchronised"),
            "start NTP or PTP on it (`timedatectl set-ntp true`, or chrony)",
        );
    }

    /// Whether the clock offset of a node is too uncertain; for fusion, that of any edge.
    fn is_badly_known(&self, node: Option<ViewpointIndex>) -> bool {
        let all = self.facts.nodes.links(self.facts.context);
        let mut links = all.filter(|(_, viewpoint, link, _)| {
            link.live && node.is_none_or(|node| node == *viewpoint)
        });
        links.any(|(_, _, _, health)| {
            let uncertainty_us = health.clock_uncertainty_us.map(Micros::from);
            uncertainty_us.is_none_or(|us| us > MATTERS_US)
        })
    }

    /// Reports a clock that is far off and corrected.
    fn clock(&mut self, name: &str, offset_us: Option<i32>, uncertainty_us: Option<u32>) {
        let bound_ms = self.facts.context.venue.parameters.link.clock_bound_ms;
        let Some(offset_us) = offset_us else {
            return;
        };
        let off_ms = f64::from(offset_us.unsigned_abs()) / 1e3;
        // Beyond the bound the node is refused, which has its own alarm.
        if off_ms > 0.5 * bound_ms {
            let bound = uncertainty_us.map_or(String::new(), |us| {
                format!(" (±{:.1})", f64::from(us) / 1e3)
            });
            let text = format!(
                "the clock of {name} is {off_ms:.1} ms{bound} off; it is corrected up to {bound_ms} ms"
            );
            let remedy = "start NTP or PTP on it";
            self.add(
                Severity::Warning,
                format!("clock/{name}"),
                &format!("clock of {name}"),
                text,
                remedy,
            );
        }
    }
}
