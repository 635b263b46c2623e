//! Forms that messages had in versions that are only read: in old recordings.

use serde::Deserialize;

use crate::id::{CameraIndex, SessionId, ViewpointIndex};
use crate::message::health::NodeHealth;
use crate::message::live::{CameraHealth, CameraStatus, EdgeLink, LiveBoxes, LiveStatus};
use crate::message::{BoxSet, Order, PersonBoxes, StageTime, Status};
use crate::tick::Tick;

/// A [`BoxSet`] of version 3: all persons in one message, however many.
#[derive(Deserialize)]
pub(in crate::message) struct BoxSet3 {
    session: SessionId,
    tick: Tick,
    viewpoint: ViewpointIndex,
    order: Order,
    live: Option<LiveBoxes>,
    detection_cameras: Vec<CameraIndex>,
    persons: Vec<PersonBoxes>,
}

impl BoxSet3 {
    /// What it is today.
    pub(in crate::message) fn read(self) -> BoxSet {
        BoxSet {
            session: self.session,
            tick: self.tick,
            viewpoint: self.viewpoint,
            part: 0,
            parts: 1,
            order: self.order,
            live: self.live,
            detection_cameras: self.detection_cameras,
            persons: self.persons,
        }
    }
}

/// A [`Status`] of version 3: without its release, and without reasons of its cameras.
#[derive(Deserialize)]
pub(in crate::message) struct Status3 {
    node: String,
    process: u64,
    viewpoint: Option<ViewpointIndex>,
    ready: bool,
    venue_hash: String,
    calibration_hash: String,
    network_hash: String,
    backend: String,
    ticks: Option<[Tick; 2]>,
    tick: Option<Tick>,
    unreadable: u64,
    failure: Option<String>,
    stages: Vec<StageTime>,
    live: Option<LiveStatus3>,
}

/// A [`LiveStatus`] of version 3.
#[derive(Deserialize)]
struct LiveStatus3 {
    epoch_us: Option<u64>,
    clock_correction_us: i32,
    quality: u8,
    persons_per_tick: Option<u16>,
    every_nth_tick: u16,
    bytes_per_s: u32,
    held_back: u64,
    missed_ticks: u64,
    cameras: Vec<CameraStatus3>,
    edges: Vec<EdgeLink>,
    recording_failure: Option<String>,
}

/// A [`CameraStatus`] of version 3.
#[derive(Deserialize)]
struct CameraStatus3 {
    camera: CameraIndex,
    health: CameraHealth,
    frames_per_s: f32,
    capture_offset_us: i32,
}

impl Status3 {
    /// What it is today.
    pub(in crate::message) fn read(self) -> Status {
        Status {
            node: self.node,
            process: self.process,
            viewpoint: self.viewpoint,
            release: String::new(),
            ready: self.ready,
            venue_hash: self.venue_hash,
            calibration_hash: self.calibration_hash,
            network_hash: self.network_hash,
            backend: self.backend,
            ticks: self.ticks,
            tick: self.tick,
            unreadable: self.unreadable,
            failure: self.failure,
            stages: self.stages,
            live: self.live.map(LiveStatus3::read),
            health: NodeHealth::default(),
            agreement: Vec::new(),
        }
    }
}

impl LiveStatus3 {
    fn read(self) -> LiveStatus {
        let camera = |camera: CameraStatus3| CameraStatus {
            camera: camera.camera,
            health: camera.health,
            frames_per_s: camera.frames_per_s,
            capture_offset_us: camera.capture_offset_us,
            reason: None,
        };
        LiveStatus {
            epoch_us: self.epoch_us,
            clock_correction_us: self.clock_correction_us,
            quality: self.quality,
            persons_per_tick: self.persons_per_tick,
            every_nth_tick: self.every_nth_tick,
            needed_nth_tick: 0,
            bytes_per_s: self.bytes_per_s,
            held_back: self.held_back,
            missed_ticks: self.missed_ticks,
            cameras: self.cameras.into_iter().map(camera).collect(),
            edges: self.edges,
            recording_failure: self.recording_failure,
        }
    }
}
