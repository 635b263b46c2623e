//! One viewpoint that is played: its session with fusion, and what it says at a tick.

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

use super::casting::{Casting, Places, places_of_boxes};
use crate::live_venue::watch::{session, subscribe, unix_us, zenoh_error};

/// Detection passes that are remembered.
const DETECTIONS: usize = 64;

/// What fusion has said to a viewpoint.
#[derive(Debug, Default)]
pub(super) struct HeardBoxes {
    /// The newest boxes, and their arrival as Unix time, microseconds.
    pub(super) newest: Option<(BoxSet, u64)>,
    /// Which messages of the newest have come.
    parts: Option<BoxParts>,
    /// The cameras that detection passes were asked of.
    detection: BTreeMap<Tick, Vec<CameraIndex>>,
    /// Whether the run is over.
    pub(super) is_over: bool,
}

impl HeardBoxes {
    fn hear(&mut self, mut boxes: BoxSet) {
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
    heard: Arc<Mutex<HeardBoxes>>,
    patches: Publisher<'static>,
    sightings: Publisher<'static>,
    statuses: Publisher<'static>,
    /// Both last as long as the viewpoint plays.
    _token: LivelinessToken,
    _session: Session,
}

/// What was recorded of a viewpoint at a tick.
pub(super) struct RecordedSets<'a> {
    pub(super) patch_sets: Vec<&'a PatchSet>,
    /// Of a detection pass of all cameras.
    pub(super) sighting_sets: Vec<&'a SightingSet>,
}

impl PlayedViewpoint {
    /// Connects viewpoint `index` of `venue`, which plays `ticks` ticks from 0, with fusion at `endpoint`.
    pub(super) fn connect(
        venue: &Venue,
        index: usize,
        ticks: i64,
        endpoint: &str,
    ) -> anyhow::Result<Self> {
        let name = &venue.viewpoints[index].name;
        let session = session(endpoint)?;
        let keys = Keys::new(&venue.name);
        let heard: Arc<Mutex<HeardBoxes>> = Arc::default();
        let hears = Arc::clone(&heard);
        subscribe(&session, keys.boxes(name), move |_, bytes| {
            if let Ok(boxes) = wire::decode::<BoxSet>(bytes) {
                lock(&hears).hear(boxes);
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
            heard,
            patches,
            sightings,
            statuses,
            _token: token,
            _session: session,
        })
    }

    /// What fusion has said so far.
    pub(super) fn heard(&self) -> MutexGuard<'_, HeardBoxes> {
        lock(&self.heard)
    }

    /// Where the newest boxes have everybody at `tick`.
    pub(super) fn places(&self, tick: Tick) -> Places {
        let heard = self.heard();
        let newest = heard.newest.as_ref();
        newest.map_or_else(Places::new, |(boxes, _)| places_of_boxes(boxes, tick))
    }

    /// Says how it is.
    pub(super) fn send_status(&self) -> anyhow::Result<()> {
        let bytes = wire::encode(&self.status);
        self.statuses.put(bytes).wait().map_err(zenoh_error)
    }

    /// Sends what was recorded of those whom the newest boxes hold, as `casting` says who they are, at `tick`, which is
    /// at `tick_us` (Unix time, microseconds); and the sightings, where they were asked for.
    pub(super) fn send(
        &self,
        (tick, tick_us): (Tick, u64),
        recorded: &RecordedSets<'_>,
        casting: &Casting,
    ) -> anyhow::Result<()> {
        let (boxes, arrived_us, asked) = {
            let mut heard = self.heard();
            let asked = heard.detection.remove(&tick);
            let Some((boxes, arrived_us)) = heard.newest.clone() else {
                return Ok(());
            };
            (boxes, arrived_us, asked)
        };
        let now_us = unix_us();
        let echo = boxes.live.map(|live| BoxEcho {
            sequence: live.sequence,
            held_us: now_us.saturating_sub(arrived_us) as u32,
        });
        let timing = PatchTiming {
            // Later than 36 minutes is no time of an edge.
            sent_after_us: i32::try_from(now_us.saturating_sub(tick_us)).unwrap_or(i32::MAX),
            clock_correction_us: 0,
            echo,
        };
        let sighting_sets = match &asked {
            Some(cameras) => sighted_by(&recorded.sighting_sets, cameras, boxes.session),
            None => Vec::new(),
        };
        for set in &recorded.patch_sets {
            let set = PatchSet {
                session: boxes.session,
                timing: Some(timing),
                sighting_parts: sighting_sets.len() as u16,
                persons: persons_of(set, &boxes, casting),
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
fn persons_of(set: &PatchSet, boxes: &BoxSet, casting: &Casting) -> Vec<PersonPatch> {
    let asked = boxes.persons.iter().filter_map(|asked| {
        let recorded = casting.of(asked.person)?;
        let patches = set.persons.iter().filter(move |p| p.person == recorded);
        Some(patches.map(|patch| PersonPatch {
            person: asked.person,
            box_tick: boxes.tick,
            ..patch.clone()
        }))
    });
    asked.flatten().collect()
}

/// What `cameras` sighted.
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

fn lock(heard: &Mutex<HeardBoxes>) -> MutexGuard<'_, HeardBoxes> {
    // A panic elsewhere leaves whole messages behind.
    heard.lock().unwrap_or_else(PoisonError::into_inner)
}
