//! Possible motion of a joint since it was last seen.
//!
//! An unseen person continues with a velocity that decays with the time constant tau of
//! `smoothing.coast_decay_s`. The real person may keep its speed, or do something else:
//!
//! ```text
//!   body    D² = (1.15 v (t - tau (1 - exp(-t/tau))))²/3 + (0.1 t)² + (0.6 t²/2)²       metres per axis
//!                                 without any view        + (0.45 t v/(v + 0.5 m/s))²
//!   limb    d  = reach (1 - exp(-(rate + gait v) u/reach))
//! ```
//!
//! v is the speed of the pelvis when it was last seen, t the time since evidence of the person was
//! lost, u that since the joint itself was. The first part of D is the distance that the decaying
//! velocity misses. The next two allow for a person who starts to walk, the last for a turn. A limb
//! moves relative to the body at a rate that grows with the gait, and no further than its reach.
//!
//! The numbers are fitted on the project's own scenes (evidence of each person withheld for 0.2 to
//! 1 s every 2.3 s) so that two thirds of the errors per axis lie within.

use crate::body::skeleton::{Joint, N_JOINTS};

/// Upper limit of human speed, metres per second.
const FASTEST_M_S: f64 = 10.0;
/// Factor on the missed distance: people also speed up.
const LEFT_BEHIND: f64 = 1.15;
/// A standing person starts to walk: metres per second, and per second squared.
const SETS_OFF_M_S: f64 = 0.10;
const SETS_OFF_M_S2: f64 = 0.6;

/// A moving person turns and changes pace, metres per second; half as much at the second speed.
const TURNS_M_S: f64 = 0.45;
const TURNS_AT_M_S: f64 = 0.5;
/// Largest change of velocity of any person, metres per second squared: a runner is slow where it
/// turns around.
const SUDDEN_M_S2: f64 = 2.0;

/// Motion of a body part relative to the trunk.
#[derive(Debug, Clone, Copy)]
struct DriftPart {
    /// For a still body, metres per second.
    rate_m_s: f64,
    /// In addition, per speed of the body.
    gait: f64,
    /// Largest displacement per axis, metres.
    reach_m: f64,
}

const fn part(rate_m_s: f64, gait: f64, reach_m: f64) -> DriftPart {
    DriftPart {
        rate_m_s,
        gait,
        reach_m,
    }
}

const TRUNK: DriftPart = part(0.04, 0.0, 0.05);
const HEAD: DriftPart = part(0.12, 0.03, 0.12);
const ELBOW: DriftPart = part(0.17, 0.06, 0.20);
const HAND: DriftPart = part(0.30, 0.12, 0.35);
const KNEE: DriftPart = part(0.06, 0.15, 0.15);
const FOOT: DriftPart = part(0.10, 0.33, 0.32);

impl DriftPart {
    fn for_joint(joint: Joint) -> Self {
        use Joint::{
            Head, LeftAnkle, LeftEar, LeftElbow, LeftEye, LeftHand, LeftHeel, LeftKnee, LeftToe,
            LeftWrist, Nose, RightAnkle, RightEar, RightElbow, RightEye, RightHand, RightHeel,
            RightKnee, RightToe, RightWrist,
        };
        match joint {
            Head | Nose | LeftEye | RightEye | LeftEar | RightEar => HEAD,
            LeftElbow | RightElbow => ELBOW,
            LeftWrist | RightWrist | LeftHand | RightHand => HAND,
            LeftKnee | RightKnee => KNEE,
            LeftAnkle | RightAnkle | LeftHeel | RightHeel | LeftToe | RightToe => FOOT,
            _ => TRUNK,
        }
    }
}

/// Variance per axis (m²) of a person who has coasted for `coasted_s` after moving at `speed_m_s`.
pub(super) fn body_drift_m2(speed_m_s: f64, coasted_s: f64, coast_decay_s: f64) -> f64 {
    let t = coasted_s;
    let carried_s = -coast_decay_s * libm::expm1(-t / coast_decay_s);
    let behind_m = LEFT_BEHIND * speed_m_s.min(FASTEST_M_S) * (t - carried_s);
    let off_m2 = (SETS_OFF_M_S * t).powi(2) + (0.5 * SETS_OFF_M_S2 * t * t).powi(2);
    behind_m * behind_m / 3.0 + off_m2
}

/// Additional variance per axis (m²) if no view shows the person.
pub(super) fn turns_drift_m2(speed_m_s: f64, coasted_s: f64) -> f64 {
    let share = speed_m_s / (speed_m_s + TURNS_AT_M_S);
    (TURNS_M_S * share * coasted_s).powi(2)
}

/// Additional variance per axis (m²) for an upper limit: another person must not be confused with
/// this one.
pub(super) fn at_most_m2(coasted_s: f64) -> f64 {
    (0.5 * SUDDEN_M_S2 * coasted_s * coasted_s).powi(2)
}

