//! Walking along a path to its end and back again, with rounded corners.
//!
//! The walker follows a point that moves along the polygon at constant speed. At a corner at time
//! t, its velocity changes from one leg's to the next leg's within t ± T/2 as a smooth step. So the
//! walker is on time on every leg, is never faster than the given speed, and slows down in turns.
//! Its acceleration is at most 1.875 |Δv| / T.

use std::f64::consts::{PI, TAU};

use nalgebra::Vector2;

use super::timeline::{STEEPEST, smooth_step};
use crate::scene::file::PathEntry;

/// Largest acceleration in a corner, metres per second squared: 1.5 g, as in a sprinter's cut. At
/// half of it the fastest players of a court would rarely reach their speed between corners.
const MAX_ACCELERATION_M_S2: f64 = 15.0;
/// Shortest duration of a turn while walking, seconds.
const MIN_TURN_S: f64 = 0.8;
/// Corners closer than this are one, metres.
const SAME_PLACE_M: f64 = 1e-3;
/// The time of a turn and its change of velocity and heading.
#[derive(Debug, Clone, Copy)]
struct Corner {
    time_s: f64,
    velocity_change_m_s: Vector2<f64>,
    turn_rad: f64,
}

/// A straight part of the path.
#[derive(Debug, Clone, Copy)]
struct PathLeg {
    start_s: f64,
    from_m: Vector2<f64>,
    velocity_m_s: Vector2<f64>,
    heading_rad: f64,
}

/// The position of a walker as a pure function of time.
#[derive(Debug, Clone)]
pub(super) struct PathWalk {
    legs: Vec<PathLeg>,
    corners: Vec<Corner>,
    turn_s: f64,
}

impl PathWalk {
    /// The walk of `length_s` along `path`. Corners reached later are left out, so a walker who
    /// never reaches the end does not slow down for it. `heading_rad` is the heading at speed 0.
    pub(super) fn new(path: &PathEntry, heading_rad: f64, length_s: f64) -> Self {
        let mut points: Vec<Vector2<f64>> = path.points_m.iter().map(|&p| p.into()).collect();
        points.dedup_by(|b, a| (*b - *a).norm() < SAME_PLACE_M);
        let speed_m_s = path.speed_m_s;
        if speed_m_s <= 0.0 || points.len() < 2 {
            let stand = PathLeg {
                start_s: 0.0,
                from_m: points[0],
                velocity_m_s: Vector2::zeros(),
                heading_rad,
            };
            return Self {
                legs: vec![stand],
                corners: Vec::new(),
                turn_s: MIN_TURN_S,
            };
        }
        let there_and_back = (0..points.len() - 1).chain((1..points.len()).rev());
        let (mut legs, mut corners): (Vec<PathLeg>, Vec<Corner>) = (Vec::new(), Vec::new());
        let mut time_s = 0.0;
        let mut from = 0;
        for to in there_and_back.cycle().skip(1) {
            let way_m = points[to] - points[from];
            let velocity_m_s = way_m * (speed_m_s / way_m.norm());
            let mut heading_rad = way_m.y.atan2(way_m.x);
            if let Some(last) = legs.last() {
                let turn_rad = nearest_turn(heading_rad - last.heading_rad);
                heading_rad = last.heading_rad + turn_rad;
                corners.push(Corner {
                    time_s,
                    velocity_change_m_s: velocity_m_s - last.velocity_m_s,
                    turn_rad,
                });
            }
            legs.push(PathLeg {
                start_s: time_s,
                from_m: points[from],
                velocity_m_s,
                heading_rad,
            });
            time_s += way_m.norm() / speed_m_s;
            from = to;
            if time_s >= length_s {
                break;
            }
        }
        let turn_s = (STEEPEST * 2.0 * speed_m_s / MAX_ACCELERATION_M_S2).max(MIN_TURN_S);
        Self {
            legs,
            corners,
            turn_s,
        }
    }

