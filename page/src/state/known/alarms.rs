//! What is wrong, in words, each with what mends it: the table of `docs/failures.md`, by what nodes say.

mod clocks;
#[cfg(test)]
mod tests;

use farfield_proto::id::ViewpointIndex;
use farfield_proto::message::live::{CameraHealth, LiveStatus};
use farfield_proto::tick::{Micros, SECOND_US};

use super::context::Context;
use super::growth::Growth;
use super::nodes::{HeardNode, Nodes, SILENT_US};
use crate::protocol::status::{Alarm, PageCounts, RecordingState, Severity};

/// A certificate that ends in less time is worth a word, seconds.
const ENDS_SOON_S: i64 = 30 * 86_400;
const DAY_S: i64 = 86_400;
/// An edge of which more ticks are missing a second is badly seen.
const MISSING_PER_S: f64 = 2.0;
/// How long after fusion was first heard a venue is starting, microseconds: its nodes are started one after another, and a
/// busy machine opens a network for half a minute. No node that was not heard yet is missed until then.
const STARTING_US: Micros = 60 * SECOND_US;
/// After this long a node that was not heard yet is named, microseconds.
const NAMED_AFTER_US: Micros = 10 * SECOND_US;

/// What alarms are found from.
pub(super) struct Circumstances<'a> {
    pub(super) context: &'a Context,
    pub(super) nodes: &'a Nodes,
    pub(super) now_us: Micros,
    /// When the last poses came, microseconds of Unix time; `None`: there were none yet.
    pub(super) last_poses_us: Option<Micros>,
    pub(super) recording: Option<&'a RecordingState>,
    pub(super) counts: PageCounts,
}

/// Alarms under way.
struct Found<'a> {
    of: &'a Circumstances<'a>,
    growth: &'a mut Growth,
    alarms: Vec<Alarm>,
}

/// Everything that is wrong now; `since_us` is now for each.
pub(super) fn find<'a>(of: &'a Circumstances<'a>, growth: &'a mut Growth) -> Vec<Alarm> {
    let mut found = Found {
        of,
        growth,
        alarms: Vec::new(),
    };
    for node in Nodes::expected(of.context) {
        found.node(node);
    }
    if of.nodes.has_ended() {
        found.ended();
    } else {
        found.links();
        found.cameras();
        found.poses();
    }
    found.page();
    found.alarms
}

