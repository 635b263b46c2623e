//! Walking people, poses of them with realistic noise, and truths that are correct or wrong by one number.

use std::collections::BTreeMap;
use std::ops::Range;

use farfield_proto::tick::Tick;
use nalgebra::Vector3;

use super::*;
use crate::points::{PointSet, ScoredBody};
use crate::score;

/// Height, half the width, and swing of each part of the body: shoulders, elbows, wrists, hips, knees, ankles; metres.
const BODY_M: [[f64; 3]; 6] = [
    [1.40, 0.20, 0.00],
    [1.15, 0.25, -0.12],
    [0.95, 0.25, -0.25],
    [0.90, 0.10, 0.00],
    [0.48, 0.10, 0.20],
    [0.08, 0.10, 0.40],
];

/// Standard deviation per axis of poses that are 13 mm off on average, metres.
const GOOD_SIGMA_M: f64 = 0.008;

/// Pseudo-random numbers that are the same on every run.
struct Noise(u64);

impl Noise {
    /// Uniform in 0..1 (splitmix64).
    fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Nearly normal in each axis.
    fn vector(&mut self, sigma_m: f64) -> Vector3<f64> {
        let mut normal = || (0..12).map(|_| self.uniform()).sum::<f64>() - 6.0;
        Vector3::new(normal(), normal(), normal()) * sigma_m
    }

    fn on(&mut self, body: &ScoredBody, sigma_m: f64) -> ScoredBody {
        moved(body, |at_m| at_m + self.vector(sigma_m))
    }
}

fn moved(body: &ScoredBody, mut to: impl FnMut(Vector3<f64>) -> Vector3<f64>) -> ScoredBody {
    let mut body = body.clone();
    for point in body.points_m.iter_mut().flatten() {
        *point = to(*point);
    }
    body
}

/// A person who walks along a circle, 40 mm a tick, swinging arms and legs.
fn walker(tick: i64, person: u32) -> ScoredBody {
    let (t, n) = (tick as f64, f64::from(person));
    let radius_m = 1.0 + 0.6 * n;
    let (sin, cos) = (0.04 * t / radius_m + 2.0 * n).sin_cos();
    let out = Vector3::new(cos, sin, 0.0);
    let (forward, left) = (Vector3::new(-sin, cos, 0.0), -out);
    let at_m = Vector3::new(1.0 + 1.5 * n, 0.5 - n, 0.0) + radius_m * out;
    let stride = (0.2 * t + n).sin();
    let mut body = ScoredBody::default();
    for (part, [height_m, width_m, swing_m]) in BODY_M.into_iter().enumerate() {
        for (side, sign) in [1.0, -1.0].into_iter().enumerate() {
            let from_m = width_m * sign * left + swing_m * stride * sign * forward;
            let point_m = at_m + from_m + Vector3::new(0.0, 0.0, height_m);
            body.points_m[2 * part + side] = Some(point_m);
        }
    }
    body
}

fn standing(_tick: i64, person: u32) -> ScoredBody {
    walker(7, person)
}

type Body = fn(i64, u32) -> ScoredBody;
const BODIES: [Body; 2] = [walker, standing];

fn lines(
    ticks: Range<i64>,
    people: Range<u32>,
    mut body: impl FnMut(i64, u32) -> ScoredBody,
) -> PoseLines {
    let mut all = BTreeMap::new();
    for tick in ticks {
        let bodies = people.clone().map(|person| (person, body(tick, person)));
        all.insert(Tick(tick), bodies.collect());
    }
    PoseLines::from_people(PointSet::Joints, all)
}

/// Poses of `people` walkers over 100 ticks, with ids from 11.
fn poses(people: u32, sigma_m: f64) -> PoseLines {
    let mut noise = Noise(3);
    lines(0..100, 11..11 + people, |tick, person| {
        noise.on(&walker(tick, person - 11), sigma_m)
    })
}

fn truth(people: u32, body: impl FnMut(i64, u32) -> ScoredBody) -> PoseLines {
    lines(0..100, 0..people, body)
}

fn warned(poses: &PoseLines, truth: &PoseLines, extent: TruthExtent) -> Vec<TruthWarning> {
    truth_warnings(poses, truth, &score(poses, truth, extent, Some(30.0)))
}

