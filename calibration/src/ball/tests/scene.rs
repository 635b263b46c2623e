//! One thing among others, over many frames.

use std::sync::{Arc, OnceLock};

use nalgebra::Vector3;

use super::render::{Ball, ORANGE, Patch, Scene, ball_at, camera, lens_of, seeded};
use crate::ball::{
    Appearance, BallError, BallFinder, BallRequest, BallSighting, ColourRange, Picture, sightings,
    sightings_text,
};
use crate::points::parse;

const SIZE_PX: [u32; 2] = [480, 360];
const MIDDLE_PX: [f64; 2] = [900.0, 560.0];

fn orange() -> ColourRange {
    ColourRange::about(ORANGE.map(|c| c as u8))
}

fn request(appearance: Appearance) -> BallRequest {
    BallRequest {
        appearance,
        diameter_px: [8.0, 80.0],
        lens: Some(lens_of(&camera(1300.0))),
    }
}

/// Position of the ball's centre in a frame: up and down through the picture.
fn path(frame: u64) -> [f64; 2] {
    let t = frame as f64;
    [
        MIDDLE_PX[0] + 170.0 * libm::sin(0.05 * t),
        MIDDLE_PX[1] + 110.0 * libm::cos(0.083 * t),
    ]
}

fn ball(frame: u64) -> Ball {
    ball_at(
        &camera(1300.0),
        path(frame),
        8.0 + 2.0 * libm::sin(0.03 * frame as f64),
    )
}

/// The scene, with its background drawn once.
fn scene() -> Scene {
    static DRAWN: OnceLock<Vec<[f64; 3]>> = OnceLock::new();
    let scene = Scene {
        noise: 4.0,
        ..Scene::about(&camera(1300.0), MIDDLE_PX, SIZE_PX)
    };
    let drawn = DRAWN.get_or_init(|| scene.background()).clone();
    Scene {
        drawn: Some(drawn.into()),
        ..scene
    }
}

/// Shirts of the ball's colour that move through the picture, and a still round sign of that colour.
fn look_alikes(frame: u64) -> Vec<Patch> {
    let t = frame as f64;
    let shirt = |middle_px: [f64; 2], half_px: [f64; 2], is_box: bool| Patch {
        middle_px,
        half_px,
        is_box,
        colour: ORANGE,
    };
    let [x, y] = MIDDLE_PX;
    vec![
        shirt([x - 200.0 + 2.0 * t, y - 60.0], [13.0, 19.0], true),
        shirt(
            [x + 180.0 - 1.5 * t, y + 90.0],
            [22.0, 12.0 + 3.0 * libm::sin(0.4 * t)],
            false,
        ),
        shirt([x + 120.0, y - 120.0], [18.0, 18.0], false),
    ]
}

fn process(finder: &mut BallFinder, frames: std::ops::Range<u64>, scene_of: impl Fn(u64) -> Scene) {
    let mut rng = seeded(11);
    for frame in frames {
        let scene = scene_of(frame);
        let bytes = scene.bytes(&mut rng);
        finder.look(frame, &scene.picture(&bytes)).unwrap();
    }
}

fn off_px(sighting: &BallSighting) -> f64 {
    let [x, y] = path(sighting.frame);
    libm::hypot(sighting.px[0] - x, sighting.px[1] - y)
}

#[test]
fn only_the_ball_is_found_among_similar_things() {
    let mut finder = BallFinder::new(request(Appearance::Colour(orange()))).unwrap();
    process(&mut finder, 0..150, |frame| Scene {
        ball: Some(ball(frame)),
        patches: look_alikes(frame),
        ..scene()
    });
    let found = finder.finish();
    let wrong = found.iter().filter(|it| off_px(it) > 1.0).count();
    println!("{} of 150, {wrong} wrong", found.len());
    // The ball is not visible in front of a shirt of its colour.
    assert!(found.len() > 110 && wrong == 0);
}

