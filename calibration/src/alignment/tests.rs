//! Alignment of cameras with clicked marks, compared with the truth.

use farfield_proto::camera::{Distortion, Intrinsics};
use farfield_proto::court::{Court, LineShape};
use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::*;
use crate::adjustment::CameraState;

pub(super) type Cameras = Vec<(String, CameraState)>;

/// Six cameras around a futsal court.
pub(super) fn venue() -> Cameras {
    let intrinsics = Intrinsics {
        fx_px: 1100.0,
        fy_px: 1100.0,
        cx_px: 960.0,
        cy_px: 600.0,
    };
    let lens = Distortion {
        k1: -0.08,
        k2: 0.02,
        ..Distortion::default()
    };
    let places = [
        [-23.0, -12.0],
        [0.0, -14.0],
        [23.0, -12.0],
        [23.0, 12.0],
        [0.0, 14.0],
        [-23.0, 12.0],
    ];
    let cameras = places.iter().enumerate().map(|(i, [x, y])| {
        let center = Vector3::new(*x, *y, 5.0 + 0.4 * i as f64);
        let forward = (Vector3::new(0.2 * x, 0.1 * y, 0.0) - center).normalize();
        let right = forward.cross(&Vector3::z()).normalize();
        let rows = [
            right.transpose(),
            forward.cross(&right).transpose(),
            forward.transpose(),
        ];
        let rotation = Rotation3::from_matrix_unchecked(Matrix3::from_rows(&rows));
        let state = CameraState {
            center_w: center,
            camera_from_world: UnitQuaternion::from_rotation_matrix(&rotation),
            ..CameraState::at_origin(intrinsics, lens)
        };
        (format!("c{i}"), state)
    });
    cameras.collect()
}

/// From the venue to another world, as an adjustment would have it.
fn elsewhere() -> Similarity {
    Similarity {
        scale: 0.23,
        rotation: UnitQuaternion::from_scaled_axis(Vector3::new(0.9, -2.0, 0.4)),
        shift: Vector3::new(4.0, -7.0, 2.0),
    }
}

fn moved(cameras: &Cameras, by: &Similarity) -> Cameras {
    cameras
        .iter()
        .map(|(name, state)| (name.clone(), by.apply_to_camera(state)))
        .collect()
}

fn seen_px(state: &CameraState, at_m: [f64; 3]) -> Option<[f64; 2]> {
    let px = state.project(&Vector3::from(at_m), state.fold_radius())?;
    let is_inside = (0.0..1920.0).contains(&px.x) && (0.0..1200.0).contains(&px.y);
    is_inside.then(|| px.into())
}

/// Clicks at `at_m` in all cameras that see it, with an error of `sigma_px`.
fn clicks(cameras: &Cameras, at_m: [f64; 3], sigma_px: f64, rng: &mut ChaCha8Rng) -> Vec<Click> {
    let mut gauss = || {
        let radius = (-2.0 * libm::log(rng.random_range(1e-12..1.0))).sqrt();
        sigma_px * radius * libm::cos(std::f64::consts::TAU * rng.random_range(0.0..1.0))
    };
    let seen = cameras
        .iter()
        .filter_map(|(name, state)| Some((name, seen_px(state, at_m)?)));
    seen.map(|(name, [x, y])| (name.clone(), [x + gauss(), y + gauss()]))
        .collect()
}

fn no_marks() -> Marks {
    Marks {
        court: None,
        known: Vec::new(),
        floor: Vec::new(),
        lengths: Vec::new(),
        click_sigma_px: 1.0,
        place_sigma_m: 0.005,
    }
}

/// Marks of a futsal court as seen by all cameras.
pub(super) fn court_marks(cameras: &Cameras, names: &[&str], sigma_px: f64, seed: u64) -> Marks {
    let court = Court::of("futsal", None).unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let known = names.iter().map(|name| {
        let at_m = court.mark(name).unwrap().position_m;
        KnownMark {
            name: (*name).to_owned(),
            known: Known::Place(at_m),
            clicks: clicks(cameras, at_m, sigma_px, &mut rng),
        }
    });
    Marks {
        known: known.collect(),
        ..no_marks()
    }
}

