//! Steering: a turn over time that keeps a unit in the field and clear of others.
//!
//! A turned unit moves with its own steps in its new direction: p' = R(θ) q', where q is the path
//! in its own clips. The search variable is the rate θ', which changes by at most two steps every
//! 0.2 s. A beam search keeps the courses that leave the field least, then those that keep clear of
//! others, then those that turn least. Courses that reach the same place in the same direction
//! compete. A unit with a free path is not turned.

use nalgebra::Vector2;

use super::timeline::turned;

/// Samples of a unit's path per second.
pub(super) const SAMPLES_PER_S: f64 = 60.0;
/// Samples per decision.
const PER_STEP: usize = 12;
/// Samples between two evaluations of the cost.
const PER_LOOK: usize = 3;
/// Step of the turning rate; and the largest rate in steps: 2 radians per second.
const RATE_STEP_RAD_S: f64 = 0.4;
const MAX_RATE: i32 = 5;
/// Samples ahead at which the straight continuation of a course is evaluated, and the weight of its
/// cost now. So a course that must still turn does not win over one that has turned.
const AHEAD_SAMPLES: [usize; 3] = [24, 48, 72];
const AHEAD: f64 = 0.02;
/// Courses in the beam.
const BEAM: usize = 240;
/// Courses closer than these are one, metres and radians.
const SAME_M: f64 = 0.15;
const SAME_RAD: f64 = 0.2;
/// Distance between pelvises at which avoidance starts, metres.
const AVOID_M: f64 = 0.75;
/// Costs per second: of a metre outside and its square, of a squared metre too close, of a squared
/// radian per second of turning; and, once, of a squared step of the rate.
const OUTSIDE: [f64; 2] = [200.0, 1000.0];
const NEAR: f64 = 150.0;
const TURNING: f64 = 0.04;
const CHANGING: f64 = 0.01;

/// The limits of a unit's motion.
pub(super) struct Obstacles<'a> {
    /// Largest distance of its people from the origin, metres.
    pub(super) reach_m: Vector2<f64>,
    /// All people placed earlier, at the unit's samples; `None` while absent.
    pub(super) others: &'a [Vec<Option<Vector2<f64>>>],
}

/// A unit's own path: the middle of its people at every sample, and the offset of each person.
pub(super) struct UnitWay {
    pub(super) middle_m: Vec<Vector2<f64>>,
    pub(super) people_m: Vec<Vec<Vector2<f64>>>,
}

impl UnitWay {
    /// The path from the pelvises of all its people at every sample.
    pub(super) fn new(pelvises_m: &[Vec<Vector2<f64>>]) -> Self {
        let middle = |at: &Vec<Vector2<f64>>| at.iter().sum::<Vector2<f64>>() / at.len() as f64;
        let middle_m: Vec<_> = pelvises_m.iter().map(middle).collect();
        let around = |(at, middle): (&Vec<Vector2<f64>>, &Vector2<f64>)| {
            at.iter().map(|p| p - middle).collect()
        };
        let people_m = pelvises_m.iter().zip(&middle_m).map(around).collect();
        Self { middle_m, people_m }
    }
}

/// A partial course.
#[derive(Clone, Copy)]
struct SteeredCourse {
    at_m: Vector2<f64>,
    yaw_rad: f64,
    rate: i32,
    cost: f64,
    /// The cost of going straight on for a while.
    ahead: f64,
    parent: usize,
}

/// The turn of a unit at every sample, radians, and the middle of its people, metres.
pub(super) fn steer(way: &UnitWay, around: &Obstacles<'_>) -> Vec<(f64, Vector2<f64>)> {
    let straight: Vec<_> = way.middle_m.iter().map(|m| (0.0, *m)).collect();
    let look = |(i, (yaw, at)): (usize, &(f64, Vector2<f64>))| around.cost(way, i, *at, *yaw);
    let is_free = straight
        .iter()
        .enumerate()
        .map(look)
        .all(|cost| cost <= 0.0);
    if is_free {
        return straight;
    }
    let n_steps = way.middle_m.len().div_ceil(PER_STEP);
    let start = SteeredCourse {
        at_m: straight[0].1,
        yaw_rad: 0.0,
        rate: 0,
        cost: 0.0,
        ahead: 0.0,
        parent: 0,
    };
    let mut generations = vec![vec![start]];
    for step in 0..n_steps {
        let parents = &generations[step];
        let mut children = Vec::with_capacity(parents.len() * 5);
        for (index, parent) in parents.iter().enumerate() {
            for change in [0, -1, 1, -2, 2] {
                let rate = parent.rate + change;
                if rate.abs() <= MAX_RATE {
                    children.push(follow(
                        way,
                        around,
                        step,
                        index,
                        parent,
                        rate,
                        &mut |_, _| {},
                    ));
                }
            }
        }
        generations.push(thinned(children));
    }
    retrace(way, around, &generations)
}

/// The best distinct courses.
fn thinned(mut courses: Vec<SteeredCourse>) -> Vec<SteeredCourse> {
    courses.sort_by(|a, b| (a.cost + a.ahead).total_cmp(&(b.cost + b.ahead)));
    let mut taken = std::collections::BTreeSet::new();
    let cell = |value: f64, size: f64| (value / size).round() as i64;
    courses.retain(|course| {
        taken.insert((
            cell(course.at_m.x, SAME_M),
            cell(course.at_m.y, SAME_M),
            cell(course.yaw_rad, SAME_RAD),
            course.rate,
        ))
    });
    courses.truncate(BEAM);
    courses
}

