//! The messages between nodes. Framing, bounds and versions are in [`crate::wire`].
//!
//! From edge to fusion: [`PatchSet`], [`SightingSet`], and [`thumbnail::Thumbnail`] for display.
//! From fusion to edge: [`BoxSet`]. From fusion to all: [`PoseSet`], [`decision::Decision`]. From
//! every node: [`Status`]. On request: the venue's files ([`handout`]) and stored sets ([`fill`]).

pub mod agreement;
mod check;
pub mod decision;
pub mod fill;
mod form;
pub mod handout;
pub mod health;
pub mod identity_event;
pub mod live;
pub mod naming;
pub mod parts;
pub mod thumbnail;

use serde::{Deserialize, Serialize};

use crate::bounding_box::{BoundingBox, BoxRate};
use crate::grid::CellGrid;
use crate::id::{CameraIndex, PersonId, SessionId, ViewpointIndex};
use crate::message::agreement::AgreementOfCamera;
use crate::message::health::NodeHealth;
use crate::message::live::{LiveBoxes, LiveStatus, PatchTiming};
use crate::order_statistics::percentile;
use crate::patch::EncodedMaps;
use crate::tick::Tick;

/// Most people in one message, and of one viewpoint at one tick.
pub const MAX_PERSONS: usize = 256;
/// Most crops for the maps of one person in one camera.
pub const MAX_CROPS: usize = 4;
/// Largest time difference between a frame and its tick, microseconds (0.1 s): at the lowest rate,
/// 10 Hz, the next tick is nearer.
pub const MAX_CAPTURE_OFFSET_US: i32 = 100_000;
/// Most sightings in one message, and of one viewpoint at one tick.
pub const MAX_SIGHTINGS: usize = 256;

/// Edge to fusion: the people of one viewpoint at one tick, or a part of them, readable alone.
#[derive(Debug, Clone, PartialEq)]
pub struct PatchSet {
    /// The session of the person ids.
    pub session: SessionId,
    /// The tick of the pictures.
    pub tick: Tick,
    /// The sender's viewpoint.
    pub viewpoint: ViewpointIndex,
    /// Part number within the tick, from 0.
    pub part: u16,
    /// Number of parts of the tick from this viewpoint, at least 1.
    pub parts: u16,
    /// Number of [`SightingSet`] messages of this tick from this viewpoint (0: no detection pass).
    pub sighting_parts: u16,
    /// Its sending time and the latest received box set; `None` in lock-step.
    pub timing: Option<PatchTiming>,
    /// The people of this part.
    pub persons: Vec<PersonPatch>,
}

/// The part confidence maps of one person in one camera at one tick, encoded.
#[derive(Debug, Clone, PartialEq)]
pub struct PersonPatch {
    /// The person.
    pub person: PersonId,
    /// The camera that the edge chose.
    pub camera: CameraIndex,
    /// The tick of the crop's box.
    pub box_tick: Tick,
    /// Capture time of the frame minus the time of the tick, microseconds, at most
    /// [`MAX_CAPTURE_OFFSET_US`] either way.
    pub capture_offset_us: i32,
    /// The grids of the crops, in undistorted pixels of `camera`.
    pub crops: Vec<CellGrid>,
    /// Per keypoint of the network's card: the index in `crops` of its map.
    pub crop_of_keypoint: Vec<u8>,
    /// The maps, one per keypoint.
    pub maps: EncodedMaps,
}

/// Fusion to edge: the predicted boxes of all people at a tick, and the edge's other orders.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BoxSet {
    /// Fusion's session.
    pub session: SessionId,
    /// The tick of the boxes.
    pub tick: Tick,
    /// The receiving viewpoint.
    pub viewpoint: ViewpointIndex,
    /// Part number within the set, from 0; everything except the people is equal in all parts.
    pub part: u16,
    /// Number of parts of the set, at least 1.
    pub parts: u16,
    /// Whether the run continues.
    pub order: Order,
    /// Clock and link; `None` in lock-step.
    pub live: Option<LiveBoxes>,
    /// The cameras of this viewpoint in a detection pass at this tick, ascending; usually empty.
    /// All viewpoints detect at the same ticks, because rays of different ticks do not meet.
    pub detection_cameras: Vec<CameraIndex>,
    /// The predicted boxes.
    pub persons: Vec<PersonBoxes>,
}

