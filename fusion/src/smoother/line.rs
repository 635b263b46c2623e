//! One point through a window of time, forward and back: a Kalman filter and the smoother over it.
//!
//! ```text
//!   x = (place, velocity, acceleration),   x' = F x + w,   z = H x + n,   H = (1 0 0)
//!   F = (1 h h²/2; 0 1 h; 0 0 1),          Q = q (h⁵/20 h⁴/8 h³/6; h⁴/8 h³/3 h²/2; h³/6 h²/2 h)
//! ```
//!
//! The acceleration changes randomly with the spectral density q of its derivative (m²/s⁵), which
//! grows with the point's speed. A measurement has one variance for all three axes, so the axes
//! share their covariance. The backward pass is Bierman's form of the Rauch-Tung-Striebel smoother:
//! it inverts only the scalar S, and a tick without a measurement is one step less.
//!
//! ```text
//!   forward    S = H P Hᵀ + r,   K = P Hᵀ/S,   e = z - H x
//!   back       λ <- (I - KH)ᵀ λ - Hᵀ e/S,   Λ <- (I - KH)ᵀ Λ (I - KH) + Hᵀ H/S       at measurements
//!              xs = x - P λ,   Ps = P - P Λ P,   λ <- Fᵀ λ,   Λ <- Fᵀ Λ F            (x, P: predicted)
//! ```
//!
//! The form is known as the modified Bryson-Frazier smoother. It is tested against weighted least
//! squares over the whole window.

use nalgebra::{Matrix3, RowVector3, Vector3};

/// Measurement of a point at a tick.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Measure {
    /// Measured place, world, metres.
    pub(super) place_m: Vector3<f64>,
    /// Variance per axis, m²; infinite without a measurement.
    pub(super) variance_m2: f64,
    /// Time since the previous tick, seconds.
    pub(super) since_s: f64,
    /// Spectral density of the jerk since then, m²/s⁵.
    pub(super) jerk: f64,
}

/// State of a point after a tick, from all ticks up to it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct PointState {
    /// Rows: place (m), velocity (m/s), acceleration (m/s²); columns: axes of the world.
    state: Matrix3<f64>,
    /// Of the rows, the same for all axes.
    covariance: Matrix3<f64>,
}

impl PointState {
    /// A point near `place_m` with unknown motion: `spreads` are one standard deviation of place
    /// (m), velocity (m/s) and acceleration (m/s²).
    pub(super) fn near(place_m: Vector3<f64>, spreads: [f64; 3]) -> Self {
        let mut state = Matrix3::zeros();
        state.set_row(0, &place_m.transpose());
        Self {
            state,
            covariance: Matrix3::from_diagonal(&Vector3::from(spreads.map(|s| s * s))),
        }
    }
}

/// State of a point at a tick, from all ticks of the window.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct KnownPoint {
    /// World, metres.
    pub(super) place_m: Vector3<f64>,
    /// Metres per second.
    pub(super) velocity_m_s: Vector3<f64>,
    /// Variance of the place per axis, m².
    pub(super) variance_m2: f64,
}

/// One tick of the forward pass.
#[derive(Debug, Clone, Copy)]
struct LineStep {
    transition: Matrix3<f64>,
    predicted: Matrix3<f64>,
    covariance: Matrix3<f64>,
    innovation: RowVector3<f64>,
    gain: Vector3<f64>,
    /// 1/S; 0 without a measurement.
    precision: f64,
}

/// The buffers of one point's window.
#[derive(Debug, Clone, Default)]
pub(super) struct JointLine {
    steps: Vec<LineStep>,
}

impl JointLine {
    /// Smooths `measures`, in the order of time, into `known`, one each; `before` is the state at
    /// the tick before the first. Allocates only while windows grow.
    pub(super) fn smooth(
        &mut self,
        before: &PointState,
        measures: &[Measure],
        known: &mut Vec<KnownPoint>,
    ) {
        self.forward(before, measures);
        self.back(known);
    }

    /// The state after tick `n` of the last [`Self::smooth`], from ticks up to it.
    pub(super) fn after(&self, n: usize) -> Option<PointState> {
        self.steps.get(n).map(LineStep::updated)
    }

    fn forward(&mut self, before: &PointState, measures: &[Measure]) {
        self.steps.clear();
        let mut belief = *before;
        for measure in measures {
            let step = LineStep::to(&belief, measure);
            belief = step.updated();
            self.steps.push(step);
        }
    }

