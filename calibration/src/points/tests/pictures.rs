//! Calibration from pictures of a ball: the finder of [`crate::ball`] followed by the calibration.

use std::sync::Arc;

use nalgebra::Vector3;

use super::simulated::{Field, SMALL, ball, cameras, worst};
use super::*;
use crate::adjustment::CameraState;
use crate::ball::tests::render::{Ball, ORANGE, SIZE_PX, Scene, seeded};
use crate::ball::{Appearance, BallFinder, BallLens, BallRequest, ColourRange, sightings};

/// Size of the rendered part of each picture around the ball.
const DRAWN_PX: [u32; 2] = [200, 200];
const RADIUS_M: f64 = 0.11;

/// Sightings by the finder in `ticks` pictures of one camera, ten a second.
fn found(
    field: &Field,
    state: &CameraState,
    ticks: u64,
    background: &Arc<Vec<[f64; 3]>>,
) -> Vec<Sighting> {
    let lens = BallLens::new(SIZE_PX, state.intrinsics, state.lens()).unwrap();
    let colour = ColourRange::about(ORANGE.map(|c| c as u8));
    let request = BallRequest {
        appearance: Appearance::Colour(colour),
        diameter_px: [4.0, 160.0],
        lens: Some(lens),
    };
    let mut finder = BallFinder::new(request).unwrap();
    let mut rng = seeded(9);
    for tick in 0..ticks {
        let centre_w = ball(field, 0.1 * tick as f64);
        let Some(px) = state.project(&centre_w, state.fold_radius()) else {
            continue;
        };
        let is_inside =
            (0..2).all(|axis| (30.0..f64::from(SIZE_PX[axis]) - 30.0).contains(&px[axis]));
        if !is_inside {
            continue;
        }
        let scene = Scene {
            noise: 4.0,
            drawn: Some(background.clone()),
            ball: Some(Ball {
                centre_c: state.camera_from_world * (centre_w - state.center_w),
                path_c: Vector3::zeros(),
                radius_m: RADIUS_M,
                colour: ORANGE,
                shade: 0.4,
                hidden: None,
            }),
            ..Scene::about(state, px.into(), DRAWN_PX)
        };
        let bytes = scene.bytes(&mut rng);
        finder.look(tick, &scene.picture(&bytes)).unwrap();
    }
    sightings(&finder.finish())
}

/// Largest errors of a camera of `field` from pictures of `ticks` moments, metres and degrees.
fn from_pictures(field: &Field, ticks: u64) -> (f64, f64) {
    let truth = cameras(field);
    let background: Arc<Vec<[f64; 3]>> = Scene::about(&truth[0], [500.0, 500.0], DRAWN_PX)
        .background()
        .into();
    let seen = truth.iter().enumerate().map(|(index, state)| PointCamera {
        name: format!("c{index}"),
        size_px: SIZE_PX,
        intrinsics: state.intrinsics,
        lens: state.lens(),
        rate_hz: None,
        offset_s: None,
        sightings: found(field, state, ticks, &background),
    });
    let request = PointRequest::new(seen.collect(), Timing::Synchronised);
    for camera in &request.cameras {
        println!(
            "  {}: {} of {ticks} pictures",
            camera.name,
            camera.sightings.len()
        );
    }
    let found = quiet(&request).unwrap();
    for camera in &found.report.cameras {
        println!("  {}: {:.3} px", camera.name, camera.rms_px);
    }
    worst(&found_states(&found), &truth)
}

#[test]
fn a_ball_in_pictures_gives_the_cameras() {
    let (off_m, off_deg) = from_pictures(&SMALL, 250);
    println!("250 pictures of each of 8 cameras: {off_m:.5} m {off_deg:.5} deg");
    assert!(off_m < 0.0015 && off_deg < 0.006);
}

/// `cargo test --release -p farfield-calibration thousand_pictures -- --nocapture`, with `FARFIELD_MEASURE=1`
#[test]
fn a_thousand_pictures_of_a_ball_calibrate_every_field() {
    if std::env::var_os("FARFIELD_MEASURE").is_none() {
        println!("skipped: draws 32,000 pictures; FARFIELD_MEASURE=1 runs it");
        return;
    }
    for (field, bar_m, bar_deg) in BARS {
        let (off_m, off_deg) = from_pictures(&field, 1000);
        println!("{:?} m: {off_m:.5} m {off_deg:.5} deg", field.size_m);
        assert!(off_m < bar_m && off_deg < bar_deg);
    }
}