#[test]
fn an_absent_ball_gives_no_sightings() {
    let mut finder = BallFinder::new(request(Appearance::Colour(orange()))).unwrap();
    let is_there = |frame: u64| (60..100).contains(&frame);
    process(&mut finder, 0..200, |frame| Scene {
        ball: is_there(frame).then(|| ball(frame)),
        patches: look_alikes(frame),
        ..scene()
    });
    let found = finder.finish();
    println!("{} of 40", found.len());
    assert!(
        found
            .iter()
            .all(|it| is_there(it.frame) && off_px(it) < 1.0)
    );
    assert!(found.len() > 25);
}

#[test]
fn scenes_without_a_ball_give_no_sightings() {
    let mut finder = BallFinder::new(request(Appearance::Colour(orange()))).unwrap();
    process(&mut finder, 0..120, |frame| Scene {
        patches: look_alikes(frame),
        ..scene()
    });
    let found = finder.finish();
    assert!(found.is_empty(), "{} sightings", found.len());
}

#[test]
fn colour_and_motion_find_a_ball_as_bright_as_its_background() {
    let grey = (ORANGE[0] + 2.0 * ORANGE[1] + ORANGE[2]) / 4.0;
    let boards = Scene {
        background: [grey; 3],
        texture: 8.0,
        drawn: None,
        ..scene()
    };
    let drawn: Arc<Vec<[f64; 3]>> = boards.background().into();
    let mut finder = BallFinder::new(request(Appearance::MovingColour(orange()))).unwrap();
    process(&mut finder, 0..80, |frame| Scene {
        ball: Some(ball(frame)),
        drawn: Some(drawn.clone()),
        ..boards.clone()
    });
    let found = finder.finish();
    let wrong = found.iter().filter(|it| off_px(it) > 1.0).count();
    println!("{} of 80, {wrong} wrong", found.len());
    assert!(found.len() > 72 && wrong == 0);
}

#[test]
fn the_colour_of_the_ball_is_learnt() {
    let request = request(Appearance::MovingColour(ColourRange::saturated()));
    let mut finder = BallFinder::new(request).unwrap();
    process(&mut finder, 0..80, |frame| {
        let t = frame as f64;
        let green = Patch {
            middle_px: [MIDDLE_PX[0] - 150.0 + 3.0 * t, MIDDLE_PX[1] + 40.0],
            half_px: [15.0, 24.0],
            is_box: true,
            colour: [40.0, 170.0, 60.0],
        };
        Scene {
            ball: Some(ball(frame)),
            patches: vec![green],
            ..scene()
        }
    });
    let learnt = finder.colour().unwrap();
    assert!(learnt.contains(ORANGE.map(|c| c as u8)), "{learnt:?}");
    assert!(!learnt.contains([40, 170, 60]), "{learnt:?}");
}

#[test]
fn a_light_in_the_dark_is_found() {
    let dark = Scene {
        background: [14.0, 14.0, 18.0],
        texture: 8.0,
        drawn: None,
        ..scene()
    };
    let request = BallRequest {
        diameter_px: [2.0, 12.0],
        ..request(Appearance::Bright { least: 120 })
    };
    let mut finder = BallFinder::new(request).unwrap();
    process(&mut finder, 0..80, |frame| Scene {
        ball: Some(Ball {
            radius_m: 0.02,
            colour: [400.0; 3],
            shade: 0.0,
            ..ball(frame)
        }),
        ..dark.clone()
    });
    let found = finder.finish();
    let wrong = found.iter().filter(|it| off_px(it) > 0.4).count();
    println!("{} of 80, {wrong} off by more than 0.4 px", found.len());
    assert!(found.len() > 72 && wrong * 20 < found.len());
}

