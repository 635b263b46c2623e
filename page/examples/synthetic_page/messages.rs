//! Messages that the nodes of the synthetic venue would send for a tick: a pure function of the
//! tick.
//!
//! In every 20 s the last edge is silent for six and its link fails. In every 30 s one camera is
//! black for five. In every 40 s one link is too slow for eight.

use farfield_page::RecordedMessages;
use farfield_proto::bounding_box::{BoundingBox, BoxRate};
use farfield_proto::frames::Point;
use farfield_proto::grid::CellGrid;
use farfield_proto::id::{CameraIndex, PersonId, SessionId, ViewpointIndex};
use farfield_proto::key::Keys;
use farfield_proto::message::health::{LinkHealth, NodeHealth, SystemClock};
use farfield_proto::message::identity_event::{Change, IdentityEvent, IdentityEventSet};
use farfield_proto::message::live::{
    CameraHealth, CameraStatus, EdgeLink, LiveBoxes, LiveStatus, PatchTiming,
};
use farfield_proto::message::{
    BoxSet, CameraBox, KeypointPeak, Order, PatchSet, PersonBoxes, PersonPatch, PersonPose,
    PoseSet, Sighting, SightingSet, StageTime, Status,
};
use farfield_proto::patch::EncodedMaps;
use farfield_proto::tick::Tick;
use farfield_proto::venue::Venue;
use farfield_proto::wire::{Message, encode};
use nalgebra::Point3;

use super::people::{is_lost, pose};
use super::venue::RATE_HZ;

/// A message: key, payload, and time, microseconds of Unix time.
pub(crate) type Timed = (String, Vec<u8>, i64);

/// The synthetic venue at work.
pub(crate) struct Synthetic {
    venue: Venue,
    keys: Keys,
    people: u32,
    /// Unix time of tick 0, microseconds.
    epoch_us: i64,
}

fn viewpoint_index(index: usize) -> ViewpointIndex {
    ViewpointIndex(index as u16)
}

const SESSION: SessionId = SessionId(0x5e55_1001);

impl Synthetic {
    /// A venue with this many people that starts at a Unix time in microseconds.
    pub(crate) fn new(venue: Venue, people: u32, epoch_us: i64) -> Self {
        Self {
            keys: Keys::new(&venue.name),
            venue,
            people,
            epoch_us,
        }
    }

    /// Time of a tick, microseconds of Unix time.
    pub(crate) fn tick_us(&self, tick: Tick) -> i64 {
        self.epoch_us + (tick.seconds(RATE_HZ) * 1e6).round() as i64
    }

    /// The messages of a tick, in order.
    pub(crate) fn messages(&self, tick: Tick) -> Vec<Timed> {
        let (s, tick_us) = (tick.seconds(RATE_HZ), self.tick_us(tick));
        let people: Vec<PersonPose> = (1..=self.people).map(|person| pose(person, tick)).collect();
        let mut passed = Vec::new();
        let mut send = |key: String, bytes: Vec<u8>, at_us: i64| passed.push((key, bytes, at_us));
        for (index, viewpoint) in self.venue.viewpoints.iter().enumerate() {
            let name = &viewpoint.name;
            let boxes = self.boxes(index, tick, &people);
            let chosen = Self::patches(index, tick, &boxes, s);
            let sightings = self.sightings(index, tick);
            send(self.keys.boxes(name), encode(&boxes), tick_us - 20_000);
            if self.is_silent(index, s) {
                continue;
            }
            // Delays vary, a little and sometimes more.
            let number = i64::from(viewpoint_index(index).0);
            let late_us = 9_000 + 1_500 * number + (tick.0 * 7919 + 13 * number) % 3_000;
            send(self.keys.patch(name), encode(&chosen), tick_us + late_us);
            if let Some(sightings) = sightings {
                send(
                    self.keys.sighting(name),
                    encode(&sightings),
                    tick_us + late_us,
                );
            }
        }
        if let Some(events) = self.events(tick, s) {
            send(self.keys.event(), encode(&events), tick_us + 18_000);
        }
        let hiccup_us = if tick.0 % 97 == 0 { 9_000 } else { 0 };
        let poses = PoseSet {
            session: SESSION,
            tick,
            persons: people,
        };
        send(
            self.keys.pose(),
            encode(&poses),
            tick_us + 21_000 + hiccup_us,
        );
        if tick.0 % 60 == 0 {
            self.statuses(tick, s, &mut send);
        }
        passed.sort_by_key(|(_, _, at_us)| *at_us);
        passed
    }