impl Found<'_> {
    fn say(
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
            since_us: self.of.now_us,
        });
    }

    fn node(&mut self, node: Option<ViewpointIndex>) {
        let (context, nodes, now_us) = (self.of.context, self.of.nodes, self.of.now_us);
        let name = context.node_name(node);
        let subject = subject(context, node);
        let key = format!("node/{name}");
        let Some(heard) = nodes.get(node) else {
            self.never_heard(name, key, &subject);
            return;
        };
        let status = &heard.status;
        let silent_us = now_us.saturating_sub(heard.at_us);
        if let Some(failure) = &status.failure {
            let remedy = "mend what it says and start it again; the others go on";
            self.say(
                Severity::Failed,
                key,
                &subject,
                format!("{subject} gave up: {failure}"),
                remedy,
            );
            return;
        }
        if nodes.has_ended() {
            self.recording(heard, &subject);
            return;
        }
        // In lock-step fusion says nothing of itself while the run goes on.
        let is_to_be_heard = node.is_some() || status.live.is_some();
        if is_to_be_heard && silent_us >= SILENT_US {
            let text = format!(
                "{subject} has not been heard for {} s",
                silent_us / 1_000_000
            );
            let remedy = if node.is_some() {
                "look at its power, its network and its log; it joins again by itself"
            } else {
                "look at its log; start it again: edges go on by themselves for five seconds, and people come back with their ids"
            };
            self.say(Severity::Failed, key, &subject, text, remedy);
            return;
        }
        let key = format!("{key}/unreadable");
        if self.growth.has_grown(&key, status.unreadable, now_us) {
            let text = format!(
                "{subject} received {} messages that it could not read",
                status.unreadable
            );
            let remedy = "update the older node: fusion first, then edge by edge";
            self.say(Severity::Warning, key, &subject, text, remedy);
        }
        if node.is_none() {
            self.waiting(heard);
        }
        self.recording(heard, &subject);
        self.health(node, &subject);
    }

    /// A node that has not been heard of yet: while the venue is starting it is only named, by who waits for it if fusion does.
    fn never_heard(&mut self, name: &str, key: String, subject: &str) {
        let nodes = self.of.nodes;
        let fusion = nodes.get(None);
        let fusion = fusion.filter(|it| !nodes.has_ended() && it.status.live.is_some());
        let us = fusion.map_or(0, |it| self.of.now_us.saturating_sub(it.first_us));
        let (severity, starting) = match us {
            STARTING_US.. => (Severity::Failed, ""),
            NAMED_AFTER_US.. if !nodes.fusion_waits() => (Severity::Warning, "starting: "),
            _ => return,
        };
        let text = format!("{starting}{subject} has not been heard of yet");
        let remedy = format!(
            "start it: `farfield edge VENUE --viewpoint {name}`; look at its power and network"
        );
        self.say(severity, key, subject, text, remedy);
    }

    /// That no more ticks come, in the place of all that is silent because of it.
    fn ended(&mut self) {
        let remedy = "nothing is wrong: fusion that starts anew, as that of a demo does, is shown again by itself";
        self.say(
            Severity::Warning,
            "run/ended".to_owned(),
            "run",
            "the run has ended",
            remedy,
        );
    }

    /// For whom fusion waits before it lets recordings be played.
    fn waiting(&mut self, fusion: &HeardNode) {
        let nodes = self.of.nodes;
        let missing = nodes.not_ready(self.of.context);
        let waited_us = self.of.now_us.saturating_sub(fusion.first_us);
        if nodes.fusion_waits() && !missing.is_empty() && waited_us >= SILENT_US {
            let starting = if waited_us < STARTING_US {
                "starting: "
            } else {
                ""
            };
            let text = format!("{starting}fusion waits for {}", missing.join(", "));
            let remedy = "start who is missing (`farfield edge VENUE --viewpoint NAME`), or wait: 20 s after the first is ready \
                          fusion begins without the others";
            let key = "node/fusion/waiting".to_owned();
            self.say(Severity::Warning, key, "fusion", text, remedy);
        }
    }

    /// Whether a node does not work, by the alarms so far.
    fn has_failed(&self, node: Option<ViewpointIndex>) -> bool {
        let key = format!("node/{}", self.of.context.node_name(node));
        self.alarms
            .iter()
            .any(|alarm| alarm.severity == Severity::Failed && alarm.key == key)
    }

    /// What a node says of its clock, its keys and its disk.
    fn health(&mut self, node: Option<ViewpointIndex>, subject: &str) {
        let name = self.of.context.node_name(node).to_owned();
        let Some(heard) = self.of.nodes.get(node) else {
            return;
        };
        let health = &heard.status.health;
        self.free_clock(node, subject);
        let ends_s = health
            .certificate_ends_s
            .and_then(|ends_s| i64::try_from(ends_s).ok());
        let left_s = ends_s.map(|ends_s| ends_s.saturating_sub(self.of.now_us / 1_000_000));
        if let Some(left_s) = left_s.filter(|left_s| *left_s < ENDS_SOON_S) {
            let key = format!("key/{name}");
            let remedy = "make a new one with `farfield certs`, and bring it there";
            if left_s < 0 {
                self.say(
                    Severity::Failed,
                    key,
                    subject,
                    format!("the certificate of {subject} has ended"),
                    remedy,
                );
            } else {
                let text = format!(
                    "the certificate of {subject} ends in {} days",
                    left_s / DAY_S
                );
                self.say(Severity::Warning, key, subject, text, remedy);
            }
        }
        for (index, notice) in health.notices.iter().enumerate() {
            let key = format!("node/{name}/notice/{index}");
            let (text, remedy) = found_and_remedy(notice);
            self.say(Severity::Warning, key, subject, text, remedy);
        }
    }

    /// That a node records no more, or keeps no more of what it sends.
    fn recording(&mut self, heard: &HeardNode, subject: &str) {
        let live = heard.status.live.as_ref();
        if let Some(failure) = live.and_then(|live| live.recording_failure.clone()) {
            let remedy = "make room on its disk; poses go on without it";
            let key = format!("recording/{}", heard.status.node);
            self.say(Severity::Failed, key, subject, failure, remedy);
        }
    }

    fn links(&mut self) {
        let (context, nodes) = (self.of.context, self.of.nodes);
        for (index, viewpoint, link, health) in nodes.links(context) {
            let name = &link.viewpoint;
            let subject = format!("link to {name}");
            let key = format!("link/{name}");
            let is_expected = nodes.expects_link(viewpoint, self.of.now_us);
            if let Some(refused) = &link.refused {
                let severity = if link.live {
                    Severity::Warning
                } else {
                    Severity::Failed
                };
                let remedy = "mend what it says: the same files, keys and clock on both; it joins again by itself";
                self.say(
                    severity,
                    key.clone(),
                    &subject,
                    format!("{name} is refused: {refused}"),
                    remedy,
                );
            } else if !link.live && is_expected && !self.has_failed(Some(viewpoint)) {
                let remedy = "look at its network and its log; the others go on";
                self.say(
                    Severity::Failed,
                    key.clone(),
                    &subject,
                    format!("nothing comes from {name}"),
                    remedy,
                );
            }
            if let Some(edge) = nodes.edge_live(viewpoint).filter(|_| link.live) {
                self.load(name, &subject, edge);
            }
            if link.live {
                self.missing((index, viewpoint), name, &subject);
            }
            let lost = format!("{key}/dropped");
            if self.growth.has_grown(&lost, health.dropped, self.of.now_us) {
                let text = format!(
                    "{} messages of {name} found no place at fusion",
                    health.dropped
                );
                let remedy = "fusion is too slow, or the edge sends too much: `farfield bench`, `farfield status`";
                self.say(Severity::Warning, lost, &subject, text, remedy);
            }
            self.clock(name, link.clock_offset_us, health.clock_uncertainty_us);
        }
    }

    /// That ticks of a viewpoint are missing at fusion, by what most of them are lost to: nodes count what they do not do,
    /// and what is left was lost on the way.
    fn missing(&mut self, (link, viewpoint): (usize, ViewpointIndex), name: &str, subject: &str) {
        let (context, nodes) = (self.of.context, self.of.nodes);
        let Some(fusion) = nodes.get(None) else {
            return;
        };
        let [late, missing] = fusion.losses_per_s(link).map(Option::unwrap_or_default);
        if missing < MISSING_PER_S {
            return;
        }
        let not_done = nodes.get(Some(viewpoint));
        let not_done = not_done.and_then(HeardNode::missed_per_s).unwrap_or(0.0);
        let every_nth = nodes.edge_live(viewpoint).map_or(1, |it| it.every_nth_tick);
        let left_out = context.venue.rate_hz * (1.0 - 1.0 / f64::from(every_nth.max(1)));
        let dropped = fusion.dropped_per_s(link).unwrap_or(0.0);
        let lost = missing - late - not_done - left_out - dropped;
        let most = [late, not_done, left_out, dropped, lost]
            .into_iter()
            .fold(0.0, f64::max);
        let is_most = |cause: f64| cause >= most;
        let (why, remedy) = if is_most(left_out) || is_most(dropped) {
            // Alarms of their own say so.
            return;
        } else if is_most(not_done) {
            (
                ", which it did not work on",
                "its processor is too busy: end other programs there, give it fewer cameras or a smaller network: `farfield bench`",
            )
        } else if is_most(late) {
            (
                " in time",
                "none is lost: its processor is too busy, or its link too slow: `farfield status` has its stages and round trip",
            )
        } else {
            (
                "",
                "the link loses messages: look at its cable or radio; give it more room or fewer people",
            )
        };
        let text = format!("of {missing:.0} ticks a second nothing comes from {name}{why}");
        let key = format!("link/{name}/missing");
        self.say(Severity::Warning, key, subject, text, remedy);
    }

    /// What an edge leaves out because its link carries no more. It packs more tightly first: one that does not has too slow a
    /// computer, and says so in a notice.
    fn load(&mut self, name: &str, subject: &str, edge: &LiveStatus) {
        let usual = self.of.context.usual_level();
        if edge.quality <= usual {
            return;
        }
        let mut less = Vec::new();
        if edge.every_nth_tick > 1 {
            less.push(format!("only one of {} ticks", edge.every_nth_tick));
        }
        if let Some(persons) = edge.persons_per_tick {
            less.push(format!("{persons} people a tick"));
        }
        less.push(format!(
            "maps at compression level {} instead of {usual}",
            edge.quality
        ));
        let text = format!(
            "the link to {name} is too thin: it sends {}",
            less.join(", ")
        );
        let remedy = "give the link more room, or raise `[link] budget_bytes_per_s`; nothing queues up, and it comes back by itself";
        self.say(
            Severity::Warning,
            format!("link/{name}/load"),
            subject,
            text,
            remedy,
        );
    }

    fn cameras(&mut self) {
        let (context, nodes) = (self.of.context, self.of.nodes);
        for (index, camera) in context.venue.cameras.iter().enumerate() {
            let Some(said) = nodes.camera(context, index as u16) else {
                continue;
            };
            // What a node said before it failed is not how its cameras are; it is one cause, and one alarm.
            if self.has_failed(Some(camera.viewpoint)) {
                continue;
            }
            let (what, remedy) = match said.health {
                CameraHealth::Works => continue,
                CameraHealth::Silent if !nodes.expects_pictures(&camera.source, self.of.now_us) => {
                    continue;
                }
                CameraHealth::Frozen => (
                    "gives the same picture over and over",
                    "take its power away and give it back",
                ),
                CameraHealth::Black => (
                    "gives black pictures",
                    "look at its cap, its exposure and the light",
                ),
                CameraHealth::Silent => ("gives no pictures", "look at its cable and its power"),
                CameraHealth::Failed => (
                    "has failed, and is opened again until it works",
                    "look at its cable, its power and its address",
                ),
            };
            let name = camera.model.name();
            let reason = said
                .reason
                .as_ref()
                .map_or(String::new(), |reason| format!(": {reason}"));
            let text = format!("camera {name} {what}{reason}");
            let remedy = format!("{remedy}; its viewpoint takes another camera until then");
            self.say(
                Severity::Failed,
                format!("camera/{name}"),
                &format!("camera {name}"),
                text,
                remedy,
            );
        }
    }

    fn poses(&mut self) {
        // Fusion gives a tick's poses, of nobody if need be, as soon as ticks have a time.
        let ticks_since_us = self
            .of
            .nodes
            .get(None)
            .and_then(|fusion| fusion.ticks_since_us);
        let Some(ticks_since_us) = ticks_since_us.filter(|_| !self.has_failed(None)) else {
            return;
        };
        let since_us = self
            .of
            .last_poses_us
            .map_or(ticks_since_us, |us| us.max(ticks_since_us));
        let us = self.of.now_us.saturating_sub(since_us);
        if us >= SILENT_US {
            let text = format!("there have been no poses for {} s", us / 1_000_000);
            let remedy = "look at fusion's log and at the machine's load";
            self.say(Severity::Failed, "poses".to_owned(), "poses", text, remedy);
        }
    }

    fn page(&mut self) {
        if let Some(RecordingState {
            running: false,
            text,
            ..
        }) = self.of.recording
            && text.starts_with("failed")
        {
            let remedy = "make room on the disk, and start the recording again";
            self.say(
                Severity::Failed,
                "recording".to_owned(),
                "recording",
                text.clone(),
                remedy,
            );
        }
        let dropped = self.of.counts.dropped;
        if self.growth.has_grown("page", dropped, self.of.now_us) {
            let text = format!(
                "the page lost {} messages: what it shows has gaps, poses have none",
                self.of.counts.dropped
            );
            let remedy = "the machine is too busy for the page";
            self.say(Severity::Warning, "page".to_owned(), "page", text, remedy);
        }
    }
}

/// What a notice found and what mends it, in the words of the node: whatever it is about, it says so behind a semicolon.
fn found_and_remedy(notice: &str) -> (&str, &str) {
    let usual = "see `farfield status` and `farfield doctor`";
    notice.split_once("; ").unwrap_or((notice, usual))
}

/// A node as people call it.
fn subject(context: &Context, node: Option<ViewpointIndex>) -> String {
    match node {
        None => "fusion".to_owned(),
        Some(_) => format!("edge {}", context.node_name(node)),
    }
}

/// The worst of the alarms whose keys are `prefix` or stand below it.
pub(super) fn worst(alarms: &[Alarm], prefix: &str) -> Option<Severity> {
    let is_of = |alarm: &&Alarm| {
        let rest = alarm.key.strip_prefix(prefix);
        rest.is_some_and(|rest| rest.is_empty() || rest.starts_with('/'))
    };
    alarms
        .iter()
        .filter(is_of)
        .map(|alarm| alarm.severity)
        .min()
}
