//! A hall in which two people walk about, seen by four cameras of which some are not what the venue says.

#![expect(clippy::cast_possible_wrap, reason = "a few hundred ticks")]

use farfield_proto::camera::CameraModel;
use farfield_proto::frames::Point;
use nalgebra::{Rotation3, Vector3};

use super::samples::{Burst, PassSample, SeenBody, SeenKeypoint, Trail};
use super::*;
use crate::body::fixture::{Noise, standing};
use crate::sightings::fixture::{hall, looking_at};

const RATE_HZ: f64 = 60.0;
const TICKS: usize = 120;

/// What is wrong with the pictures of a camera.
#[derive(Clone, Copy, Default)]
struct Mistake {
    late_ticks: i64,
    /// Ticks more in each burst than in the one before.
    later_each_burst: i64,
    /// The ticks of this burst alone are late.
    late_in_burst: Option<usize>,
    mirrored: bool,
    half_turned: bool,
    /// Per keypoint the one that is written in its place.
    order: Option<[usize; 17]>,
    /// Its focal length as a factor of the calibrated one; 0 is 1.
    focal_factor: f32,
    /// By what it was turned about its axes (right, down, ahead) since it was calibrated, degrees.
    turned_deg: [f64; 3],
    /// Which of the two people the camera shows alone.
    sees_only: Option<usize>,
}

/// The hall, what each camera shows (whose pictures, and what is wrong with them), and by how much all is scaled.
struct Hall {
    shows: [(usize, Mistake); 4],
    bursts: usize,
    scale: f64,
    /// Whether each camera looks at one half of the field only.
    narrow: bool,
    /// Whether nobody moves.
    still: bool,
}

impl Default for Hall {
    fn default() -> Self {
        Self {
            shows: std::array::from_fn(|camera| (camera, Mistake::default())),
            bursts: 2,
            scale: 1.0,
            narrow: false,
            still: false,
        }
    }
}

impl Hall {
    fn with(camera: usize, mistake: Mistake) -> Self {
        let mut hall = Self::default();
        hall.shows[camera].1 = mistake;
        hall
    }

    #[expect(
        clippy::too_many_lines,
        reason = "one hall, from its cameras to its report"
    )]
    fn report(&self) -> AgreementReport {
        let mut hall = hall();
        if self.narrow {
            hall.cameras = narrow_cameras();
        }
        let mut noise = Noise(5);
        let keypoints = KeypointSet::coco17();
        let shape = [
            standing(0.0, 0.0, 1.7, &mut noise),
            standing(0.0, 0.0, 1.85, &mut noise),
        ];
        let judged = hall
            .cameras
            .iter()
            .enumerate()
            .map(|(i, (viewpoint, model))| JudgedCamera {
                name: format!("cam{i}"),
                viewpoint: *viewpoint,
                size_px: model.size_px(),
                lines: SightLines::of(model),
            });
        let cameras = AgreementCameras {
            all: judged.collect(),
            partners: partners(&keypoints),
            rate_hz: RATE_HZ,
            models: hall.cameras.clone(),
            keypoints: keypoints.clone(),
            field: Field {
                min_m: [-4.0, -3.0, -0.3],
                max_m: [4.0, 3.0, 2.6],
                floor_m: 0.0,
            },
            births: BirthParameters::default(),
        };
        let partners = cameras.partners.clone();
        let mut samples = Samples::new(RATE_HZ, 4);
        let mut see = |camera: usize, person: usize, (burst, tick): (usize, usize)| -> SeenBody {
            let (whose, mistake) = self.shows[camera];
            let in_burst = mistake.late_in_burst.is_none_or(|of| of == burst);
            let late =
                mistake.late_ticks * i64::from(in_burst) + mistake.later_each_burst * burst as i64;
            if mistake.sees_only.is_some_and(|only| only != person) {
                return vec![None; 17];
            }
            let at = (burst * 600 + tick) as f64 - late as f64;
            let at = if self.still { 0.0 } else { at };
            let body = walking(&shape[person], person, at / RATE_HZ, self.scale);
            let seen: SeenBody = body
                .iter()
                .map(|p| pixel(&hall.cameras[whose].1, p, &mut noise))
                .collect();
            changed(&seen, mistake, &partners)
        };
        for burst in 0..self.bursts {
            for tick in [0, 30, 60, 90] {
                let bodies = |camera| {
                    (0..2)
                        .map(|person| see(camera, person, (burst, tick)))
                        .collect()
                };
                samples.passes.push_back(Arc::new(PassSample {
                    tick: Tick((burst * 600 + tick) as i64),
                    of_camera: (0..4).map(bodies).collect(),
                }));
            }
            let trails = (0..4).flat_map(|camera| (0..2).map(move |person| (camera, person)));
            let trails = trails.map(|(camera, person)| {
                let bodies: Vec<SeenBody> = (0..TICKS)
                    .map(|tick| see(camera, person, (burst, tick)))
                    .collect();
                Trail::of(person as u32, camera, &bodies)
            });
            let trails = trails.collect();
            samples.bursts.push_back(Arc::new(Burst {
                first: Tick(burst as i64 * 600),
                trails,
            }));
        }
        AgreementSamples {
            cameras: Arc::new(cameras),
            samples,
            statures_m: vec![1.75 * self.scale; 20],
        }
        .report()
    }

    /// The causes that are named, each with its cameras.
    fn causes(&self) -> Vec<(Vec<String>, DisagreementCause)> {
        let disagreements = self.report().disagreements.into_iter();
        disagreements.map(|d| (d.cameras, d.cause)).collect()
    }
}