    fn back(&self, known: &mut Vec<KnownPoint>) {
        known.clear();
        let (mut lambda, mut information) = (Matrix3::zeros(), Matrix3::zeros());
        for step in self.steps.iter().rev() {
            if step.precision > 0.0 {
                let mut keep = Matrix3::identity();
                keep.set_column(0, &(keep.column(0) - step.gain));
                lambda = keep.transpose() * lambda;
                let pulled = lambda.row(0) - step.innovation * step.precision;
                lambda.set_row(0, &pulled);
                information = keep.transpose() * information * keep;
                information[(0, 0)] += step.precision;
            }
            let state = step.predicted - step.covariance * lambda;
            let first = step.covariance.column(0);
            let gained = (first.transpose() * information * first).x;
            known.push(KnownPoint {
                place_m: state.row(0).transpose(),
                velocity_m_s: state.row(1).transpose(),
                variance_m2: (step.covariance[(0, 0)] - gained).max(0.0),
            });
            lambda = step.transition.transpose() * lambda;
            information = step.transition.transpose() * information * step.transition;
        }
        known.reverse();
    }
}

impl LineStep {
    fn to(from: &PointState, measure: &Measure) -> Self {
        let h = measure.since_s;
        let transition = Matrix3::new(1.0, h, 0.5 * h * h, 0.0, 1.0, h, 0.0, 0.0, 1.0);
        let (h2, h3) = (h * h, h * h * h);
        let noise = Matrix3::new(
            h2 * h3 / 20.0,
            h2 * h2 / 8.0,
            h3 / 6.0,
            h2 * h2 / 8.0,
            h3 / 3.0,
            h2 / 2.0,
            h3 / 6.0,
            h2 / 2.0,
            h,
        );
        let predicted = transition * from.state;
        let covariance =
            transition * from.covariance * transition.transpose() + noise * measure.jerk;
        let s = covariance[(0, 0)] + measure.variance_m2;
        let precision = if s > 0.0 { 1.0 / s } else { 0.0 };
        Self {
            transition,
            predicted,
            covariance,
            innovation: measure.place_m.transpose() - predicted.row(0),
            gain: covariance.column(0) * precision,
            precision,
        }
    }

