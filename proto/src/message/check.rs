//! Validity checks of messages: counts, sizes, orders and numbers.
//!
//! A message that passes is well formed. Whether it makes sense (an existing camera, a current
//! session) is checked by the node.

use serde::Serialize;
use serde::de::DeserializeOwned;

use super::agreement;
use super::form::sightings;
use super::live::{LiveStatus, MAX_CLOCK_CORRECTION_US, MAX_EDGES, MAX_NTH_TICK};
use super::{
    BoxSet, CameraBox, MAX_CAPTURE_OFFSET_US, MAX_CROPS, MAX_PERSONS, MAX_SIGHTINGS, MAX_STAGES,
    PatchSet, PersonPatch, PersonPose, PoseSet, Sighting, SightingSet, Status,
};
use crate::grid::CellGrid;
use crate::key::is_key_chunk;
use crate::patch::MAX_KEYPOINTS;
use crate::plain_text::one_line;
use crate::wire::{
    MAX_CAMERAS, MAX_HASH_BYTES, MAX_JOINTS, MAX_PARTS, MAX_REASON_BYTES, MAX_TEXT_BYTES, Message,
};

impl Message for PatchSet {
    fn check(&self) -> Result<(), &'static str> {
        check_parts(self.part, self.parts)?;
        ensure(
            self.sighting_parts <= MAX_PARTS,
            "more sighting parts than a tick may have",
        )?;
        let timing = self.timing.iter();
        timing
            .map(|timing| timing.clock_correction_us)
            .try_for_each(check_correction)?;
        ensure(
            self.persons.len() <= MAX_PERSONS,
            "more persons than a message may have",
        )?;
        self.persons.iter().try_for_each(check_patch)
    }
}

fn check_patch(patch: &PersonPatch) -> Result<(), &'static str> {
    ensure(
        patch.capture_offset_us.unsigned_abs() <= MAX_CAPTURE_OFFSET_US.unsigned_abs(),
        "a capture too far from its tick",
    )?;
    let maps = &patch.maps;
    maps.check_size()
        .map_err(|_| "maps of an impossible size")?;
    ensure(
        (1..=MAX_CROPS).contains(&patch.crops.len()),
        "an impossible number of crops",
    )?;
    ensure(
        patch.crops.iter().all(CellGrid::is_valid),
        "an impossible crop",
    )?;
    let same_size = patch
        .crops
        .iter()
        .all(|c| (c.width, c.height) == (maps.width, maps.height));
    ensure(same_size, "a crop whose size differs from its maps")?;
    let of_keypoint = &patch.crop_of_keypoint;
    ensure(
        of_keypoint.len() == usize::from(maps.keypoints),
        "not one crop index per keypoint",
    )?;
    ensure(
        of_keypoint
            .iter()
            .all(|&c| usize::from(c) < patch.crops.len()),
        "a crop index without a crop",
    )
}

/// Writes a message and the number that follows it from version 2 on.
fn write_with_nth(
    message: &impl Serialize,
    nth_tick: u16,
    version: u8,
    bytes: Vec<u8>,
) -> postcard::Result<Vec<u8>> {
    let bytes = postcard::to_extend(message, bytes)?;
    if version < 2 {
        return Ok(bytes);
    }
    postcard::to_extend(&nth_tick, bytes)
}

/// Reads a message, the number that follows it from version 2 on (else 0), and returns the rest.
fn read_with_nth<M: DeserializeOwned>(
    version: u8,
    bytes: &[u8],
) -> postcard::Result<(M, u16, &[u8])> {
    let (message, rest) = postcard::take_from_bytes(bytes)?;
    let (nth_tick, rest) = match version {
        ..=1 => (0, rest),
        2.. => postcard::take_from_bytes(rest)?,
    };
    Ok((message, nth_tick, rest))
}

impl Message for BoxSet {
    fn write(&self, version: u8, bytes: Vec<u8>) -> postcard::Result<Vec<u8>> {
        let every_nth_tick = self.live.map_or(0, |live| live.every_nth_tick);
        write_with_nth(self, every_nth_tick, version, bytes)
    }

    fn read(version: u8, bytes: &[u8]) -> postcard::Result<(Self, &[u8])> {
        let (mut set, every_nth_tick, rest) = read_with_nth::<Self>(version, bytes)?;
        if let Some(live) = &mut set.live {
            live.every_nth_tick = every_nth_tick;
        }
        Ok((set, rest))
    }

