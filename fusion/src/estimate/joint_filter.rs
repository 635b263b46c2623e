//! The low-pass filter on the joints, paper, eq. (13), applied to the innovation.
//!
//! A causal low-pass on positions lags every motion. This one filters what is *new* against its own
//! prediction (an alpha-beta filter per joint, critically damped), so that a constant velocity
//! passes without any lag:
//!
//! ```text
//!   x- = x + v dt,   r = z - x-,   x = x- + alpha r,   v = v + beta r/dt
//!   alpha = 1 - q^2,   beta = (1 - q)^2,   q = exp(-w dt)          both poles at q
//! ```
//!
//! Its continuous form is H(s) = (2 w s + w^2)/(s + w)^2 with |H| = 1/sqrt(2) at sqrt(3 + sqrt(10)) w
//! = 2.482 w, hence w = 2 pi `cutoff_hz` / 2.482. Sampled, the gain at the stated cutoff is 0.67 to
//! 0.77 for every cutoff up to 0.45 of the rate.
//!
//! **It peaks**: at w/sqrt(2) = 0.285 of the cutoff |H| is sqrt(4/3), 1.25 dB. That is the cost of
//! no lag at constant velocity: H = 1 + O(s²) cannot fall at low frequencies, so it must rise
//! before it falls. Less damping peaks more, more damping lags longer. At the cutoffs of moving
//! limbs (8 Hz and more) the peak is at frequencies without body motion.
//!
//! **The remaining lag** is that of acceleration: at a constant acceleration A the output lags by A
//! (q dt/(1 - q))^2, which is A/w^2 for slow cutoffs: at 6 Hz and 60 Hz 3.3 mm per m/s^2. The
//! cutoff therefore rises with the low-passed innovation and with the speed (One-Euro style): fast
//! motion is not delayed, while a still person stays still.

use std::f64::consts::TAU;

use farfield_proto::venue::parameters::SmoothingParameters;
use nalgebra::Vector3;

use crate::body::skeleton::{Joint, Joints, N_JOINTS};

/// -3 dB frequency of H over w: sqrt(3 + sqrt(10)).
const CUTOFF_OVER_W: f64 = 2.482_39;
/// Highest cutoff as a share of the rate; beyond it the filter is transparent.
const HIGHEST_CUTOFF_PER_RATE: f64 = 0.45;
/// The filter of one person: position and velocity of 29 joints.
#[derive(Debug, Clone, PartialEq)]
pub struct JointFilter {
    position_m: Joints,
    velocity_m_s: Joints,
    /// Low-passed innovation, metres.
    innovation_m: Joints,
    /// Time without a measurement before this tick, seconds.
    unmeasured_s: f64,
}

impl JointFilter {
    /// Starts at rest at `joints_m` (world, metres).
    pub fn new(joints_m: &Joints) -> Self {
        let zero = [Vector3::zeros(); N_JOINTS];
        Self {
            position_m: *joints_m,
            velocity_m_s: zero,
            innovation_m: zero,
            unmeasured_s: 0.0,
        }
    }

    /// Restarts at rest at `joints_m` (world, metres).
    pub fn reset(&mut self, joints_m: &Joints) {
        *self = Self::new(joints_m);
    }

    /// The smoothed joints (`P_smo` of eq. (13)), world, metres.
    pub fn position_m(&self) -> &Joints {
        &self.position_m
    }

    /// Their velocity, metres per second.
    pub fn velocity_m_s(&self) -> &Joints {
        &self.velocity_m_s
    }

    /// Time without a measurement before the current tick, seconds.
    pub fn unmeasured_s(&self) -> f64 {
        self.unmeasured_s
    }

    /// Filters the joints of the first inverse kinematics (world, metres), `dt_s` after the last
    /// tick, and returns the smoothed joints. The innovation came since the last measurement, and
    /// the gains are those of a filter with that step. No effect unless `dt_s` is above zero.
    pub fn step(
        &mut self,
        measured_m: &Joints,
        dt_s: f64,
        parameters: &SmoothingParameters,
    ) -> &Joints {
        if dt_s <= 0.0 || !dt_s.is_finite() {
            return &self.position_m;
        }
        let since_s = dt_s + std::mem::take(&mut self.unmeasured_s);
        let keep = 1.0 - libm::exp(-TAU * parameters.innovation_cutoff_hz * since_s);
        let highest_hz = HIGHEST_CUTOFF_PER_RATE / since_s;
        for (n, &measured) in measured_m.iter().enumerate() {
            let ahead = self.position_m[n] + self.velocity_m_s[n] * dt_s;
            let innovation = measured - ahead;
            self.innovation_m[n] += (innovation - self.innovation_m[n]) * keep;
            let raised_hz = parameters.cutoff_hz
                + parameters.cutoff_rise_hz_per_m * self.innovation_m[n].norm()
                + parameters.cutoff_rise_per_m * self.velocity_m_s[n].norm();
            let q = pole(raised_hz.min(highest_hz), since_s);
            self.position_m[n] = ahead + innovation * (1.0 - q * q);
            self.velocity_m_s[n] += innovation * ((1.0 - q) * (1.0 - q) / since_s);
        }
        &self.position_m
    }