/// Checks that a truth declared whole causes no warning.
fn check_silent(poses: &PoseLines, truth: &PoseLines) {
    let warnings = warned(poses, truth, TruthExtent::Whole);
    assert!(warnings.is_empty(), "{warnings:?}");
}

/// Checks that good poses of one and of three people cause this warning only.
fn check(cause: TruthWarningCause, words: &str, body: impl Fn(i64, u32) -> ScoredBody) {
    for people in [1, 3] {
        let warnings = warned(
            &poses(people, GOOD_SIGMA_M),
            &truth(people, &body),
            TruthExtent::Whole,
        );
        let [warning] = warnings.as_slice() else {
            panic!("{people} people: {warnings:?}");
        };
        assert_eq!(warning.cause, cause, "{people} people: {warning:?}");
        let message = &warning.message;
        let words = format!("the truth seems {words};");
        assert!(message.contains(&words), "{people} people: {message}");
        // The noise remains: 10 to 19 mm.
        assert!(
            message.contains("joints are 1"),
            "{people} people: {message}"
        );
    }
}

#[test]
fn a_correct_truth_causes_no_warning_with_bad_poses() {
    // 13 to 40 mm off on average.
    for sigma_m in [0.008, 0.013, 0.019, 0.025] {
        for (people, body) in [1_u32, 3]
            .into_iter()
            .flat_map(|n| BODIES.map(|body| (n, body)))
        {
            let mut noise = Noise(u64::from(people));
            let truth = truth(people, body);
            let poses = lines(0..100, 0..people, |tick, person| {
                noise.on(&body(tick, person), sigma_m)
            });
            check_silent(&poses, &truth);
            // Good scores skip the search; here it runs.
            assert_eq!(misread(&poses, &truth, None), None);
        }
    }
}

#[test]
fn a_constant_bias_of_joints_is_no_other_reading() {
    for body in BODIES {
        let mut noise = Noise(5);
        let biases: Vec<Vector3<f64>> = (0..24).map(|_| noise.vector(0.025)).collect();
        let poses = lines(0..100, 0..2, |tick, person| {
            let mut bias = biases[12 * person as usize..].iter();
            moved(&body(tick, person), |at_m| {
                at_m + bias.next().unwrap() + noise.vector(0.004)
            })
        });
        let truth = truth(2, body);
        check_silent(&poses, &truth);
    }
}

/// The body with only the points in these slots.
fn only(body: &ScoredBody, slots: &[usize]) -> ScoredBody {
    let mut body = body.clone();
    for (slot, point) in body.points_m.iter_mut().enumerate() {
        *point = point.filter(|_| slots.contains(&slot));
    }
    body
}

#[test]
fn few_points_determine_a_tick_shift_but_no_place() {
    for hips in [&[6][..], &[6, 7][..]] {
        let mut noise = Noise(13);
        let bias_m = Vector3::new(0.06, 0.02, -0.03);
        let biased = lines(0..100, 0..2, |tick, person| {
            moved(&walker(tick, person), |at_m| {
                at_m + bias_m + noise.vector(0.004)
            })
        });
        let truth = truth(2, |tick, person| only(&walker(tick, person), hips));
        check_silent(&biased, &truth);
        let good = lines(0..100, 0..2, |tick, person| {
            noise.on(&walker(tick, person), GOOD_SIGMA_M)
        });
        let late = lines(0..100, 0..2, |tick, person| {
            only(&walker(tick - 5, person), hips)
        });
        let warning = misread(&good, &late, Some(200.0)).unwrap();
        assert_eq!(warning.cause, TruthWarningCause::OtherTicks);
        assert!(
            warning.message.contains("to be 5 ticks later"),
            "{warning:?}"
        );
    }
}

#[test]
fn missing_poses_and_false_poses_are_no_other_reading() {
    // The poses lack one of three people, add a ghost, and exchange the sides at every tenth tick.
    let mut noise = Noise(9);
    let poses = lines(0..100, 1..4, |tick, person| {
        let body = if person == 3 {
            moved(&standing(tick, 0), |at_m| {
                at_m + Vector3::new(4.0, 4.0, 0.0)
            })
        } else {
            walker(tick, person)
        };
        let body = noise.on(&body, 0.02);
        if tick % 10 == 0 {
            exchanged(&body)
        } else {
            body
        }
    });
    let truth = truth(3, walker);
    check_silent(&poses, &truth);
}