/// Four cameras beside the field, of which two see the half of one person, and two that of the other.
fn narrow_cameras() -> Vec<(ViewpointIndex, CameraModel)> {
    let places = [[-9.0, -2.8], [9.0, -2.2], [-9.0, 2.2], [9.0, 2.8]];
    let camera = |(index, [x, y]): (usize, [f64; 2])| {
        let aim_m = [0.0, if y < 0.0 { -1.4 } else { 1.4 }, 0.9];
        let model = looking_at(&format!("narrow-{index}"), [x, y, 2.5], aim_m, 6000.0);
        (ViewpointIndex(index as u16), model)
    };
    places.into_iter().enumerate().map(camera).collect()
}

/// A body that walks to and fro with swinging limbs.
fn walking(shape: &[Vector3<f64>], person: usize, at_s: f64, scale: f64) -> Vec<Vector3<f64>> {
    let side = if person == 0 { 1.0 } else { -1.0 };
    let place = Vector3::new(side * (1.5 * libm::sin(0.9 * at_s)), side * 1.2, 0.0);
    let swing = |k: usize| {
        let phase = if k.is_multiple_of(2) { 0.0 } else { 3.0 };
        let reach = if k >= 7 { 0.25 } else { 0.02 };
        Vector3::new(reach * libm::sin(6.0 * at_s + phase), 0.0, 0.0)
    };
    let moved = shape.iter().enumerate();
    moved.map(|(k, p)| scale * (p + place + swing(k))).collect()
}

fn pixel(model: &CameraModel, p: &Vector3<f64>, noise: &mut Noise) -> Option<SeenKeypoint> {
    let pixel = model.project(Point::new((*p).into()))?;
    let off = [noise.normal() * 2.0, noise.normal() * 2.0];
    Some(SeenKeypoint {
        pixel: [(pixel.x() + off[0]) as f32, (pixel.y() + off[1]) as f32],
        score: 0.8,
    })
}

fn changed(seen: &SeenBody, mistake: Mistake, partners: &Partners) -> SeenBody {
    let of = |k: usize| {
        let from = if mistake.mirrored { partners[k] } else { k };
        let from = mistake.order.map_or(from, |order| order[from]);
        let mut keypoint = seen[from]?;
        if mistake.focal_factor > 0.0 {
            let middle = [959.5, 599.5];
            for (pixel, middle) in keypoint.pixel.iter_mut().zip(middle) {
                *pixel = middle + mistake.focal_factor * (*pixel - middle);
            }
        }
        if mistake.turned_deg.iter().any(|deg| deg.abs() > 0.0) {
            keypoint.pixel = turned(keypoint.pixel, mistake.turned_deg);
        }
        if mistake.mirrored != mistake.half_turned {
            keypoint.pixel[0] = 1919.0 - keypoint.pixel[0];
        }
        if mistake.half_turned {
            keypoint.pixel[1] = 1199.0 - keypoint.pixel[1];
        }
        Some(keypoint)
    };
    (0..seen.len()).map(of).collect()
}

