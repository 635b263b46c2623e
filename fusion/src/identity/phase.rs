//! Where a person is in its life: tentative, tracked, lost. Who is gone has no track any more.
//!
//! ```text
//!   tentative --enough evidence--> tracked <--seen for long enough-- lost
//!       |                             '-------evidence lost---------->|
//!       |--none for tentative_s                                       |--none for coast_s
//!       |--contradicted, or a poster                                  |--one view alone for one_view_s
//!       '---------------------------> gone <--------------------------'
//! ```
//!
//! The transitions are decided in `super::decide`, by a table of rules.

use farfield_proto::message::PersonState;
use farfield_proto::tick::Tick;

use super::event::EventKind;
use crate::estimate::uncertainty::MadeOf;

/// Where a person is in its life.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Phase {
    /// Sighted, and not confirmed.
    Tentative {
        /// Ticks with evidence from two viewpoints, the first sighting's too.
        supported_ticks: u32,
        /// Ticks for which its crops cannot have come yet; 0 from when it was seen.
        awaited_ticks: u32,
    },
    /// Confirmed, and surely who it is.
    Tracked,
    /// Confirmed, and carried by the model or by one viewpoint alone: it may be elsewhere by now, or follow
    /// somebody else.
    Lost {
        /// Since when.
        since: Tick,
        /// Whether it is seen again where it is, but not for long enough that nobody doubts that it is the same.
        is_back: bool,
    },
}

impl Phase {
    /// Seen at its first tick, and its first crops come `awaited_ticks` later than the next: it is not gone
    /// before they can have come.
    pub fn tentative(awaited_ticks: u32) -> Self {
        Self::Tentative {
            supported_ticks: 1,
            awaited_ticks,
        }
    }

    /// Whether the person is not confirmed yet.
    pub fn is_tentative(self) -> bool {
        matches!(self, Self::Tentative { .. })
    }

    /// Whether the first crops of a tentative person are still on the way.
    pub fn is_awaited(self) -> bool {
        matches!(self, Self::Tentative { awaited_ticks, .. } if awaited_ticks > 0)
    }

    /// Whether a confirmed person is carried by the model, or by one viewpoint alone.
    pub fn is_lost(self) -> bool {
        matches!(self, Self::Lost { is_back: false, .. })
    }

    /// Whether a confirmed person is lost, or was a short while ago.
    pub fn is_doubtful(self) -> bool {
        matches!(self, Self::Lost { .. })
    }

    /// The phase after a tick that was made of `made_of`, before anything is decided.
    #[must_use]
    pub(crate) fn counted(self, made_of: MadeOf) -> Self {
        match self {
            Self::Tentative {
                supported_ticks, ..
            } if made_of == MadeOf::Views => Self::Tentative {
                supported_ticks: supported_ticks + 1,
                awaited_ticks: 0,
            },
            phase => phase,
        }
    }

    /// The phase after an event at `tick`.
    #[must_use]
    pub(crate) fn after(self, event: &EventKind, tick: Tick) -> Self {
        match *event {
            EventKind::Confirm { .. } | EventKind::Find { .. } => Self::Tracked,
            EventKind::Lose { .. } | EventKind::StepBack { .. } => Self::Lost {
                since: tick,
                is_back: false,
            },
            EventKind::Waver { is_back } => self.lost(tick, is_back),
            EventKind::Revive { .. } => self.lost(tick, true),
            EventKind::Initiate { awaited_ticks, .. }
            | EventKind::Reinitiate { awaited_ticks, .. } => Self::tentative(awaited_ticks),
            EventKind::Recognise { .. } | EventKind::Drop { .. } | EventKind::Give => self,
        }
    }

    fn lost(self, tick: Tick, is_back: bool) -> Self {
        let since = match self {
            Self::Lost { since, .. } => since,
            Self::Tentative { .. } | Self::Tracked => tick,
        };
        Self::Lost { since, is_back }
    }
}

/// For how long a person has had which evidence, ticks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Coverage {
    /// Since evidence from two viewpoints.
    pub missing: u32,
    /// Since evidence from any viewpoint.
    pub unseen: u32,
    /// In a row with evidence from two viewpoints.
    pub streak: u32,
}

impl Coverage {
    /// Counts one tick with what it was made of.
    pub(crate) fn count(&mut self, made_of: MadeOf) {
        let counted = |since: u32, seen: bool| if seen { 0 } else { since.saturating_add(1) };
        self.streak = if made_of == MadeOf::Views {
            self.streak.saturating_add(1)
        } else {
            0
        };
        self.missing = counted(self.missing, made_of == MadeOf::Views);
        self.unseen = counted(self.unseen, made_of != MadeOf::Motion);
    }

    /// As if the person was seen at this tick; until it is seen again the streak says what it said.
    pub(crate) fn revive(&mut self) {
        (self.missing, self.unseen) = (0, 0);
    }

    /// What was taken for evidence of the last `ticks` was somebody else's.
    pub(crate) fn withdraw(&mut self, ticks: u32) {
        *self = Self {
            missing: ticks,
            unseen: ticks,
            streak: 0,
        };
    }
}

/// What is published of a phase.
pub(crate) fn published(phase: Phase, coverage: Coverage) -> PersonState {
    match phase {
        Phase::Tentative { .. } => PersonState::Tentative,
        _ if coverage.missing == 0 => PersonState::Tracked,
        _ => PersonState::Coasting,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_evidence_ends_the_wait_for_crops() {
        let phase = Phase::tentative(15);
        assert!(phase.is_awaited());
        assert!(phase.counted(MadeOf::OneView).is_awaited());
        let seen = phase.counted(MadeOf::Views);
        assert_eq!(
            seen,
            Phase::Tentative {
                supported_ticks: 2,
                awaited_ticks: 0
            }
        );
    }

    #[test]
    fn who_wavers_or_is_revived_is_lost_since_it_was() {
        let lost = Phase::Tracked.after(&EventKind::Lose { missing_s: 0.2 }, Tick(7));
        let back = lost.after(&EventKind::Waver { is_back: true }, Tick(9));
        let since = Tick(7);
        assert_eq!(
            back,
            Phase::Lost {
                since,
                is_back: true
            }
        );
        assert!(!back.is_lost() && back.is_doubtful());
    }

    #[test]
    fn evidence_is_counted_by_how_many_viewpoints_gave_it() {
        let mut coverage = Coverage::default();
        for made_of in [
            MadeOf::Views,
            MadeOf::OneView,
            MadeOf::OneView,
            MadeOf::Motion,
        ] {
            coverage.count(made_of);
        }
        let Coverage {
            missing,
            unseen,
            streak,
        } = coverage;
        assert_eq!([missing, unseen, streak], [3, 1, 0]);
        coverage.count(MadeOf::Views);
        assert_eq!((coverage.missing, coverage.streak), (0, 1));
        assert_eq!(published(Phase::Tracked, coverage), PersonState::Tracked);
    }
}
