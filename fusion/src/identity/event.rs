//! Identity events: every change of a track, with its reason and numbers.

use farfield_proto::id::PersonId;
use farfield_proto::message::identity_event::{Change, DropReason, IdentityEvent, Likeness};

#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Event {
    /// The person's id on the edges.
    pub(crate) wire_id: PersonId,
    pub(crate) kind: EventKind,
}

/// What happens.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum EventKind {
    /// A new person was sighted: track initiation.
    Initiate { views: u16, awaited_ticks: u32 },
    /// A person is given by hand.
    Given,
    /// A tentative person was sighted again before its first crops arrived: it starts over there.
    Reinitiate { moved_m: f64, awaited_ticks: u32 },
    /// A tentative person is confirmed.
    Confirm { seen_s: f64 },
    /// A new person was here before.
    Recognise { old: PersonId, why: Likeness },
    /// The person has lacked evidence from two viewpoints for long enough to be lost.
    Lose { missing_s: f64 },
    /// A lost person is seen again in its place, but not yet for long enough to be found.
    SeenAgain,
    /// A person that was seen again is no longer seen.
    UnseenAgain,
    /// A lost person has been seen again for long enough.
    Find { lost_s: f64 },
    /// A lost person was sighted elsewhere, and moved there.
    Revive { why: Likeness },
    /// A lost person followed the evidence of another. It goes back to where it stood alone.
    StepBack {
        other: PersonId,
        distance_m: f64,
        ticks: u32,
    },
    /// The track is dropped.
    Drop { reason: DropReason },
}

impl EventKind {
    /// The event of `person` as it is published; `None` for internal events.
    pub(crate) fn as_message(
        &self,
        person: PersonId,
        wire_id: PersonId,
        dt_s: f64,
    ) -> Option<IdentityEvent> {
        let change = match *self {
            Self::Initiate { views, .. } => Change::Initiate { views },
            Self::Given => Change::Given,
            Self::Reinitiate { moved_m, .. } => Change::Reinitiate {
                moved_m: moved_m as f32,
            },
            Self::Confirm { seen_s } => Change::Confirm {
                seen_s: seen_s as f32,
            },
            Self::Recognise { old, why } => Change::Recognise { old, why },
            Self::Lose { missing_s } => Change::Lose {
                missing_s: missing_s as f32,
            },
            Self::SeenAgain | Self::UnseenAgain => return None,
            Self::Find { lost_s } => Change::Find {
                lost_s: lost_s as f32,
            },
            Self::Revive { why } => Change::Revive { why },
            Self::StepBack {
                other,
                distance_m,
                ticks,
            } => Change::StepBack {
                other,
                distance_m: distance_m as f32,
                since_s: (f64::from(ticks) * dt_s) as f32,
            },
            Self::Drop { reason } => Change::Drop { reason },
        };
        Some(IdentityEvent {
            person,
            wire_id,
            change,
        })
    }
}