/// Clicks on a line that one camera sees.
pub(super) fn on_line(cameras: &Cameras, camera: usize, name: &str) -> KnownMark {
    let court = Court::of("futsal", None).unwrap();
    let shape = court.line(name).unwrap().shape;
    let at = |share: f64| match shape {
        LineShape::Segment { from_m, to_m } => {
            let [x, y] = [0, 1].map(|axis| from_m[axis] + share * (to_m[axis] - from_m[axis]));
            [x, y, 0.0]
        }
        LineShape::Arc {
            centre_m,
            radius_m,
            from_rad,
            by_rad,
        } => {
            let turn = from_rad + share * by_rad;
            [
                centre_m[0] + radius_m * libm::cos(turn),
                centre_m[1] + radius_m * libm::sin(turn),
                0.0,
            ]
        }
    };
    let (camera_name, state) = &cameras[camera];
    let seen = (0..40).filter_map(|i| seen_px(state, at(f64::from(i) / 40.0)));
    KnownMark {
        name: name.to_owned(),
        known: Known::OnLine(shape),
        clicks: seen
            .step_by(4)
            .map(|px| (camera_name.clone(), px))
            .collect(),
    }
}

const CORNERS: [&str; 9] = [
    "corner_north_west",
    "corner_north_east",
    "corner_south_west",
    "corner_south_east",
    "penalty_spot_west",
    "penalty_spot_east",
    "halfway_north",
    "halfway_south",
    "centre",
];

/// Largest error of a camera, metres.
fn worst_m(found: &MarkFit, cameras: &Cameras, truth: &Cameras) -> f64 {
    let each = cameras.iter().zip(truth);
    each.map(|((_, a), (_, b))| (found.venue_from_found.apply(&a.center_w) - b.center_w).norm())
        .fold(0.0, f64::max)
}

fn fit(marks: &Marks, cameras: &Cameras) -> Result<MarkFit, String> {
    fit_marks(marks, &[], cameras, MarkFreedom::Similarity)
}

#[test]
fn clicked_marks_align_the_cameras_with_the_court() {
    let truth = venue();
    let cameras = moved(&truth, &elsewhere());
    let exact = fit(&court_marks(&truth, &CORNERS, 0.0, 1), &cameras).unwrap();
    assert!(worst_m(&exact, &cameras, &truth) < 1e-6);
    assert!(
        exact
            .residuals
            .iter()
            .all(|it| it.px.is_some_and(|px| px < 1e-4))
    );
    let noisy = fit(&court_marks(&truth, &CORNERS, 1.0, 1), &cameras).unwrap();
    let off_m = worst_m(&noisy, &cameras, &truth);
    println!(
        "nine marks clicked to 1 px: {off_m:.4} m, rest {:.4} m",
        noisy.rms_m
    );
    assert!(off_m < 0.03 && noisy.outliers().count() == 0);
}

#[test]
fn the_reported_uncertainty_matches_the_errors() {
    let truth = venue();
    let cameras = moved(&truth, &elsewhere());
    let mut ratios = Vec::new();
    for seed in 0..60 {
        let found = fit(&court_marks(&truth, &CORNERS, 1.0, seed), &cameras).unwrap();
        for at_m in [[0.0, 0.0, 0.0], [20.0, 10.0, 0.0], [-20.0, 0.0, 2.0]] {
            let before = elsewhere().apply(&Vector3::from(at_m));
            let off_m = (found.venue_from_found.apply(&before) - Vector3::from(at_m)).norm();
            ratios.push(off_m / found.sigma_m(at_m));
        }
    }
    let squares: f64 = ratios.iter().map(|r| r * r).sum::<f64>() / ratios.len() as f64;
    println!("error over sigma {:.2}", squares.sqrt());
    // Only clicks have errors here; the fit also assumes 5 mm for places.
    assert!(squares.sqrt() > 0.6 && squares.sqrt() < 1.2);
}

