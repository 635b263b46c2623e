//! The messages that nodes send to each other. Framing, bounds and versions are in [`crate::wire`].
//!
//! From edge to fusion: [`PatchSet`], [`SightingSet`], and [`thumbnail::Thumbnail`] for people to look at; from fusion
//! to edge: [`BoxSet`]; from fusion to all: [`PoseSet`], [`decision::Decision`]; from every node: [`Status`]. On request:
//! the venue's files ([`handout`]) and stored sets ([`fill`]).

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

/// Most persons in one message, and of one viewpoint at one tick.
pub const MAX_PERSONS: usize = 256;
/// Most crops that the maps of one person in one camera may come from.
pub const MAX_CROPS: usize = 4;
/// Largest distance of a frame from its tick, microseconds (0.1 s): at the lowest rate at which people are tracked,
/// 10 Hz, the next tick is nearer.
pub const MAX_CAPTURE_OFFSET_US: i32 = 100_000;
/// Most sightings in one message, and of one viewpoint at one tick.
pub const MAX_SIGHTINGS: usize = 256;

/// Edge to fusion: the persons of one viewpoint at one tick, or a part of them, readable alone.
#[derive(Debug, Clone, PartialEq)]
pub struct PatchSet {
    /// The session whose person ids are meant.
    pub session: SessionId,
    /// The tick of the pictures.
    pub tick: Tick,
    /// The sender's viewpoint.
    pub viewpoint: ViewpointIndex,
    /// This message's number among those of the tick, from 0.
    pub part: u16,
    /// How many messages the tick has from this viewpoint, at least 1.
    pub parts: u16,
    /// How many [`SightingSet`] messages belong to this tick from this viewpoint (0: no detection pass ran).
    pub sighting_parts: u16,
    /// When it was sent and which box set had arrived by then; `None` in lock-step.
    pub timing: Option<PatchTiming>,
    /// The persons of this part.
    pub persons: Vec<PersonPatch>,
}

/// The part confidence maps of one person in one camera at one tick, encoded.
#[derive(Debug, Clone, PartialEq)]
pub struct PersonPatch {
    /// Who.
    pub person: PersonId,
    /// The camera that the edge chose.
    pub camera: CameraIndex,
    /// The tick of the box that the crop came from.
    pub box_tick: Tick,
    /// Capture instant of the frame less the tick's time, microseconds, at most
    /// [`MAX_CAPTURE_OFFSET_US`] either way.
    pub capture_offset_us: i32,
    /// The grids of the crops, in undistorted pixels of `camera`.
    pub crops: Vec<CellGrid>,
    /// Per keypoint of the network's card: which of `crops` its map lies on.
    pub crop_of_keypoint: Vec<u8>,
    /// The maps, one per keypoint.
    pub maps: EncodedMaps,
}

/// Fusion to edge: where each person will be at a tick, and what else the edge is to do then.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BoxSet {
    /// Fusion's session.
    pub session: SessionId,
    /// The tick that the boxes are made for.
    pub tick: Tick,
    /// The viewpoint that it is for.
    pub viewpoint: ViewpointIndex,
    /// This message's number among those of the set, from 0; all but the persons is the same in each.
    pub part: u16,
    /// How many messages the set has, at least 1.
    pub parts: u16,
    /// Whether the run goes on.
    pub order: Order,
    /// Clock and link; `None` in lock-step.
    pub live: Option<LiveBoxes>,
    /// The cameras of this viewpoint that take part in a detection pass at this tick, ascending; at most ticks none.
    /// All viewpoints detect at the same ticks, because rays of different ticks do not meet.
    pub detection_cameras: Vec<CameraIndex>,
    /// Where the persons will be.
    pub persons: Vec<PersonBoxes>,
}

/// Whether a run goes on at a tick.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Order {
    /// Make patches for the boxes, and run the detector on [`BoxSet::detection_cameras`].
    Track,
    /// The run is over: leave.
    End,
}

/// Where one person will be in the cameras of one viewpoint.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PersonBoxes {
    /// Who.
    pub person: PersonId,
    /// One per camera of the viewpoint that could see the person.
    pub cameras: Vec<CameraBox>,
}

/// Where one person will be in one camera.
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

