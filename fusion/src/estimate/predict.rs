//! Prediction of a person's joints: paper, eq. (3), and our replacements.
//!
//! The next lattice is centred on the pose one tick ahead (plus or minus a view's capture offset),
//! the boxes on the pose one round trip ahead. So every formula here is defined for any horizon,
//! also between ticks. Joints are predicted one by one: inverse kinematics restores link lengths.

use farfield_proto::venue::parameters::{PredictionParameters, Predictor};
use nalgebra::Vector3;

use crate::body::skeleton::{Joints, N_JOINTS};

/// Input of a prediction: the last poses P' of eq. (14), one per tick, and the velocity of the
/// filter.
#[derive(Debug, Clone, PartialEq)]
pub struct Motion {
    /// Newest first, metres.
    poses_m: [Joints; 3],
    /// How many of `poses_m` are real: 1 to 3.
    known: usize,
    /// Metres per second.
    velocity_m_s: Joints,
}

impl Motion {
    /// A person at rest, with one known pose (world, metres).
    pub fn at_rest(joints_m: Joints) -> Self {
        Self {
            poses_m: [joints_m; 3],
            known: 1,
            velocity_m_s: [Vector3::zeros(); N_JOINTS],
        }
    }

    /// Adds the pose of the next tick (world, metres) and the velocity there (metres per second).
    pub fn push(&mut self, joints_m: &Joints, velocity_m_s: &Joints) {
        self.poses_m.rotate_right(1);
        self.poses_m[0] = *joints_m;
        self.velocity_m_s = *velocity_m_s;
        self.known = (self.known + 1).min(self.poses_m.len());
    }

    /// The newest pose, world, metres.
    pub fn newest_m(&self) -> &Joints {
        &self.poses_m[0]
    }

    /// The velocity at the newest pose, metres per second.
    pub fn velocity_m_s(&self) -> &Joints {
        &self.velocity_m_s
    }

    /// Predicts the joints `horizon_ticks` (any, also fractional) after the newest pose, into
    /// `ahead_m` (world, metres). `dt_s` is the time from tick to tick.
    ///
    /// ```text
    ///   paper                  P + h a/2                      h = 1: 3/2 P(t) - P(t-1) + 1/2 P(t-2)
    ///   damped velocity        P + u g(tau_body) + (v - u) g(tau),  g(tau) = tau (1 - exp(-h dt/tau)),
    ///                          u = the mean of all joints' v
    ///   constant acceleration  P + h w + h^2 a/2              h = 1: 3 P(t) - 3 P(t-1) + P(t-2)
    ///
    ///   a = P(t) - 2 P(t-1) + P(t-2),   w = (3 P(t) - 4 P(t-1) + P(t-2))/2   per tick
    /// ```
    ///
    /// The first is the paper's, eq. (3), for h = 1. The paper has nothing for longer horizons; we
    /// add its step, half of the last change of velocity, once per tick. Iterating it on its own
    /// output would turn a constant velocity into a motion *backwards* from the second tick on.
    ///
    /// While fewer than three poses are known, a = 0 and w is the last difference.
    pub fn predict(
        &self,
        horizon_ticks: f64,
        dt_s: f64,
        parameters: &PredictionParameters,
        ahead_m: &mut Joints,
    ) {
        let h = horizon_ticks;
        let [p0, p1, p2] = &self.poses_m;
        match parameters.predictor {
            Predictor::Paper => {
                for (n, ahead) in ahead_m.iter_mut().enumerate() {
                    *ahead = p0[n] + self.change_per_tick2(n) * (0.5 * h);
                }
            }
            Predictor::DampedVelocity => {
                let gain_s = |decay_s: f64| {
                    let tau = decay_s.max(f64::MIN_POSITIVE);
                    -tau * libm::expm1(-h * dt_s / tau)
                };
                let own_gain_s = gain_s(parameters.velocity_decay_s);
                let body_gain_s = gain_s(parameters.body_velocity_decay_s);
                let of_body = self.velocity_m_s.iter().sum::<Vector3<f64>>() / N_JOINTS as f64;
                let by_body_m = of_body * (body_gain_s - own_gain_s);
                for (n, ahead) in ahead_m.iter_mut().enumerate() {
                    *ahead = p0[n] + self.velocity_m_s[n] * own_gain_s + by_body_m;
                }
            }
            Predictor::ConstantAcceleration => {
                for (n, ahead) in ahead_m.iter_mut().enumerate() {
                    let u = match self.known {
                        1 => Vector3::zeros(),
                        2 => p0[n] - p1[n],
                        _ => (p0[n] * 3.0 - p1[n] * 4.0 + p2[n]) * 0.5,
                    };
                    *ahead = p0[n] + u * h + self.change_per_tick2(n) * (0.5 * h * h);
                }
            }
        }
    }

