//! Forms that messages had in earlier versions: read for ever, and written for nodes that are one version behind.

use std::borrow::Cow;

use serde::{Deserialize, Serialize};

use super::live::{CameraHealth, CameraStatus, EdgeLink, LiveBoxes, LiveStatus};
use super::{BoxSet, Order, PersonBoxes, StageTime, Status};
use crate::id::{CameraIndex, SessionId, ViewpointIndex};
use crate::tick::Tick;

/// A [`BoxSet`] of version 3: all persons in one message, however many.
#[derive(Serialize, Deserialize)]
pub(super) struct BoxSet3<'a> {
    session: SessionId,
    tick: Tick,
    viewpoint: ViewpointIndex,
    order: Order,
    live: Option<LiveBoxes>,
    detection_cameras: Cow<'a, [CameraIndex]>,
    persons: Cow<'a, [PersonBoxes]>,
}

impl<'a> BoxSet3<'a> {
    /// The form of `set`, which is not in parts.
    pub(super) fn of(set: &'a BoxSet) -> Self {
        Self {
            session: set.session,
            tick: set.tick,
            viewpoint: set.viewpoint,
            order: set.order,
            live: set.live,
            detection_cameras: Cow::Borrowed(&set.detection_cameras),
            persons: Cow::Borrowed(&set.persons),
        }
    }

    /// What it is today.
    pub(super) fn read(self) -> BoxSet {
        BoxSet {
            session: self.session,
            tick: self.tick,
            viewpoint: self.viewpoint,
            part: 0,
            parts: 1,
            order: self.order,
            live: self.live,
            detection_cameras: self.detection_cameras.into_owned(),
            persons: self.persons.into_owned(),
        }
    }
}

/// A [`Status`] of version 3: without its release, and without reasons of its cameras.
#[derive(Serialize, Deserialize)]
pub(super) struct Status3<'a> {
    node: Cow<'a, str>,
    process: u64,
    viewpoint: Option<ViewpointIndex>,
    ready: bool,
    venue_hash: Cow<'a, str>,
    calibration_hash: Cow<'a, str>,
    network_hash: Cow<'a, str>,
    backend: Cow<'a, str>,
    ticks: Option<[Tick; 2]>,
    tick: Option<Tick>,
    unreadable: u64,
    failure: Option<Cow<'a, str>>,
    stages: Cow<'a, [StageTime]>,
    live: Option<LiveStatus3<'a>>,
}

/// A [`LiveStatus`] of version 3.
#[derive(Serialize, Deserialize)]
struct LiveStatus3<'a> {
    epoch_us: Option<u64>,
    clock_correction_us: i32,
    quality: u8,
    persons_per_tick: Option<u16>,
    every_nth_tick: u16,
    bytes_per_s: u32,
    held_back: u64,
    missed_ticks: u64,
    cameras: Vec<CameraStatus3>,
    edges: Cow<'a, [EdgeLink]>,
    recording_failure: Option<Cow<'a, str>>,
}

/// A [`CameraStatus`] of version 3.
#[derive(Serialize, Deserialize)]
struct CameraStatus3 {
    camera: CameraIndex,
    health: CameraHealth,
    frames_per_s: f32,
    capture_offset_us: i32,
}

impl<'a> Status3<'a> {
    /// The form of `status`.
    pub(super) fn of(status: &'a Status) -> Self {
        Self {
            node: Cow::Borrowed(&status.node),
            process: status.process,
            viewpoint: status.viewpoint,
            ready: status.ready,
            venue_hash: Cow::Borrowed(&status.venue_hash),
            calibration_hash: Cow::Borrowed(&status.calibration_hash),
            network_hash: Cow::Borrowed(&status.network_hash),
            backend: Cow::Borrowed(&status.backend),
            ticks: status.ticks,
            tick: status.tick,
            unreadable: status.unreadable,
            failure: status.failure.as_deref().map(Cow::Borrowed),
            stages: Cow::Borrowed(&status.stages),
            live: status.live.as_ref().map(LiveStatus3::of),
        }
    }

    /// What it is today.
    pub(super) fn read(self) -> Status {
        Status {
            node: self.node.into_owned(),
            process: self.process,
            viewpoint: self.viewpoint,
            release: String::new(),
            ready: self.ready,
            venue_hash: self.venue_hash.into_owned(),
            calibration_hash: self.calibration_hash.into_owned(),
            network_hash: self.network_hash.into_owned(),
            backend: self.backend.into_owned(),
            ticks: self.ticks,
            tick: self.tick,
            unreadable: self.unreadable,
            failure: self.failure.map(Cow::into_owned),
            stages: self.stages.into_owned(),
            live: self.live.map(LiveStatus3::read),
        }
    }
}

impl<'a> LiveStatus3<'a> {
    fn of(live: &'a LiveStatus) -> Self {
        let camera = |camera: &CameraStatus| CameraStatus3 {
            camera: camera.camera,
            health: camera.health,
            frames_per_s: camera.frames_per_s,
            capture_offset_us: camera.capture_offset_us,
        };
        Self {
            epoch_us: live.epoch_us,
            clock_correction_us: live.clock_correction_us,
            quality: live.quality,
            persons_per_tick: live.persons_per_tick,
            every_nth_tick: live.every_nth_tick,
            bytes_per_s: live.bytes_per_s,
            held_back: live.held_back,
            missed_ticks: live.missed_ticks,
            cameras: live.cameras.iter().map(camera).collect(),
            edges: Cow::Borrowed(&live.edges),
            recording_failure: live.recording_failure.as_deref().map(Cow::Borrowed),
        }
    }

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
            bytes_per_s: self.bytes_per_s,
            held_back: self.held_back,
            missed_ticks: self.missed_ticks,
            cameras: self.cameras.into_iter().map(camera).collect(),
            edges: self.edges.into_owned(),
            recording_failure: self.recording_failure.map(Cow::into_owned),
        }
    }
}