#[test]
fn a_truth_at_other_ticks_is_reported_with_the_shift() {
    let late = TruthWarningCause::OtherTicks;
    check(late, "to be 5 ticks later", |tick, person| {
        walker(tick - 5, person)
    });
    check(late, "to be 1 tick later", |tick, person| {
        walker(tick - 1, person)
    });
    check(late, "to be 3 ticks earlier", |tick, person| {
        walker(tick + 3, person)
    });
}

#[test]
fn a_truth_at_another_rate_is_reported() {
    let rate = TruthWarningCause::OtherTicks;
    let words = "to count one tick where the poses count two";
    check(rate, words, |tick, person| walker(2 * tick, person));
    // Here the truth has a tick between two ticks of the poses.
    let body = |tick: i64, person| walker(tick.div_euclid(2), person);
    let words = "to count two ticks where the poses count one";
    check(rate, words, body);
}

fn exchanged(body: &ScoredBody) -> ScoredBody {
    let mut exchanged = body.clone();
    for pair in exchanged.points_m.chunks_exact_mut(2) {
        pair.swap(0, 1);
    }
    exchanged
}

#[test]
fn exchanged_sides_are_reported() {
    check(
        TruthWarningCause::SidesExchanged,
        "to have left and right exchanged",
        |tick, person| exchanged(&walker(tick, person)),
    );
}

#[test]
fn exchanged_parts_are_reported_by_name() {
    for (one, other, words) in [
        (4, 5, "to have knees and ankles exchanged"),
        (0, 3, "to have shoulders and hips exchanged"),
        (1, 2, "to have elbows and wrists exchanged"),
    ] {
        check(TruthWarningCause::PartsExchanged, words, |tick, person| {
            let mut body = walker(tick, person);
            for side in 0..2 {
                body.points_m.swap(2 * one + side, 2 * other + side);
            }
            body
        });
    }
}

/// Checks the warning about a truth whose points are mapped by `to`.
fn check_place(cause: TruthWarningCause, words: &str, to: impl Fn(Vector3<f64>) -> Vector3<f64>) {
    check(cause, words, |tick, person| {
        moved(&walker(tick, person), &to)
    });
}

#[test]
fn a_truth_in_other_coordinates_is_reported_with_the_transform() {
    let elsewhere = TruthWarningCause::OtherCoordinates;
    let shift_m = Vector3::new(0.2, 0.0, 0.0);
    check_place(elsewhere, "to be shifted by (0.20, 0.00, 0.00) m", |at_m| {
        at_m + shift_m
    });
    check_place(elsewhere, "to be scaled by 0.90", |at_m| 0.9 * at_m);
    check_place(elsewhere, "to be in millimetres", |at_m| 1000.0 * at_m);
    check_place(elsewhere, "to be turned by 90 degrees about z", |at_m| {
        Vector3::new(-at_m.y, at_m.x, at_m.z)
    });
    check_place(
        elsewhere,
        "to be in other axes (its x, y, z are the poses' y, z, x)",
        |at_m| Vector3::new(at_m.y, at_m.z, at_m.x),
    );
    check_place(
        elsewhere,
        "to be turned by 90 degrees about z and shifted by (3.00, -2.00, 0.00) m",
        |at_m| Vector3::new(3.0 - at_m.y, at_m.x - 2.0, at_m.z),
    );
}

#[test]
fn a_mirrored_truth_is_reported_with_the_axis() {
    check_place(
        TruthWarningCause::Mirrored,
        "to be mirrored along y",
        |at_m| Vector3::new(at_m.x, -at_m.y, at_m.z),
    );
}

#[test]
fn both_equivalent_readings_are_reported() {
    let gliding = |tick: i64| {
        let gone = Vector3::new(0.05 * tick as f64, 0.0, 0.0);
        moved(&standing(0, 0), |at_m| at_m + gone)
    };
    let poses = lines(0..100, 0..1, |tick, _| gliding(tick));
    let late = lines(0..100, 0..1, |tick, _| gliding(tick - 4));
    let warning = misread(&poses, &late, Some(200.0)).unwrap();
    for words in [
        "to be 4 ticks later",
        "to be shifted by (-0.20, 0.00, 0.00) m",
        ", or to be ",
        "0 mm off on average instead of 200",
    ] {
        assert!(warning.message.contains(words), "{}", warning.message);
    }
}