    /// Whether an edge is silent.
    fn is_silent(&self, viewpoint: usize, s: f64) -> bool {
        viewpoint + 1 == self.venue.viewpoints.len()
            && s.rem_euclid(20.0) >= 12.0
            && s.rem_euclid(20.0) < 18.0
    }

    fn is_black(camera: CameraIndex, s: f64) -> bool {
        camera.0 == 2 && (8.0..13.0).contains(&s.rem_euclid(30.0))
    }

    fn boxes(&self, viewpoint: usize, tick: Tick, people: &[PersonPose]) -> BoxSet {
        let persons = people.iter().map(|pose| PersonBoxes {
            person: pose.person,
            cameras: self.venue.viewpoints[viewpoint]
                .cameras
                .iter()
                .filter_map(|&camera| self.camera_box(camera, pose))
                .collect(),
        });
        BoxSet {
            session: SESSION,
            tick,
            viewpoint: viewpoint_index(viewpoint),
            part: 0,
            parts: 1,
            order: Order::Track,
            live: Some(LiveBoxes {
                sequence: tick.0 as u32,
                epoch_us: self.epoch_us as u64,
                clock_correction_us: Some(0),
                heard: None,
                every_nth_tick: 0,
            }),
            detection_cameras: Vec::new(),
            persons: persons
                .filter(|person| !person.cameras.is_empty())
                .collect(),
        }
    }

    fn project(&self, camera: CameraIndex, [x, y, z]: [f32; 3]) -> Option<[f32; 2]> {
        let model = &self.venue.camera(camera)?.model;
        let pixel = model.project(Point::new(Point3::new(x.into(), y.into(), z.into())))?;
        model
            .sees(pixel)
            .then(|| [pixel.x() as f32, pixel.y() as f32])
    }

    fn camera_box(&self, camera: CameraIndex, pose: &PersonPose) -> Option<CameraBox> {
        let seen: Vec<[f32; 2]> = pose
            .joints_m
            .iter()
            .filter_map(|&joint| self.project(camera, joint))
            .collect();
        let bound = |i: usize| {
            let limit =
                |fold: fn(f32, f32) -> f32, from| seen.iter().map(|px| px[i]).fold(from, fold);
            [
                limit(f32::min, f32::INFINITY),
                limit(f32::max, f32::NEG_INFINITY),
            ]
        };
        let ([left, right], [top, bottom]) = (bound(0), bound(1));
        (seen.len() > 20).then(|| CameraBox {
            camera,
            bounding_box: BoundingBox {
                center_px: [0.5 * (left + right), 0.5 * (top + bottom)],
                size_px: [1.3 * (right - left) + 4.0, 1.15 * (bottom - top) + 4.0],
                rotation_rad: 0.0,
            },
            rate: BoxRate::default(),
            torso_px: seen[0],
            neck_px: seen[2],
        })
    }

    fn patches(viewpoint: usize, tick: Tick, boxes: &BoxSet, s: f64) -> PatchSet {
        let crop = CellGrid {
            origin_px: [10.0, 20.5],
            step_px: [4.0, 0.25],
            width: 48,
            height: 64,
        };
        let persons = boxes
            .persons
            .iter()
            .filter(|person| !is_lost(person.person.0, s));
        let persons = persons.filter_map(|person| {
            let mut works = person
                .cameras
                .iter()
                .filter(|b| !Self::is_black(b.camera, s));
            Some(PersonPatch {
                person: person.person,
                camera: works.next()?.camera,
                box_tick: tick,
                capture_offset_us: -150,
                crops: vec![crop],
                crop_of_keypoint: vec![0; 17],
                maps: EncodedMaps {
                    width: 48,
                    height: 64,
                    keypoints: 17,
                    bytes: vec![7; 90],
                },
            })
        });
        PatchSet {
            session: SESSION,
            tick,
            viewpoint: viewpoint_index(viewpoint),
            part: 0,
            parts: 1,
            sighting_parts: 0,
            timing: Some(PatchTiming {
                sent_after_us: 7_000 + (tick.0 * 31 % 900) as i32,
                clock_correction_us: 0,
                echo: None,
            }),
            persons: persons.collect(),
        }
    }