    /// Second difference of joint `n`, metres per tick squared.
    fn change_per_tick2(&self, n: usize) -> Vector3<f64> {
        let [p0, p1, p2] = &self.poses_m;
        if self.known < 3 {
            Vector3::zeros()
        } else {
            p0[n] - p1[n] * 2.0 + p2[n]
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const DT_S: f64 = 1.0 / 60.0;
    /// Rounding of metres in f64, amplified by the formulas' factors.
    const TOLERANCE_M: f64 = 1e-9;

    /// Three poses of a motion x(t) = x0 + v t + a t^2/2, the newest at t = 0.
    fn history(x0: Vector3<f64>, v: Vector3<f64>, a: Vector3<f64>) -> Motion {
        let at = |t: f64| [x0 + v * t + a * (0.5 * t * t); N_JOINTS];
        let mut motion = Motion::at_rest(at(-2.0 * DT_S));
        motion.push(&at(-DT_S), &[v - a * DT_S; N_JOINTS]);
        motion.push(&at(0.0), &[v; N_JOINTS]);
        motion
    }

    fn predicted(motion: &Motion, predictor: Predictor, h: f64) -> Vector3<f64> {
        let mut ahead = [Vector3::zeros(); N_JOINTS];
        let parameters = PredictionParameters {
            predictor,
            ..PredictionParameters::default()
        };
        motion.predict(h, DT_S, &parameters, &mut ahead);
        ahead[7]
    }

    fn vector(range: std::ops::Range<f64>) -> impl Strategy<Value = Vector3<f64>> {
        prop::array::uniform3(range).prop_map(Vector3::from)
    }

    proptest! {
        #[test]
        fn one_tick_ahead_the_formulas_equal_the_papers(
            p0 in vector(-9.0..9.0), p1 in vector(-9.0..9.0), p2 in vector(-9.0..9.0),
        ) {
            let mut motion = Motion::at_rest([p2; N_JOINTS]);
            motion.push(&[p1; N_JOINTS], &[Vector3::zeros(); N_JOINTS]);
            motion.push(&[p0; N_JOINTS], &[Vector3::zeros(); N_JOINTS]);
            let paper = p0 * 1.5 - p1 + p2 * 0.5;
            prop_assert!((predicted(&motion, Predictor::Paper, 1.0) - paper).norm() < TOLERANCE_M);
            let uniform = p0 * 3.0 - p1 * 3.0 + p2;
            prop_assert!((predicted(&motion, Predictor::ConstantAcceleration, 1.0) - uniform).norm() < TOLERANCE_M);
        }

        #[test]
        fn constant_acceleration_is_exact_at_any_horizon(
            x0 in vector(-50.0..50.0), v in vector(-9.0..9.0), a in vector(-40.0..40.0), h in 0.5f64..6.0,
        ) {
            let t = h * DT_S;
            let truth = x0 + v * t + a * (0.5 * t * t);
            let got = predicted(&history(x0, v, a), Predictor::ConstantAcceleration, h);
            prop_assert!((got - truth).norm() < TOLERANCE_M);
        }

        #[test]
        fn a_damped_velocity_is_bounded_by_its_range(
            v in vector(-9.0..9.0), h in 0.0f64..600.0,
        ) {
            let motion = history(Vector3::zeros(), v, Vector3::zeros());
            let moved = predicted(&motion, Predictor::DampedVelocity, h);
            // All joints move alike: that is the body.
            let tau = PredictionParameters::default().body_velocity_decay_s;
            prop_assert!(moved.norm() <= v.norm() * (tau.min(h * DT_S)) + TOLERANCE_M);
            let soon = predicted(&motion, Predictor::DampedVelocity, 1e-3);
            prop_assert!((soon - v * (1e-3 * DT_S)).norm() < 1e-8);
        }
    }

    #[test]
    fn the_papers_formula_predicts_no_constant_velocity() {
        let motion = history(
            Vector3::zeros(),
            Vector3::new(8.0, 0.0, 0.0),
            Vector3::zeros(),
        );
        for h in [1.0, 2.5, 7.0] {
            assert!(predicted(&motion, Predictor::Paper, h).norm() < TOLERANCE_M);
        }
    }

    #[test]
    fn a_newcomer_is_predicted_still_until_two_poses_are_known() {
        let here = Vector3::new(1.0, 2.0, 0.9);
        let mut motion = Motion::at_rest([here; N_JOINTS]);
        for predictor in [
            Predictor::Paper,
            Predictor::DampedVelocity,
            Predictor::ConstantAcceleration,
        ] {
            assert!((predicted(&motion, predictor, 3.0) - here).norm() < TOLERANCE_M);
        }
        let step = Vector3::new(0.01, 0.0, 0.0);
        motion.push(&[here + step; N_JOINTS], &[step / DT_S; N_JOINTS]);
        let got = predicted(&motion, Predictor::ConstantAcceleration, 2.0);
        assert!((got - (here + step * 3.0)).norm() < TOLERANCE_M);
    }
}