/// Where a camera of the hall shows what it showed at `pixel` before it was turned.
fn turned(pixel: [f32; 2], by_deg: [f64; 3]) -> [f32; 2] {
    let [x, y] = pixel.map(f64::from);
    let ray = Vector3::new(x - 959.5, y - 599.5, 1000.0);
    let turn = Rotation3::from_scaled_axis(Vector3::from(by_deg.map(f64::to_radians)));
    let ray = turn.inverse() * ray;
    [
        (959.5 + 1000.0 * ray.x / ray.z) as f32,
        (599.5 + 1000.0 * ray.y / ray.z) as f32,
    ]
}

fn names(cameras: &[usize]) -> Vec<String> {
    cameras
        .iter()
        .map(|camera| format!("cam{camera}"))
        .collect()
}

#[test]
fn cameras_that_are_what_the_venue_says_agree() {
    let report = Hall::default().report();
    assert_eq!(report.disagreements, []);
    for (name, camera) in &report.cameras {
        assert_eq!(camera.verdict, AgreementVerdict::Agrees, "{name}");
        assert!(camera.distance_mm.unwrap() < 30.0, "{name} {camera:?}");
        assert!(camera.late_ticks.unwrap().abs() < 0.2, "{name} {camera:?}");
    }
}

#[test]
fn every_swapped_pair_is_named() {
    for a in 0..4 {
        for b in a + 1..4 {
            let mut hall = Hall::default();
            hall.shows.swap(a, b);
            let causes = hall.causes();
            match causes.as_slice() {
                // Of cameras that stand opposite each other either pair may be the swapped one.
                [(cameras, DisagreementCause::Swapped)] => {
                    let both = names(&[a, b]);
                    assert!(
                        cameras.chunks(2).any(|pair| pair == both),
                        "{a} {b}: {cameras:?}"
                    );
                    assert!(cameras.len() == 2 || b == a + 2, "{a} {b}: {cameras:?}");
                }
                other => panic!("cameras {a} and {b}: {other:?}"),
            }
        }
    }
}

#[test]
fn a_mirror_a_half_turn_and_a_borrowed_picture_are_named() {
    let mirrored = Mistake {
        mirrored: true,
        ..Mistake::default()
    };
    let expected = (names(&[1]), DisagreementCause::Mirrored);
    assert_eq!(Hall::with(1, mirrored).causes(), [expected]);
    let half_turned = Mistake {
        half_turned: true,
        ..Mistake::default()
    };
    let expected = (names(&[2]), DisagreementCause::HalfTurned);
    assert_eq!(Hall::with(2, half_turned).causes(), [expected]);
    let mut hall = Hall::default();
    hall.shows[3].0 = 0;
    let causes = hall.causes();
    assert_eq!(causes.len(), 1, "{causes:?}");
    assert_eq!(causes[0].1, DisagreementCause::SamePictures);
}

#[test]
fn keypoints_in_another_order_are_named() {
    let sides = [0, 2, 1, 4, 3, 6, 5, 8, 7, 10, 9, 12, 11, 14, 13, 16, 15];
    // From the ankles up, as in MPII and what came of it.
    let upwards = std::array::from_fn(|k| 16 - k);
    // By limbs, as OpenPose writes them.
    let by_limbs = [0, 5, 6, 8, 10, 7, 9, 12, 14, 16, 11, 13, 15, 2, 1, 4, 3];
    for (order, is_of_sides) in [(sides, true), (upwards, false), (by_limbs, false)] {
        let mistake = Mistake {
            order: Some(order),
            ..Mistake::default()
        };
        match Hall::with(2, mistake).causes().as_slice() {
            [(cameras, DisagreementCause::KeypointOrder { moved, sides })] => {
                assert_eq!(*cameras, names(&[2]));
                assert_eq!(*sides, is_of_sides, "{order:?}");
                assert!(*moved >= 8, "{order:?}: {moved}");
            }
            other => panic!("{order:?}: {other:?}"),
        }
    }
}

#[test]
fn another_focal_length_is_told_by_its_factor() {
    for focal_factor in [0.8, 0.92, 1.08] {
        let mistake = Mistake {
            focal_factor,
            ..Mistake::default()
        };
        match Hall::with(1, mistake).causes().as_slice() {
            [(cameras, DisagreementCause::FocalLength { factor })] => {
                assert_eq!(*cameras, names(&[1]));
                assert!((factor - f64::from(focal_factor)).abs() < 0.02, "{factor}");
            }
            other => panic!("{focal_factor}: {other:?}"),
        }
    }
}

