//! Accuracy of the centre in one picture, and the time that a picture takes.

use std::time::Instant;

use nalgebra::Vector3;
use rand::RngExt;

use super::render::{Ball, ORANGE, Patch, SIZE_PX, Scene, ball_at, camera, lens_of, seeded};
use crate::ball::blobs::Blobs;
use crate::ball::candidate::{Buffers, Candidate, candidates};
use crate::ball::mask::Mask;
use crate::ball::{Appearance, BallFinder, BallLens, BallRequest, ColourRange, outline_offset_px};

/// Disturbances of a picture.
#[derive(Debug, Clone, Copy)]
struct Disturbance {
    noise: f64,
    /// Motion during the exposure over the diameter.
    blur: f64,
    /// Share of the diameter that is hidden, from one side.
    hidden: f64,
    /// How much darker the ball is below than above, share.
    shade: f64,
}

const CLEAN: Disturbance = Disturbance {
    noise: 0.0,
    blur: 0.0,
    hidden: 0.0,
    shade: 0.4,
};
const NOISY: Disturbance = Disturbance {
    noise: 6.0,
    ..CLEAN
};

/// Errors of the centre, and their ratios to the reported standard deviation.
struct Errors {
    px: Vec<f64>,
    over_sigma: Vec<f64>,
    /// Number of drawn balls.
    balls: usize,
}

impl Errors {
    fn percentile(&self, share: f64) -> f64 {
        let mut sorted = self.px.clone();
        sorted.sort_by(f64::total_cmp);
        sorted[((sorted.len() - 1) as f64 * share) as usize]
    }

    fn print(&self, what: &str) {
        let squares: f64 = self.over_sigma.iter().map(|v| v * v).sum();
        println!(
            "{what}: found {} of {}, median {:.3} px, 95 % {:.3} px, error over sigma {:.2}",
            self.px.len(),
            self.balls,
            self.percentile(0.5),
            self.percentile(0.95),
            (squares / (2.0 * self.px.len() as f64)).sqrt()
        );
    }
}

fn in_picture(
    scene: &Scene,
    bytes: &[u8],
    lens: Option<&BallLens>,
    diameters: [f64; 2],
) -> Vec<Candidate> {
    let range = ColourRange::about(ORANGE.map(|c| c as u8));
    let (mut mask, mut blobs) = (Mask::new(&Appearance::Colour(range)), Blobs::default());
    let picture = scene.picture(bytes);
    mask.find(&picture, &mut blobs).unwrap();
    let mut found = Vec::new();
    candidates(
        &picture,
        &mut blobs,
        diameters,
        lens,
        &mut Buffers::default(),
        &mut found,
    );
    found.sort_by(|a, b| b.score.total_cmp(&a.score));
    found
}

/// Errors of balls all over the picture, at distances of `distances_m`.
fn errors(disturbance: &Disturbance, distances_m: [f64; 2], count: usize) -> Errors {
    let camera = camera(1300.0);
    let lens = lens_of(&camera);
    let mut rng = seeded(3);
    let mut found = Errors {
        px: Vec::new(),
        over_sigma: Vec::new(),
        balls: count,
    };
    for _ in 0..count {
        let distance_m = rng.random_range(distances_m[0]..distances_m[1]);
        let px = [0, 1].map(|axis| rng.random_range(120.0..f64::from(SIZE_PX[axis]) - 120.0));
        let turn = rng.random_range(0.0..std::f64::consts::TAU);
        let toward = [libm::cos(turn), libm::sin(turn)];
        let path = Vector3::new(toward[0], toward[1], 0.0) * (2.0 * 0.11 * disturbance.blur);
        let hidden = (disturbance.hidden > 0.0).then_some([
            toward[0],
            toward[1],
            1.0 - 2.0 * disturbance.hidden,
        ]);
        let ball = Ball {
            path_c: path,
            hidden,
            shade: disturbance.shade,
            ..ball_at(&camera, px, distance_m)
        };
        let scene = Scene {
            noise: disturbance.noise,
            ball: Some(ball),
            ..Scene::about(&camera, px, [200, 200])
        };
        let bytes = scene.bytes(&mut rng);
        let seen = in_picture(&scene, &bytes, Some(&lens), [2.0, 150.0]);
        let Some(best) = seen.first() else { continue };
        let off = [0, 1].map(|axis| best.px[axis] - px[axis]);
        found.px.push(libm::hypot(off[0], off[1]));
        found
            .over_sigma
            .push(libm::hypot(off[0], off[1]) / best.sigma_px);
    }
    found
}

#[test]
fn clean_balls_are_located_to_a_fraction_of_a_pixel() {
    let found = errors(&CLEAN, [2.5, 25.0], 150);
    found.print("clean");
    assert!(found.px.len() >= 148);
    assert!(found.percentile(0.5) < 0.1 && found.percentile(0.95) < 0.2);
}

#[test]
fn noise_changes_the_centre_little() {
    let found = errors(&NOISY, [2.5, 25.0], 150);
    found.print("noise of 6 levels");
    assert!(found.px.len() >= 145);
    assert!(found.percentile(0.5) < 0.15 && found.percentile(0.95) < 0.3);
}

