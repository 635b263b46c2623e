//! How a venue is: what the `status` message holds. Everything that is not known is `null`.

use farfield_proto::message::StageTime;
use farfield_proto::message::agreement::CameraAgreement;
use farfield_proto::tick::{Micros, Tick};
use serde::Serialize;

use super::text::json;

/// How bad something is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Severity {
    /// Red: something does not work, and somebody must look after it.
    Failed,
    /// It works, and is not as it should be.
    Warning,
}

/// Something that is wrong, in words, with what mends it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Alarm {
    /// How bad.
    pub severity: Severity,
    /// The same for as long as the alarm lasts.
    pub key: String,
    /// What it is about.
    pub subject: String,
    /// What is wrong.
    pub text: String,
    /// What mends it.
    pub remedy: String,
    /// Since when, microseconds of Unix time.
    pub since_us: i64,
}

/// How a node or a link is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Condition {
    /// As it should be.
    Works,
    /// It works, and somebody should know something.
    Warning,
    /// It does not work.
    Failed,
    /// Nothing was heard of it yet.
    Unknown,
}

impl From<Option<Severity>> for Condition {
    /// Of what is heard of, by its worst alarm.
    fn from(worst: Option<Severity>) -> Self {
        match worst {
            Some(Severity::Failed) => Self::Failed,
            Some(Severity::Warning) => Self::Warning,
            None => Self::Works,
        }
    }
}

/// The `status` message.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(tag = "type", rename = "status")]
pub struct StatusDocument {
    /// The newest tick with poses.
    pub tick: Option<Tick>,
    /// As of when, microseconds of Unix time.
    pub at_us: i64,
    /// What is wrong: red first, then the oldest.
    pub alarms: Vec<Alarm>,
    /// Fusion, then the edges in the venue's order.
    pub nodes: Vec<NodeLine>,
    /// The links, in the order of the viewpoints; empty in lock-step.
    pub links: Vec<LinkLine>,
    /// All cameras of the venue.
    pub cameras: Vec<CameraLine>,
    /// How long poses take.
    pub latency: Latency,
    /// How many people.
    pub people: People,
    /// Poses in the last second.
    pub poses_per_s: f64,
    /// Whether there is a recording; `None` where nobody says.
    pub recording: Option<RecordingState>,
    /// The page's own feed.
    pub page: PageCounts,
}

impl StatusDocument {
    /// The message as it is sent.
    pub fn to_json(&self) -> String {
        json(self)
    }
}

/// One node.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[expect(
    missing_docs,
    reason = "the fields are those of `farfield_proto::message::Status`"
)]
pub struct NodeLine {
    pub name: String,
    /// `fusion` or `edge`.
    pub kind: &'static str,
    pub viewpoint: Option<u16>,
    pub state: Condition,
    /// How long ago its last status came, seconds.
    pub heard_ago_s: Option<f64>,
    pub release: String,
    pub ready: bool,
    pub tick: Option<Tick>,
    /// Between its last two statuses.
    pub ticks_per_s: Option<f64>,
    pub backend: String,
    pub failure: Option<String>,
    pub notices: Vec<String>,
    pub unreadable: u64,
    pub missed_ticks: Option<u64>,
    pub clock: Option<ClockLine>,
    pub certificate_ends_s: Option<u64>,
    pub stages: Vec<StageLine>,
}

/// The clock of a node's system.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct ClockLine {
    /// Whether something keeps it right.
    pub synchronised: bool,
    /// By how much it may be wrong, microseconds.
    pub max_error_us: Option<u32>,
}

/// How long one stage of a node takes.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct StageLine {
    /// Its name.
    pub stage: String,
    /// Measurements.
    pub count: u64,
    /// Median, microseconds.
    pub p50_us: u32,
    /// 99th percentile, microseconds.
    pub p99_us: u32,
    /// Largest, microseconds.
    pub max_us: u32,
}

impl From<&StageTime> for StageLine {
    fn from(time: &StageTime) -> Self {
        Self {
            stage: time.stage.clone(),
            count: time.count,
            p50_us: time.p50_us,
            p99_us: time.p99_us,
            max_us: time.max_us,
        }
    }
}

/// The link between fusion and one edge: what each side says of it.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[expect(
    missing_docs,
    reason = "the fields are those of `farfield_proto::message::live` and `farfield_proto::message::health`"
)]
pub struct LinkLine {
    pub viewpoint: u16,
    pub name: String,
    pub state: Condition,
    pub live: bool,
    pub refused: Option<String>,
    pub round_trip_us: Option<u32>,
    pub clock_offset_us: Option<i32>,
    pub clock_uncertainty_us: Option<u32>,
    pub clock_correction_us: Option<i32>,
    pub horizon_ticks: f32,
    pub bytes_per_s: u32,
    /// What the venue allows; `None`: no bound.
    pub budget_bytes_per_s: Option<f64>,
    pub compression_level: Option<u8>,
    /// The level that the venue asks for.
    pub usual_level: u8,
    pub persons_per_tick: Option<u16>,
    pub every_nth_tick: Option<u16>,
    pub held_back: Option<u64>,
    pub late: u64,
    pub missing: u64,
    /// Between fusion's last two statuses.
    pub late_per_s: Option<f64>,
    pub missing_per_s: Option<f64>,
    pub unreadable: u64,
    pub dropped: u64,
}

/// One camera.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CameraLine {
    /// Its index.
    pub camera: u16,
    /// Its name.
    pub name: String,
    /// `works`, `frozen`, `black`, `silent`, `failed` or `unknown`.
    pub state: &'static str,
    /// Frames in the last second.
    pub frames_per_s: Option<f32>,
    /// Captures less their ticks' times, microseconds.
    pub capture_offset_us: Option<i32>,
    /// Why it gives no pictures.
    pub reason: Option<String>,
    /// How it agrees with the other cameras; `None` where nothing could be compared.
    pub agreement: Option<CameraAgreement>,
    /// Who was cropped from it at the newest tick.
    pub persons: Vec<u32>,
}

/// How long poses take, over the last seconds.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Latency {
    /// Over how long, seconds.
    pub window_s: u32,
    /// Stages that have samples.
    pub stages: Vec<LatencyLine>,
}

/// One stage on the way from a capture to a pose.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct LatencyLine {
    /// Its name.
    pub stage: &'static str,
    /// Measurements.
    pub samples: usize,
    /// Median, microseconds.
    pub p50_us: u32,
    /// 99th percentile, microseconds.
    pub p99_us: u32,
}

/// How many people, by the phase of their tracks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct People {
    /// Not yet confirmed.
    pub tentative: usize,
    /// Seen.
    pub tracked: usize,
    /// Carried by the model.
    pub coasting: usize,
}

/// Whether a recording runs.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct RecordingState {
    /// Whether it does.
    pub running: bool,
    /// Its name, or what became of it.
    pub text: String,
    /// When it began, microseconds of Unix time.
    pub since_us: Option<Micros>,
    /// Bytes on the disk.
    pub bytes: Option<u64>,
}

/// What the page's own feed has lost.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct PageCounts {
    /// Connected pages and programs.
    pub clients: usize,
    /// Messages that found no room.
    pub dropped: u64,
    /// Messages that were none.
    pub unreadable: u64,
}
