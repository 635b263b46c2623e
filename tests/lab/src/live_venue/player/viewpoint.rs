//! One played viewpoint: its session with fusion, and its messages.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use farfield_edge::box_parts::BoxParts;
use farfield_proto::id::{CameraIndex, SessionId, ViewpointIndex};
use farfield_proto::key::Keys;
use farfield_proto::message::health::NodeHealth;
use farfield_proto::message::live::{BoxEcho, LiveStatus, PatchTiming};
use farfield_proto::message::{BoxSet, Order, PatchSet, PersonPatch, SightingSet, Status};
use farfield_proto::tick::Tick;
use farfield_proto::venue::Venue;
use farfield_proto::wire;
use zenoh::liveliness::LivelinessToken;
use zenoh::pubsub::Publisher;
use zenoh::qos::{CongestionControl, Priority};
use zenoh::{Session, Wait as _};

use super::mapping::{IdMapping, Places, places_of_boxes};
use crate::live_venue::watch::{session, subscribe, unix_us, zenoh_error};

/// Number of detection passes that are remembered.
const DETECTIONS: usize = 64;

/// Messages of fusion to a viewpoint.
#[derive(Debug, Default)]
pub(super) struct ReceivedBoxes {
    /// The newest boxes, and their arrival as Unix time, microseconds.
    pub(super) newest: Option<(BoxSet, u64)>,
    /// Received parts of the newest boxes.
    parts: Option<BoxParts>,
    /// Cameras of the requested detection passes.
    detection: BTreeMap<Tick, Vec<CameraIndex>>,
    /// Whether the run is over.
    pub(super) is_over: bool,
}

impl ReceivedBoxes {
    fn receive(&mut self, mut boxes: BoxSet) {
        self.is_over |= boxes.order == Order::End;
        if !boxes.detection_cameras.is_empty() {
            let cameras = boxes.detection_cameras.clone();
            self.detection.insert(boxes.tick, cameras);
            if self.detection.len() > DETECTIONS {
                self.detection.pop_first();
            }
        }
        if let (Some((newest, _)), Some(parts)) = (&mut self.newest, &mut self.parts)
            && newest.live == boxes.live
            && parts.add(newest, &boxes)
        {
            return;
        }
        let newest = self.newest.as_ref().map(|(newest, _)| newest);
        let is_newer = newest.is_none_or(|newest| newest.tick <= boxes.tick);
        if is_newer && boxes.live.is_some() {
            self.parts = Some(BoxParts::begin(&mut boxes, newest));
            self.newest = Some((boxes, unix_us()));
        }
    }
}

/// The session of a viewpoint.
pub(super) struct PlayedViewpoint {
    status: Status,
    received: Arc<Mutex<ReceivedBoxes>>,
    patches: Publisher<'static>,
    sightings: Publisher<'static>,
    statuses: Publisher<'static>,
    /// Token and session live as long as the viewpoint plays.
    _token: LivelinessToken,
    _session: Session,
}

/// Recorded sets of a viewpoint at a tick.
pub(super) struct RecordedSets<'a> {
    pub(super) patch_sets: Vec<&'a PatchSet>,
    /// Of a detection pass of all cameras.
    pub(super) sighting_sets: Vec<&'a SightingSet>,
}

impl PlayedViewpoint {
    /// Connects viewpoint `index` of `venue`, which plays `ticks` ticks from 0, to fusion at `endpoint`.
    pub(super) fn connect(
        venue: &Venue,
        index: usize,
        ticks: i64,
        endpoint: &str,
    ) -> anyhow::Result<Self> {
        let name = &venue.viewpoints[index].name;
        let session = session(endpoint)?;
        let keys = Keys::new(&venue.name);
        let received: Arc<Mutex<ReceivedBoxes>> = Arc::default();
        let receiver = Arc::clone(&received);
        subscribe(&session, keys.boxes(name), move |_, bytes| {
            if let Ok(boxes) = wire::decode::<BoxSet>(bytes) {
                lock(&receiver).receive(boxes);
            }
        })?;
        let publisher = |key: String| {
            let declared = session
                .declare_publisher(key)
                .congestion_control(CongestionControl::Drop)
                .priority(Priority::RealTime)
                .express(true);
            declared.wait().map_err(zenoh_error)
        };
        let (patches, sightings) = (
            publisher(keys.patch(name))?,
            publisher(keys.sighting(name))?,
        );
        let statuses = publisher(keys.status(name))?;
        let token = session.liveliness().declare_token(keys.alive(name));
        let token = token.wait().map_err(zenoh_error)?;
        Ok(Self {
            status: status_of(venue, index, ticks),
            received,
            patches,
            sightings,
            statuses,
            _token: token,
            _session: session,
        })
    }

