//! Changes of identity at a tick, with the reason and its numbers.

use std::fmt;

use serde::{Deserialize, Serialize};

use crate::id::{PersonId, SessionId};
use crate::tick::Tick;
use crate::wire::Message;

/// Most events in one message, and of one tick; fusion drops the rest.
pub const MAX_EVENTS: usize = 4096;

/// Fusion to all: the changes of identity at a tick. Sent only for ticks with changes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct IdentityEventSet {
    /// Fusion's session.
    pub session: SessionId,
    /// The tick.
    pub tick: Tick,
    /// In the order of the decisions.
    pub events: Vec<IdentityEvent>,
}

/// One event of one person. Its text is a line for operators.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct IdentityEvent {
    /// The person, by its id before the event.
    pub person: PersonId,
    /// The id of the person in patches and boxes.
    pub wire_id: PersonId,
    /// The change.
    pub change: Change,
}

/// A change of a person's track.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Change {
    /// Several viewpoints sighted a person without a track: a tentative track begins.
    Initiate {
        /// Number of viewpoints.
        views: u16,
    },
    /// The venue file places a person there.
    #[serde(rename = "give")]
    Given,
    /// A tentative person without crops so far was sighted elsewhere; its track moves there.
    Reinitiate {
        /// Distance from the previous position, metres.
        moved_m: f32,
    },
    /// A tentative person is confirmed and published from now on.
    Confirm {
        /// Time during which two viewpoints have seen it, seconds.
        seen_s: f32,
    },
    /// A confirmed person was present before and gets its old id again.
    Recognise {
        /// The old id.
        old: PersonId,
        /// The evidence.
        why: Likeness,
    },
    /// A person is lost: only the model, or a single viewpoint, carries its track.
    Lose {
        /// Time without two viewpoints that see it, seconds.
        missing_s: f32,
    },
    /// A lost person has been seen again for long enough.
    Find {
        /// Time during which it was lost, seconds.
        lost_s: f32,
    },
    /// A lost person was sighted; its track moves there.
    Revive {
        /// The evidence.
        why: Likeness,
    },
    /// A lost person's track had followed another person; it returns to the position where it was
    /// alone.
    StepBack {
        /// The other person.
        other: PersonId,
        /// Mean distance of the joints of the two, metres.
        distance_m: f32,
        /// Time since it was alone, seconds.
        since_s: f32,
    },
    /// A track is dropped.
    Drop {
        /// The reason.
        reason: DropReason,
    },
}

/// Why a track is dropped.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum DropReason {
    /// Tentative: viewpoints that should see it do not.
    Contradicted {
        /// Number of viewpoints that saw it, summed over the detection passes.
        seen: u32,
        /// Number of viewpoints that should have seen it but did not.
        missed: u32,
    },
    /// Tentative: it is flat and does not move.
    Poster {
        /// Distance of its keypoints from their plane, root mean square, metres.
        flat_m: f32,
        /// Median distance that they have moved, metres.
        moved_m: f32,
    },
    /// Tentative: it was not seen again.
    NotSeenAgain {
        /// Time without a sighting, seconds.
        missing_s: f32,
    },
    /// No viewpoint sees it.
    Unseen {
        /// For how long, seconds.
        unseen_s: f32,
    },
    /// Only one viewpoint sees it.
    OneView {
        /// For how long, seconds.
        missing_s: f32,
    },
    /// It has left the field.
    OutsideField {
        /// Its pelvis, world, metres.
        at_m: [f32; 3],
    },
    /// Another track with more evidence is in the same place.
    SamePlace {
        /// The other person.
        other: PersonId,
        /// For how long, seconds.
        for_s: f32,
    },
    /// It was lost, and the same person has been recognised elsewhere.
    FoundElsewhere,
    /// The venue file names the person at this place.
    GivenByHand,
}

/// The evidence that two tracks are one person.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Likeness {
    /// Distance on the floor from the last reliable position, metres.
    pub distance_m: f32,
    /// Time since then, seconds.
    pub absence_s: f32,
    /// Difference of the link lengths over their standard deviation, root mean square.
    pub lengths_sigma: f32,
    /// Natural logarithm of the likelihood ratio: the same person against another.
    pub log_ratio: f32,
    /// By how much the next best pairing of all tracks is worse, on the same scale; `None` without
    /// one.
    pub margin: Option<f32>,
}

impl Change {
    /// The kind of the change, with its reason if there are several; events are counted by it.
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

    /// Whether every number is finite. All fields are listed, so that the compiler reports a new
    /// one.
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
            Change::Drop { reason } => write!(f, "id {id} is dropped: {reason}"),
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
            Self::Unseen { unseen_s } => write!(f, "seen by no viewpoint for {unseen_s:.1} s"),
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
            Self::GivenByHand => write!(f, "the venue file names the person there"),
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
pub(crate) mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::wire::{WireError, decode, encode};