#[test]
fn motion_finds_a_drone_against_the_sky_in_grey_pictures() {
    let mut rng = seeded(5);
    let request = BallRequest {
        diameter_px: [2.0, 20.0],
        ..request(Appearance::Moving { contrast: 25 })
    };
    let mut finder = BallFinder::new(request).unwrap();
    for frame in 0..120 {
        let scene = Scene {
            background: [170.0, 180.0, 200.0],
            texture: 20.0,
            drawn: None,
            ball: Some(Ball {
                radius_m: 0.03,
                colour: [45.0; 3],
                ..ball(frame)
            }),
            ..scene()
        };
        let bytes = scene.bytes(&mut rng);
        let grey: Vec<u8> = bytes.chunks_exact(3).map(|pixel| pixel[1]).collect();
        let picture = Picture::grey8(&grey, SIZE_PX)
            .unwrap()
            .at_origin(scene.origin_px);
        finder.look(frame, &picture).unwrap();
    }
    let found = finder.finish();
    let wrong = found.iter().filter(|it| off_px(it) > 0.5).count();
    println!("{} of 120, {wrong} off by more than 0.5 px", found.len());
    assert!(found.len() > 90 && wrong * 20 < found.len());
}

#[test]
fn points_parse_the_sightings() {
    let mut finder = BallFinder::new(request(Appearance::Colour(orange()))).unwrap();
    process(&mut finder, 3..20, |frame| Scene {
        ball: Some(ball(frame)),
        ..scene()
    });
    let found = finder.finish();
    assert!(found.len() == 17);
    let text = sightings_text(&found);
    let read = parse(&text, std::path::Path::new("north.txt")).unwrap();
    for (a, b) in read.iter().zip(sightings(&found)) {
        assert!((a.frame - b.frame).abs() < 1e-9 && (a.px[0] - b.px[0]).abs() < 1e-3);
    }
    assert_eq!(read.len(), found.len());
}

#[test]
fn invalid_pictures_and_requests_are_rejected() {
    let bytes = [90; 300];
    let grey = Picture::grey8(&bytes, [20, 10]).unwrap();
    let mut by_colour = BallFinder::new(request(Appearance::Colour(orange()))).unwrap();
    assert_eq!(by_colour.look(0, &grey), Err(BallError::Grey));
    let mut by_motion = BallFinder::new(request(Appearance::Moving { contrast: 20 })).unwrap();
    by_motion.look(4, &grey).unwrap();
    assert_eq!(
        by_motion.look(4, &grey),
        Err(BallError::Order { found: 4, last: 4 })
    );
    let other = Picture::grey8(&bytes, [10, 10]).unwrap();
    assert!(matches!(
        by_motion.look(5, &other),
        Err(BallError::SizeChanged { .. })
    ));
    for diameter_px in [[0.0, 5.0], [9.0, 5.0], [1.0, f64::NAN], [1.0, 1e9]] {
        let wrong = BallRequest {
            diameter_px,
            ..request(Appearance::Bright { least: 3 })
        };
        assert!(BallFinder::new(wrong).is_err());
    }
}

#[test]
fn pictures_of_any_content_and_size_are_processed() {
    let bytes: Vec<u8> = (0..3 * 64 * 64_u32)
        .map(|i| (i.wrapping_mul(2_654_435_761) >> 13) as u8)
        .collect();
    for appearance in [
        Appearance::Colour(ColourRange::saturated()),
        Appearance::MovingColour(ColourRange::saturated()),
        Appearance::Bright { least: 0 },
        Appearance::Bright { least: 128 },
        Appearance::Moving { contrast: 0 },
    ] {
        for size_px in [[1, 1], [1, 64], [64, 1], [2, 2], [64, 64], [5, 40]] {
            let diameter_px = [1.0, 2000.0];
            let mut finder = BallFinder::new(BallRequest {
                diameter_px,
                ..request(appearance)
            })
            .unwrap();
            for (frame, from) in [0, 300, 700].into_iter().enumerate() {
                let picture = Picture::rgb8(&bytes[from..], size_px);
                let Ok(picture) = picture else { continue };
                finder.look(frame as u64, &picture).unwrap();
            }
            finder.finish();
        }
    }
    // The renderer rejects a ball whose centre is behind what the lens can project, without a panic.
    let behind = Ball {
        centre_c: Vector3::new(0.0, 0.0, -3.0),
        ..ball(0)
    };
    let scene = Scene {
        ball: Some(behind),
        ..scene()
    };
    assert_eq!(scene.bytes(&mut seeded(1)).len(), 3 * 480 * 360);
}