    /// About once a second detectors find all people; one of them is used here.
    fn sightings(&self, viewpoint: usize, tick: Tick) -> Option<SightingSet> {
        let camera = *self.venue.viewpoints[viewpoint].cameras.first()?;
        let found = pose(
            1 + (tick.0 / 60).rem_euclid(i64::from(self.people.max(1))) as u32,
            tick,
        );
        let keypoints = found.keypoints_m.iter().map(|&at_m| {
            let position_px = self.project(camera, at_m)?;
            Some(KeypointPeak {
                position_px,
                score: 0.8,
            })
        });
        (tick.0 % 60 == 0).then(|| SightingSet {
            session: SESSION,
            tick,
            viewpoint: viewpoint_index(viewpoint),
            part: 0,
            parts: 1,
            sightings: vec![Sighting {
                camera,
                score: 0.9,
                keypoints: keypoints.collect(),
            }],
        })
    }

    fn events(&self, tick: Tick, s: f64) -> Option<IdentityEventSet> {
        let before = (tick + -1).seconds(RATE_HZ);
        let changes = (1..=self.people).filter_map(|person| {
            let change = match (is_lost(person, before), is_lost(person, s)) {
                _ if tick.0 == 1 => Change::Initiate { views: 3 },
                _ if tick.0 == 30 => Change::Confirm { seen_s: 0.5 },
                (false, true) => Change::Lose { missing_s: 0.1 },
                (true, false) => Change::Find { lost_s: 3.0 },
                _ => return None,
            };
            let person = PersonId(person);
            Some(IdentityEvent {
                person,
                wire_id: person,
                change,
            })
        });
        let events: Vec<IdentityEvent> = changes.collect();
        (!events.is_empty()).then_some(IdentityEventSet {
            session: SESSION,
            tick,
            events,
        })
    }

    fn statuses(&self, tick: Tick, s: f64, send: &mut impl FnMut(String, Vec<u8>, i64)) {
        let at_us = self.tick_us(tick) + 25_000;
        let mut links = Vec::new();
        for (index, viewpoint) in self.venue.viewpoints.iter().enumerate() {
            let is_silent = self.is_silent(index, s);
            links.push(self.link(index, tick, is_silent));
            if !is_silent {
                self.send_one(&viewpoint.name, &self.edge(index, tick, s), at_us, send);
            }
        }
        let live = LiveStatus {
            epoch_us: Some(self.epoch_us as u64),
            every_nth_tick: 1,
            edges: links,
            ..LiveStatus::default()
        };
        let stages = [
            ("step", 4_000),
            ("lattice", 1_800),
            ("ik", 1_300),
            ("capture_to_pose", 21_000),
        ];
        let mut status = node("fusion", tick, live, &stages);
        status.health.links = vec![
            LinkHealth {
                clock_uncertainty_us: Some(180),
                clock_correction_us: Some(-350),
                dropped: 0
            };
            self.venue.viewpoints.len()
        ];
        self.send_one("fusion", &status, at_us, send);
    }

    fn send_one(
        &self,
        name: &str,
        status: &Status,
        at_us: i64,
        send: &mut impl FnMut(String, Vec<u8>, i64),
    ) {
        debug_assert_eq!(status.check(), Ok(()));
        send(self.keys.status(name), encode(status), at_us);
    }

    fn link(&self, index: usize, tick: Tick, is_silent: bool) -> EdgeLink {
        EdgeLink {
            viewpoint: self.venue.viewpoints[index].name.clone(),
            live: !is_silent,
            refused: None,
            round_trip_us: (!is_silent).then_some(1_900 + 400 * index as u32),
            clock_offset_us: Some(350 - 500 * i32::from(viewpoint_index(index).0)),
            horizon_ticks: 2.4,
            bytes_per_s: if is_silent {
                0
            } else {
                90_000 + 9_000 * self.people * (1 + index as u32 % 2) / 4
            },
            late: (tick.0 / 600) as u64,
            missing: (tick.0 / 1200) as u64 * 360 * u64::from(index == 3),
            unreadable: 0,
        }
    }

