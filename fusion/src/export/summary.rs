//! `summary.json`: the summary of a run.
//!
//! Two equal lock-step runs give equal summaries except for [`Summary::timing`]: values that depend
//! on a clock, a socket or another process belong there.

use std::collections::BTreeMap;
use std::path::PathBuf;

use farfield_proto::message::identity_event::IdentityEvent;
use farfield_proto::message::live::CameraHealth;
use farfield_proto::tick::Tick;
use serde::{Deserialize, Serialize};

use super::pose_files::Presence;
use super::refusal::Refusal;
use crate::camera_agreement::AgreementReport;

/// A run in `summary.json`.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Summary {
    /// Name of the venue.
    pub venue: String,
    /// Fingerprint of the venue file.
    pub venue_hash: String,
    /// Fingerprint of the calibration.
    pub calibration_hash: String,
    /// Ticks per second.
    pub rate_hz: f64,
    /// Whether the run reached its end, or was interrupted.
    pub complete: bool,
    /// The processed ticks.
    pub ticks: TickSpan,
    /// The people, by id.
    pub people: Vec<PersonSummary>,
    /// Counts of identity events.
    #[serde(default)]
    pub events: EventCounts,
    /// Whether the cameras agree, by recent data, and what does not fit.
    #[serde(default)]
    pub agreement: AgreementReport,
    /// Per viewpoint, the traffic of its link.
    pub links: BTreeMap<String, LinkSummary>,
    /// Lost data, over all links.
    pub drops: DropSummary,
    /// Per node that runs a network: the inference backend.
    pub backends: BTreeMap<String, String>,
    /// Per model file (network, detector): its fingerprint.
    pub models: BTreeMap<String, String>,
    /// Per program and library: its version.
    pub versions: BTreeMap<String, String>,
    /// Everything that may differ between two equal runs.
    pub timing: TimingSummary,
}

/// The ticks of a run, without `end`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct TickSpan {
    /// First tick.
    pub first: Tick,
    /// The tick after the last.
    pub end: Tick,
    /// How many were finished.
    pub done: u64,
}

/// One person of a run.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct PersonSummary {
    /// The id.
    pub person: u32,
    /// First tick with a pose.
    pub first_tick: Tick,
    /// Last tick with a pose.
    pub last_tick: Tick,
    /// Ticks with a pose.
    pub ticks: u64,
    /// Body height from the final link lengths of the run, metres, without shoes and hair.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stature_m: Option<f64>,
}

impl From<Presence> for PersonSummary {
    fn from(presence: Presence) -> Self {
        Self {
            person: presence.person.0,
            first_tick: presence.first_tick,
            last_tick: presence.last_tick,
            ticks: presence.ticks,
            stature_m: presence.stature_m.map(to_millimetre),
        }
    }
}

fn to_millimetre(length_m: f64) -> f64 {
    (1000.0 * length_m).round() / 1000.0
}

/// Counts of events, by kind and reason: `drop/outside_field`.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(transparent)]
pub struct EventCounts(BTreeMap<String, u64>);

impl EventCounts {
    /// Counts these events.
    pub fn count(&mut self, events: &[IdentityEvent]) {
        for event in events {
            let name = event.change.name();
            match self.0.get_mut(name) {
                Some(count) => *count += 1,
                None => drop(self.0.insert(name.to_owned(), 1)),
            }
        }
    }
}

/// Messages and payload bytes of one viewpoint's link, without protocol overhead.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct LinkSummary {
    /// Patch messages that fusion received.
    pub patch_messages: u64,
    /// Their bytes.
    pub patch_bytes: u64,
    /// Persons in them: one per person and tick.
    pub patches: u64,
    /// Sighting messages that fusion received.
    pub sighting_messages: u64,
    /// Their bytes.
    pub sighting_bytes: u64,
    /// Box messages that fusion sent.
    pub box_messages: u64,
    /// Their bytes.
    pub box_bytes: u64,
}

/// Lost data.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct DropSummary {
    /// Messages that could not be read.
    pub unreadable: u64,
    /// Patches that could be read, but were invalid: of an unknown person or camera.
    pub unusable: u64,
    /// Patch messages that came after their tick was closed.
    pub late: u64,
    /// Live: ticks without timely messages from an edge that had started sending.
    pub missing: u64,
    /// Live: messages of unknown senders, of another session, of refused edges, or repeated.
    #[serde(default)]
    pub refused: u64,
    /// Live: messages that fusion had no room to send.
    #[serde(default)]
    pub unsent: u64,
    /// Live: patches that were skipped because their ticks would have taken too long.
    #[serde(default)]
    pub shed: u64,
}