#[test]
fn a_mark_clicked_at_another_one_is_an_outlier() {
    let truth = venue();
    let cameras = moved(&truth, &elsewhere());
    let mut marks = court_marks(&truth, &CORNERS, 0.5, 4);
    let wrong = marks.known[4].clicks.clone();
    marks.known[5].clicks = wrong;
    let found = fit(&marks, &cameras).unwrap();
    assert!(found.outliers().all(|it| it.name == "penalty_spot_east"));
    assert!(found.outliers().count() >= 2);
    let worst = found.outliers().map(|it| it.m).fold(0.0, f64::max);
    assert!(worst > 10.0, "{worst}");
    assert!(worst_m(&found, &cameras, &truth) < 0.03);
}

#[test]
fn marks_are_refused_if_less_than_half_agree() {
    let truth = venue();
    let cameras = moved(&truth, &elsewhere());
    let mut marks = court_marks(&truth, &CORNERS, 0.5, 4);
    // Five of nine are wrong, each in another way.
    for (index, mark) in marks.known.iter_mut().enumerate().skip(4) {
        if let Known::Place(at_m) = &mut mark.known {
            at_m[0] += [3.0, -4.0, 6.0, -5.0, 2.0][index - 4];
            at_m[1] += [-5.0, 2.0, 3.0, -3.0, 6.0][index - 4];
        }
    }
    let message = fit(&marks, &cameras).unwrap_err();
    assert!(message.contains("contradict each other"), "{message}");
}

#[test]
fn one_wrong_click_in_one_camera_is_an_outlier() {
    let truth = venue();
    let cameras = moved(&truth, &elsewhere());
    let mut marks = court_marks(&truth, &CORNERS, 0.5, 5);
    marks.known[2].clicks[1].1[0] += 40.0;
    let camera = marks.known[2].clicks[1].0.clone();
    let found = fit(&marks, &cameras).unwrap();
    let named: Vec<_> = found
        .outliers()
        .map(|it| (it.name.clone(), it.camera.clone()))
        .collect();
    assert_eq!(named, [("corner_south_west".to_owned(), Some(camera))]);
}

#[test]
fn marks_seen_by_one_camera_each_are_enough() {
    let truth = venue();
    let cameras = moved(&truth, &elsewhere());
    let court = Court::of("futsal", None).unwrap();
    let names: Vec<&str> = court.marks.iter().map(|mark| mark.name.as_str()).collect();
    let mut marks = court_marks(&truth, &names, 0.0, 1);
    // No mark is in two cameras.
    for (index, mark) in marks.known.iter_mut().enumerate() {
        let own = if index % 2 == 0 { "c0" } else { "c3" };
        mark.clicks.retain(|(name, _)| name == own);
    }
    marks.known.retain(|mark| !mark.clicks.is_empty());
    let found = fit(&marks, &cameras).unwrap();
    assert!(worst_m(&found, &cameras, &truth) < 1e-4);
}

#[test]
fn lines_improve_a_fit_with_few_marks() {
    let truth = venue();
    let cameras = moved(&truth, &elsewhere());
    let few = ["halfway_north", "halfway_south", "penalty_spot_west"];
    let mut with_m = 0.0;
    let mut without_m = 0.0;
    for seed in 0..8 {
        let mut marks = court_marks(&truth, &few, 1.0, seed);
        without_m += worst_m(&fit(&marks, &cameras).unwrap(), &cameras, &truth);
        for camera in 0..6 {
            for line in [
                "touchline_north",
                "touchline_south",
                "goal_line_west",
                "goal_line_east",
                "centre_circle",
            ] {
                marks.known.push(on_line(&truth, camera, line));
            }
        }
        marks.known.retain(|mark| !mark.clicks.is_empty());
        with_m += worst_m(&fit(&marks, &cameras).unwrap(), &cameras, &truth);
    }
    println!(
        "three marks: {:.4} m, with lines {:.4} m",
        without_m / 8.0,
        with_m / 8.0
    );
    assert!(with_m < 0.5 * without_m);
}

