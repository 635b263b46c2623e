//! Where a person is in its life: tentative, tracked, coasting, gone.
//!
//! ```text
//!   tentative --enough evidence--> tracked <--evidence returns-- coasting
//!       |                             '------evidence lost-------->|
//!       |--none for tentative_s                                    |--none for coast_s
//!       |--contradicted, or a picture                              |--one view alone for one_view_s
//!       '------------------------> gone <--------------------------'
//! ```

use farfield_proto::message::PersonState;
use farfield_proto::venue::parameters::BirthParameters;

use crate::estimate::uncertainty::MadeOf;

/// How long a confirmed person lacks evidence from two viewpoints until it is lost, and has it again until
/// it is not, seconds: longer than eight ticks at 60 Hz, a round of turns on a thin link.
const LOST_S: f64 = 0.15;
/// How long who was lost must be seen again until nobody doubts that it is the same, seconds.
const FOUND_S: f64 = 0.5;

/// A person's state, with what decides the next one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Life {
    state: State,
    /// Ticks since evidence from two viewpoints.
    missing: u32,
    /// Ticks since evidence from any viewpoint.
    unseen: u32,
    /// Ticks in a row with evidence from two viewpoints.
    streak: u32,
    /// Whether the person was lost, and has not been seen for long enough since.
    doubtful: bool,
    lost: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum State {
    Tentative {
        supported: u32,
        /// Ticks for which it cannot be seen, until it was seen again.
        awaited: u32,
    },
    Confirmed,
    /// Whether it was published before.
    Gone {
        confirmed: bool,
    },
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

/// What is thought of a tentative person, beside how often it was seen.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// Somebody.
    Somebody,
    /// It cannot be said yet.
    Open,
    /// Nobody: the viewpoints contradict it.
    Nobody,
    /// A picture of somebody.
    Picture,
}

impl Life {
    /// A newborn, seen at its first tick, whose first crops come `awaited` ticks later than the next: it is
    /// not gone before they can have come.
    pub fn newborn(awaited: u32) -> Self {
        Self {
            state: State::Tentative {
                supported: 1,
                awaited,
            },
            missing: 0,
            unseen: 0,
            streak: 0,
            doubtful: false,
            lost: false,
        }
    }

    /// A person given by hand: nobody doubts it.
    pub fn given() -> Self {
        Self {
            state: State::Confirmed,
            missing: 0,
            unseen: 0,
            streak: 0,
            doubtful: false,
            lost: false,
        }
    }

    /// Whether the person is not confirmed yet.
    pub fn is_tentative(&self) -> bool {
        matches!(self.state, State::Tentative { .. })
    }

    /// Whether the first crops of a newborn are still on the way.
    pub fn is_awaited(&self) -> bool {
        matches!(self.state, State::Tentative { awaited, .. } if awaited > 0)
    }

    /// Whether nobody heard of the person: it is tentative, or was when it went.
    pub fn was_tentative(&self) -> bool {
        match self.state {
            State::Tentative { .. } => true,
            State::Confirmed => false,
            State::Gone { confirmed } => !confirmed,
        }
    }

    /// The published state.
    pub fn published(&self) -> PersonState {
        match self.state {
            State::Tentative { .. } => PersonState::Tentative,
            State::Confirmed if self.missing == 0 => PersonState::Tracked,
            State::Confirmed | State::Gone { .. } => PersonState::Coasting,
        }
    }

    /// Ticks since evidence from two viewpoints.
    pub fn missing_ticks(&self) -> u32 {
        self.missing
    }

    /// Counts one tick with what it brought; `verdict` counts for who is tentative.
    pub fn tick(
        &mut self,
        evidence: MadeOf,
        verdict: Verdict,
        rate_hz: f64,
        births: &BirthParameters,
    ) -> Change {
        let counted = |since: u32, seen: bool| if seen { 0 } else { since.saturating_add(1) };
        self.streak = if evidence == MadeOf::Views {
            self.streak.saturating_add(1)
        } else {
            0
        };
        self.missing = counted(self.missing, evidence == MadeOf::Views);
        self.unseen = counted(self.unseen, evidence != MadeOf::Motion);
        let seconds = |ticks: u32| f64::from(ticks) / rate_hz;
        let (missing_s, unseen_s) = (seconds(self.missing), seconds(self.unseen));
        let leaves = match &mut self.state {
            State::Tentative { supported, awaited } => {
                if evidence == MadeOf::Views {
                    *supported += 1;
                    *awaited = 0;
                }
                if *supported >= births.confirm_ticks && verdict == Verdict::Somebody {
                    self.state = State::Confirmed;
                    return Change::Confirmed;
                }
                matches!(verdict, Verdict::Nobody | Verdict::Picture)
                    || missing_s > births.tentative_s + seconds(*awaited)
            }
            State::Confirmed => {
                let streak_s = seconds(self.streak);
                self.doubtful = missing_s >= LOST_S || self.doubtful && streak_s < FOUND_S;
                self.lost = self.doubtful && streak_s < LOST_S;
                unseen_s > births.coast_s || missing_s > births.one_view_s
            }
            State::Gone { .. } => false,
        };
        if !leaves {
            return Change::None;
        }
        let confirmed = self.state == State::Confirmed;
        self.state = State::Gone { confirmed };
        Change::Gone
    }

