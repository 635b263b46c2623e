//! Cameras that fail, as fakes: one freezes, one turns black, one dies. Each viewpoint has two.

use farfield_lab::live_venue::SeenVenue;
use farfield_proto::message::live::CameraHealth;
use farfield_sim::maps_file::{CameraFailure, FailureKind};

use super::stage::{LiveStage, RATE_HZ};

/// When the fakes begin to fail: everybody has been tracked for a while.
const FROM_S: f64 = 8.0;

/// The worst health of a viewpoint's cameras that is not `Works`, as its edge says.
fn ill(seen: &SeenVenue, viewpoint: &str) -> Option<CameraHealth> {
    let cameras = &seen.live(viewpoint)?.cameras;
    let healths = cameras.iter().map(|camera| camera.health);
    healths.into_iter().find(|h| *h != CameraHealth::Works)
}

/// The first camera of the first viewpoint fails; its edge says how, and everybody stays who they are.
fn check(kind: FailureKind, expected: CameraHealth) {
    let from = (FROM_S * RATE_HZ) as u32;
    let mut stage = LiveStage::prepare(&[(0, CameraFailure { from, kind })], "");
    stage.start();
    let viewpoint = stage.live.venue().viewpoints[0].name.clone();
    let (before, ids) = (stage.takes(), stage.ids());
    stage.wait("the camera's failure is said", |seen| {
        ill(seen, &viewpoint) == Some(expected)
    });
    stage.go_on(2.0);
    assert_eq!(stage.ids(), ids);
    let other = stage.live.venue().viewpoints[1].name.clone();
    assert_eq!(ill(&stage.seen(), &other), None);
    before.assert_flat(&stage.takes());
}

#[test]
fn fake_a_camera_that_freezes_is_named_and_nobody_is_lost() {
    check(FailureKind::Freezes, CameraHealth::Frozen);
}

#[test]
fn fake_a_camera_that_turns_black_is_named_and_nobody_is_lost() {
    check(FailureKind::TurnsBlack, CameraHealth::Black);
}

#[test]
fn fake_a_camera_that_dies_is_named_and_nobody_is_lost() {
    check(FailureKind::Dies, CameraHealth::Failed);
}
