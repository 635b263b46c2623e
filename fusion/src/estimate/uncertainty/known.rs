//! Snapshots of the uncertainty, for a person who must go back because its evidence belonged to
//! another person.

use super::last_seen::LastSeen;
use super::{MadeOf, Uncertainty};
use crate::body::skeleton::N_JOINTS;

/// The uncertainty of a person at a tick.
#[derive(Debug, Clone, Copy)]
pub struct UncertaintySnapshot {
    was_seen: bool,
    variance_m2: [f64; N_JOINTS],
    by_two: LastSeen,
    by_any: LastSeen,
    made_of: MadeOf,
    speed_m_s: f64,
    variance_factor: f64,
}

impl Uncertainty {
    /// The current uncertainty.
    pub fn known(&self) -> UncertaintySnapshot {
        UncertaintySnapshot {
            was_seen: self.is_known,
            variance_m2: self.variance_m2,
            by_two: self.by_two,
            by_any: self.by_any,
            made_of: self.made_of,
            speed_m_s: self.speed_m_s,
            variance_factor: self.variance_factor,
        }
    }

    /// Restores `known`. A step with the time since then makes it as uncertain as if nothing had
    /// been seen.
    pub fn go_back_to(&mut self, known: &UncertaintySnapshot) {
        self.is_known = known.was_seen;
        self.variance_m2 = known.variance_m2;
        self.by_two = known.by_two;
        self.by_any = known.by_any;
        self.made_of = known.made_of;
        self.speed_m_s = known.speed_m_s;
        self.variance_factor = known.variance_factor;
        self.misfit_m2 = [0.0; N_JOINTS];
    }
}