    fn edge(&self, index: usize, tick: Tick, s: f64) -> Status {
        let viewpoint = &self.venue.viewpoints[index];
        let is_thin = index == 1 && (20.0..28.0).contains(&s.rem_euclid(40.0));
        let cameras = viewpoint.cameras.iter().map(|&camera| {
            let is_black = Self::is_black(camera, s);
            CameraStatus {
                camera,
                health: if is_black {
                    CameraHealth::Black
                } else {
                    CameraHealth::Works
                },
                frames_per_s: 60.0,
                capture_offset_us: -150 - 40 * i32::from(camera.0),
                reason: is_black.then(|| "mean brightness 0.4 of 255".to_owned()),
            }
        });
        let live = LiveStatus {
            epoch_us: Some(self.epoch_us as u64),
            quality: if is_thin { 5 } else { 2 },
            persons_per_tick: is_thin.then_some(6),
            every_nth_tick: 1,
            bytes_per_s: 90_000,
            cameras: cameras.collect(),
            ..LiveStatus::default()
        };
        let mut status = node(
            &viewpoint.name,
            tick,
            live,
            &[("network", 5_200), ("crop", 900), ("look", 14_000)],
        );
        status.viewpoint = Some(viewpoint_index(index));
        status.process = 1000 + index as u64;
        "onnxruntime cpu".clone_into(&mut status.backend);
        status
    }
}

fn node(name: &str, tick: Tick, live: LiveStatus, stages: &[(&str, u32)]) -> Status {
    let stage = |&(stage, p50_us): &(&str, u32)| StageTime {
        stage: stage.to_owned(),
        count: tick.0.max(1) as u64,
        total_us: tick.0.max(1) as u64 * u64::from(p50_us),
        p50_us,
        p99_us: 2 * p50_us,
        p999_us: 3 * p50_us,
        max_us: 4 * p50_us,
    };
    Status {
        node: name.to_owned(),
        process: 0,
        viewpoint: None,
        release: env!("CARGO_PKG_VERSION").to_owned(),
        ready: true,
        venue_hash: "0123456789abcdef".to_owned(),
        calibration_hash: "fedcba9876543210".to_owned(),
        network_hash: String::new(),
        backend: String::new(),
        ticks: None,
        tick: Some(tick),
        unreadable: 0,
        failure: None,
        stages: stages.iter().map(stage).collect(),
        live: Some(live),
        health: NodeHealth {
            system_clock: Some(SystemClock {
                synchronised: true,
                max_error_us: Some(900),
                ahead_us: 0,
            }),
            follows: Some(SESSION),
            ..NodeHealth::default()
        },
        agreement: Vec::new(),
    }
}

/// A recording that is generated while it is read.
pub(crate) struct SyntheticRecording {
    synthetic: Synthetic,
    ticks: i64,
}

impl SyntheticRecording {
    /// Covers ticks 0 to `ticks`.
    pub(crate) fn new(synthetic: Synthetic, ticks: i64) -> Self {
        Self { synthetic, ticks }
    }
}

impl RecordedMessages for SyntheticRecording {
    fn span_us(&self) -> [i64; 2] {
        [
            self.synthetic.tick_us(Tick(0)),
            self.synthetic.tick_us(Tick(self.ticks)),
        ]
    }

    fn read(
        &mut self,
        from_us: i64,
        to_us: i64,
        visit: &mut dyn FnMut(&str, &[u8], i64),
    ) -> Result<(), String> {
        let period_us = self.synthetic.tick_us(Tick(60)) - self.synthetic.tick_us(Tick(0));
        let tick = |us: i64| (us - self.synthetic.tick_us(Tick(0))) * 60 / period_us;
        let (first, last) = (
            (tick(from_us) - 10).max(0),
            (tick(to_us) + 10).min(self.ticks),
        );
        let mut all: Vec<_> = (first..=last)
            .flat_map(|t| self.synthetic.messages(Tick(t)))
            .collect();
        all.sort_by_key(|(_, _, at_us)| *at_us);
        for (key, bytes, at_us) in all {
            if (from_us..to_us).contains(&at_us) {
                visit(&key, &bytes, at_us);
            }
        }
        Ok(())
    }
}