#[test]
fn balls_of_a_few_pixels_are_located() {
    let found = errors(&NOISY, [42.0, 80.0], 150);
    found.print("3.5 to 7 px");
    assert!(found.px.len() >= 135);
    assert!(found.percentile(0.5) < 0.3 && found.percentile(0.95) < 0.6);
}

#[test]
fn partly_hidden_balls_are_located() {
    let found = errors(
        &Disturbance {
            hidden: 0.25,
            ..NOISY
        },
        [2.5, 20.0],
        150,
    );
    found.print("a quarter of the diameter hidden");
    assert!(found.px.len() >= 100);
    assert!(found.percentile(0.5) < 0.3 && found.percentile(0.95) < 1.0);
}

#[test]
fn blurred_balls_are_located_at_the_middle_of_the_exposure() {
    // Shade biases the centre: light parts outweigh dark ones where both are mixed with the background.
    for (shade, median_px, most_px) in [(0.0, 0.15, 0.5), (0.4, 0.3, 1.5)] {
        let blurred = Disturbance {
            blur: 0.4,
            shade,
            ..NOISY
        };
        let found = errors(&blurred, [2.5, 20.0], 150);
        found.print(&format!("blurred by 0.4 diameters, shade {shade}"));
        assert!(found.px.len() >= 135);
        assert!(found.percentile(0.5) < median_px && found.percentile(0.95) < most_px);
    }
}

#[test]
fn only_without_a_lens_is_the_outline_off_as_predicted() {
    let mut camera = camera(1400.0);
    camera.distortion = [0.0; 8];
    let lens = lens_of(&camera);
    let px = [1700.0, 1000.0];
    let ball = ball_at(&camera, px, 2.2);
    let scene = Scene {
        ball: Some(ball),
        texture: 0.0,
        ..Scene::about(&camera, px, [220, 220])
    };
    let bytes = scene.bytes(&mut seeded(1));
    let off = |lens: Option<&BallLens>| {
        let seen = in_picture(&scene, &bytes, lens, [2.0, 200.0]);
        let best = seen.first().unwrap();
        [best.px[0] - px[0], best.px[1] - px[1]]
    };
    let arm = [
        px[0] - camera.intrinsics.cx_px,
        px[1] - camera.intrinsics.cy_px,
    ];
    let theta = libm::atan(libm::hypot(arm[0], arm[1]) / 1400.0);
    let expected = outline_offset_px(1400.0, theta, libm::asin(0.11 / 2.2));
    let [x, y] = off(None);
    let outward = (x * arm[0] + y * arm[1]) / libm::hypot(arm[0], arm[1]);
    let [u, v] = off(Some(&lens));
    println!(
        "outline {outward:.3} px outward, expected {expected:.3}; with the lens ({u:.3}, {v:.3})"
    );
    assert!(expected > 2.0 && (outward - expected).abs() < 0.15);
    assert!(libm::hypot(u, v) < 0.05);
}

#[test]
fn the_diameter_gives_the_distance() {
    let camera = camera(1300.0);
    let lens = lens_of(&camera);
    for distance_m in [3.0, 6.0, 12.0] {
        let px = [400.0, 900.0];
        let scene = Scene {
            ball: Some(ball_at(&camera, px, distance_m)),
            ..Scene::about(&camera, px, [200, 200])
        };
        let bytes = scene.bytes(&mut seeded(2));
        let found = in_picture(&scene, &bytes, Some(&lens), [2.0, 150.0])[0];
        let measured_m = 2.0 * 1301.3 * 0.11 / found.diameter_px;
        assert!(
            (measured_m / distance_m - 1.0).abs() < 0.03,
            "{measured_m} {distance_m}"
        );
    }
}

#[test]
fn things_of_the_same_colour_that_are_not_round_score_low() {
    let camera = camera(1300.0);
    let lens = lens_of(&camera);
    let at = [800.0, 500.0];
    for half_px in [[20.0, 20.0], [14.0, 24.0], [8.0, 30.0], [30.0, 12.0]] {
        let shirt = Patch {
            middle_px: at,
            half_px,
            is_box: true,
            colour: ORANGE,
        };
        let scene = Scene {
            patches: vec![shirt],
            noise: 4.0,
            ..Scene::about(&camera, at, [160, 160])
        };
        let bytes = scene.bytes(&mut seeded(7));
        let seen = in_picture(&scene, &bytes, Some(&lens), [6.0, 100.0]);
        assert!(
            seen.iter().all(|it| it.score < 0.6),
            "{half_px:?}: {seen:?}"
        );
    }
}

/// `FARFIELD_MEASURE=1 cargo test --release -p farfield-calibration a_large_picture -- --nocapture`
#[test]
#[expect(clippy::disallowed_methods, reason = "it is what this measures")]
fn a_large_picture_takes_some_tens_of_milliseconds() {
    if std::env::var_os("FARFIELD_MEASURE").is_none() {
        println!(
            "skipped: it measures time, which depends on the machine; FARFIELD_MEASURE=1 runs it"
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
