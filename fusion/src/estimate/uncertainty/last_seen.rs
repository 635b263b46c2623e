//! The variance of every joint when it was last seen, and its growth since.

use super::drift;
use crate::body::skeleton::{Joint, N_JOINTS};

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
        drift::body_drift_m2(self.speed_m_s, self.lost_s, coast_decay_s)
            + drift::turns_drift_m2(self.speed_m_s, self.blind_s)
    }

    /// [`Self::body_m2`] as an upper limit.
    pub(super) fn at_most_m2(&self, coast_decay_s: f64) -> f64 {
        self.body_m2(coast_decay_s) + drift::at_most_m2(self.lost_s)
    }

    /// Current variance of `joint` per axis, m², if that of the body has grown by `body_m2`; the
    /// pelvis moves at `speed_m_s` metres per second.
    pub(super) fn ahead_m2(&self, joint: Joint, body_m2: f64, speed_m_s: f64) -> f64 {
        let limb_m2 = drift::limb_drift_m2(joint, speed_m_s, self.unseen_s[joint.index()]);
        self.seen_m2[joint.index()] + body_m2 + limb_m2
    }
}