/// Variance per axis (m²) of `joint` relative to the body of a person moving at `speed_m_s`, after
/// `unseen_s` without evidence of it.
pub(super) fn limb_drift_m2(joint: Joint, speed_m_s: f64, unseen_s: f64) -> f64 {
    let part = DriftPart::for_joint(joint);
    let path_m = (part.rate_m_s + part.gait * speed_m_s.min(FASTEST_M_S)) * unseen_s;
    (part.reach_m * libm::expm1(-path_m / part.reach_m)).powi(2)
}

/// State when a person was last seen in some way.
#[derive(Debug, Clone, Copy)]
pub(super) struct LastSeen {
    /// Variance per axis when each joint was last seen, m².
    seen_m2: [f64; N_JOINTS],
    /// Time since then, seconds.
    unseen_s: [f64; N_JOINTS],
    /// Time since the person was seen, seconds...
    lost_s: f64,
    /// ...and the part of it without any view of the person.
    blind_s: f64,
    /// Speed of the pelvis at that time, metres per second.
    speed_m_s: f64,
}

impl Default for LastSeen {
    fn default() -> Self {
        Self::now(&[0.0; N_JOINTS], 0.0)
    }
}

impl LastSeen {
    /// A person that is seen now, with the speed of its pelvis (metres per second) and variance per
    /// axis (m²).
    pub(super) fn now(variance_m2: &[f64; N_JOINTS], speed_m_s: f64) -> Self {
        Self {
            seen_m2: *variance_m2,
            unseen_s: [0.0; N_JOINTS],
            lost_s: 0.0,
            blind_s: 0.0,
            speed_m_s,
        }
    }

    /// `dt_s` later the person is still seen; seen joints must be added by [`Self::see`].
    pub(super) fn stay(&mut self, dt_s: f64) {
        for unseen_s in &mut self.unseen_s {
            *unseen_s += dt_s;
        }
    }

    /// `dt_s` later the person is still not seen so; `is_blind`: by no view at all.
    pub(super) fn lose(&mut self, dt_s: f64, is_blind: bool) {
        self.stay(dt_s);
        self.lost_s += dt_s;
        if is_blind {
            self.blind_s += dt_s;
        }
    }

    /// A joint is seen with this variance per axis, m².
    pub(super) fn see(&mut self, joint: Joint, variance_m2: f64) {
        (self.seen_m2[joint.index()], self.unseen_s[joint.index()]) = (variance_m2, 0.0);
    }

    /// Growth of the variance of the body as a whole per axis, m².
    pub(super) fn body_m2(&self, coast_decay_s: f64) -> f64 {
        body_drift_m2(self.speed_m_s, self.lost_s, coast_decay_s)
            + turns_drift_m2(self.speed_m_s, self.blind_s)
    }

    /// [`Self::body_m2`] as an upper limit.
    pub(super) fn at_most_m2(&self, coast_decay_s: f64) -> f64 {
        self.body_m2(coast_decay_s) + at_most_m2(self.lost_s)
    }

    /// Current variance of `joint` per axis, m², if that of the body has grown by `body_m2`; the
    /// pelvis moves at `speed_m_s` metres per second.
    pub(super) fn ahead_m2(&self, joint: Joint, body_m2: f64, speed_m_s: f64) -> f64 {
        let limb_m2 = limb_drift_m2(joint, speed_m_s, self.unseen_s[joint.index()]);
        self.seen_m2[joint.index()] + body_m2 + limb_m2
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DECAY_S: f64 = 0.25;

    #[test]
    fn a_body_drifts_farther_the_longer_and_the_faster() {
        let times_s = [0.0, 0.1, 0.3, 1.0];
        for pair in times_s.windows(2) {
            assert!(body_drift_m2(2.0, pair[0], DECAY_S) < body_drift_m2(2.0, pair[1], DECAY_S));
        }
        assert!(body_drift_m2(0.0, 0.5, DECAY_S) < body_drift_m2(4.0, 0.5, DECAY_S));
        assert!(body_drift_m2(4.0, 0.0, DECAY_S).abs() < 1e-12);
    }

    #[test]
    fn the_speed_of_a_body_is_limited() {
        for speed_m_s in [0.0, 10.0, 1e9] {
            let sigma_m = body_drift_m2(speed_m_s, 1.0, DECAY_S).sqrt();
            assert!(sigma_m < FASTEST_M_S, "{speed_m_s}: {sigma_m}");
        }
    }

    #[test]
    fn a_hand_drifts_within_its_reach_and_more_than_the_trunk() {
        let sigma_m = |joint| limb_drift_m2(joint, 3.0, 5.0).sqrt();
        assert!(sigma_m(Joint::LeftWrist) <= HAND.reach_m);
        assert!(sigma_m(Joint::LeftWrist) > 3.0 * sigma_m(Joint::LeftShoulder));
    }
}
