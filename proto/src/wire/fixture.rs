//! One message of each kind, for tests.

use crate::bounding_box::{BoundingBox, BoxRate};
use crate::grid::CellGrid;
use crate::id::{CameraIndex, PersonId, SessionId, ViewpointIndex};
use crate::message::agreement::{AgreementOfCamera, AgreementVerdict, CameraAgreement};
use crate::message::health::{LinkHealth, NodeHealth, SystemClock};
use crate::message::live::{
    BoxEcho, CameraHealth, CameraStatus, EdgeLink, HeardPatches, LiveBoxes, LiveStatus, PatchTiming,
};
use crate::message::thumbnail::Thumbnail;
use crate::message::thumbnail::tests::jpeg;
use crate::message::{
    BoxSet, CameraBox, KeypointPeak, Order, PatchSet, PersonBoxes, PersonPatch, PersonPose,
    PersonState, PoseSet, Sighting, SightingSet, StageTime, Status,
};
use crate::patch::EncodedMaps;
use crate::tick::Tick;

pub(super) fn patch_set() -> PatchSet {
    let crop = CellGrid {
        origin_px: [10.0, 20.5],
        step_px: [4.0, 0.25],
        width: 48,
        height: 64,
    };
    let patch = PersonPatch {
        person: PersonId(7),
        camera: CameraIndex(3),
        box_tick: Tick(299),
        capture_offset_us: -120,
        crops: vec![crop],
        crop_of_keypoint: vec![0, 0],
        maps: EncodedMaps {
            width: 48,
            height: 64,
            keypoints: 2,
            bytes: vec![1, 2, 3],
        },
    };
    PatchSet {
        session: SessionId(0x0102_0304),
        tick: Tick(300),
        viewpoint: ViewpointIndex(1),
        part: 0,
        parts: 1,
        sighting_parts: 2,
        timing: Some(PatchTiming {
            sent_after_us: 9_000,
            clock_correction_us: -20_000,
            echo: Some(BoxEcho {
                sequence: 299,
                held_us: 4_000,
            }),
        }),
        persons: vec![patch],
    }
}

pub(super) fn box_set() -> BoxSet {
    let camera = CameraBox {
        camera: CameraIndex(3),
        bounding_box: BoundingBox {
            center_px: [100.0, 200.0],
            size_px: [50.0, 90.0],
            rotation_rad: 0.5,
        },
        rate: BoxRate {
            center_px: [1.0, -1.0],
            size_px: [0.0, 0.5],
            rotation_rad: 0.0,
        },
        torso_px: [100.0, 210.0],
        neck_px: [101.0, 170.0],
    };
    BoxSet {
        session: SessionId(9),
        tick: Tick(-5),
        viewpoint: ViewpointIndex(0),
        part: 0,
        parts: 1,
        order: Order::Track,
        live: Some(LiveBoxes {
            sequence: 300,
            epoch_us: 1_700_000_000_000_000,
            clock_correction_us: Some(-20_000),
            heard: Some(HeardPatches {
                tick: Tick(-17),
                one_way_us: 40_100,
                bytes: 120_000,
            }),
            every_nth_tick: 3,
        }),
        detection_cameras: vec![CameraIndex(0), CameraIndex(3)],
        persons: vec![PersonBoxes {
            person: PersonId(1),
            cameras: vec![camera],
        }],
    }
}

pub(super) fn sighting_set() -> SightingSet {
    let peak = KeypointPeak {
        position_px: [1.5, -2.0],
        score: 0.75,
    };
    let sighting = Sighting {
        camera: CameraIndex(0),
        score: 1.0,
        keypoints: vec![Some(peak), None],
    };
    SightingSet {
        session: SessionId(9),
        tick: Tick(64),
        viewpoint: ViewpointIndex(2),
        part: 1,
        parts: 2,
        sightings: vec![sighting],
    }
}

