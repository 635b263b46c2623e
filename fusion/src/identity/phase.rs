//! The phase of a track: tentative, tracked, lost. A person who left has no track and no phase.
//!
//! ```text
//!   tentative --enough evidence--> tracked <--seen for long enough-- lost
//!       |                             '-------evidence lost---------->|
//!       |--none for tentative_s                                       |--none for coast_s
//!       |--contradicted, or a poster                                  |--one view alone for one_view_s
//!       '---------------------------> gone <--------------------------'
//! ```
//!
//! Only events change a phase, through `Phase::after`; `super::decide` makes them. [`Coverage`]
//! counts the evidence of ticks. "Seen by one viewpoint only" is such a count, and not a phase.
//!
//! Coasting is not a phase either. A confirmed person is published as coasting (`published`) from
//! the first tick at which no two viewpoints see it, while it is still tracked.

use farfield_proto::message::PersonState;
use farfield_proto::tick::Tick;

use super::event::EventKind;
use crate::estimate::uncertainty::MadeOf;

/// Phase of a track.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Phase {
    /// Sighted, and not confirmed.
    Tentative,
    /// Confirmed, and its identity is sure.
    Tracked,
    /// Confirmed, but carried by the model or by one viewpoint: it may be elsewhere, or follow
    /// another person.
    Lost {
        /// Since when.
        since: Tick,
        /// Seen again, for less than 0.5 s. Until then its identity is suspect.
        is_seen_again: bool,
    },
}

impl Phase {
    /// Whether the person is not confirmed yet.
    pub fn is_tentative(self) -> bool {
        self == Self::Tentative
    }

    /// Whether a confirmed person is carried by the model, or by one viewpoint alone.
    pub fn is_lost(self) -> bool {
        matches!(
            self,
            Self::Lost {
                is_seen_again: false,
                ..
            }
        )
    }

    /// Whether a confirmed person is lost, or was lost a short while ago.
    pub fn is_suspect(self) -> bool {
        matches!(self, Self::Lost { .. })
    }

    /// The phase after an event at `tick`; `None` before the track begins and after it is dropped.
    #[must_use]
    pub(crate) fn after(before: Option<Self>, event: &EventKind, tick: Tick) -> Option<Self> {
        let since = match before {
            Some(Self::Lost { since, .. }) => since,
            _ => tick,
        };
        match *event {
            EventKind::Initiate { .. } | EventKind::Reinitiate { .. } => Some(Self::Tentative),
            EventKind::Given | EventKind::Confirm { .. } | EventKind::Find { .. } => {
                Some(Self::Tracked)
            }
            EventKind::Lose { .. } | EventKind::StepBack { .. } => Some(Self::Lost {
                since: tick,
                is_seen_again: false,
            }),
            EventKind::SeenAgain | EventKind::Revive { .. } => Some(Self::Lost {
                since,
                is_seen_again: true,
            }),
            EventKind::UnseenAgain => Some(Self::Lost {
                since,
                is_seen_again: false,
            }),
            // This changes the identity, not the phase.
            EventKind::Recognise { .. } => before,
            EventKind::Drop { .. } => None,
        }
    }
}

/// Which evidence a tick could give about a person, by the viewpoints that have it in sight and
/// sent messages at this tick. A tick that edges skipped, or whose messages were lost, is no
/// evidence of absence.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Showable {
    /// Evidence from two viewpoints.
    pub(crate) by_two: bool,
    /// Evidence from any viewpoint.
    pub(crate) by_any: bool,
}

impl Showable {
    /// All viewpoints sent messages.
    pub(crate) const BY_ALL: Self = Self {
        by_two: true,
        by_any: true,
    };
}

/// How long a person has had which evidence, ticks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Coverage {
    /// Since evidence from two viewpoints, counting only ticks that could show it.
    pub missing: u32,
    /// Since evidence from any viewpoint.
    pub unseen: u32,
    /// Of `unseen`, the ticks that could show the person.
    pub absent: u32,
    /// Consecutive ticks with evidence from two viewpoints, counting only ticks that could show it.
    pub streak: u32,
    /// With evidence from two viewpoints since the first sighting, that one included.
    pub supported: u32,
    /// Until the crops of a sighted person can arrive; 0 as soon as two viewpoints have shown it.
    pub awaited: u32,
    /// Since evidence from two viewpoints, all ticks.
    pub since_two: u32,
}

impl Coverage {
    /// A person that was sighted at this tick, and whose first crops arrive `awaited` ticks after
    /// the next one. It is not dropped before they can arrive.
    pub(crate) fn sighted(awaited: u32) -> Self {
        Self {
            supported: 1,
            awaited,
            ..Self::default()
        }
    }