    fn check(&self) -> Result<(), &'static str> {
        check_parts(self.part, self.parts)?;
        ensure(
            self.persons.len() <= MAX_PERSONS,
            "more persons than a message may have",
        )?;
        let few_cameras = self.persons.iter().all(|p| p.cameras.len() <= MAX_CAMERAS);
        ensure(
            few_cameras && self.detection_cameras.len() <= MAX_CAMERAS,
            "more cameras than a viewpoint may have",
        )?;
        let live = self.live.iter();
        live.clone()
            .filter_map(|live| live.clock_correction_us)
            .try_for_each(check_correction)?;
        let mut planned = live.map(|live| live.every_nth_tick);
        ensure(
            planned.all(|nth| nth <= MAX_NTH_TICK),
            "a plan of too few ticks",
        )?;
        ensure(
            self.detection_cameras.is_sorted_by(|a, b| a < b),
            "detection cameras out of order or twice",
        )?;
        self.persons
            .iter()
            .flat_map(|p| &p.cameras)
            .try_for_each(check_box)
    }
}

fn check_box(camera: &CameraBox) -> Result<(), &'static str> {
    ensure(camera.bounding_box.is_valid(), "an impossible box")?;
    let rate = &camera.rate;
    let rates = rate
        .center_px
        .iter()
        .chain(&rate.size_px)
        .chain([&rate.rotation_rad]);
    ensure(all_finite(rates), "a rate that is not finite")?;
    ensure(
        all_finite(camera.torso_px.iter().chain(&camera.neck_px)),
        "a torso or neck that is not finite",
    )
}

impl Message for SightingSet {
    fn write(&self, _version: u8, bytes: Vec<u8>) -> postcard::Result<Vec<u8>> {
        sightings::write(self, bytes)
    }

    fn read(_version: u8, bytes: &[u8]) -> postcard::Result<(Self, &[u8])> {
        sightings::read(bytes)
    }

    fn check(&self) -> Result<(), &'static str> {
        check_parts(self.part, self.parts)?;
        ensure(
            self.sightings.len() <= MAX_SIGHTINGS,
            "more sightings than a message may have",
        )?;
        self.sightings.iter().try_for_each(check_sighting)
    }
}

fn check_sighting(sighting: &Sighting) -> Result<(), &'static str> {
    ensure(
        (0.0..=1.0).contains(&sighting.score),
        "a score outside 0 to 1",
    )?;
    ensure(
        sighting.keypoints.len() <= MAX_KEYPOINTS,
        "more keypoints than a network may have",
    )?;
    sighting.keypoints.iter().flatten().try_for_each(|peak| {
        ensure((0.0..=1.0).contains(&peak.score), "a score outside 0 to 1")?;
        ensure(
            all_finite(&peak.position_px),
            "a position that is not finite",
        )
    })
}

impl Message for PoseSet {
    fn check(&self) -> Result<(), &'static str> {
        ensure(
            self.persons.len() <= MAX_PERSONS,
            "more persons than a message may have",
        )?;
        self.persons.iter().try_for_each(check_pose)
    }
}

fn check_pose(pose: &PersonPose) -> Result<(), &'static str> {
    ensure(
        pose.joints_m.len() <= MAX_JOINTS,
        "more joints than a skeleton may have",
    )?;
    ensure(
        pose.angles.len() <= MAX_JOINTS,
        "more angles than a skeleton may have",
    )?;
    ensure(
        pose.keypoints_m.len() <= MAX_KEYPOINTS,
        "more keypoints than a network may have",
    )?;
    ensure(
        pose.sigma_m.len() <= pose.joints_m.len(),
        "more uncertainties than joints",
    )?;
    ensure(
        pose.sigma_m.iter().all(|s| s.is_finite() && *s >= 0.0),
        "an uncertainty that is not a length",
    )?;
    let positions = pose.joints_m.iter().chain(&pose.keypoints_m).flatten();
    ensure(
        all_finite(positions.chain(&pose.angles)),
        "a number that is not finite",
    )
}

impl Message for Status {
    fn write(&self, version: u8, bytes: Vec<u8>) -> postcard::Result<Vec<u8>> {
        let needed_nth_tick = self.live.as_ref().map_or(0, |live| live.needed_nth_tick);
        write_with_nth(self, needed_nth_tick, version, bytes)
    }

    fn read(version: u8, bytes: &[u8]) -> postcard::Result<(Self, &[u8])> {
        let (mut status, needed_nth_tick, rest) = read_with_nth::<Self>(version, bytes)?;
        if let Some(live) = &mut status.live {
            live.needed_nth_tick = needed_nth_tick;
        }
        Ok((status, rest))
    }