/// The same people in integers, as edges send them.
pub(super) fn sighting_set_whole() -> SightingSet {
    let peak = |position_px, score| Some(KeypointPeak { position_px, score });
    let sighting = Sighting {
        camera: CameraIndex(3),
        score: 0.8,
        keypoints: vec![
            peak([1203.25, 499.0625], 0.6),
            None,
            peak([1201.0, 511.5], 1.0),
        ],
    };
    SightingSet {
        sightings: vec![sighting.snapped()],
        ..sighting_set()
    }
}

pub(super) fn pose_set() -> PoseSet {
    let pose = PersonPose {
        person: PersonId(2),
        state: PersonState::Coasting,
        joints_m: vec![[0.0, 0.5, 1.0]],
        keypoints_m: vec![[1.0, -0.5, 2.0]],
        sigma_m: vec![0.015_625],
        angles: vec![0.25],
        unobserved: 1 << 39,
        views: 4,
    };
    PoseSet {
        session: SessionId(9),
        tick: Tick(64),
        persons: vec![pose],
    }
}

pub(super) fn thumbnail() -> Thumbnail {
    Thumbnail {
        session: SessionId(9),
        tick: Tick(300),
        viewpoint: ViewpointIndex(1),
        camera: CameraIndex(3),
        jpeg: jpeg(320, 180),
    }
}

pub(super) fn stage(count: u64) -> StageTime {
    StageTime {
        stage: "crop".to_owned(),
        count,
        total_us: 70,
        p50_us: 40,
        p99_us: 300,
        p999_us: 600,
        max_us: 1000,
    }
}

pub(super) fn live_status() -> LiveStatus {
    let camera = CameraStatus {
        camera: CameraIndex(4),
        health: CameraHealth::Frozen,
        frames_per_s: 59.5,
        capture_offset_us: -3_000,
        reason: Some("no signal".to_owned()),
    };
    let edge = EdgeLink {
        viewpoint: "north".to_owned(),
        live: false,
        refused: Some("clock".to_owned()),
        round_trip_us: Some(80_000),
        clock_offset_us: Some(-20_000),
        horizon_ticks: 6.5,
        bytes_per_s: 100_000,
        late: 3,
        missing: 4,
        unreadable: 5,
    };
    LiveStatus {
        epoch_us: Some(1_700_000_000_000_000),
        clock_correction_us: 20_000,
        quality: 3,
        persons_per_tick: Some(6),
        every_nth_tick: 2,
        needed_nth_tick: 1,
        bytes_per_s: 110_000,
        held_back: 7,
        missed_ticks: 8,
        cameras: vec![camera],
        edges: vec![edge],
        recording_failure: None,
    }
}

pub(super) fn status() -> Status {
    Status {
        node: "north".to_owned(),
        process: 129,
        viewpoint: Some(ViewpointIndex(2)),
        release: "0.1.0".to_owned(),
        ready: true,
        venue_hash: "ab".to_owned(),
        calibration_hash: "cd".to_owned(),
        network_hash: String::new(),
        backend: String::new(),
        ticks: Some([Tick(300), Tick(400)]),
        tick: None,
        unreadable: 300,
        failure: Some("lost".to_owned()),
        stages: vec![stage(3)],
        live: Some(live_status()),
        health: NodeHealth {
            system_clock: Some(SystemClock {
                synchronised: true,
                max_error_us: Some(1_500),
                ahead_us: -40,
            }),
            certificate_ends_s: Some(1_800_000_000),
            follows: Some(SessionId(9)),
            links: vec![LinkHealth {
                clock_uncertainty_us: Some(20_000),
                clock_correction_us: Some(-150),
                dropped: 6,
            }],
            notices: vec!["the disk is full".to_owned()],
        },
        agreement: vec![AgreementOfCamera {
            camera: CameraIndex(3),
            agreement: CameraAgreement {
                verdict: AgreementVerdict::Disagrees,
                keypoints: 1_200,
                distance_mm: Some(61.0),
                distance_px: Some(4.5),
                late_ticks: Some(-2.25),
            },
        }],
    }
}
