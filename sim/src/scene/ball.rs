//! A ball that people pass to each other, rolling or in bouncing arcs.

use farfield_fusion::body::skeleton::Joint;
use nalgebra::{Vector2, Vector3};
use rand::RngExt as _;

use super::Scene;
use super::{Purpose, draws};

/// Radius of the ball, metres.
pub const BALL_RADIUS_M: f64 = 0.11;
/// Acceleration of free fall, metres per second squared.
const GRAVITY_M_S2: f64 = 9.81;
/// Fraction of the vertical speed that remains after a bounce.
const BOUNCE: f64 = 0.6;
/// Distance in front of a person's pelvis at which the ball is touched, metres.
const REACH_M: f64 = 0.45;
/// Speed range of a pass, metres per second.
const SPEED_M_S: [f64; 2] = [4.0, 9.0];
/// Shortest and longest time between two touches, seconds.
const PASS_S: [f64; 2] = [0.5, 3.0];
/// Share of the passes that roll.
const ROLLING: f64 = 0.6;

/// The way from one touch to the next.
#[derive(Debug, Clone, Copy)]
struct Pass {
    start_s: f64,
    length_s: f64,
    from_m: Vector2<f64>,
    to_m: Vector2<f64>,
    /// Arcs through the air; 0 for a rolling pass.
    arcs: u32,
}

/// The position of the ball at any time.
#[derive(Debug, Clone)]
pub(super) struct Ball {
    passes: Vec<Pass>,
}

impl Ball {
    /// Draws all passes.
    pub(super) fn new(scene: &Scene) -> Self {
        let mut rng = draws(scene.seed(), Purpose::Ball, 0);
        let n_people = scene.people().len();
        let half_m = Vector2::from(scene.size_m()) / 2.0;
        let clamp = |p: Vector2<f64>| p.sup(&-half_m).inf(&half_m);
        let meet = |person: usize, time_s: f64| -> Option<Vector2<f64>> {
            let truth = scene.person_at(person, time_s)?;
            let pelvis = truth.joint_m(Joint::Pelvis);
            let hips = truth.joint_m(Joint::LeftHip) - truth.joint_m(Joint::RightHip);
            let forward = Vector2::new(hips.y, -hips.x);
            let forward = forward.try_normalize(1e-9).unwrap_or_default();
            Some(clamp(pelvis.xy() + REACH_M * forward))
        };
        let mut passes: Vec<Pass> = Vec::new();
        let (mut at_m, mut time_s, mut holder) = (Vector2::zeros(), 0.0, usize::MAX);
        while time_s < scene.seconds() || passes.is_empty() {
            let drawn = rng.random_range(0..n_people.max(1));
            let receiver = if drawn == holder {
                (drawn + 1) % n_people.max(1)
            } else {
                drawn
            };
            let speed_m_s = rng.random_range(SPEED_M_S[0]..SPEED_M_S[1]);
            let rolls = rng.random::<f64>() < ROLLING;
            let share = Vector2::new(rng.random_range(-1.0..1.0), rng.random_range(-1.0..1.0));
            // Without a receiver the ball goes to a random place.
            let somewhere_m = share.component_mul(&half_m);
            let aimed_m = meet(receiver, time_s).unwrap_or(somewhere_m);
            let length_s = ((aimed_m - at_m).norm() / speed_m_s).clamp(PASS_S[0], PASS_S[1]);
            let to_m = meet(receiver, time_s + length_s).unwrap_or(somewhere_m);
            let arcs = match (rolls, length_s < 1.0) {
                (true, _) => 0,
                (false, true) => 1,
                (false, false) => 3,
            };
            passes.push(Pass {
                start_s: time_s,
                length_s,
                from_m: at_m,
                to_m,
                arcs,
            });
            (at_m, time_s, holder) = (to_m, time_s + length_s, receiver);
        }
        Self { passes }
    }

    /// The centre of the ball, metres.
    pub(super) fn at(&self, time_s: f64) -> Vector3<f64> {
        let next = self.passes.partition_point(|pass| pass.start_s <= time_s);
        self.passes[next.saturating_sub(1)].at(time_s)
    }
}

impl Pass {
    fn at(&self, time_s: f64) -> Vector3<f64> {
        let since_s = (time_s - self.start_s).clamp(0.0, self.length_s);
        let on_floor = self.from_m.lerp(&self.to_m, since_s / self.length_s);
        Vector3::new(
            on_floor.x,
            on_floor.y,
            BALL_RADIUS_M + self.height_m(since_s),
        )
    }

    /// Each arc takes [`BOUNCE`] of the time of the previous one.
    fn height_m(&self, since_s: f64) -> f64 {
        let arcs = (0..self.arcs).map(|i| BOUNCE.powi(i.cast_signed()));
        let unit_s = self.length_s / arcs.clone().sum::<f64>().max(1.0);
        let mut start_s = 0.0;
        for arc_s in arcs.map(|share| share * unit_s) {
            let into_s = since_s - start_s;
            if into_s < arc_s {
                return GRAVITY_M_S2 / 2.0 * into_s * (arc_s - into_s);
            }
            start_s += arc_s;
        }
        0.0
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    /// Fastest ball, metres per second: a pass plus the fall of its longest arc.
    const FASTEST_M_S: f64 = 20.0;

    #[test]
    fn the_ball_moves_evenly_above_the_floor_of_the_field() {
        let text = "rate_hz = 60\nseconds = 20\nseed = 3\nsize_m = [24, 16]\n[ball]\n\
                    [cameras]\nviewpoints = 4\nper_viewpoint = 2\nheight_m = 4\n";
        let scene = Scene::parse(text, Path::new("a.toml"), &mut |_| unreachable!()).unwrap();
        let mut highest_m = 0.0_f64;
        for i in 0..2000 {
            let time_s = f64::from(i) * 0.01;
            let at_m = scene.ball_at(time_s).unwrap();
            let moved_m = (scene.ball_at(time_s + 0.01).unwrap() - at_m).norm();
            assert!(moved_m < 0.01 * FASTEST_M_S, "{moved_m} m at {time_s} s");
            assert!(at_m.z >= BALL_RADIUS_M && at_m.x.abs() <= 12.0 && at_m.y.abs() <= 8.0);
            highest_m = highest_m.max(at_m.z);
        }
        assert!((0.3..4.0).contains(&highest_m), "{highest_m} m");
    }
}
