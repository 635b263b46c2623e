//! Where a person is in its life: tentative, tracked, coasting, gone.
//!
//! ```text
//!   tentative --enough evidence--> tracked <--evidence returns-- coasting
//!       |                             '------evidence lost-------->|
//!       '--none for tentative_s--> gone <---none for coast_s-------'
//! ```

use farfield_proto::message::PersonState;
use farfield_proto::venue::parameters::BirthParameters;

/// A person's state, with what decides the next one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Life {
    state: State,
    /// Ticks since evidence from two viewpoints.
    missing: u32,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum State {
    Tentative { supported: u32 },
    Confirmed,
    Gone,
}

/// What a tick changed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Change {
    /// Nothing.
    None,
    /// The person has just been confirmed.
    Confirmed,
    /// The person is gone.
    Gone,
}

impl Life {
    /// A newborn, seen at its first tick.
    pub fn newborn() -> Self {
        Self {
            state: State::Tentative { supported: 1 },
            missing: 0,
        }
    }

    /// A person given by hand: nobody doubts it.
    pub fn given() -> Self {
        Self {
            state: State::Confirmed,
            missing: 0,
        }
    }

    /// Whether the person is not confirmed yet.
    pub fn is_tentative(&self) -> bool {
        matches!(self.state, State::Tentative { .. })
    }

    /// The published state.
    pub fn published(&self) -> PersonState {
        match self.state {
            State::Tentative { .. } => PersonState::Tentative,
            State::Confirmed if self.missing == 0 => PersonState::Tracked,
            State::Confirmed | State::Gone => PersonState::Coasting,
        }
    }

    /// Ticks since evidence from two viewpoints.
    pub fn missing_ticks(&self) -> u32 {
        self.missing
    }

    /// Counts one tick with or without evidence from two viewpoints.
    pub fn tick(&mut self, evidence: Evidence, rate_hz: f64, births: &BirthParameters) -> Change {
        self.missing = if evidence == Evidence::Seen {
            0
        } else {
            self.missing + 1
        };
        let missing_s = f64::from(self.missing) / rate_hz;
        match &mut self.state {
            State::Tentative { supported } => {
                if evidence == Evidence::Seen {
                    *supported += 1;
                }
                if *supported >= births.confirm_ticks {
                    self.state = State::Confirmed;
                    return Change::Confirmed;
                }
                self.leave_after(missing_s, births.tentative_s)
            }
            State::Confirmed => self.leave_after(missing_s, births.coast_s),
            State::Gone => Change::None,
        }
    }

    fn leave_after(&mut self, missing_s: f64, limit_s: f64) -> Change {
        if missing_s <= limit_s {
            return Change::None;
        }
        self.state = State::Gone;
        Change::Gone
    }
}

/// Whether a tick brought evidence of a person from two viewpoints.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Evidence {
    /// It did.
    Seen,
    /// It did not.
    Missing,
}

#[cfg(test)]
mod tests {
    use super::*;

    const RATE_HZ: f64 = 50.0;

    fn live(life: &mut Life, evidence: Evidence, ticks: u32) -> Vec<Change> {
        let births = BirthParameters::default();
        (0..ticks)
            .map(|_| life.tick(evidence, RATE_HZ, &births))
            .filter(|c| *c != Change::None)
            .collect()
    }

    #[test]
    fn a_newborn_is_confirmed_after_enough_ticks_with_evidence() {
        let mut life = Life::newborn();
        assert_eq!(live(&mut life, Evidence::Seen, 10), []);
        assert_eq!(life.published(), PersonState::Tentative);
        assert_eq!(live(&mut life, Evidence::Seen, 1), [Change::Confirmed]);
        assert_eq!(life.published(), PersonState::Tracked);
    }

    #[test]
    fn a_newborn_that_is_not_seen_again_is_gone_soon() {
        let mut life = Life::newborn();
        assert_eq!(live(&mut life, Evidence::Missing, 10), []);
        assert_eq!(live(&mut life, Evidence::Missing, 1), [Change::Gone]);
    }

    #[test]
    fn a_confirmed_person_coasts_and_comes_back() {
        let mut life = Life::given();
        assert_eq!(live(&mut life, Evidence::Missing, 50), []);
        assert_eq!(life.published(), PersonState::Coasting);
        live(&mut life, Evidence::Seen, 1);
        assert_eq!(life.published(), PersonState::Tracked);
        assert_eq!(live(&mut life, Evidence::Missing, 60), [Change::Gone]);
    }
}