    /// Counts a lost person as seen again at this tick; it stays doubtful, and from the next tick on
    /// evidence decides again whether it is lost.
    pub fn revive(&mut self) {
        (self.missing, self.unseen, self.lost) = (0, 0, false);
    }

    /// What was taken for evidence of the last `ticks` was somebody else's.
    pub fn was_mistaken_for(&mut self, ticks: u32) {
        (self.missing, self.unseen, self.streak) = (ticks, ticks, 0);
        self.lost = true;
    }

    /// Whether a confirmed person is carried by the model, or by one viewpoint alone.
    pub fn is_lost(&self) -> bool {
        self.lost
    }

    /// Whether a confirmed person is lost, or was a short while ago.
    pub fn is_doubtful(&self) -> bool {
        self.doubtful
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const RATE_HZ: f64 = 50.0;

    fn live(life: &mut Life, evidence: MadeOf, ticks: u32) -> Vec<Change> {
        let births = BirthParameters::default();
        (0..ticks)
            .map(|_| life.tick(evidence, Verdict::Somebody, RATE_HZ, &births))
            .filter(|c| *c != Change::None)
            .collect()
    }

    #[test]
    fn a_newborn_is_confirmed_after_enough_ticks_with_evidence() {
        let mut life = Life::newborn(0);
        assert_eq!(live(&mut life, MadeOf::Views, 10), []);
        assert_eq!(life.published(), PersonState::Tentative);
        assert_eq!(live(&mut life, MadeOf::Views, 1), [Change::Confirmed]);
        assert_eq!(life.published(), PersonState::Tracked);
    }

    #[test]
    fn a_newborn_far_away_is_not_gone_before_its_crops_can_have_come() {
        let mut life = Life::newborn(15);
        assert_eq!(live(&mut life, MadeOf::Motion, 25), []);
        live(&mut life, MadeOf::Views, 1);
        assert_eq!(live(&mut life, MadeOf::Motion, 10), []);
        assert_eq!(live(&mut life, MadeOf::Motion, 1), [Change::Gone]);
        let mut life = Life::newborn(15);
        assert_eq!(live(&mut life, MadeOf::Motion, 26), [Change::Gone]);
    }

    #[test]
    fn a_newborn_that_is_not_seen_again_is_gone_soon() {
        let mut life = Life::newborn(0);
        assert_eq!(live(&mut life, MadeOf::Motion, 10), []);
        assert_eq!(live(&mut life, MadeOf::Motion, 1), [Change::Gone]);
    }

    #[test]
    fn a_confirmed_person_coasts_and_comes_back() {
        let mut life = Life::given();
        assert_eq!(live(&mut life, MadeOf::Motion, 50), []);
        assert_eq!(life.published(), PersonState::Coasting);
        live(&mut life, MadeOf::Views, 1);
        assert_eq!(life.published(), PersonState::Tracked);
        assert_eq!(live(&mut life, MadeOf::Motion, 60), [Change::Gone]);
    }

    #[test]
    fn one_view_carries_a_person_on_for_longer_but_not_for_good() {
        let mut life = Life::given();
        assert_eq!(live(&mut life, MadeOf::OneView, 250), []);
        assert_eq!(life.published(), PersonState::Coasting);
        assert_eq!(live(&mut life, MadeOf::OneView, 1), [Change::Gone]);
    }

    #[test]
    fn an_open_verdict_holds_a_birth_back_and_a_picture_is_gone() {
        let births = BirthParameters::default();
        let mut life = Life::newborn(0);
        let mut tick = |verdict| life.tick(MadeOf::Views, verdict, RATE_HZ, &births);
        for _ in 0..100 {
            assert_eq!(tick(Verdict::Open), Change::None);
        }
        assert_eq!(tick(Verdict::Picture), Change::Gone);
        let mut life = Life::newborn(0);
        let mut tick = |verdict| life.tick(MadeOf::Views, verdict, RATE_HZ, &births);
        assert_eq!(tick(Verdict::Nobody), Change::Gone);
    }

    #[test]
    fn who_was_lost_is_doubtful_for_a_while() {
        let mut life = Life::given();
        live(&mut life, MadeOf::OneView, 7);
        assert!(!life.is_lost());
        live(&mut life, MadeOf::OneView, 1);
        assert!(life.is_lost() && life.is_doubtful());
        live(&mut life, MadeOf::Views, 8);
        assert!(!life.is_lost() && life.is_doubtful());
        live(&mut life, MadeOf::Views, 20);
        assert!(!life.is_doubtful());
    }
}