/// All samples of the best course of the last generation.
fn retrace(
    way: &UnitWay,
    around: &Obstacles<'_>,
    generations: &[Vec<SteeredCourse>],
) -> Vec<(f64, Vector2<f64>)> {
    let mut chosen = vec![0; generations.len()];
    for step in (1..generations.len()).rev() {
        chosen[step - 1] = generations[step][chosen[step]].parent;
    }
    let mut route = vec![(0.0, way.middle_m[0])];
    for step in 0..generations.len() - 1 {
        let parent = &generations[step][chosen[step]];
        let rate = generations[step + 1][chosen[step + 1]].rate;
        follow(way, around, step, 0, parent, rate, &mut |yaw_rad, at_m| {
            route.push((yaw_rad, at_m));
        });
    }
    route
}

/// Continues `parent` for one step while its rate changes to `rate`; calls `passed` for every
/// sample.
fn follow(
    way: &UnitWay,
    around: &Obstacles<'_>,
    step: usize,
    index: usize,
    parent: &SteeredCourse,
    rate: i32,
    passed: &mut impl FnMut(f64, Vector2<f64>),
) -> SteeredCourse {
    let mut course = SteeredCourse {
        rate,
        parent: index,
        ..*parent
    };
    let first = step * PER_STEP;
    let last = (first + PER_STEP).min(way.middle_m.len() - 1);
    for i in first..last {
        let share = (i - first) as f64 / PER_STEP as f64 + 0.5 / PER_STEP as f64;
        let rate_rad_s =
            RATE_STEP_RAD_S * (f64::from(parent.rate) * (1.0 - share) + f64::from(rate) * share);
        let turn_rad = rate_rad_s / SAMPLES_PER_S;
        let moved = way.middle_m[i + 1] - way.middle_m[i];
        course.at_m += turned(moved, course.yaw_rad + turn_rad / 2.0);
        course.yaw_rad += turn_rad;
        passed(course.yaw_rad, course.at_m);
        if (i + 1) % PER_LOOK == 0 {
            let cost = around.cost(way, i + 1, course.at_m, course.yaw_rad);
            let turning = TURNING * rate_rad_s * rate_rad_s;
            course.cost += (cost + turning) * PER_LOOK as f64 / SAMPLES_PER_S;
        }
    }
    let change = f64::from(rate - parent.rate);
    course.cost += CHANGING * change * change;
    course.ahead = AHEAD_SAMPLES
        .map(|ahead| {
            let then = (last + ahead).min(way.middle_m.len() - 1);
            let moved = turned(way.middle_m[then] - way.middle_m[last], course.yaw_rad);
            AHEAD * around.cost(way, then, course.at_m + moved, course.yaw_rad)
        })
        .iter()
        .sum();
    course
}

impl Obstacles<'_> {
    /// Cost per second at sample `i`: 0 inside the field and clear of other people.
    fn cost(&self, way: &UnitWay, i: usize, at_m: Vector2<f64>, yaw_rad: f64) -> f64 {
        let mut cost = 0.0;
        for person in &way.people_m[i] {
            let at_m = at_m + turned(*person, yaw_rad);
            let outside_m = (at_m.abs() - self.reach_m).sup(&Vector2::zeros()).sum();
            cost += outside_m * (OUTSIDE[0] + OUTSIDE[1] * outside_m);
            for other in self.others.iter().filter_map(|other| other[i]) {
                let lacking_m = (AVOID_M - (at_m - other).norm()).max(0.0);
                cost += NEAR * lacking_m * lacking_m;
            }
        }
        cost
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn straight_way(speed_m_s: f64, seconds: f64) -> UnitWay {
        let n = (seconds * SAMPLES_PER_S) as usize;
        let at = |i: usize| vec![Vector2::new(i as f64 * speed_m_s / SAMPLES_PER_S, 0.0)];
        UnitWay::new(&(0..=n).map(at).collect::<Vec<_>>())
    }

    #[test]
    fn a_unit_with_a_free_path_is_not_turned() {
        let way = straight_way(1.0, 2.0);
        let around = Obstacles {
            reach_m: Vector2::new(3.0, 2.0),
            others: &[],
        };
        let route = steer(&way, &around);
        assert!(
            route
                .iter()
                .zip(&way.middle_m)
                .all(|((yaw, at), m)| *yaw == 0.0 && at == m)
        );
    }

    #[test]
    fn a_runner_stays_in_a_small_field() {
        let way = straight_way(2.0, 30.0);
        let around = Obstacles {
            reach_m: Vector2::new(3.1, 2.1),
            others: &[],
        };
        let route = steer(&way, &around);
        assert_eq!(route.len(), way.middle_m.len());
        for (_, at_m) in &route {
            assert!(at_m.x.abs() < 3.12 && at_m.y.abs() < 2.12, "{at_m}");
        }
        for pair in route.windows(2) {
            let speed_m_s = (pair[1].1 - pair[0].1).norm() * SAMPLES_PER_S;
            assert!((speed_m_s - 2.0).abs() < 1e-6);
            assert!((pair[1].0 - pair[0].0).abs() * SAMPLES_PER_S < 2.0 + 1e-6);
        }
    }

    #[test]
    fn a_person_in_the_way_is_avoided() {
        let way = straight_way(1.2, 5.0);
        let other = vec![Some(Vector2::new(3.0, 0.05)); way.middle_m.len()];
        let others = [other];
        let around = Obstacles {
            reach_m: Vector2::new(20.0, 20.0),
            others: &others,
        };
        let nearest_m = steer(&way, &around)
            .iter()
            .map(|(_, at)| (at - Vector2::new(3.0, 0.05)).norm())
            .fold(f64::MAX, f64::min);
        assert!(nearest_m > 0.45, "{nearest_m}");
    }
}