#[test]
fn a_few_ticks_cause_no_warning() {
    let misread_in = |ticks: Range<i64>| {
        let poses = lines(ticks.clone(), 0..1, walker);
        let shifted = lines(ticks, 0..1, |tick, person| {
            moved(&walker(tick, person), |at_m| at_m.add_scalar(0.2))
        });
        misread(&poses, &shifted, None)
    };
    assert_eq!(misread_in(0..4), None);
    assert!(misread_in(0..12).is_some());
}

#[test]
fn coordinates_out_of_range_cause_no_warning() {
    let far = lines(0..100, 0..1, |tick, person| {
        moved(&walker(tick, person), |at_m| at_m * 1e300)
    });
    let poses = poses(1, GOOD_SIGMA_M);
    assert_eq!(misread(&poses, &far, None), None);
    assert_eq!(misread(&far, &poses, None), None);
}

#[test]
fn an_incomplete_truth_is_reported_unless_declared_partial() {
    let poses = poses(3, GOOD_SIGMA_M);
    let mut every_third = BTreeMap::new();
    let whole = truth(3, walker);
    for tick in whole.ticks().step_by(3) {
        every_third.insert(tick, whole.people_at(tick).unwrap().clone());
    }
    let every_third = PoseLines::from_people(PointSet::Joints, every_third);
    let one_of_three = truth(1, walker);
    for (truth, words) in [
        (&every_third, "has people at 34 ticks, the poses at 100"),
        (
            &one_of_three,
            "has 1.0 people on average where the poses have 3.0",
        ),
    ] {
        let warnings = warned(&poses, truth, TruthExtent::Whole);
        assert_eq!(warnings.len(), 1, "{warnings:?}");
        assert_eq!(warnings[0].cause, TruthWarningCause::AnnotatedInPart);
        let message = &warnings[0].message;
        assert!(message.contains(words), "{message}");
        assert!(message.contains("`--truth partial`"), "{message}");
        assert!(warned(&poses, truth, TruthExtent::Partial).is_empty());
    }
}

#[test]
fn absent_people_and_false_poses_do_not_make_a_truth_incomplete() {
    let (mut truth, mut poses) = (BTreeMap::new(), BTreeMap::new());
    for tick in 0..100 {
        let is_there = |person: &u32| *person == 0 || !(40..70).contains(&tick);
        let bodies = (0..2).filter(is_there);
        let mut bodies: BTreeMap<u32, ScoredBody> = bodies
            .map(|person| (person, walker(tick, person)))
            .collect();
        truth.insert(Tick(tick), bodies.clone());
        if tick % 3 == 0 {
            bodies.insert(9, moved(&standing(0, 0), |at_m| at_m.add_scalar(5.0)));
        }
        poses.insert(Tick(tick), bodies);
    }
    let [truth, poses] = [truth, poses].map(|it| PoseLines::from_people(PointSet::Joints, it));
    check_silent(&poses, &truth);
}

fn tick_warning(truth: &PoseLines) -> String {
    let warnings = warned(&poses(2, GOOD_SIGMA_M), truth, TruthExtent::Whole);
    let is_of_ticks = |warning: &&TruthWarning| warning.cause == TruthWarningCause::OtherTicks;
    let warning = warnings.iter().find(is_of_ticks);
    warning.map_or_else(String::new, |warning| warning.message.clone())
}

#[test]
fn a_truth_that_lost_frames_half_way_is_reported_with_the_half() {
    let lost = truth(2, |tick, person| {
        walker(tick + if tick < 50 { 0 } else { 6 }, person)
    });
    let message = tick_warning(&lost);
    assert!(
        message.contains("6 ticks earlier at ticks 50 to 99"),
        "{message}"
    );
    assert!(!message.contains("0 to 49"), "{message}");
}

#[test]
fn a_truth_at_a_slightly_different_rate_is_reported_by_half() {
    let slow = truth(2, |tick, person| {
        walker((1.06 * tick as f64).round() as i64, person)
    });
    let message = tick_warning(&slow);
    assert!(message.contains("at ticks 50 to 99"), "{message}");
}

