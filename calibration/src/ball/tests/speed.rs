//! How long a picture takes.

use std::time::Instant;

use super::render::{ORANGE, Patch, SIZE_PX, Scene, ball_at, camera, lens_of, seeded};
use crate::ball::{Appearance, BallFinder, BallRequest, ColourRange};

/// `FARFIELD_MEASURE=1 cargo test --release -p farfield-calibration a_large_picture -- --nocapture`
#[test]
#[expect(clippy::disallowed_methods, reason = "it is what this measures")]
fn a_large_picture_takes_some_tens_of_milliseconds() {
    if std::env::var_os("FARFIELD_MEASURE").is_none() {
        println!(
            "skipped: says how long it takes, which depends on the machine; FARFIELD_MEASURE=1 runs it"
        );
        return;
    }
    let camera = camera(1300.0);
    let mut scene = Scene {
        noise: 4.0,
        ..Scene::about(&camera, [960.0, 600.0], SIZE_PX)
    };
    for i in 0..12 {
        scene.patches.push(Patch {
            middle_px: [100.0 + 140.0 * f64::from(i), 900.0],
            half_px: [14.0, 24.0],
            is_box: i % 2 == 0,
            colour: ORANGE,
        });
    }
    let mut rng = seeded(1);
    let pictures: Vec<Vec<u8>> = (0..4)
        .map(|i| {
            scene.ball = Some(ball_at(&camera, [700.0 + 40.0 * f64::from(i), 400.0], 6.0));
            scene.bytes(&mut rng)
        })
        .collect();
    let orange = ColourRange::about(ORANGE.map(|c| c as u8));
    for appearance in [
        Appearance::Colour(orange),
        Appearance::MovingColour(orange),
        Appearance::Moving { contrast: 25 },
        Appearance::Bright { least: 200 },
    ] {
        let request = BallRequest {
            appearance,
            diameter_px: [6.0, 120.0],
            lens: Some(lens_of(&camera)),
        };
        let mut finder = BallFinder::new(request).unwrap();
        let mut spans = Vec::new();
        for frame in 0..40 {
            let picture = scene.picture(&pictures[frame as usize % pictures.len()]);
            let begun = Instant::now();
            finder.look(frame, &picture).unwrap();
            spans.push(begun.elapsed().as_secs_f64());
        }
        spans.sort_by(f64::total_cmp);
        println!(
            "{appearance:?}: median {:.1} ms, most {:.1} ms",
            1e3 * spans[20],
            1e3 * spans[39]
        );
        assert!(spans[20] < 0.2);
    }
}
