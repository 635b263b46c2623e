//! Tests of people who are lost, found again, or confused with another person.

use super::*;
use crate::body::skeleton::N_JOINTS;
use crate::identity::phase::Phase;
use crate::sightings::finder::{SightedKeypoint, SightedPerson};

const STATURE_M: f64 = 1.75;

/// The greatest sigma of a pose, metres.
fn unsure_m(pose: &PersonPose) -> f32 {
    assert_eq!(pose.sigma_m.len(), N_JOINTS, "a pose has its sigmas");
    pose.sigma_m.iter().copied().fold(0.0, f32::max)
}

/// A person who was lost, and was seen again too briefly for a sure identity.
fn just_found() -> HallFixture {
    let mut stage = HallFixture::new();
    let body = person(0.0, 0.0, STATURE_M);
    stage.run_for(std::slice::from_ref(&body), 3.0);
    stage.run_for(&[], 0.15);
    stage.run_for(&[body], 0.2);
    let phase = stage.registry.tracks()[0].identity.phase;
    assert!(phase.is_suspect() && !phase.is_lost());
    stage
}

/// Adds a track in the place of the first.
fn add_on_the_first(stage: &mut HallFixture, phase: Phase) {
    let first = &stage.registry.tracks[0];
    let estimator = first.estimator();
    let body = (estimator.body().skeleton.clone(), *estimator.pose());
    let track = Track::new(PersonId(99), phase, body, &stage.method);
    stage.registry.tracks.push(track);
}

#[test]
fn a_found_person_stays_where_a_newcomer_stands_on_its_body() {
    let mut stage = just_found();
    add_on_the_first(&mut stage, Phase::Tentative);
    let tick = stage.tick;
    stage.registry.step_back(tick, &stage.method);
    assert_eq!(stage.registry.tracks()[0].identity.coverage.missing, 0);
}

#[test]
fn a_found_person_gives_way_to_a_sure_one() {
    let mut stage = just_found();
    add_on_the_first(&mut stage, Phase::Tracked);
    let tick = stage.tick;
    stage.registry.step_back(tick, &stage.method);
    assert!(stage.registry.tracks()[0].identity.phase.is_lost());
}

#[test]
fn stepping_back_discards_evidence_and_raises_sigmas() {
    let mut stage = HallFixture::new();
    stage.run_for(
        &[
            person(0.0, 0.0, STATURE_M),
            person(1.5, 0.0, 1.1 * STATURE_M),
        ],
        3.0,
    );
    let before = stage.registry.published()[0].clone();
    let near = [
        person(0.0, 0.0, STATURE_M),
        person(0.5, 0.0, 1.1 * STATURE_M),
    ];
    stage.run_for(&near, 0.5);
    let (tick, method) = (stage.tick, stage.method.clone());
    let alone_at = stage.registry.tracks()[0].identity.alone.unwrap().tick;
    let ticks = u32::try_from(tick - alone_at).unwrap();
    let event = Event {
        wire_id: stage.registry.tracks()[0].wire_id(),
        kind: EventKind::StepBack {
            other: PersonId(2),
            distance_m: 0.1,
            ticks,
        },
    };
    stage.registry.apply(&[event], tick, &method);
    let back = stage.registry.published()[0].clone();
    assert_eq!((back.state, back.views), (PersonState::Coasting, 0));
    assert!(stage.registry.tracks()[0].estimator.estimates().is_empty());
    let (before_m, back_m) = (unsure_m(&before), unsure_m(&back));
    assert!(back_m > 2.0 * before_m, "{before_m} m, {back_m} m");
    stage.step_seen_by(&[], &[]);
    assert!(unsure_m(&stage.registry.published()[0]) > back_m);
}

#[test]
fn a_revived_person_has_sigmas_at_every_tick() {
    let mut stage = HallFixture::new();
    stage.run_for(&[person(0.0, 0.0, STATURE_M)], 3.0);
    let mut carried_m = 0.0;
    for i in 1..=16 {
        stage.step_seen_by(&[person(0.1 * f64::from(i), 0.0, STATURE_M)], &[]);
        carried_m = unsure_m(&stage.registry.published()[0]);
    }
    let mut last_m = carried_m;
    for _ in 0..10 {
        stage.step(&[person(1.7, 0.0, STATURE_M)]);
        last_m = unsure_m(&stage.registry.published()[0]);
    }
    assert!(last_m < carried_m, "{carried_m} m, {last_m} m");
}