/// Edge to fusion: people found without a box.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SightingSet {
    /// The session that asked.
    pub session: SessionId,
    /// The tick of the pictures.
    pub tick: Tick,
    /// Who sends.
    pub viewpoint: ViewpointIndex,
    /// This message's number among those of the tick, from 0.
    pub part: u16,
    /// How many messages the tick has, at least 1.
    pub parts: u16,
    /// The people seen, in any camera of the viewpoint.
    pub sightings: Vec<Sighting>,
}

/// One person found by a detector in one camera.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Sighting {
    /// The camera.
    pub camera: CameraIndex,
    /// The detector's confidence, 0 to 1.
    pub score: f32,
    /// Per keypoint of the network's card: where its best peak is; `None` when there is none.
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

/// Fusion to all: the persons of a tick.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PoseSet {
    /// Fusion's session.
    pub session: SessionId,
    /// The tick.
    pub tick: Tick,
    /// The persons, by id.
    pub persons: Vec<PersonPose>,
}

/// Phase of a track, as published.
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
    /// Who.
    pub person: PersonId,
    /// State of the track.
    pub state: PersonState,
    /// The 29 joints, world, metres, in the order of the skeletal model.
    pub joints_m: Vec<[f32; 3]>,
    /// The keypoints' sites, world, metres, in the order of the network's card.
    pub keypoints_m: Vec<[f32; 3]>,
    /// Per joint, one standard deviation of its place per axis (sqrt(trace/3) of the covariance),
    /// metres; empty while it is not known.
    pub sigma_m: Vec<f32>,
    /// The 40 reported angles, radians (root translations: metres), in the model's order.
    pub angles: Vec<f32>,
    /// Bit i: angle i is carried by a prior, not by what was seen.
    pub unobserved: u64,
    /// Viewpoints that gave evidence at this tick.
    pub views: u16,
}

/// Each node to all, once a second and while waiting for the start: identity and state of the node.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Status {
    /// Name of the node: the viewpoint's name, or "fusion".
    pub node: String,
    /// A number that is different for every edge process, to tell two of one name apart; 0 for fusion.
    pub process: u64,
    /// The viewpoint, for an edge.
    pub viewpoint: Option<ViewpointIndex>,
    /// Which farfield it runs, as `0.1.0`.
    pub release: String,
    /// Whether everything is open and matched, and the node only waits for its first box set; false in the last status of an edge, and of a live
    /// fusion whose run is over.
    pub ready: bool,
    /// Fingerprint of the venue file.
    pub venue_hash: String,
    /// Fingerprint of the calibration.
    pub calibration_hash: String,
    /// Fingerprint of the network and detector, with the backend's name; empty without a network.
    pub network_hash: String,
    /// Inference backend, for people to read; empty without a network.
    pub backend: String,
    /// The ticks that all of an edge's recorded sources hold, first and one past the last; `None`
    /// for fusion and for live sources.
    pub ticks: Option<[Tick; 2]>,
    /// The last tick that was worked on.
    pub tick: Option<Tick>,
    /// Messages that could not be read, since the start.
    pub unreadable: u64,
    /// Why the node gave up, when it did.
    pub failure: Option<String>,
    /// How long each stage took; in lock-step only in an edge's last status, when the run is over.
    pub stages: Vec<StageTime>,
    /// How it runs live; `None` in lock-step.
    pub live: Option<LiveStatus>,
    /// How it is otherwise.
    pub health: NodeHealth,
    /// Of live fusion: how the cameras agree, those of which it is known.
    pub agreement: Vec<AgreementOfCamera>,
}

impl Status {
    /// Ticks that a live node did not work on though it should have, since its start; 0 in lock-step.
    pub fn missed_ticks(&self) -> u64 {
        self.live.as_ref().map_or(0, |live| live.missed_ticks)
    }

    /// How many ticks the node has worked on since it was at tick `before` and had missed `missed_before`; `None` where
    /// it is at none, or ticks have begun anew.
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

/// Name of the stage of detection passes in statuses and summaries: detector and keypoints, live the detector alone.
pub const DETECTION_STAGE: &str = "look";

/// Name of the stage of the keypoints of detection passes, where they are made apart from the detector.
pub const SIGHTING_STAGE: &str = "sight";

/// How long one stage of a node took, over all ticks of a run.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct StageTime {
    /// Which stage.
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
    /// Summarises `samples_us` (microseconds; percentiles by nearest rank), sorting them in place. `None` when there are
    /// none.
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
    fn ticks_that_a_node_left_out_or_missed_are_not_done() {
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
