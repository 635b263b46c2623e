//! What changed who is who at a tick, with the reason and its numbers.

use std::fmt;

use serde::{Deserialize, Serialize};

use crate::id::{PersonId, SessionId};
use crate::tick::Tick;
use crate::wire::Message;

/// Most events in one message, and of one tick: fusion leaves out what is more.
pub const MAX_EVENTS: usize = 4096;

/// Fusion to all: what changed who is who at a tick. Said only of ticks at which something did.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct IdentityEventSet {
    /// Fusion's session.
    pub session: SessionId,
    /// The tick.
    pub tick: Tick,
    /// In the order in which they were decided.
    pub events: Vec<IdentityEvent>,
}

/// One event of one person. Its text is a line for operators.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct IdentityEvent {
    /// Who, by the id that it had until then.
    pub person: PersonId,
    /// By which patches and boxes name the person.
    pub wire_id: PersonId,
    /// What happened.
    pub change: Change,
}

/// What happened to a person.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Change {
    /// Several viewpoints sighted somebody whom nobody follows: a tentative track begins.
    Initiate {
        /// How many viewpoints.
        views: u16,
    },
    /// The venue file says that somebody is there.
    #[serde(rename = "give")]
    Given,
    /// A tentative person whose crops have not come yet was sighted elsewhere, and is followed from there.
    Reinitiate {
        /// How far from where it was, metres.
        moved_m: f32,
    },
    /// A tentative person is somebody: from now on it is published.
    Confirm {
        /// For how long two viewpoints have shown it, seconds.
        seen_s: f32,
    },
    /// Who was confirmed was here before, and has its old id again.
    Recognise {
        /// The id.
        old: PersonId,
        /// What speaks for it.
        why: Likeness,
    },
    /// Somebody is lost: the model, or one viewpoint alone, carries it.
    Lose {
        /// For how long no two viewpoints have shown it, seconds.
        missing_s: f32,
    },
    /// Somebody who was lost has been seen again for long enough.
    Find {
        /// For how long it was lost, seconds.
        lost_s: f32,
    },
    /// Somebody lost was sighted, and is followed from there.
    Revive {
        /// What speaks for it.
        why: Likeness,
    },
    /// Somebody lost had followed what was seen of another: it is back where it stood alone.
    StepBack {
        /// The other.
        other: PersonId,
        /// How far the joints of the two were apart, metres: the mean.
        distance_m: f32,
        /// How long ago it stood alone, seconds.
        since_s: f32,
    },
    /// Somebody is let go.
    Drop {
        /// Why.
        reason: DropReason,
    },
}

/// Why a person is let go.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum DropReason {
    /// Tentative: viewpoints that look do not see it.
    Contradicted {
        /// How many saw it, summed over the detection passes.
        seen: u32,
        /// How many should have and did not.
        missed: u32,
    },
    /// Tentative: it is flat and does not move.
    Poster {
        /// Distance of its keypoints from their plane, root mean square, metres.
        flat_m: f32,
        /// How far they have moved, metres: the median.
        moved_m: f32,
    },
    /// Tentative: it was not seen again.
    NotSeenAgain {
        /// For how long, seconds.
        missing_s: f32,
    },
    /// Nobody has seen it.
    Unseen {
        /// For how long, seconds.
        unseen_s: f32,
    },
    /// One viewpoint alone has seen it.
    OneView {
        /// For how long, seconds.
        missing_s: f32,
    },
    /// It has left the field.
    OutsideField {
        /// Its pelvis, world, metres.
        at_m: [f32; 3],
    },
    /// Another stands in its place, and is surer.
    SamePlace {
        /// The other.
        other: PersonId,
        /// For how long, seconds.
        for_s: f32,
    },
    /// It was lost, and the same person has been recognised elsewhere.
    FoundElsewhere,
    /// The venue file says who stands there.
    GivenByHand,
}

/// What speaks for two being one person.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Likeness {
    /// Distance on the floor from where it was last surely seen, metres.
    pub distance_m: f32,
    /// How long ago that was, seconds.
    pub absence_s: f32,
    /// How far the link lengths differ over how well they are measured, root mean square.
    pub lengths_sigma: f32,
    /// Natural logarithm of the likelihood ratio, the same person over another.
    pub log_ratio: f32,
    /// By how much the next best pairing of all is worse, on the same scale; `None` without one.
    pub margin: Option<f32>,
}

