//! What was known of every joint at some moment, and what it may have gained since.

use super::drift;
use crate::body::skeleton::{Joint, N_JOINTS};

/// What was known when a person was last seen in some way.
#[derive(Debug, Clone, Copy)]
pub(super) struct LastSeen {
    /// Variance per axis when each joint was last seen, m².
    held_m2: [f64; N_JOINTS],
    /// Since then, seconds.
    unseen_s: [f64; N_JOINTS],
    /// Since the person was, seconds...
    lost_s: f64,
    /// ...and for how much of that nothing showed the person at all.
    blind_s: f64,
    /// Of the pelvis when the person was, metres per second.
    speed_m_s: f64,
}

impl Default for LastSeen {
    fn default() -> Self {
        Self::now(&[0.0; N_JOINTS], 0.0)
    }
}

impl LastSeen {
    /// Whoever is seen now, at this speed of the pelvis (metres per second), and known so well (variance per axis, m²).
    pub(super) fn now(variance_m2: &[f64; N_JOINTS], speed_m_s: f64) -> Self {
        Self {
            held_m2: *variance_m2,
            unseen_s: [0.0; N_JOINTS],
            lost_s: 0.0,
            blind_s: 0.0,
            speed_m_s,
        }
    }

    /// `dt_s` later the person is still seen, each joint unless [`Self::see`] is told of it.
    pub(super) fn stay(&mut self, dt_s: f64) {
        for unseen_s in &mut self.unseen_s {
            *unseen_s += dt_s;
        }
    }

    /// `dt_s` later the person is still not seen so, or not at all: then `is_blind`.
    pub(super) fn lose(&mut self, dt_s: f64, is_blind: bool) {
        self.stay(dt_s);
        self.lost_s += dt_s;
        if is_blind {
            self.blind_s += dt_s;
        }
    }

    /// A joint is seen, and known so well (variance per axis, m²).
    pub(super) fn see(&mut self, joint: Joint, variance_m2: f64) {
        (self.held_m2[joint.index()], self.unseen_s[joint.index()]) = (variance_m2, 0.0);
    }

    /// Variance per axis that the body as a whole has gained, m².
    pub(super) fn body_m2(&self, coast_decay_s: f64) -> f64 {
        drift::of_body_m2(self.speed_m_s, self.lost_s, coast_decay_s)
            + drift::of_turns_m2(self.speed_m_s, self.blind_s)
    }

    /// [`Self::body_m2`] of whom one must be sure not to take for somebody else.
    pub(super) fn at_most_m2(&self, coast_decay_s: f64) -> f64 {
        self.body_m2(coast_decay_s) + drift::at_most_m2(self.lost_s)
    }

    /// What is left of what was known of `joint`, variance per axis, m², where the body has gained `body_m2`; the pelvis
    /// moves at `speed_m_s` metres per second.
    pub(super) fn ahead_m2(&self, joint: Joint, body_m2: f64, speed_m_s: f64) -> f64 {
        let limb_m2 = drift::of_limb_m2(joint, speed_m_s, self.unseen_s[joint.index()]);
        self.held_m2[joint.index()] + body_m2 + limb_m2
    }
}