    fn updated(&self) -> PointState {
        if self.precision <= 0.0 {
            return PointState {
                state: self.predicted,
                covariance: self.covariance,
            };
        }
        let covariance = self.covariance - self.gain * self.covariance.row(0);
        PointState {
            state: self.predicted + self.gain * self.innovation,
            covariance: (covariance + covariance.transpose()) * 0.5,
        }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{DMatrix, DVector};
    use proptest::prelude::*;

    use super::*;

    const DT_S: f64 = 1.0 / 60.0;
    /// Variance of measurements without noise.
    const EXACT_M2: f64 = 1e-8;
    const SPREADS: [f64; 3] = [1.0, 10.0, 100.0];

    fn measure(place_m: Vector3<f64>, variance_m2: f64) -> Measure {
        Measure {
            place_m,
            variance_m2,
            since_s: DT_S,
            jerk: 1e4,
        }
    }

    fn smoothed(before: &PointState, measures: &[Measure]) -> Vec<KnownPoint> {
        let mut known = Vec::new();
        JointLine::default().smooth(before, measures, &mut known);
        known
    }

    fn somewhere() -> PointState {
        PointState::near(Vector3::zeros(), SPREADS)
    }

    fn any_measures() -> impl Strategy<Value = Vec<Measure>> {
        let place = prop::array::uniform3(-1.0f64..1.0);
        let of_tick = (place, 1e-5f64..1e-2, prop::bool::weighted(0.8));
        prop::collection::vec(of_tick, 2..30).prop_map(|ticks| {
            let measure = |(place, variance, is_seen): ([f64; 3], f64, bool)| {
                measure(place.into(), if is_seen { variance } else { f64::INFINITY })
            };
            ticks.into_iter().map(measure).collect()
        })
    }

    proptest! {
        #[test]
        fn a_constant_velocity_is_recovered_through_a_gap(
            velocity in prop::array::uniform3(-8.0f64..8.0), gap in 5usize..20, lasts in 0usize..8,
        ) {
            let velocity = Vector3::from(velocity);
            let at = |k: usize| velocity * (DT_S * k as f64);
            let of_tick = |k| {
                let is_lost = (gap..gap + lasts).contains(&k);
                // Unseen places may have any value.
                let wrong = Vector3::repeat(9.0);
                measure(
                    if is_lost { wrong } else { at(k) },
                    if is_lost { f64::INFINITY } else { EXACT_M2 },
                )
            };
            let measures: Vec<Measure> = (0..40).map(of_tick).collect();
            let known = smoothed(&somewhere(), &measures);
            for (k, known) in known.iter().enumerate() {
                prop_assert!((known.place_m - at(k)).norm() < 2e-3, "{k}: {}", known.place_m - at(k));
            }
            let middle = &known[30];
            prop_assert!((middle.velocity_m_s - velocity).norm() < 0.02 * velocity.norm() + 0.05);
        }

        #[test]
        fn the_smoother_equals_least_squares_over_the_window(measures in any_measures()) {
            let n = measures.len();
            let known = smoothed(&somewhere(), &measures);
            // Unknown: all states of one axis. Information of the first, of each motion and each
            // measurement.
            let first = LineStep::to(&somewhere(), &measures[0]);
            let mut information = DMatrix::<f64>::zeros(3 * n, 3 * n);
            let mut pull = DVector::<f64>::zeros(3 * n);
            let inverse = first.covariance.try_inverse().unwrap();
            information.view_mut((0, 0), (3, 3)).copy_from(&inverse);
            for (k, measure) in measures.iter().enumerate() {
                information[(3 * k, 3 * k)] += 1.0 / measure.variance_m2;
                if measure.variance_m2.is_finite() {
                    pull[3 * k] += measure.place_m.x / measure.variance_m2;
                }
                if k == 0 {
                    continue;
                }
                let nothing = PointState { state: Matrix3::zeros(), covariance: Matrix3::zeros() };
                let step = LineStep::to(&nothing, measure);
                let noise = step.covariance.try_inverse().unwrap();
                let mut between = DMatrix::<f64>::zeros(3, 3 * n);
                between.view_mut((0, 3 * (k - 1)), (3, 3)).copy_from(&-step.transition);
                between.view_mut((0, 3 * k), (3, 3)).copy_from(&Matrix3::identity());
                information += between.transpose() * noise * between;
            }
            let covariance = information.clone().try_inverse().unwrap();
            let states = &covariance * pull;
            for (k, known) in known.iter().enumerate() {
                let (place_m, variance_m2) = (states[3 * k], covariance[(3 * k, 3 * k)]);
                prop_assert!((known.place_m.x - place_m).abs() < 1e-4, "{k}: {} {place_m}", known.place_m.x);
                let apart = (known.variance_m2 / variance_m2 - 1.0).abs();
                prop_assert!(apart < 1e-3, "{k}: {} {variance_m2}", known.variance_m2);
            }
        }

        #[test]
        fn moving_windows_equal_the_whole_one(measures in any_measures()) {
            let whole = smoothed(&somewhere(), &measures);
            let (mut line, mut known, mut before) = (JointLine::default(), Vec::new(), somewhere());
            for (k, of_whole) in whole.iter().enumerate() {
                line.smooth(&before, &measures[k..], &mut known);
                prop_assert!((known[0].place_m - of_whole.place_m).norm() < 1e-6);
                before = line.after(0).unwrap();
            }
        }

        #[test]
        fn results_repeat_bit_for_bit(measures in any_measures()) {
            prop_assert_eq!(smoothed(&somewhere(), &measures), smoothed(&somewhere(), &measures));
        }
    }

    #[test]
    fn later_ticks_reduce_the_variance_and_gaps_increase_it() {
        let mut measures = vec![measure(Vector3::zeros(), 1e-4); 30];
        let alone = smoothed(&somewhere(), &measures[..11])[10].variance_m2;
        let among = smoothed(&somewhere(), &measures)[10].variance_m2;
        assert!(among < 0.5 * alone, "{among} {alone}");
        for lost in &mut measures[9..14] {
            lost.variance_m2 = f64::INFINITY;
        }
        let in_gap = smoothed(&somewhere(), &measures)[11].variance_m2;
        assert!(in_gap > 4.0 * among, "{in_gap} {among}");
    }

    #[test]
    fn without_measurements_the_motion_continues() {
        let before = PointState::near(Vector3::new(1.0, 2.0, 3.0), SPREADS);
        let known = smoothed(&before, &[measure(Vector3::zeros(), f64::INFINITY); 5]);
        assert!(
            known
                .iter()
                .all(|k| (k.place_m - Vector3::new(1.0, 2.0, 3.0)).norm() < 1e-12)
        );
        assert!(smoothed(&before, &[]).is_empty());
    }
}
