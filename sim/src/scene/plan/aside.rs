//! Stepping aside: people outside a group keep a minimum distance; the later one in the file makes
//! room.
//!
//! The algorithm finds the worst moment and moves the unit away with a smooth bump around that
//! time. The direction is perpendicular to the relative motion of two who pass, or straight away
//! from a person who stands. It repeats until no pair is too close. Conflicts that a turn can avoid
//! are solved before this step.

use nalgebra::Vector2;

use super::steer::SAMPLES_PER_S;

/// Minimum distance of two pelvises on the floor, metres.
pub const KEEP_M: f64 = 0.45;
/// Extra distance against rounding and overlapping bumps.
const SPARE_M: f64 = 0.015;
/// How far a unit may leave its area, metres.
const EDGE_M: f64 = 0.02;
/// Minimum half width of a bump, seconds; and half width per metre.
const HALF_S: f64 = 0.6;
const HALF_S_PER_M: f64 = 2.5;
/// Two units pass each other above this relative speed, metres per second; below it they stand.
const PASSING_M_S: f64 = 0.3;
/// Limit of bumps of one unit per second of its time: a crowd without room stays too close.
const BUMPS_PER_S: f64 = 60.0;

/// The people that a unit may have to avoid.
pub(super) struct Neighbours<'a> {
    /// Largest distance of its people from the origin, metres; `None` for people on a path.
    pub(super) reach_m: Option<Vector2<f64>>,
    /// All people placed earlier, at the unit's samples; `None` while absent.
    pub(super) others: &'a [Vec<Option<Vector2<f64>>>],
}

/// A required displacement of the unit.
struct Push {
    sample: usize,
    by_m: Vector2<f64>,
    lacking_m: f64,
}

/// The displacement of the unit whose people are at `people_m` (per sample), metres, per sample.
pub(super) fn step_aside(people_m: &[Vec<Vector2<f64>>], near: &Neighbours<'_>) -> Vec<[f64; 2]> {
    let n = people_m.len();
    let mut aside = vec![Vector2::zeros(); n];
    let most = 100 + (BUMPS_PER_S * n as f64 / SAMPLES_PER_S) as usize;
    for _ in 0..most {
        let Some(push) = worst(people_m, &aside, near) else {
            break;
        };
        bump(&mut aside, &push);
    }
    aside.into_iter().map(Into::into).collect()
}

fn worst(
    people_m: &[Vec<Vector2<f64>>],
    aside: &[Vector2<f64>],
    near: &Neighbours<'_>,
) -> Option<Push> {
    let mut worst: Option<Push> = None;
    let mut offer = |push: Push| {
        if worst.as_ref().is_none_or(|w| push.lacking_m > w.lacking_m) {
            worst = Some(push);
        }
    };
    // A person starts at the position in the file. One who starts outside comes inside without
    // help.
    let mut starts_outside = vec![true; people_m[0].len()];
    for (sample, people) in people_m.iter().enumerate() {
        for (person, at_m) in people.iter().enumerate() {
            let at_m = at_m + aside[sample];
            if let Some(reach_m) = near.reach_m {
                starts_outside[person] &= (at_m.abs() - reach_m).max() > 0.0;
            }
            if let Some(reach_m) = near.reach_m.filter(|_| !starts_outside[person]) {
                let inside_m = at_m.sup(&-reach_m).inf(&reach_m);
                let by_m = inside_m - at_m;
                if by_m.norm() > EDGE_M {
                    let lacking_m = by_m.norm();
                    offer(Push {
                        sample,
                        by_m,
                        lacking_m,
                    });
                }
            }
            for other in near.others {
                let Some(other_m) = other[sample] else {
                    continue;
                };
                let lacking_m = KEEP_M + SPARE_M / 2.0 - (at_m - other_m).norm();
                if lacking_m > 0.0 {
                    let by_m = away(people_m, aside, person, other, sample, near.reach_m);
                    offer(Push {
                        sample,
                        by_m,
                        lacking_m,
                    });
                }
            }
        }
    }
    worst
}