    /// Position, metres, and continuous heading, radians, at `time_s`.
    pub(super) fn at(&self, time_s: f64) -> (Vector2<f64>, f64) {
        let index = self.legs.partition_point(|leg| leg.start_s <= time_s);
        let leg = &self.legs[index.saturating_sub(1)];
        let mut at_m = leg.from_m + (time_s - leg.start_s) * leg.velocity_m_s;
        let mut heading_rad = leg.heading_rad;
        let half_s = self.turn_s / 2.0;
        let first = self
            .corners
            .partition_point(|c| c.time_s <= time_s - half_s);
        for corner in &self.corners[first..] {
            let since_s = time_s - corner.time_s;
            if since_s <= -half_s {
                break;
            }
            let share = since_s / self.turn_s + 0.5;
            // `at_m` and `heading_rad` already contain the sharp corner of the polygon.
            at_m += (self.ramp_s(share) - since_s.max(0.0)) * corner.velocity_change_m_s;
            let done = if since_s >= 0.0 { 1.0 } else { 0.0 };
            heading_rad += (smooth_step(share) - done) * corner.turn_rad;
        }
        (at_m, heading_rad)
    }

    /// The integral of the smooth step over time, at `share` of a turn, seconds.
    fn ramp_s(&self, share: f64) -> f64 {
        let u = share.clamp(0.0, 1.0);
        self.turn_s * u.powi(4) * (u * u - 3.0 * u + 2.5)
    }
}

/// The equivalent turn with the smallest angle; a full reversal goes to the left.
fn nearest_turn(turn_rad: f64) -> f64 {
    let turn = turn_rad.rem_euclid(TAU);
    if turn > PI + 1e-9 { turn - TAU } else { turn }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DT_S: f64 = 1e-3;

    fn walk(points_m: &[[f64; 2]], speed_m_s: f64, length_s: f64) -> PathWalk {
        let path = PathEntry {
            points_m: points_m.to_vec(),
            speed_m_s,
        };
        PathWalk::new(&path, 0.5, length_s)
    }

    fn velocity_m_s(walk: &PathWalk, time_s: f64) -> Vector2<f64> {
        (walk.at(time_s + DT_S).0 - walk.at(time_s - DT_S).0) / (2.0 * DT_S)
    }

    #[test]
    fn a_path_is_walked_to_its_end_and_back_again() {
        let walk = walk(&[[0.0, 0.0], [6.0, 0.0], [6.0, 3.0]], 1.5, 30.0);
        for (time_s, x, y) in [
            (2.0, 3.0, 0.0),
            (5.0, 6.0, 1.5),
            (7.0, 6.0, 1.5),
            (10.0, 3.0, 0.0),
            (14.0, 3.0, 0.0),
        ] {
            let (at_m, _) = walk.at(time_s);
            assert!(
                (at_m - Vector2::new(x, y)).norm() < 1e-9,
                "{time_s} s: {at_m}"
            );
        }
    }

    #[test]
    fn speed_and_acceleration_stay_within_their_limits() {
        let walk = walk(
            &[
                [1.0, -6.0],
                [-0.3, -7.0],
                [-1.9, -3.3],
                [6.2, -7.0],
                [2.6, -7.0],
            ],
            6.7,
            20.0,
        );
        for i in 1..20_000 {
            let time_s = f64::from(i) * DT_S;
            let speed_m_s = velocity_m_s(&walk, time_s).norm();
            assert!(speed_m_s < 6.7 + 1e-6, "{time_s} s: {speed_m_s}");
        }
    }

    #[test]
    fn the_walker_faces_along_its_way() {
        let walk = walk(&[[0.0, 0.0], [0.0, 6.0]], 1.5, 30.0);
        assert!((walk.at(2.0).1 - PI / 2.0).abs() < 1e-9);
        // Back again, with a left turn.
        assert!((walk.at(6.0).1 - 1.5 * PI).abs() < 1e-9);
    }

    #[test]
    fn a_walker_who_never_reaches_the_end_does_not_brake() {
        let walk = walk(&[[-11.0, 0.0], [11.0, 0.0]], 8.0, 2.6);
        assert!((velocity_m_s(&walk, 2.59) - Vector2::new(8.0, 0.0)).norm() < 1e-6);
    }

    #[test]
    fn at_speed_0_the_walker_stands() {
        let walk = walk(&[[1.0, 2.0]], 0.0, 30.0);
        assert_eq!(walk.at(7.0), (Vector2::new(1.0, 2.0), 0.5));
    }
}