/// Whether a run continues at a tick.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Order {
    /// Make patches for the boxes, and run the detector on [`BoxSet::detection_cameras`].
    Track,
    /// The run is over: stop.
    End,
}

/// The predicted boxes of one person in the cameras of one viewpoint.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PersonBoxes {
    /// The person.
    pub person: PersonId,
    /// One per camera of the viewpoint that could see the person.
    pub cameras: Vec<CameraBox>,
}

/// The predicted box of one person in one camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CameraBox {
    /// The camera.
    pub camera: CameraIndex,
    /// The region.
    pub bounding_box: BoundingBox,
    /// Its change per tick.
    pub rate: BoxRate,
    /// Projected pelvis ("torso", n(1) of the paper), undistorted pixels.
    pub torso_px: [f32; 2],
    /// Projected neck (n(6) of the paper), undistorted pixels.
    pub neck_px: [f32; 2],
}

/// Edge to fusion: people detected without a box.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SightingSet {
    /// The requesting session.
    pub session: SessionId,
    /// The tick of the pictures.
    pub tick: Tick,
    /// The sender.
    pub viewpoint: ViewpointIndex,
    /// Part number within the tick, from 0.
    pub part: u16,
    /// Number of parts of the tick, at least 1.
    pub parts: u16,
    /// The detected people, in any camera of the viewpoint.
    pub sightings: Vec<Sighting>,
}

/// One person detected in one camera.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Sighting {
    /// The camera.
    pub camera: CameraIndex,
    /// The detector's confidence, 0 to 1.
    pub score: f32,
    /// Per keypoint of the network's card: its best peak; `None` without one.
    pub keypoints: Vec<Option<KeypointPeak>>,
}

/// A peak of one keypoint's map.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct KeypointPeak {
    /// Undistorted pixels (x, y).
    pub position_px: [f32; 2],
    /// Height of the peak, 0 to 1.
    pub score: f32,
}

/// Fusion to all: the people of a tick.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PoseSet {
    /// Fusion's session.
    pub session: SessionId,
    /// The tick.
    pub tick: Tick,
    /// The people, by id.
    pub persons: Vec<PersonPose>,
}

/// Published state of a track.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PersonState {
    /// Initiated, not yet confirmed.
    Tentative,
    /// Confirmed and seen by enough views.
    Tracked,
    /// Predicted by the model alone until views return.
    Coasting,
}

/// One person's skeleton at one tick.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PersonPose {
    /// The person.
    pub person: PersonId,
    /// State of the track.
    pub state: PersonState,
    /// The 29 joints, world, metres, in the order of the skeletal model.
    pub joints_m: Vec<[f32; 3]>,
    /// The keypoint sites, world, metres, in the order of the network's card.
    pub keypoints_m: Vec<[f32; 3]>,
    /// Per joint, one standard deviation of its position per axis (sqrt(trace/3) of the
    /// covariance), metres; empty if unknown.
    pub sigma_m: Vec<f32>,
    /// The 40 reported angles, radians (root translations: metres), in the model's order.
    pub angles: Vec<f32>,
    /// Bit i: angle i is determined by a prior, not by observations.
    pub unobserved: u64,
    /// Viewpoints with evidence at this tick.
    pub views: u16,
}

/// Each node to all, once per second and while waiting for the start: identity and state of the
/// node.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Status {
    /// Name of the node: the viewpoint's name, or "fusion".
    pub node: String,
    /// A different number for every edge process, to distinguish two of one name; 0 for fusion.
    pub process: u64,
    /// The viewpoint, for an edge.
    pub viewpoint: Option<ViewpointIndex>,
    /// The release of Farfield, as `0.1.0`.
    pub release: String,
    /// Whether everything is open and matched, and the node only waits for its first box set. False
    /// in the last status of an edge, and of a live fusion whose run is over.
    pub ready: bool,
    /// Fingerprint of the venue file.
    pub venue_hash: String,
    /// Fingerprint of the calibration.
    pub calibration_hash: String,
    /// Fingerprint of the network and detector, with the backend's name; empty without a network.
    pub network_hash: String,
    /// Inference backend, for display; empty without a network.
    pub backend: String,
    /// The ticks that all recorded sources of an edge contain, first and one past the last; `None`
    /// for fusion and for live sources.
    pub ticks: Option<[Tick; 2]>,
    /// The last processed tick.
    pub tick: Option<Tick>,
    /// Messages that could not be read, since the start.
    pub unreadable: u64,
    /// Why the node failed, if it did.
    pub failure: Option<String>,
    /// Duration of each stage; in lock-step only in an edge's last status.
    pub stages: Vec<StageTime>,
    /// Live state; `None` in lock-step.
    pub live: Option<LiveStatus>,
    /// Health.
    pub health: NodeHealth,
    /// For live fusion: the agreement of the cameras, if known.
    pub agreement: Vec<AgreementOfCamera>,
}

