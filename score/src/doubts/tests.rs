//! People who walk about, poses of them with the noise that poses have, and truths that are right or that one number would mend.

mod in_part;
mod many_ticks;

use std::collections::BTreeMap;
use std::ops::Range;

use farfield_proto::tick::Tick;
use nalgebra::Vector3;

use super::*;
use crate::points::{PointSet, ScoredBody};
use crate::score;

/// Height, half the width, and swing of shoulders, elbows, wrists, hips, knees and ankles, metres.
const BODY_M: [[f64; 3]; 6] = [
    [1.40, 0.20, 0.00],
    [1.15, 0.25, -0.12],
    [0.95, 0.25, -0.25],
    [0.90, 0.10, 0.00],
    [0.48, 0.10, 0.20],
    [0.08, 0.10, 0.40],
];

/// One sigma per axis of poses that are 13 mm off on average.
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

/// Poses of `people` walkers over 100 ticks, who are called 11 and so on.
fn poses(people: u32, sigma_m: f64) -> PoseLines {
    let mut noise = Noise(3);
    lines(0..100, 11..11 + people, |tick, person| {
        noise.on(&walker(tick, person - 11), sigma_m)
    })
}

fn truth(people: u32, body: impl FnMut(i64, u32) -> ScoredBody) -> PoseLines {
    lines(0..100, 0..people, body)
}

fn doubted(poses: &PoseLines, truth: &PoseLines, extent: TruthExtent) -> Vec<Doubt> {
    doubts(poses, truth, &score(poses, truth, extent, Some(30.0)))
}

/// That nothing is said of a truth that was taken for whole.
fn check_silent(poses: &PoseLines, truth: &PoseLines) {
    let found = doubted(poses, truth, TruthExtent::Whole);
    assert!(found.is_empty(), "{found:?}");
}

/// That of one and of three people with good poses this one thing is said.
fn check(cause: DoubtCause, words: &str, body: impl Fn(i64, u32) -> ScoredBody) {
    for people in [1, 3] {
        let found = doubted(
            &poses(people, GOOD_SIGMA_M),
            &truth(people, &body),
            TruthExtent::Whole,
        );
        let [doubt] = found.as_slice() else {
            panic!("{people} people: {found:?}");
        };
        assert_eq!(doubt.cause, cause, "{people} people: {doubt:?}");
        let said = &doubt.found;
        assert!(
            said.contains(&format!(
                "against the poses the truth seems {words}: one of the two is wrong; put right, joints are 1"
            )),
            "{people} people: {said}"
        );
    }
}

#[test]
fn a_right_truth_is_not_doubted_however_bad_the_poses_are() {
    // 13 to 40 mm off on average.
    for sigma_m in [0.008, 0.013, 0.019, 0.025] {
        for (people, body) in [1_u32, 3]
            .into_iter()
            .flat_map(|n| BODIES.map(|body| (n, body)))
        {
            let mut noise = Noise(u64::from(people));
            let truth = truth(people, body);
            let found = lines(0..100, 0..people, |tick, person| {
                noise.on(&body(tick, person), sigma_m)
            });
            check_silent(&found, &truth);
            // Good scores are not looked into at all: here they are.
            assert_eq!(misread(&found, &truth, None), None);
        }
    }
}

#[test]
fn joints_that_are_off_in_the_same_way_all_the_time_are_no_other_reading() {
    for body in BODIES {
        let mut noise = Noise(5);
        let biases: Vec<Vector3<f64>> = (0..24).map(|_| noise.vector(0.025)).collect();
        let found = lines(0..100, 0..2, |tick, person| {
            let mut bias = biases[12 * person as usize..].iter();
            moved(&body(tick, person), |at_m| {
                at_m + bias.next().unwrap() + noise.vector(0.004)
            })
        });
        let truth = truth(2, body);
        check_silent(&found, &truth);
    }
}

/// The body with the points in these slots alone.
fn only(body: &ScoredBody, slots: &[usize]) -> ScoredBody {
    let mut body = body.clone();
    for (slot, point) in body.points_m.iter_mut().enumerate() {
        *point = point.filter(|_| slots.contains(&slot));
    }
    body
}

#[test]
fn of_one_hip_or_two_a_bias_is_no_other_place_and_ticks_are_told_all_the_same() {
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
        let doubt = misread(&good, &late, Some(200.0)).unwrap();
        assert!(doubt.found.contains("to be 5 ticks later"), "{doubt:?}");
    }
}

