//! Status of a venue: content of the `status` message. Unknown values are `null`.

use farfield_proto::message::StageTime;
use farfield_proto::message::agreement::CameraAgreement;
use farfield_proto::tick::{Micros, Tick};
use serde::Serialize;

use super::text::json;

/// Severity of an alarm.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Severity {
    /// Red: something does not work and needs attention.
    Failed,
    /// It works, but not properly.
    Warning,
}

/// A problem, with its description and remedy.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Alarm {
    /// Its severity.
    pub severity: Severity,
    /// Constant while the alarm lasts.
    pub key: String,
    /// The affected node, link or camera.
    pub subject: String,
    /// Description of the problem.
    pub text: String,
    /// Remedy.
    pub remedy: String,
    /// Start time, microseconds of Unix time.
    pub since_us: i64,
}

/// Condition of a node or link.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Condition {
    /// Healthy.
    Works,
    /// It works, with a warning.
    Warning,
    /// It does not work.
    Failed,
    /// No data yet.
    Unknown,
}

impl From<Option<Severity>> for Condition {
    /// From the worst alarm of a node or link that has reported.
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
    /// Time of the status, microseconds of Unix time.
    pub at_us: i64,
    /// Alarms: failures first, then the oldest.
    pub alarms: Vec<Alarm>,
    /// Fusion, then the edges in the venue's order.
    pub nodes: Vec<NodeLine>,
    /// The links, in the order of the viewpoints; empty in lock-step.
    pub links: Vec<LinkLine>,
    /// All cameras of the venue.
    pub cameras: Vec<CameraLine>,
    /// Latency of poses.
    pub latency: Latency,
    /// Number of people.
    pub people: People,
    /// Poses in the last second.
    pub poses_per_s: f64,
    /// State of the recording; `None` if unknown.
    pub recording: Option<RecordingState>,
    /// The page's own feed.
    pub page: PageCounts,
}

impl StatusDocument {
    /// The message as JSON.
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
    /// Seconds since its last status.
    pub heard_ago_s: Option<f64>,
    pub release: String,
    pub ready: bool,
    pub tick: Option<Tick>,
    /// Derived from its last two statuses.
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
    /// Whether it is synchronised.
    pub synchronised: bool,
    /// Maximum error, microseconds.
    pub max_error_us: Option<u32>,
}

/// Duration of one stage of a node.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct StageLine {
    /// Its name.
    pub stage: String,
    /// Number of measurements.
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

/// The link between fusion and one edge, from both sides.
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
    /// Limit of the venue; `None` if unlimited.
    pub budget_bytes_per_s: Option<f64>,
    pub compression_level: Option<u8>,
    /// The level configured in the venue.
    pub usual_level: u8,
    pub persons_per_tick: Option<u16>,
    pub every_nth_tick: Option<u16>,
    pub held_back: Option<u64>,
    pub late: u64,
    pub missing: u64,
    /// Derived from fusion's last two statuses.
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
    /// Capture times relative to their ticks, microseconds.
    pub capture_offset_us: Option<i32>,
    /// Why it gives no images.
    pub reason: Option<String>,
    /// Agreement with the other cameras; `None` if nothing could be compared.
    pub agreement: Option<CameraAgreement>,
    /// The people cropped from it at the newest tick.
    pub persons: Vec<u32>,
}

/// Latency of poses over the last seconds.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Latency {
    /// Length of the window, seconds.
    pub window_s: u32,
    /// Stages that have samples.
    pub stages: Vec<LatencyLine>,
}

/// One stage on the way from a capture to a pose.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct LatencyLine {
    /// Its name.
    pub stage: &'static str,
    /// Number of measurements.
    pub samples: usize,
    /// Median, microseconds.
    pub p50_us: u32,
    /// 99th percentile, microseconds.
    pub p99_us: u32,
}

/// Number of people by phase of their tracks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct People {
    /// Not yet confirmed.
    pub tentative: usize,
    /// Seen by enough viewpoints.
    pub tracked: usize,
    /// Predicted by the model.
    pub coasting: usize,
}

/// State of the recording.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct RecordingState {
    /// Whether a recording runs.
    pub running: bool,
    /// Its name, or its result.
    pub text: String,
    /// Start time, microseconds of Unix time.
    pub since_us: Option<Micros>,
    /// Size on disk, bytes.
    pub bytes: Option<u64>,
}

/// Losses of the page's own feed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct PageCounts {
    /// Connected pages and programs.
    pub clients: usize,
    /// Messages dropped for lack of room.
    pub dropped: u64,
    /// Messages that could not be decoded.
    pub unreadable: u64,
}