    fn likeness(numbers: [f32; 5], has_margin: bool) -> Likeness {
        let [distance_m, absence_s, lengths_sigma, log_ratio, margin] = numbers;
        Likeness {
            distance_m,
            absence_s,
            lengths_sigma,
            log_ratio,
            margin: has_margin.then_some(margin),
        }
    }

    /// Every kind of change with these numbers.
    fn changes(n: [f32; 5], other: u32, flag: bool) -> Vec<Change> {
        let (old, why) = (PersonId(other), likeness(n, flag));
        let reasons = [
            DropReason::Contradicted {
                seen: other,
                missed: other / 2,
            },
            DropReason::Poster {
                flat_m: n[0],
                moved_m: n[1],
            },
            DropReason::NotSeenAgain { missing_s: n[0] },
            DropReason::Unseen { unseen_s: n[0] },
            DropReason::OneView { missing_s: n[0] },
            DropReason::OutsideField {
                at_m: [n[0], n[1], n[2]],
            },
            DropReason::SamePlace {
                other: old,
                for_s: n[0],
            },
            DropReason::FoundElsewhere,
            DropReason::GivenByHand,
        ];
        let mut all = vec![
            Change::Initiate {
                views: other as u16,
            },
            Change::Given,
            Change::Reinitiate { moved_m: n[0] },
            Change::Confirm { seen_s: n[0] },
            Change::Recognise { old, why },
            Change::Lose { missing_s: n[0] },
            Change::Find { lost_s: n[0] },
            Change::Revive { why },
            Change::StepBack {
                other: old,
                distance_m: n[0],
                since_s: n[1],
            },
        ];
        all.extend(reasons.map(|reason| Change::Drop { reason }));
        all
    }

    fn set(changes: Vec<Change>) -> IdentityEventSet {
        let event = |change| IdentityEvent {
            person: PersonId(7),
            wire_id: PersonId(9),
            change,
        };
        IdentityEventSet {
            session: SessionId(1 << 63),
            tick: Tick(300),
            events: changes.into_iter().map(event).collect(),
        }
    }

    /// Every kind of event, with numbers that floats represent exactly, for the golden bytes.
    pub(crate) fn every_event() -> IdentityEventSet {
        set(changes([0.5, 1.0, 1.5, -2.0, 0.25], 300, true))
    }

    #[test]
    fn the_text_of_a_recognition_contains_its_evidence() {
        let why = likeness([0.4, 3.0, 1.1, 4.0, 5.2], true);
        let old = PersonId(3);
        let events = set(vec![Change::Recognise { old, why }]).events;
        assert_eq!(
            events[0].to_string(),
            "id 7 is id 3 again: place 0.4 m after 3.0 s, lengths 1.1 sigma, second best 5.2 behind"
        );
    }

    #[test]
    fn every_change_has_its_own_name_and_text() {
        use std::collections::BTreeSet;

        let all = changes([0.5; 5], 3, true);
        let names: BTreeSet<&str> = all.iter().map(Change::name).collect();
        assert_eq!(names.len(), all.len());
        let events = set(all).events;
        let lines: BTreeSet<String> = events.iter().map(ToString::to_string).collect();
        assert_eq!(lines.len(), events.len());
        assert!(lines.iter().all(|line| line.starts_with("id 7 ")));
    }

    #[test]
    fn too_many_events_are_refused() {
        let most = set(vec![Change::Given; MAX_EVENTS]);
        assert!(decode::<IdentityEventSet>(&encode(&most)).is_ok());
        let more = set(vec![Change::Given; MAX_EVENTS + 1]);
        let read = decode::<IdentityEventSet>(&encode(&more));
        assert!(matches!(read, Err(WireError::Invalid(_))));
    }

    #[test]
    fn a_number_that_is_not_finite_is_refused() {
        for bad in [f32::NAN, f32::INFINITY] {
            for place in 0..5 {
                let mut numbers = [0.5; 5];
                numbers[place] = bad;
                let spoilt = changes(numbers, 3, true);
                for (change, sound) in spoilt.into_iter().zip(changes([0.5; 5], 3, true)) {
                    let read = decode::<IdentityEventSet>(&encode(&set(vec![change])));
                    // A change without that many numbers is unchanged.
                    assert_eq!(read.is_err(), change != sound, "{change:?}");
                }
            }
        }
    }

    proptest! {
        #[test]
        fn every_event_is_read_back(
            numbers in prop::array::uniform5(-1e6f32..1e6), other in any::<u32>(), flag in any::<bool>(),
        ) {
            let set = set(changes(numbers, other, flag));
            prop_assert_eq!(decode::<IdentityEventSet>(&encode(&set)), Ok(set));
        }

        #[test]
        fn arbitrary_bytes_cause_no_panic(bytes in any::<Vec<u8>>()) {
            drop(decode::<IdentityEventSet>(&[&[crate::wire::VERSION], &bytes[..]].concat()));
        }
    }
}