#[test]
fn people_without_a_pose_and_poses_of_nobody_are_no_other_reading() {
    // Of three people the poses lack one; a ghost stands apart, and every tenth pose has its sides exchanged.
    let mut noise = Noise(9);
    let found = lines(0..100, 1..4, |tick, person| {
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
    check_silent(&found, &truth);
}

#[test]
fn a_truth_of_other_ticks_is_told_with_how_many() {
    let late = DoubtCause::OtherTicks;
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
fn a_truth_of_another_rate_is_told() {
    let rate = DoubtCause::OtherTicks;
    let words = "to count one tick where the poses count two";
    check(rate, words, |tick, person| walker(2 * tick, person));
    // Between two of the poses' ticks the truth has one that they do not.
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
fn left_and_right_that_are_exchanged_are_told() {
    check(
        DoubtCause::SidesExchanged,
        "to have left and right exchanged",
        |tick, person| exchanged(&walker(tick, person)),
    );
}

#[test]
fn parts_that_are_exchanged_are_told_by_name() {
    for (one, other, words) in [
        (4, 5, "to have knees and ankles exchanged"),
        (0, 3, "to have shoulders and hips exchanged"),
        (1, 2, "to have elbows and wrists exchanged"),
    ] {
        check(DoubtCause::PartsExchanged, words, |tick, person| {
            let mut body = walker(tick, person);
            for side in 0..2 {
                body.points_m.swap(2 * one + side, 2 * other + side);
            }
            body
        });
    }
}

/// That the truth whose points are moved so is told in these words.
fn check_place(cause: DoubtCause, words: &str, to: impl Fn(Vector3<f64>) -> Vector3<f64>) {
    check(cause, words, |tick, person| {
        moved(&walker(tick, person), &to)
    });
}

#[test]
fn a_truth_that_lies_elsewhere_is_told_with_where() {
    let elsewhere = DoubtCause::OtherCoordinates;
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
fn a_mirror_image_is_told_with_the_axis() {
    check_place(DoubtCause::Mirrored, "to be mirrored along y", |at_m| {
        Vector3::new(at_m.x, -at_m.y, at_m.z)
    });
}

#[test]
fn who_moves_without_a_limb_may_be_late_or_elsewhere_and_both_are_told() {
    let gliding = |tick: i64| {
        let gone = Vector3::new(0.05 * tick as f64, 0.0, 0.0);
        moved(&standing(0, 0), |at_m| at_m + gone)
    };
    let poses = lines(0..100, 0..1, |tick, _| gliding(tick));
    let late = lines(0..100, 0..1, |tick, _| gliding(tick - 4));
    let doubt = misread(&poses, &late, Some(200.0)).unwrap();
    for words in [
        "to be 4 ticks later",
        "to be shifted by (-0.20, 0.00, 0.00) m",
        ", or to be ",
        "0 mm off on average instead of 200",
    ] {
        assert!(doubt.found.contains(words), "{}", doubt.found);
    }
}

#[test]
fn of_a_few_ticks_nothing_is_said() {
    let of = |ticks: Range<i64>| {
        let poses = lines(ticks.clone(), 0..1, walker);
        let shifted = lines(ticks, 0..1, |tick, person| {
            moved(&walker(tick, person), |at_m| at_m.add_scalar(0.2))
        });
        misread(&poses, &shifted, None)
    };
    assert_eq!(of(0..4), None);
    assert!(of(0..12).is_some());
}

#[test]
fn what_lies_beyond_all_numbers_is_read_without_harm() {
    let far = lines(0..100, 0..1, |tick, person| {
        moved(&walker(tick, person), |at_m| at_m * 1e300)
    });
    let poses = poses(1, GOOD_SIGMA_M);
    assert_eq!(misread(&poses, &far, None), None);
    assert_eq!(misread(&far, &poses, None), None);
}

#[test]
fn a_truth_that_was_annotated_in_part_is_told_unless_it_was_said_to_be() {
    let poses = poses(3, GOOD_SIGMA_M);
    let mut every_third = BTreeMap::new();
    let whole = truth(3, walker);
    for tick in whole.ticks().step_by(3) {
        every_third.insert(tick, whole.people_at(tick).unwrap().clone());
    }
    let every_third = PoseLines::from_people(PointSet::Joints, every_third);
    let one_of_three = truth(1, walker);
    for (truth, words) in [
        (
            &every_third,
            "holds people at 34 ticks, the poses do at 100",
        ),
        (
            &one_of_three,
            "holds 1.0 people on average where the poses hold 3.0",
        ),
    ] {
        let found = doubted(&poses, truth, TruthExtent::Whole);
        assert_eq!(found.len(), 1, "{found:?}");
        assert_eq!(found[0].cause, DoubtCause::AnnotatedInPart);
        let said = &found[0].found;
        assert!(said.contains(words), "{said}");
        assert!(said.contains("`--truth partial`"), "{said}");
        assert!(
            said.contains("or the poses hold people who were not there"),
            "{said}"
        );
        assert!(doubted(&poses, truth, TruthExtent::Partial).is_empty());
    }
}

#[test]
fn who_is_away_for_a_while_and_poses_of_nobody_make_no_truth_one_in_part() {
    let (mut truth, mut found) = (BTreeMap::new(), BTreeMap::new());
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
        found.insert(Tick(tick), bodies);
    }
    let [truth, found] = [truth, found].map(|it| PoseLines::from_people(PointSet::Joints, it));
    check_silent(&found, &truth);
}