    /// Counts one tick: the evidence it had, and the evidence it could have had.
    pub(crate) fn count(&mut self, made_of: MadeOf, showable: Showable) {
        let has_two = made_of == MadeOf::Views;
        if has_two {
            self.streak = self.streak.saturating_add(1);
            self.supported = self.supported.saturating_add(1);
            (self.missing, self.since_two, self.awaited) = (0, 0, 0);
        } else {
            self.since_two = self.since_two.saturating_add(1);
            if showable.by_two {
                self.streak = 0;
                self.missing = self.missing.saturating_add(1);
            }
        }
        if made_of == MadeOf::Motion {
            self.unseen = self.unseen.saturating_add(1);
            self.absent = self.absent.saturating_add(showable.by_any.into());
        } else {
            (self.unseen, self.absent) = (0, 0);
        }
    }

    /// Whether the last tick had evidence from two viewpoints.
    pub(crate) fn is_seen(&self) -> bool {
        self.since_two == 0
    }

    /// As if the person was seen at this tick; the streak does not change.
    pub(crate) fn revive(&mut self) {
        (self.missing, self.since_two) = (0, 0);
        (self.unseen, self.absent) = (0, 0);
    }

    /// The evidence of the last `ticks` belonged to another person.
    pub(crate) fn withdraw(&mut self, ticks: u32) {
        (self.missing, self.unseen, self.streak) = (ticks, ticks, 0);
        (self.since_two, self.absent) = (ticks, ticks);
    }
}

/// Whether the first crops of a tentative person are still on the way.
pub(crate) fn is_awaited(phase: Phase, coverage: Coverage) -> bool {
    phase.is_tentative() && coverage.awaited > 0
}

/// The state that is published for a phase.
pub(crate) fn published(phase: Phase, coverage: Coverage) -> PersonState {
    match phase {
        Phase::Tentative => PersonState::Tentative,
        _ if coverage.is_seen() => PersonState::Tracked,
        _ => PersonState::Coasting,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use farfield_proto::message::identity_event::DropReason;

    #[test]
    fn the_first_evidence_ends_the_wait_for_crops() {
        let mut coverage = Coverage::sighted(15);
        coverage.count(MadeOf::OneView, Showable::BY_ALL);
        assert!(is_awaited(Phase::Tentative, coverage));
        assert!(!is_awaited(Phase::Tracked, coverage), "it has come already");
        coverage.count(MadeOf::Views, Showable::BY_ALL);
        assert!(!is_awaited(Phase::Tentative, coverage));
        assert_eq!(coverage.supported, 2);
    }

    #[test]
    fn absence_counts_only_while_a_viewpoint_could_show_the_person() {
        let mut coverage = Coverage::default();
        for by_any in [true, false, false, true] {
            let by_two = true;
            coverage.count(MadeOf::Motion, Showable { by_two, by_any });
        }
        assert_eq!((coverage.unseen, coverage.absent), (4, 2));
        coverage.count(MadeOf::OneView, Showable::BY_ALL);
        assert_eq!((coverage.unseen, coverage.absent), (0, 0));
    }

    #[test]
    fn ticks_that_edges_skip_do_not_count() {
        let left_out = Showable {
            by_two: false,
            by_any: false,
        };
        let mut coverage = Coverage::default();
        for _ in 0..3 {
            coverage.count(MadeOf::Views, Showable::BY_ALL);
            coverage.count(MadeOf::Motion, left_out);
            assert_eq!(published(Phase::Tracked, coverage), PersonState::Coasting);
        }
        let Coverage {
            missing,
            unseen,
            absent,
            streak,
            ..
        } = coverage;
        assert_eq!([missing, unseen, absent, streak], [0, 1, 0, 3]);
        coverage.count(MadeOf::OneView, left_out);
        assert_eq!((coverage.since_two, coverage.missing), (2, 0));
    }

    #[test]
    fn seeing_a_lost_person_again_keeps_its_start_of_loss() {
        let since = Tick(7);
        let lose = EventKind::Lose { missing_s: 0.2 };
        let lost = Phase::after(Some(Phase::Tracked), &lose, since);
        let back = Phase::after(lost, &EventKind::SeenAgain, Tick(9));
        let is_seen_again = true;
        assert_eq!(
            back,
            Some(Phase::Lost {
                since,
                is_seen_again
            })
        );
        assert!(back.is_some_and(|back| !back.is_lost() && back.is_suspect()));
        let lost_again = Phase::after(back, &EventKind::UnseenAgain, Tick(11));
        assert_eq!(lost_again, lost);
    }

    #[test]
    fn a_dropped_person_has_no_phase() {
        let given = Phase::after(None, &EventKind::Given, Tick(3));
        assert_eq!(given, Some(Phase::Tracked));
        let reason = DropReason::GivenByHand;
        let gone = Phase::after(given, &EventKind::Drop { reason }, Tick(4));
        assert_eq!(gone, None);
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
            coverage.count(made_of, Showable::BY_ALL);
        }
        let Coverage {
            missing,
            unseen,
            streak,
            ..
        } = coverage;
        assert_eq!([missing, unseen, streak], [3, 1, 0]);
        coverage.count(MadeOf::Views, Showable::BY_ALL);
        assert_eq!((coverage.missing, coverage.streak), (0, 1));
        assert_eq!(published(Phase::Tracked, coverage), PersonState::Tracked);
    }
}