/// Measurements of a clock.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct TimingSummary {
    /// From the first tick to the last, seconds.
    pub elapsed_s: f64,
    /// Finished ticks per second.
    pub ticks_per_s: f64,
    /// Per stage of a tick: how long it took.
    pub stages: BTreeMap<String, StageTiming>,
    /// Per viewpoint: the share of its edge's work in detection passes, 0 to 1.
    pub look_share: BTreeMap<String, f64>,
    /// Per viewpoint of a live run: ticks that its edge should have processed and did not;
    /// viewpoints without such are omitted.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub missed_ticks: BTreeMap<String, u64>,
    /// Per viewpoint: bytes on the wire with protocol overhead, if they can be measured.
    pub link_bytes_on_wire: BTreeMap<String, u64>,
    /// Per camera of a live run: the last report of its edge.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub cameras: BTreeMap<String, CameraSummary>,
    /// How the target latency was kept, if one was set.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub target_latency: Option<TargetLatencySummary>,
    /// What the files lack, if not all poses were written.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub poses: Option<PosesSummary>,
    /// The recording, if one was made.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub recording: Option<RecordingSummary>,
}

/// How a target latency was kept.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TargetLatencySummary {
    /// From the pictures of a tick to its poses, milliseconds.
    pub target_ms: f64,
    /// Share of the ticks with patches whose poses were published in time, 0 to 1.
    pub in_time: f64,
    /// By viewpoint: the share of the ticks whose patches were skipped because of the target, 0 to
    /// 1; viewpoints without such are omitted.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub left_out: BTreeMap<String, f64>,
}

/// A camera's state.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CameraSummary {
    /// The health at the end.
    pub health: CameraHealth,
    /// Frames per second at the end.
    pub frames_per_s: f32,
    /// How often it stopped working.
    pub troubles: u32,
    /// Why it gave no pictures the last time.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
}

/// What the pose files lack.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct PosesSummary {
    /// Ticks whose poses are missing in `poses.jsonl`, or incomplete; the files of persons may lack
    /// a few more.
    pub unwritten_ticks: u64,
    /// The same for the smoothed poses.
    pub unwritten_smoothed_ticks: u64,
    /// The system's error; `None` if the disk was too slow, or nothing is missing.
    pub failure: Option<String>,
    /// Files that the system refused while they were written: nothing is missing if they continue
    /// in another part.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub refused: Vec<Refusal>,
}

impl PosesSummary {
    /// Whether all poses are in the files.
    pub fn is_whole(&self) -> bool {
        self.failure.is_none() && self.unwritten_ticks + self.unwritten_smoothed_ticks == 0
    }
}

/// The result of a recording.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct RecordingSummary {
    /// The file.
    pub file: PathBuf,
    /// Messages that were lost because the disk was too slow.
    pub lost: u64,
    /// Messages in it that an edge delivered after an outage.
    pub filled: u64,
    /// Ticks with missing sets, summed over the viewpoints: they came neither in time nor late, and
    /// no edge delivered them afterwards. Ticks that a viewpoint skips by its rate do not count.
    pub holes: u64,
    /// Why it ended before the run.
    pub failure: Option<String>,
}

/// How long one stage took, microseconds per tick.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct StageTiming {
    /// Median.
    pub p50_us: f64,
    /// 99th percentile.
    pub p99_us: f64,
    /// 99.9th percentile.
    #[serde(default)]
    pub p999_us: f64,
    /// Longest.
    pub max_us: f64,
}

impl Summary {
    /// The file's text.
    #[expect(clippy::missing_panics_doc, reason = "see the message")]
    pub fn to_json(&self) -> String {
        let mut text = serde_json::to_string_pretty(self)
            .expect("a map with string keys and numbers always serialises");
        text.push('\n');
        text
    }

    /// The same in fewer bytes, for places with less room.
    #[expect(clippy::missing_panics_doc, reason = "see the message")]
    pub fn to_short_json(&self) -> String {
        let mut text = serde_json::to_string(self)
            .expect("a map with string keys and numbers always serialises");
        text.push('\n');
        text
    }
}

#[cfg(test)]
mod tests {
    use farfield_proto::id::PersonId;
    use farfield_proto::message::identity_event::{Change, DropReason};

    use super::*;

    #[test]
    fn events_are_counted_by_kind_and_reason() {
        let event = |change| IdentityEvent {
            person: PersonId(1),
            wire_id: PersonId(1),
            change,
        };
        let reason = DropReason::FoundElsewhere;
        let mut counts = EventCounts::default();
        counts.count(&[event(Change::Given), event(Change::Drop { reason })]);
        counts.count(&[event(Change::Given)]);
        let json = serde_json::to_string(&counts).unwrap();
        assert_eq!(json, r#"{"drop/found_elsewhere":1,"give":2}"#);
    }

    #[test]
    fn measurements_of_clocks_are_under_timing() {
        let slow = TimingSummary {
            elapsed_s: 9.0,
            ..TimingSummary::default()
        };
        let summary = Summary {
            timing: slow,
            ..Summary::default()
        };
        let mut a: serde_json::Value = serde_json::from_str(&summary.to_json()).unwrap();
        let mut b = serde_json::to_value(Summary::default()).unwrap();
        assert_ne!(a, b);
        for value in [&mut a, &mut b] {
            value.as_object_mut().unwrap().remove("timing");
        }
        assert_eq!(a, b);
    }
}