    fn make_plain(&mut self) {
        let texts = [
            &mut self.node,
            &mut self.release,
            &mut self.venue_hash,
            &mut self.calibration_hash,
            &mut self.network_hash,
            &mut self.backend,
        ];
        let live = self.live.as_mut();
        let of_live = live.into_iter().flat_map(|live| {
            let cameras = live.cameras.iter_mut().flat_map(|it| &mut it.reason);
            let edges = live.edges.iter_mut();
            let edges = edges.flat_map(|it| [&mut it.viewpoint].into_iter().chain(&mut it.refused));
            cameras.chain(edges).chain(&mut live.recording_failure)
        });
        let all = texts.into_iter().chain(&mut self.failure).chain(of_live);
        let all = all.chain(self.stages.iter_mut().map(|it| &mut it.stage));
        for text in all.chain(&mut self.health.notices) {
            *text = one_line(text);
        }
    }

    fn check(&self) -> Result<(), &'static str> {
        ensure(
            is_key_chunk(&self.node),
            "a node name that cannot be part of a key",
        )?;
        ensure(
            self.release.len() <= MAX_HASH_BYTES,
            "a text that is too long",
        )?;
        let hashes = [&self.venue_hash, &self.calibration_hash, &self.network_hash];
        let short = hashes.iter().all(|hash| hash.len() <= MAX_HASH_BYTES);
        ensure(short, "a fingerprint that is too long")?;
        let short = [&self.backend]
            .into_iter()
            .chain(&self.failure)
            .chain(self.stages.iter().map(|s| &s.stage))
            .all(|text| text.len() <= MAX_TEXT_BYTES);
        ensure(short, "a text that is too long")?;
        ensure(
            self.stages.len() <= MAX_STAGES,
            "more stages than a node may have",
        )?;
        let in_order = self.ticks.is_none_or(|[first, end]| first <= end);
        ensure(in_order, "ticks that end before they begin")?;
        self.health.check()?;
        agreement::check(&self.agreement)?;
        self.live.iter().try_for_each(check_live)
    }
}

fn check_live(live: &LiveStatus) -> Result<(), &'static str> {
    check_correction(live.clock_correction_us)?;
    ensure(live.every_nth_tick > 0, "every 0th tick")?;
    ensure(
        live.needed_nth_tick <= MAX_NTH_TICK,
        "a plan of too few ticks",
    )?;
    ensure(
        live.cameras.len() <= MAX_CAMERAS,
        "more cameras than a viewpoint may have",
    )?;
    ensure(
        live.edges.len() <= MAX_EDGES,
        "more edges than a venue may have",
    )?;
    let failure = live.recording_failure.iter();
    ensure(
        failure.clone().all(|text| text.len() <= MAX_TEXT_BYTES),
        "a text that is too long",
    )?;
    let mut reasons = live.cameras.iter().filter_map(|c| c.reason.as_ref());
    ensure(
        reasons.all(|reason| reason.len() <= MAX_REASON_BYTES),
        "a text that is too long",
    )?;
    let rates = live.cameras.iter().map(|c| &c.frames_per_s);
    ensure(
        all_finite(rates.chain(live.edges.iter().map(|e| &e.horizon_ticks))),
        "a number that is not finite",
    )?;
    live.edges.iter().try_for_each(|edge| {
        ensure(
            is_key_chunk(&edge.viewpoint),
            "a node name that cannot be part of a key",
        )?;
        let refused = edge.refused.iter();
        ensure(
            refused.clone().all(|text| text.len() <= MAX_TEXT_BYTES),
            "a text that is too long",
        )
    })
}

fn check_correction(us: i32) -> Result<(), &'static str> {
    ensure(
        us.unsigned_abs() <= MAX_CLOCK_CORRECTION_US.unsigned_abs(),
        "a clock correction out of range",
    )
}

fn check_parts(part: u16, parts: u16) -> Result<(), &'static str> {
    ensure(
        (1..=MAX_PARTS).contains(&parts),
        "an impossible number of parts",
    )?;
    ensure(part < parts, "a part past the last one")
}

fn all_finite<'a>(numbers: impl IntoIterator<Item = &'a f32>) -> bool {
    numbers.into_iter().all(|v| v.is_finite())
}

fn ensure(holds: bool, otherwise: &'static str) -> Result<(), &'static str> {
    if holds { Ok(()) } else { Err(otherwise) }
}