#[test]
fn a_rigid_fit_keeps_the_scale() {
    let truth = venue();
    let turned = Similarity {
        scale: 1.0,
        ..elsewhere()
    };
    let cameras = moved(&truth, &turned);
    let marks = court_marks(&truth, &CORNERS, 1.0, 3);
    let found = fit_marks(&marks, &[], &cameras, MarkFreedom::Rigid).unwrap();
    assert!((found.venue_from_found.scale - 1.0).abs() < 1e-12);
    assert!(worst_m(&found, &cameras, &truth) < 0.03);
    assert!(found.covariance[(3, 3)].abs() < 1e-30);
}

#[test]
fn too_few_marks_or_marks_on_one_line_are_refused() {
    let truth = venue();
    let cameras = moved(&truth, &elsewhere());
    for names in [
        &["centre", "halfway_north"][..],
        &["centre", "penalty_spot_west", "penalty_spot_east"][..],
    ] {
        let error = fit(&court_marks(&truth, names, 0.5, 1), &cameras).unwrap_err();
        assert!(error.contains("not on one line"), "{error}");
    }
    let mut marks = court_marks(&truth, &CORNERS, 0.5, 1);
    marks.known[0].clicks[0].0 = "attic".to_owned();
    assert!(
        fit(&marks, &cameras)
            .unwrap_err()
            .contains("found camera `attic`")
    );
}

#[test]
fn a_wand_and_the_floor_give_scale_and_up_without_known_places() {
    let truth = venue();
    let cameras = moved(&truth, &elsewhere());
    let mut rng = ChaCha8Rng::seed_from_u64(8);
    let mut point = |name: String, at_m: [f64; 3]| ClickedPoint {
        name,
        clicks: clicks(&truth, at_m, 0.3, &mut rng),
    };
    let lengths = (0..6).map(|i| {
        let (x, y) = (2.5 * f64::from(i) - 6.0, f64::from(i) - 3.0);
        ClickedLength {
            ends: [
                point(format!("red_{i}"), [x, y, 1.0]),
                point(format!("blue_{i}"), [x + 0.6, y, 1.8]),
            ],
            length_m: 1.0,
        }
    });
    let lengths = lengths.collect();
    let floor = [[-5.0, 0.0], [5.0, 1.0], [0.0, 6.0], [2.0, -6.0]];
    let floor = floor
        .iter()
        .enumerate()
        .map(|(i, [x, y])| point(format!("dent_{i}"), [*x, *y, 0.0]))
        .collect();
    let anchors = Anchors {
        marks: Some(Marks {
            floor,
            lengths,
            ..no_marks()
        }),
        ..Anchors::default()
    };
    let found = anchors.align(&cameras).unwrap();
    assert!(found.has_scale && found.has_floor);
    let scale = found.venue_from_found.scale * elsewhere().scale;
    println!(
        "six wands of 1 m: scale off by {:.2} %",
        100.0 * (scale - 1.0)
    );
    assert!((scale - 1.0).abs() < 0.01);
    for ((_, a), (_, b)) in cameras.iter().zip(&truth) {
        let height_m = found.venue_from_found.apply(&a.center_w).z;
        assert!(
            (height_m - b.center_w.z).abs() < 0.1,
            "{height_m} {}",
            b.center_w.z
        );
    }
}

#[test]
fn marks_and_places_of_cameras_are_fitted_together() {
    let truth = venue();
    let cameras = moved(&truth, &elsewhere());
    let anchors = Anchors {
        centers_m: truth
            .iter()
            .take(2)
            .map(|(name, it)| (name.clone(), it.center_w.into()))
            .collect(),
        marks: Some(court_marks(&truth, &["centre"], 0.0, 1)),
        ..Anchors::default()
    };
    let found = anchors.align(&cameras).unwrap();
    let off = (found.venue_from_found.apply(&cameras[4].1.center_w) - truth[4].1.center_w).norm();
    assert!(off < 1e-6, "{off}");
    let fitted = anchors.fit_marks(&cameras).unwrap().unwrap();
    assert!(
        fitted
            .residuals
            .iter()
            .any(|it| it.name == "c0" && it.camera.is_none())
    );
}