#[test]
fn poses_that_freeze_for_half_the_time_cause_no_warning() {
    let mut noise = Noise(3);
    let stuck = lines(0..100, 11..13, |tick, person| {
        noise.on(&walker(tick.min(50), person - 11), GOOD_SIGMA_M)
    });
    check_silent(&stuck, &truth(2, walker));
}

#[test]
fn a_truth_many_ticks_late_is_reported_with_the_shift() {
    for (late, words) in [
        (30, "to be 30 ticks later"),
        (-42, "to be 42 ticks earlier"),
        (11, "to be 11 ticks later"),
    ] {
        check(TruthWarningCause::OtherTicks, words, |tick, person| {
            walker(tick - late, person)
        });
    }
    // A longer file has enough ticks for a larger shift.
    let (late, mut noise) = (110, Noise(3));
    let poses = lines(0..300, 11..13, |tick, person| {
        noise.on(&walker(tick, person - 11), GOOD_SIGMA_M)
    });
    let truth = lines(0..300, 0..2, |tick, person| walker(tick - late, person));
    let message = misread(&poses, &truth, Some(400.0)).unwrap().message;
    assert!(message.contains("to be 110 ticks later"), "{message}");
}

/// A person on a treadmill: a step takes 31 ticks, and only the limbs move.
fn on_a_treadmill(tick: i64, _person: u32) -> ScoredBody {
    let stride = 0.3 * (std::f64::consts::TAU * tick as f64 / 31.0).sin();
    let mut body = standing(0, 0);
    for (slot, point) in body.points_m.iter_mut().enumerate() {
        let side = if slot % 2 == 0 { stride } else { -stride };
        *point = point.map(|at_m| at_m + Vector3::new(side, 0.0, 0.0));
    }
    body
}

#[test]
fn the_smallest_shift_is_reported_for_periodic_motion() {
    for late in [5, 36, -26] {
        let truth = truth(1, |tick, person| on_a_treadmill(tick - late, person));
        let mut noise = Noise(3);
        let poses = lines(0..100, 0..1, |tick, person| {
            noise.on(&on_a_treadmill(tick, person), GOOD_SIGMA_M)
        });
        let message = misread(&poses, &truth, Some(200.0)).unwrap().message;
        assert!(message.contains("to be 5 ticks later;"), "{message}");
    }
}

#[test]
fn poses_that_are_bad_for_a_while_cause_no_warning() {
    // The people stand for the first 60 ticks and then jump on the spot. The poses are bad in one part of that time.
    let jumping = |tick: i64, person: u32| {
        let up_m = if tick < 60 {
            0.0
        } else {
            0.4 * (0.3 * tick as f64).sin().abs()
        };
        moved(&standing(0, person), |at_m| {
            at_m + Vector3::new(0.0, 0.0, up_m)
        })
    };
    let correct = truth(2, jumping);
    for bad in [0..30, 20..60, 60..100] {
        let mut noise = Noise(7);
        let poses = lines(0..100, 0..2, |tick, person| {
            let aside_m = if bad.contains(&tick) { 0.4 } else { 0.0 };
            let body = moved(&jumping(tick, person), |at_m| {
                at_m + Vector3::new(aside_m, 0.0, 0.0)
            });
            noise.on(&body, 0.02)
        });
        check_silent(&poses, &correct);
        assert_eq!(misread(&poses, &correct, None), None, "{bad:?}");
    }
}

#[test]
fn a_person_who_follows_another_on_the_same_path_causes_no_warning() {
    // The second is thirty ticks behind the first. The poses contain both, one of the two, or exchange them.
    let queue = |tick: i64, person: u32| walker(tick - 30 * i64::from(person), 0);
    let correct = truth(2, queue);
    for people in [0..2, 0..1, 1..2] {
        for sigma_m in [0.02, 0.03] {
            let mut noise = Noise(11);
            let poses = lines(0..100, people.clone(), |tick, person| {
                noise.on(&queue(tick, person), sigma_m)
            });
            check_silent(&poses, &correct);
            assert_eq!(misread(&poses, &correct, None), None);
        }
    }
}