    /// Sets the velocity of all joints, `velocity_m_s` (world).
    pub fn set_velocity(&mut self, velocity_m_s: Vector3<f64>) {
        self.velocity_m_s.fill(velocity_m_s);
    }

    /// Decays the velocity of the `carried` joints, over `dt_s`, towards that of `body`: unseen
    /// joints keep only the body's motion. The time constant is `limb_decay_s`.
    pub fn decay_towards(
        &mut self,
        body: Joint,
        carried: impl Fn(Joint) -> bool,
        dt_s: f64,
        parameters: &SmoothingParameters,
    ) {
        let fade = libm::exp(-dt_s.max(0.0) / parameters.limb_decay_s);
        let of_body = self.velocity_m_s[body.index()];
        for joint in Joint::ALL.into_iter().filter(|&joint| carried(joint)) {
            let own = &mut self.velocity_m_s[joint.index()];
            *own = of_body + (*own - of_body) * fade;
            self.innovation_m[joint.index()] *= fade;
        }
    }

    /// Advances by `dt_s` without a measurement. The velocity of the pelvis carries all joints and
    /// decays with the time constant `coast_decay_s`; that of each joint relative to it with
    /// `limb_decay_s`.
    pub fn coast(&mut self, dt_s: f64, parameters: &SmoothingParameters) -> &Joints {
        self.unmeasured_s += dt_s.max(0.0);
        let of_body = Fade::over(dt_s, parameters.coast_decay_s);
        let of_limb = Fade::over(dt_s, parameters.limb_decay_s);
        let body_m_s = self.velocity_m_s[Joint::Pelvis.index()];
        for n in 0..N_JOINTS {
            let limb_m_s = self.velocity_m_s[n] - body_m_s;
            self.position_m[n] += body_m_s * of_body.gain_s + limb_m_s * of_limb.gain_s;
            self.velocity_m_s[n] = body_m_s * of_body.left + limb_m_s * of_limb.left;
            self.innovation_m[n] *= of_limb.left;
        }
        &self.position_m
    }
}

/// Decay of a velocity over some time.
struct Fade {
    /// The remaining share.
    left: f64,
    /// Distance travelled, over the initial velocity.
    gain_s: f64,
}

impl Fade {
    fn over(dt_s: f64, decay_s: f64) -> Self {
        let left = libm::exp(-dt_s.max(0.0) / decay_s);
        Self {
            left,
            gain_s: decay_s * (1.0 - left),
        }
    }
}

