//! What was known at a tick, for who must go back to it: what seemed to be seen of a person since was
//! somebody else's.

use super::{MadeOf, Uncertainty};
use crate::body::skeleton::N_JOINTS;

/// What was known of a person at a tick.
#[derive(Debug, Clone, Copy)]
pub struct UncertaintySnapshot {
    was_seen: bool,
    variance_m2: [f64; N_JOINTS],
    held_m2: [f64; N_JOINTS],
    unseen_s: [f64; N_JOINTS],
    made_of: MadeOf,
    coasted_s: f64,
    speed_m_s: f64,
    lost_speed_m_s: f64,
    variance_factor: f64,
}

impl Uncertainty {
    /// What is known now.
    pub fn known(&self) -> UncertaintySnapshot {
        UncertaintySnapshot {
            was_seen: self.is_known,
            variance_m2: self.variance_m2,
            held_m2: self.held_m2,
            unseen_s: self.unseen_s,
            made_of: self.made_of,
            coasted_s: self.coasted_s,
            speed_m_s: self.speed_m_s,
            lost_speed_m_s: self.lost_speed_m_s,
            variance_factor: self.variance_factor,
        }
    }

    /// Takes back all since what was `known`. A step with the time since then makes it as unsure as if
    /// nothing had been seen.
    pub fn go_back_to(&mut self, known: &UncertaintySnapshot) {
        self.is_known = known.was_seen;
        self.variance_m2 = known.variance_m2;
        self.held_m2 = known.held_m2;
        self.unseen_s = known.unseen_s;
        self.made_of = known.made_of;
        self.coasted_s = known.coasted_s;
        self.speed_m_s = known.speed_m_s;
        self.lost_speed_m_s = known.lost_speed_m_s;
        self.variance_factor = known.variance_factor;
        self.misfit_m2 = [0.0; N_JOINTS];
    }
}