#[test]
fn a_person_found_in_place_gets_its_new_posture_at_once() {
    const SHOULDER_ELBOW_WRIST: [usize; 3] = [5, 7, 9];
    let mut stage = just_found();
    let mut body = person(0.0, 0.0, STATURE_M);
    let [shoulder, elbow, wrist] = SHOULDER_ELBOW_WRIST;
    let lengths_m = [(shoulder, elbow), (elbow, wrist)].map(|(a, b)| (body[a] - body[b]).norm());
    body[elbow] = body[shoulder] + Vector3::z() * lengths_m[0];
    body[wrist] = body[elbow] + Vector3::z() * lengths_m[1];
    let sighted = |position_m: &Vector3<f64>| SightedKeypoint {
        position_m: *position_m,
        score: 1.0,
        views: 4,
    };
    let raised = SightedPerson {
        keypoints_m: body.iter().map(|point_m| Some(sighted(point_m))).collect(),
        views: 4,
    };
    let (tick, method) = (stage.tick, stage.method.clone());
    let track = &mut stage.registry.tracks_mut()[0];
    assert!(track.take_back(&raised, tick, &method));
    let off_m = (track.estimator.keypoints_m()[wrist] - body[wrist]).norm();
    assert!(off_m < 0.1, "{off_m} m");
}

#[test]
fn a_lost_runner_is_carried_without_pose_beyond_half_a_metre() {
    const SPEED_M_S: f64 = 3.0;
    let mut stage = HallFixture::new();
    let ticks = (2.0 * RATE_HZ) as u32;
    for i in 0..ticks {
        let x_m = -3.0 + SPEED_M_S * f64::from(i) / RATE_HZ;
        stage.step(&[person(x_m, 0.0, STATURE_M)]);
    }
    let mut carried = 0;
    while !stage.registry.published().is_empty() {
        stage.step_seen_by(&[], &[]);
        carried += 1;
    }
    let carried_s = f64::from(carried) / RATE_HZ;
    assert!((0.3..0.8).contains(&carried_s), "{carried_s} s");
    assert_eq!(stage.registry.tracks().len(), 1, "it may be found again");
}

#[test]
fn a_sighting_without_pose_revives_no_track() {
    let mut stage = just_found();
    let method = stage.method.clone();
    let unusable = SightedPerson {
        keypoints_m: vec![None; method.sites.len()],
        views: 2,
    };
    let tick = stage.tick;
    let track = &mut stage.registry.tracks_mut()[0];
    let seen = track.estimator.n_views();
    assert!(!track.take_back(&unusable, tick, &method));
    assert_eq!(track.estimator.n_views(), seen);
}

#[test]
fn earlier_ticks_are_solved_without_the_current_push() {
    let settled = |push_m: f64| {
        let mut stage = HallFixture::new();
        stage.run_for(&[person(0.0, 0.0, STATURE_M)], 0.4);
        let method = stage.method.clone();
        let track = &mut stage.registry.tracks_mut()[0];
        assert!(track.is_tentative());
        track
            .estimator
            .push(Some(&[Vector3::repeat(push_m); N_JOINTS]));
        track.solve_again(&method)
    };
    let poses = settled(0.0);
    assert!(!poses.is_empty());
    assert_eq!(poses, settled(0.05));
}

#[test]
fn a_person_seen_at_all_shared_ticks_is_never_lost() {
    let mut stage = HallFixture::new();
    let body = person(0.0, 0.0, STATURE_M);
    stage.run_for(std::slice::from_ref(&body), 1.0);
    let id = stage.id_at(0.0, 0.0);
    assert!(id.is_some());
    for _ in 0..20 {
        // 4 of 20 Hz.
        for _ in 0..4 {
            stage.step_seen_by(&[], &[]);
        }
        stage.step(std::slice::from_ref(&body));
        assert_eq!(stage.registry.tracks()[0].identity.phase, Phase::Tracked);
    }
    assert_eq!(stage.id_at(0.0, 0.0), id);
}