/// The double pole q of the filter whose -3 dB frequency is `cutoff_hz`, with a step of `dt_s`.
fn pole(cutoff_hz: f64, dt_s: f64) -> f64 {
    libm::exp(-TAU * cutoff_hz / CUTOFF_OVER_W * dt_s)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const RATE_HZ: f64 = 60.0;
    const DT_S: f64 = 1.0 / RATE_HZ;
    const FIXED: SmoothingParameters = SmoothingParameters {
        cutoff_hz: 6.0,
        cutoff_rise_hz_per_m: 0.0,
        cutoff_rise_per_m: 0.0,
        innovation_cutoff_hz: 4.0,
        coast_decay_s: 1.0,
        limb_decay_s: 0.25,
        delay_ms: 0.0,
    };

    fn all(x: f64) -> Joints {
        [Vector3::new(x, 0.0, 0.0); N_JOINTS]
    }

    /// Runs `signal` (metres at seconds) through the filter and returns the output of every tick.
    fn filtered(
        signal: impl Fn(f64) -> f64,
        seconds: f64,
        parameters: &SmoothingParameters,
    ) -> Vec<f64> {
        let mut smoother = JointFilter::new(&all(signal(0.0)));
        let ticks = (seconds * RATE_HZ) as usize;
        (1..=ticks)
            .map(|k| smoother.step(&all(signal(k as f64 * DT_S)), DT_S, parameters)[3].x)
            .collect()
    }

    /// Regression: the gains were those of a filter stepped at every tick. So the displacement of
    /// eight ticks counted as the speed of one, and with the usual parameters a walker seen at
    /// every eighth tick was thrown farther each time.
    #[test]
    fn a_person_seen_at_every_eighth_tick_is_followed() {
        let parameters = SmoothingParameters {
            cutoff_hz: 1.5,
            cutoff_rise_hz_per_m: 1000.0,
            cutoff_rise_per_m: 4.0,
            ..FIXED
        };
        let place_m = |tick: i32| 1.4 * f64::from(tick) * DT_S;
        let mut filter = JointFilter::new(&all(0.0));
        for tick in 1..=240 {
            let at_m = if tick % 8 == 0 {
                filter.step(&all(place_m(tick)), DT_S, &parameters)[3].x
            } else {
                filter.coast(DT_S, &parameters)[3].x
            };
            // The velocity decays between the ticks at which it is seen.
            if tick > 60 {
                assert!((at_m - place_m(tick)).abs() < 0.04, "{tick}: {at_m}");
            }
        }
    }

    /// Gain of the settled filter at `hz`.
    fn gain(hz: f64, parameters: &SmoothingParameters) -> f64 {
        // Whole periods, after the transient: the amplitude is that of the in-phase and quadrature
        // components.
        let out = filtered(|t| (TAU * hz * t).sin(), 40.0, parameters);
        let settled = out.len() / 2;
        let (mut sin, mut cos) = (0.0, 0.0);
        for (k, x) in out.iter().enumerate().skip(settled) {
            let phase = TAU * hz * (k + 1) as f64 * DT_S;
            sin += x * phase.sin();
            cos += x * phase.cos();
        }
        2.0 * sin.hypot(cos) / (out.len() - settled) as f64
    }

    #[test]
    fn the_gain_peaks_and_falls_at_the_cutoff() {
        let parameters = SmoothingParameters {
            cutoff_hz: 2.0,
            ..FIXED
        };
        let of_peak = 0.5f64.sqrt() / CUTOFF_OVER_W * parameters.cutoff_hz;
        // Sampled at thirty times the cutoff, it equals the continuous filter within two percent.
        assert!((gain(of_peak, &parameters) - (4.0f64 / 3.0).sqrt()).abs() < 0.025);
        assert!((gain(parameters.cutoff_hz, &parameters) - 0.5f64.sqrt()).abs() < 0.04);
        assert!((gain(0.05, &parameters) - 1.0).abs() < 0.01);
        let highest = (1..60).map(|tenth| gain(0.1 * f64::from(tenth), &parameters));
        assert!(highest.fold(0.0, f64::max) < 1.18);
    }

    #[test]
    fn a_constant_velocity_passes_without_lag() {
        let out = filtered(|t| 8.0 * t, 3.0, &FIXED);
        assert!((out[out.len() - 1] - 24.0).abs() < 1e-9);
    }

    #[test]
    fn at_constant_acceleration_the_stated_lag_remains() {
        let a_m_s2 = 10.0;
        let out = filtered(|t| 0.5 * a_m_s2 * t * t, 4.0, &FIXED);
        let q = pole(FIXED.cutoff_hz, DT_S);
        let stated_m = a_m_s2 * (q * DT_S / (1.0 - q)).powi(2);
        let lag_m = 0.5 * a_m_s2 * 16.0 - out[out.len() - 1];
        assert!(
            (lag_m - stated_m).abs() < 1e-9,
            "{lag_m} against {stated_m}"
        );
        // The number in the module's head: 3.3 mm per m/s^2.
        assert!((lag_m / a_m_s2 - 0.0033).abs() < 1e-4, "{lag_m}");
    }

    #[test]
    fn the_lag_at_slow_cutoffs_is_a_over_w_squared() {
        let w = TAU * 1.0 / CUTOFF_OVER_W;
        let slow = SmoothingParameters {
            cutoff_hz: 1.0,
            ..FIXED
        };
        let out = filtered(|t| 0.5 * t * t, 20.0, &slow);
        let lag_m = 200.0 - out[out.len() - 1];
        assert!((lag_m * w * w - 1.0).abs() < 0.05, "{lag_m}");
    }

    #[test]
    fn the_gain_at_the_cutoff_is_minus_three_decibel() {
        for cutoff_hz in [1.0, 3.0, 6.0, 12.0, 20.0, 27.0] {
            let parameters = SmoothingParameters { cutoff_hz, ..FIXED };
            // The sampled sine reaches its crests only at matching phases, so its power is
            // compared.
            let sine = |t: f64| (TAU * cutoff_hz * t).sin();
            let out = filtered(sine, 20.0, &parameters);
            let settled = out.len() / 2..out.len();
            let power =
                |f: &dyn Fn(usize) -> f64| settled.clone().map(|k| f(k).powi(2)).sum::<f64>();
            let gain = (power(&|k| out[k]) / power(&|k| sine((k + 1) as f64 * DT_S))).sqrt();
            assert!((0.66..0.78).contains(&gain), "{cutoff_hz} Hz: {gain}");
        }
    }

    #[test]
    fn a_rising_cutoff_shortens_the_lag_of_fast_motion() {
        let kick = |t: f64| 25.0 * t * t;
        let lag =
            |parameters: &SmoothingParameters| kick(1.0) - filtered(kick, 1.0, parameters)[59];
        let adaptive = SmoothingParameters {
            cutoff_rise_hz_per_m: 100.0,
            ..FIXED
        };
        assert!(
            lag(&adaptive) < 0.3 * lag(&FIXED),
            "{} {}",
            lag(&adaptive),
            lag(&FIXED)
        );
    }

    #[test]
    fn noise_of_a_still_person_is_damped() {
        // White noise of 10 mm (a fixed sequence): the default filter must take most of it.
        let mut state = 1u64;
        let mut noise = move || {
            let mut sum = 0.0;
            for _ in 0..12 {
                state = state
                    .wrapping_mul(6_364_136_223_846_793_005)
                    .wrapping_add(1_442_695_040_888_963_407);
                sum += (state >> 11) as f64 / (1u64 << 53) as f64;
            }
            0.01 * (sum - 6.0)
        };
        let mut smoother = JointFilter::new(&all(0.0));
        let (mut raw, mut out) = (0.0, 0.0);
        for _ in 0..600 {
            let z = noise();
            let x = smoother.step(&all(z), DT_S, &SmoothingParameters::default())[0].x;
            raw += z * z;
            out += x * x;
        }
        assert!(out < 0.45 * raw, "{}", out / raw);
    }

    #[test]
    fn coasting_people_move_on_and_come_to_rest() {
        let mut smoother = JointFilter::new(&all(0.0));
        for k in 1..=120 {
            smoother.step(&all(2.0 * f64::from(k) * DT_S), DT_S, &FIXED);
        }
        let before = smoother.position_m()[0].x;
        let first = smoother.coast(DT_S, &FIXED)[0].x - before;
        assert!((first - 2.0 * DT_S).abs() < 0.1 * 2.0 * DT_S);
        for _ in 0..3000 {
            smoother.coast(DT_S, &FIXED);
        }
        assert!((smoother.position_m()[0].x - before - 2.0 * FIXED.coast_decay_s).abs() < 1e-6);
        assert!(smoother.velocity_m_s()[0].norm() < 1e-6);
    }

    #[test]
    fn a_coasting_limb_rests_before_the_body() {
        let mut smoother = JointFilter::new(&all(0.0));
        smoother.set_velocity(Vector3::new(2.0, 0.0, 0.0));
        let wrist = Joint::LeftWrist.index();
        smoother.velocity_m_s[wrist].z = 3.0;
        for _ in 0..3000 {
            smoother.coast(DT_S, &FIXED);
        }
        let off_m = smoother.position_m()[wrist] - smoother.position_m()[0];
        let expected_m = Vector3::new(0.0, 0.0, 3.0 * FIXED.limb_decay_s);
        assert!((off_m - expected_m).norm() < 1e-6, "{off_m}");
    }

    #[test]
    fn an_unseen_limb_keeps_only_the_motion_of_the_body() {
        let mut smoother = JointFilter::new(&all(0.0));
        smoother.set_velocity(Vector3::new(2.0, 0.0, 0.0));
        let wrist = Joint::LeftWrist.index();
        smoother.velocity_m_s[wrist].z = 3.0;
        for _ in 0..60 {
            smoother.decay_towards(
                Joint::Pelvis,
                |joint| joint == Joint::LeftWrist,
                DT_S,
                &FIXED,
            );
        }
        let left = smoother.velocity_m_s()[wrist] - smoother.velocity_m_s()[0];
        assert!((left.norm() - 3.0 * (-1.0 / FIXED.limb_decay_s).exp()).abs() < 1e-9);
    }

    proptest! {
        #[test]
        fn output_is_finite_and_a_step_without_time_has_no_effect(
            jumps in prop::collection::vec(-100.0f64..100.0, 1..40), rise in 0.0f64..1000.0,
        ) {
            let parameters = SmoothingParameters { cutoff_rise_hz_per_m: rise, ..FIXED };
            let mut smoother = JointFilter::new(&all(0.0));
            for &x in &jumps {
                prop_assert!(smoother.step(&all(x), DT_S, &parameters)[0].x.is_finite());
                let before = smoother.clone();
                smoother.step(&all(x + 1.0), 0.0, &parameters);
                prop_assert_eq!(&before, &smoother);
            }
        }
    }
}