    /// Messages of fusion so far.
    pub(super) fn received(&self) -> MutexGuard<'_, ReceivedBoxes> {
        lock(&self.received)
    }

    /// Positions of the newest boxes, extrapolated to `tick`.
    pub(super) fn places(&self, tick: Tick) -> Places {
        let received = self.received();
        let newest = received.newest.as_ref();
        newest.map_or_else(Places::new, |(boxes, _)| places_of_boxes(boxes, tick))
    }

    /// Publishes the status.
    pub(super) fn send_status(&self) -> anyhow::Result<()> {
        let bytes = wire::encode(&self.status);
        self.statuses.put(bytes).wait().map_err(zenoh_error)
    }

    /// Sends the recorded patches of the people in the newest boxes, under the ids of `mapping`, at `tick`, which is at `tick_us`
    /// (Unix time, microseconds); and the sightings, if requested.
    pub(super) fn send(
        &self,
        tick: Tick,
        tick_us: u64,
        recorded: &RecordedSets<'_>,
        mapping: &IdMapping,
    ) -> anyhow::Result<()> {
        let (boxes, arrived_us, requested) = {
            let mut received = self.received();
            let requested = received.detection.remove(&tick);
            let Some((boxes, arrived_us)) = received.newest.clone() else {
                return Ok(());
            };
            (boxes, arrived_us, requested)
        };
        let now_us = unix_us();
        let echo = boxes.live.map(|live| BoxEcho {
            sequence: live.sequence,
            held_us: now_us.saturating_sub(arrived_us) as u32,
        });
        let timing = PatchTiming {
            // No edge is later than 36 minutes.
            sent_after_us: i32::try_from(now_us.saturating_sub(tick_us)).unwrap_or(i32::MAX),
            clock_correction_us: 0,
            echo,
        };
        let sighting_sets = match &requested {
            Some(cameras) => sighted_by(&recorded.sighting_sets, cameras, boxes.session),
            None => Vec::new(),
        };
        for set in &recorded.patch_sets {
            let set = PatchSet {
                session: boxes.session,
                timing: Some(timing),
                sighting_parts: sighting_sets.len() as u16,
                persons: persons_of(set, &boxes, mapping),
                ..(*set).clone()
            };
            let bytes = wire::encode(&set);
            self.patches.put(bytes).wait().map_err(zenoh_error)?;
        }
        for set in &sighting_sets {
            let bytes = wire::encode(set);
            self.sightings.put(bytes).wait().map_err(zenoh_error)?;
        }
        Ok(())
    }
}

/// The patches of `set` under the ids of `boxes`.
fn persons_of(set: &PatchSet, boxes: &BoxSet, mapping: &IdMapping) -> Vec<PersonPatch> {
    let requested = boxes.persons.iter().filter_map(|requested| {
        let recorded = mapping.recorded_id(requested.person)?;
        let patches = set.persons.iter().filter(move |p| p.person == recorded);
        Some(patches.map(|patch| PersonPatch {
            person: requested.person,
            box_tick: boxes.tick,
            ..patch.clone()
        }))
    });
    requested.flatten().collect()
}

/// The sightings of `cameras`.
fn sighted_by(
    sets: &[&SightingSet],
    cameras: &[CameraIndex],
    session: SessionId,
) -> Vec<SightingSet> {
    let of_cameras = |set: &&SightingSet| {
        let own = set.sightings.iter();
        let own = own.filter(|sighting| cameras.contains(&sighting.camera));
        SightingSet {
            session,
            sightings: own.cloned().collect(),
            ..**set
        }
    };
    sets.iter().map(of_cameras).collect()
}

fn status_of(venue: &Venue, index: usize, ticks: i64) -> Status {
    Status {
        node: venue.viewpoints[index].name.clone(),
        process: index as u64 + 1,
        viewpoint: Some(ViewpointIndex(index as u16)),
        release: String::new(),
        ready: true,
        venue_hash: venue.hashes.venue.clone(),
        calibration_hash: venue.hashes.calibration.clone(),
        network_hash: String::new(),
        backend: String::new(),
        ticks: Some([Tick(0), Tick(ticks)]),
        tick: None,
        unreadable: 0,
        failure: None,
        stages: Vec::new(),
        live: Some(LiveStatus {
            every_nth_tick: 1,
            ..LiveStatus::default()
        }),
        health: NodeHealth::default(),
        agreement: Vec::new(),
    }
}

fn lock(received: &Mutex<ReceivedBoxes>) -> MutexGuard<'_, ReceivedBoxes> {
    // A panic elsewhere leaves complete messages.
    received.lock().unwrap_or_else(PoisonError::into_inner)
}