impl Change {
    /// The kind of the change, with its reason where there are several: what events are counted by.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Initiate { .. } => "initiate",
            Self::Given => "give",
            Self::Reinitiate { .. } => "reinitiate",
            Self::Confirm { .. } => "confirm",
            Self::Recognise { .. } => "recognise",
            Self::Lose { .. } => "lose",
            Self::Find { .. } => "find",
            Self::Revive { .. } => "revive",
            Self::StepBack { .. } => "step_back",
            Self::Drop { reason } => match reason {
                DropReason::Contradicted { .. } => "drop/contradicted",
                DropReason::Poster { .. } => "drop/poster",
                DropReason::NotSeenAgain { .. } => "drop/not_seen_again",
                DropReason::Unseen { .. } => "drop/unseen",
                DropReason::OneView { .. } => "drop/one_view",
                DropReason::OutsideField { .. } => "drop/outside_field",
                DropReason::SamePlace { .. } => "drop/same_place",
                DropReason::FoundElsewhere => "drop/found_elsewhere",
                DropReason::GivenByHand => "drop/given_by_hand",
            },
        }
    }

    /// Whether every number in it is finite. Each field is named, so that none can be forgotten.
    fn is_finite(&self) -> bool {
        let are_finite = |numbers: &[f32]| numbers.iter().all(|number| number.is_finite());
        match self {
            Self::Initiate { views: _ } | Self::Given => true,
            Self::Reinitiate { moved_m: number }
            | Self::Confirm { seen_s: number }
            | Self::Lose { missing_s: number }
            | Self::Find { lost_s: number } => number.is_finite(),
            Self::Recognise { old: _, why } | Self::Revive { why } => why.is_finite(),
            Self::StepBack {
                other: _,
                distance_m,
                since_s,
            } => are_finite(&[*distance_m, *since_s]),
            Self::Drop { reason } => match reason {
                DropReason::Contradicted { seen: _, missed: _ }
                | DropReason::FoundElsewhere
                | DropReason::GivenByHand => true,
                DropReason::Poster { flat_m, moved_m } => are_finite(&[*flat_m, *moved_m]),
                DropReason::NotSeenAgain { missing_s: number }
                | DropReason::Unseen { unseen_s: number }
                | DropReason::OneView { missing_s: number }
                | DropReason::SamePlace {
                    other: _,
                    for_s: number,
                } => number.is_finite(),
                DropReason::OutsideField { at_m } => are_finite(at_m),
            },
        }
    }
}

impl Likeness {
    fn is_finite(&self) -> bool {
        let Self {
            distance_m,
            absence_s,
            lengths_sigma,
            log_ratio,
            margin,
        } = *self;
        let numbers = [distance_m, absence_s, lengths_sigma, log_ratio];
        let mut numbers = numbers.into_iter().chain(margin);
        numbers.all(f32::is_finite)
    }
}

impl fmt::Display for IdentityEvent {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let id = self.person.0;
        match &self.change {
            Change::Initiate { views } => {
                write!(f, "id {id} begins: sighted by {views} viewpoints")
            }
            Change::Given => write!(f, "id {id} begins: given in the venue file"),
            Change::Reinitiate { moved_m } => {
                write!(f, "id {id} begins again: sighted {moved_m:.1} m away")
            }
            Change::Confirm { seen_s } => write!(f, "id {id} is confirmed: seen for {seen_s:.2} s"),
            Change::Recognise { old, why } => write!(f, "id {id} is id {} again: {why}", old.0),
            Change::Lose { missing_s } => {
                write!(
                    f,
                    "id {id} is lost: not seen by two viewpoints for {missing_s:.2} s"
                )
            }
            Change::Find { lost_s } => write!(f, "id {id} is found: it was lost for {lost_s:.1} s"),
            Change::Revive { why } => write!(f, "id {id} is sighted again: {why}"),
            Change::StepBack {
                other,
                distance_m,
                since_s,
            } => write!(
                f,
                "id {id} steps back to where it stood {since_s:.1} s ago: it was {distance_m:.2} m from id {}",
                other.0
            ),
            Change::Drop { reason } => write!(f, "id {id} is let go: {reason}"),
        }
    }
}

impl fmt::Display for DropReason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Contradicted { seen, missed } => {
                write!(
                    f,
                    "{seen} viewpoints saw it, {missed} should have and did not"
                )
            }
            Self::Poster { flat_m, moved_m } => write!(
                f,
                "a poster, flat within {flat_m:.3} m, that moved by {moved_m:.3} m"
            ),
            Self::NotSeenAgain { missing_s } => write!(f, "not seen again for {missing_s:.2} s"),
            Self::Unseen { unseen_s } => write!(f, "seen by nobody for {unseen_s:.1} s"),
            Self::OneView { missing_s } => {
                write!(f, "seen by one viewpoint alone for {missing_s:.1} s")
            }
            Self::OutsideField { at_m: [x, y, z] } => {
                write!(f, "outside the field, at {x:.1}, {y:.1}, {z:.1} m")
            }
            Self::SamePlace { other, for_s } => {
                write!(f, "in the place of id {} for {for_s:.1} s", other.0)
            }
            Self::FoundElsewhere => write!(f, "recognised elsewhere"),
            Self::GivenByHand => write!(f, "the venue file says who stands there"),
        }
    }
}

impl fmt::Display for Likeness {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            distance_m,
            absence_s,
            lengths_sigma,
            ..
        } = self;
        write!(
            f,
            "place {distance_m:.1} m after {absence_s:.1} s, lengths {lengths_sigma:.1} sigma"
        )?;
        match self.margin {
            Some(margin) => write!(f, ", second best {margin:.1} behind"),
            None => Ok(()),
        }
    }
}

impl Message for IdentityEventSet {
    fn check(&self) -> Result<(), &'static str> {
        if self.events.len() > MAX_EVENTS {
            return Err("more events than a tick may have");
        }
        if !self.events.iter().all(|event| event.change.is_finite()) {
            return Err("a number that is not finite");
        }
        Ok(())
    }
}

#[cfg(test)]
#[path = "identity_event_tests.rs"]
pub(crate) mod tests;