impl Status {
    /// Ticks that a live node should have processed but did not, since its start; 0 in lock-step.
    pub fn missed_ticks(&self) -> u64 {
        self.live.as_ref().map_or(0, |live| live.missed_ticks)
    }

    /// Number of ticks processed since the node was at tick `before` and had missed
    /// `missed_before`. `None` without a tick, or if ticks restarted.
    pub fn ticks_done_since(&self, before: Tick, missed_before: u64) -> Option<i64> {
        let every_nth = self.live.as_ref().map_or(1, |live| live.every_nth_tick);
        let passed = self.tick?.0.checked_sub(before.0).filter(|it| *it >= 0)?;
        let due = passed / i64::from(every_nth.max(1));
        let missed = self.missed_ticks().saturating_sub(missed_before);
        Some(due.saturating_sub_unsigned(missed).max(0))
    }
}

/// Most stages in one status.
pub const MAX_STAGES: usize = 32;

/// Name of the stage of detection passes in statuses and summaries: detector and keypoints, or in
/// live mode the detector alone.
pub const DETECTION_STAGE: &str = "look";

/// Name of the stage of the keypoints of detection passes, if they are separate from the detector.
pub const SIGHTING_STAGE: &str = "sight";

/// The durations of one stage of a node over all ticks of a run.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct StageTime {
    /// Name of the stage.
    pub stage: String,
    /// Number of measurements.
    pub count: u64,
    /// Their sum, microseconds.
    pub total_us: u64,
    /// Median, microseconds.
    pub p50_us: u32,
    /// 99th percentile, microseconds.
    pub p99_us: u32,
    /// 99.9th percentile, microseconds.
    pub p999_us: u32,
    /// Largest, microseconds.
    pub max_us: u32,
}

impl StageTime {
    /// Summarises `samples_us` (microseconds; percentiles by nearest rank) and sorts them in place.
    /// `None` without samples.
    pub fn from_samples(stage: &str, samples_us: &mut [u32]) -> Option<Self> {
        samples_us.sort_unstable();
        let total_us = samples_us.iter().map(|&us| u64::from(us)).sum();
        Some(Self {
            stage: stage.to_owned(),
            count: samples_us.len() as u64,
            total_us,
            p50_us: percentile(samples_us, 0.5)?,
            p99_us: percentile(samples_us, 0.99)?,
            p999_us: percentile(samples_us, 0.999)?,
            max_us: *samples_us.last()?,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_are_taken_by_nearest_rank() {
        let mut samples: Vec<u32> = (1..=200).rev().collect();
        let time = StageTime::from_samples("step", &mut samples).unwrap();
        assert_eq!(
            (
                time.count,
                time.total_us,
                time.p50_us,
                time.p99_us,
                time.p999_us,
                time.max_us
            ),
            (200, 20_100, 100, 198, 200, 200)
        );
        assert_eq!(StageTime::from_samples("step", &mut []), None);
    }

    #[test]
    fn skipped_and_missed_ticks_do_not_count_as_done() {
        let at = |tick, every_nth_tick, missed_ticks| Status {
            tick: Some(Tick(tick)),
            live: Some(LiveStatus {
                every_nth_tick,
                missed_ticks,
                ..LiveStatus::default()
            }),
            ..Status::default()
        };
        let done = |status: Status| status.ticks_done_since(Tick(100), 7);
        assert_eq!(done(at(160, 1, 7)), Some(60));
        assert_eq!(done(at(160, 4, 7)), Some(15), "every fourth");
        assert_eq!(done(at(160, 1, 27)), Some(40), "missed twenty");
        assert_eq!(done(at(160, 1, 0)), Some(60), "started again");
        assert_eq!(done(at(160, 0, u64::MAX)), Some(0));
        assert_eq!(done(at(99, 1, 7)), None, "ticks began anew");
        let farthest = at(i64::MAX, 1, 0);
        assert_eq!(farthest.ticks_done_since(Tick(i64::MIN), 0), None);
    }
}