/// The displacement away from `other` at `sample`.
fn away(
    people_m: &[Vec<Vector2<f64>>],
    aside: &[Vector2<f64>],
    person: usize,
    other: &[Option<Vector2<f64>>],
    sample: usize,
    reach_m: Option<Vector2<f64>>,
) -> Vector2<f64> {
    let between = |i: usize| Some(people_m[i][person] + aside[i] - other[i]?);
    let here = between(sample).unwrap_or_default();
    let (before, after) = (
        sample.saturating_sub(1),
        (sample + 1).min(people_m.len() - 1),
    );
    let velocity_m_s = match (between(before), between(after)) {
        (Some(a), Some(b)) if after > before => (b - a) * (SAMPLES_PER_S / (after - before) as f64),
        _ => Vector2::zeros(),
    };
    let passing = velocity_m_s.norm() > PASSING_M_S;
    let direction = if passing {
        let left = Vector2::new(-velocity_m_s.y, velocity_m_s.x).normalize();
        if left.dot(&here) >= 0.0 { left } else { -left }
    } else if here.norm() > 1e-6 {
        here.normalize()
    } else {
        Vector2::x()
    };
    let push = |direction: Vector2<f64>| {
        let along = here.dot(&direction);
        let across = (here - along * direction).norm_squared();
        let keep_m = KEEP_M + SPARE_M;
        direction * ((keep_m * keep_m - across).max(0.0).sqrt() - along)
    };
    let chosen = push(direction);
    let Some(reach_m) = reach_m.filter(|_| passing) else {
        return chosen;
    };
    // Along the edge of the field, people pass on the inner side.
    let outside_m = |by_m: Vector2<f64>| {
        let at_m = people_m[sample][person] + aside[sample] + by_m;
        (at_m.abs() - reach_m).sup(&Vector2::zeros()).norm()
    };
    let opposite = push(-direction);
    if outside_m(chosen) > outside_m(opposite) + EDGE_M {
        opposite
    } else {
        chosen
    }
}

/// Adds a bump of (1 - x²)³ around the push.
fn bump(aside: &mut [Vector2<f64>], push: &Push) {
    let here_s = push.sample as f64 / SAMPLES_PER_S;
    let mut half_s = HALF_S.max(HALF_S_PER_M * push.by_m.norm());
    if here_s > HALF_S {
        // The encounter is after the start: the bump must end there, so that the unit starts at the position in the file.
        half_s = half_s.min(here_s);
    }
    for (i, aside) in aside.iter_mut().enumerate() {
        let x = (i as f64 / SAMPLES_PER_S - here_s) / half_s;
        if x.abs() < 1.0 {
            *aside += push.by_m * (1.0 - x * x).powi(3);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SECONDS: f64 = 6.0;

    fn samples(at: impl Fn(f64) -> Vector2<f64>) -> Vec<Vector2<f64>> {
        let n = (SECONDS * SAMPLES_PER_S) as usize;
        (0..=n).map(|i| at(i as f64 / SAMPLES_PER_S)).collect()
    }

    /// The minimum distance after stepping aside, and the maximum speed of the displacement.
    fn check(own: impl Fn(f64) -> Vector2<f64>, other: impl Fn(f64) -> Vector2<f64>) -> (f64, f64) {
        let (own, other) = (samples(own), samples(other));
        let people: Vec<_> = own.iter().map(|p| vec![*p]).collect();
        let others = [other.iter().copied().map(Some).collect::<Vec<_>>()];
        let near = Neighbours {
            reach_m: None,
            others: &others,
        };
        let aside = step_aside(&people, &near);
        let at = |i: usize| own[i] + Vector2::from(aside[i]);
        let nearest_m = (0..own.len())
            .map(|i| (at(i) - other[i]).norm())
            .fold(f64::MAX, f64::min);
        let speed =
            |w: &[[f64; 2]]| (Vector2::from(w[1]) - Vector2::from(w[0])).norm() * SAMPLES_PER_S;
        (nearest_m, aside.windows(2).map(speed).fold(0.0, f64::max))
    }

    #[test]
    fn two_who_meet_head_on_pass_shoulder_to_shoulder() {
        let (nearest_m, speed_m_s) = check(
            |t| Vector2::new(4.5 - 1.5 * t, -0.05),
            |t| Vector2::new(1.5 * t - 4.5, 0.05),
        );
        assert!(nearest_m > KEEP_M, "{nearest_m}");
        assert!(speed_m_s < 1.0, "{speed_m_s}");
    }

    #[test]
    fn a_standing_person_is_displaced_from_an_occupied_place() {
        let (nearest_m, speed_m_s) = check(
            |t| Vector2::new(0.1 * t.sin(), 0.0),
            |_| Vector2::new(0.2, 0.1),
        );
        assert!(nearest_m > KEEP_M, "{nearest_m}");
        assert!(speed_m_s < 1.0, "{speed_m_s}");
    }

    #[test]
    fn people_on_crossing_paths_keep_their_distance() {
        let (nearest_m, _) = check(|t| Vector2::new(3.0 * (t - 3.0), 0.0), |_| Vector2::zeros());
        assert!(nearest_m > KEEP_M, "{nearest_m}");
    }
}