#[test]
fn a_turn_of_two_degrees_is_told_to_either_side_and_one_of_five_about_any_axis() {
    for turned_deg in [
        [2.0, 0.0, 0.0],
        [0.0, 2.0, 0.0],
        [0.0, -2.0, 0.0],
        [0.0, 0.0, 5.0],
    ] {
        let mistake = Mistake {
            turned_deg,
            ..Mistake::default()
        };
        for camera in 0..4 {
            match Hall::with(camera, mistake).causes().as_slice() {
                [(cameras, DisagreementCause::Turned { degrees })] => {
                    assert_eq!(*cameras, names(&[camera]), "{turned_deg:?}");
                    let expected = turned_deg.iter().map(|d| d.abs()).sum::<f64>();
                    assert!(
                        (degrees - expected).abs() < 0.3,
                        "{turned_deg:?}: {degrees}"
                    );
                }
                other => panic!("camera {camera} by {turned_deg:?}: {other:?}"),
            }
        }
    }
}

#[test]
fn a_camera_that_is_late_or_early_is_told_by_how_much_to_a_fifth_of_a_tick() {
    for late_ticks in [1, 3, 30, -3, -45] {
        let mistake = Mistake {
            late_ticks,
            ..Mistake::default()
        };
        let causes = Hall::with(2, mistake).causes();
        match causes.as_slice() {
            [(cameras, DisagreementCause::Late { ticks })] => {
                assert_eq!(*cameras, names(&[2]));
                assert!(
                    (ticks - late_ticks as f64).abs() < 0.2,
                    "{ticks}, not {late_ticks}"
                );
            }
            other => panic!("{late_ticks}: {other:?}"),
        }
    }
}

#[test]
fn a_camera_at_another_rate_drifts() {
    let mistake = Mistake {
        later_each_burst: 2,
        ..Mistake::default()
    };
    let hall = Hall {
        bursts: 3,
        ..Hall::with(1, mistake)
    };
    match hall.causes().as_slice() {
        // Two ticks in ten seconds.
        [(cameras, DisagreementCause::Drifts { ticks_per_minute })] => {
            assert_eq!(*cameras, names(&[1]));
            assert!((ticks_per_minute - 12.0).abs() < 2.0, "{ticks_per_minute}");
        }
        other => panic!("{other:?}"),
    }
}

#[test]
fn people_of_half_their_size_tell_of_the_unit_of_the_calibration() {
    let hall = Hall {
        scale: 0.55,
        ..Hall::default()
    };
    let report = hall.report();
    match report.disagreements.as_slice() {
        [
            Disagreement {
                cause: DisagreementCause::WorldScale { stature_m },
                found,
                ..
            },
        ] => {
            assert!((stature_m - 0.96).abs() < 0.01);
            assert!(found.contains("0.96 m tall"), "{found}");
        }
        other => panic!("{other:?}"),
    }
}

#[test]
fn three_cameras_in_a_ring_of_wrong_names_are_told_of() {
    let hall = Hall {
        shows: [0, 2, 3, 1].map(|camera| (camera, Mistake::default())),
        ..Hall::default()
    };
    let causes = hall.causes().into_iter();
    let blamed: BTreeSet<String> = causes.flat_map(|(names, _)| names).collect();
    let ring: BTreeSet<String> = names(&[1, 2, 3]).into_iter().collect();
    assert!(blamed.is_superset(&ring), "{blamed:?}");
}

#[test]
fn cameras_that_look_at_different_people_do_not_disagree() {
    let mut hall = Hall {
        narrow: true,
        ..Hall::default()
    };
    for (camera, (_, mistake)) in hall.shows.iter_mut().enumerate() {
        mistake.sees_only = Some(1 - camera / 2);
    }
    assert_eq!(hall.report().disagreements, []);
}

#[test]
fn a_clock_that_was_set_right_does_not_drift() {
    let mistake = Mistake {
        late_ticks: 2,
        late_in_burst: Some(0),
        ..Mistake::default()
    };
    let hall = Hall {
        bursts: 4,
        ..Hall::with(1, mistake)
    };
    for (_, cause) in hall.causes() {
        assert!(
            !matches!(cause, DisagreementCause::Drifts { .. }),
            "{cause:?}"
        );
    }
}

#[test]
fn nothing_is_said_of_the_time_of_people_who_stand() {
    let hall = Hall {
        still: true,
        ..Hall::default()
    };
    let report = hall.report();
    assert_eq!(report.disagreements, []);
    assert!(
        report
            .cameras
            .values()
            .all(|camera| camera.late_ticks.is_none())
    );
}
