//! Matches of tracked people with the venue's subjects by their bodies, with the reason and its
//! numbers.

use std::fmt;

use serde::{Deserialize, Serialize};

use crate::id::{PersonId, SessionId};
use crate::message::MAX_PERSONS;
use crate::person_name::check_name;
use crate::tick::Tick;
use crate::wire::Message;

/// Most namings in one message, and of one tick.
pub const MAX_NAMINGS: usize = 2 * MAX_PERSONS;

/// Fusion to all: the results of comparisons with the venue's subjects at a tick. Sent only for
/// ticks with a decision.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct NamingSet {
    /// Fusion's session.
    pub session: SessionId,
    /// The tick.
    pub tick: Tick,
    /// By person, ascending.
    pub namings: Vec<Naming>,
}

/// The result of one person's comparison. Its text is a line for operators.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Naming {
    /// The person.
    pub person: PersonId,
    /// The result.
    pub finding: Finding,
}

/// The result of a comparison.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum Finding {
    /// The person is identified as this subject from now on.
    Named {
        /// The subject's name.
        subject: String,
        /// The evidence.
        why: BodyLikeness,
    },
    /// No subject is similar enough; reported once per person, when the measurement of the body is
    /// final.
    NobodyAlike {
        /// The nearest of the subjects that no other person has.
        nearest: String,
        /// The evidence.
        why: BodyLikeness,
    },
    /// Several subjects, or several people, match equally well; reported once per person, as
    /// [`Self::NobodyAlike`].
    Ambiguous {
        /// The nearest subject.
        nearest: String,
        /// The evidence.
        why: BodyLikeness,
    },
}

/// The evidence that a person is a subject.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct BodyLikeness {
    /// Difference of the link lengths over their standard deviation, root mean square.
    pub lengths_sigma: f32,
    /// Natural logarithm of the likelihood ratio: this subject against any person.
    pub log_ratio: f32,
    /// By how much the next best pairing of all people is worse, on the same scale; `None` without
    /// one.
    pub margin: Option<f32>,
}

impl NamingSet {
    /// The message for a tick; `None` without decisions.
    pub fn of(session: SessionId, tick: Tick, namings: Vec<Naming>) -> Option<Self> {
        (!namings.is_empty()).then_some(Self {
            session,
            tick,
            namings,
        })
    }
}

impl Naming {
    /// The subject's name, if the person was identified.
    pub fn name(&self) -> Option<&str> {
        match &self.finding {
            Finding::Named { subject, .. } => Some(subject),
            Finding::NobodyAlike { .. } | Finding::Ambiguous { .. } => None,
        }
    }
}

impl Finding {
    /// The kind of the result.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Named { .. } => "named",
            Self::NobodyAlike { .. } => "nobody_alike",
            Self::Ambiguous { .. } => "ambiguous",
        }
    }

    fn parts(&self) -> (&str, &BodyLikeness) {
        match self {
            Self::Named {
                subject: name, why, ..
            }
            | Self::NobodyAlike { nearest: name, why }
            | Self::Ambiguous { nearest: name, why } => (name, why),
        }
    }
}

impl fmt::Display for Naming {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let id = self.person.0;
        match &self.finding {
            Finding::Named { subject, why } => write!(f, "id {id} is {subject} by the body: {why}"),
            Finding::NobodyAlike { nearest, why } => {
                write!(
                    f,
                    "id {id} is no subject by the body: {nearest} is nearest, {why}"
                )
            }
            Finding::Ambiguous { nearest, why } => write!(
                f,
                "id {id} has no name by the body, several fit: {nearest} is nearest, {why}"
            ),
        }
    }
}

impl fmt::Display for BodyLikeness {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            lengths_sigma,
            log_ratio,
            margin,
        } = self;
        write!(
            f,
            "lengths {lengths_sigma:.1} sigma, log ratio {log_ratio:.1}"
        )?;
        match margin {
            Some(margin) => write!(f, ", second best {margin:.1} behind"),
            None => Ok(()),
        }
    }
}

impl Message for NamingSet {
    fn check(&self) -> Result<(), &'static str> {
        if self.namings.len() > MAX_NAMINGS {
            return Err("more namings than a tick may have");
        }
        if !self.namings.is_sorted_by(|a, b| a.person < b.person) {
            return Err("people out of order or twice");
        }
        for naming in &self.namings {
            let (name, why) = naming.finding.parts();
            if name.is_empty() || check_name(name).is_err() {
                return Err("an invalid name");
            }
            let numbers = [why.lengths_sigma, why.log_ratio];
            if !numbers.into_iter().chain(why.margin).all(f32::is_finite) {
                return Err("a number that is not finite");
            }
        }
        Ok(())
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::wire::{WireError, decode, encode};

    /// One naming of each kind.
    pub(crate) fn every_naming() -> NamingSet {
        let why = BodyLikeness {
            lengths_sigma: 0.75,
            log_ratio: 6.5,
            margin: Some(4.0),
        };
        let findings = [
            Finding::Named {
                subject: "Žofia".to_owned(),
                why,
            },
            Finding::NobodyAlike {
                nearest: "Anna".to_owned(),
                why: BodyLikeness {
                    log_ratio: -3.0,
                    margin: None,
                    ..why
                },
            },
            Finding::Ambiguous {
                nearest: "Bo".to_owned(),
                why: BodyLikeness {
                    margin: Some(0.5),
                    ..why
                },
            },
        ];
        let namings = (3..).zip(findings).map(|(id, finding)| Naming {
            person: PersonId(id),
            finding,
        });
        NamingSet {
            session: SessionId(9),
            tick: Tick(300),
            namings: namings.collect(),
        }
    }

    #[test]
    fn a_naming_is_a_line_for_operators() {
        let lines: Vec<String> = every_naming()
            .namings
            .iter()
            .map(ToString::to_string)
            .collect();
        assert_eq!(
            lines,
            [
                "id 3 is Žofia by the body: lengths 0.8 sigma, log ratio 6.5, second best 4.0 behind",
                "id 4 is no subject by the body: Anna is nearest, lengths 0.8 sigma, log ratio -3.0",
                "id 5 has no name by the body, several fit: Bo is nearest, lengths 0.8 sigma, log ratio 6.5, second best 0.5 behind",
            ]
        );
    }

    #[test]
    fn invalid_namings_are_refused() {
        let refused = |spoil: fn(&mut NamingSet)| {
            let mut set = every_naming();
            spoil(&mut set);
            let read = decode::<NamingSet>(&encode(&set));
            assert!(matches!(read, Err(WireError::Invalid(_))), "{set:?}");
        };
        assert_eq!(decode(&encode(&every_naming())), Ok(every_naming()));
        refused(|set| set.namings.swap(0, 1));
        refused(|set| set.namings[1].person = set.namings[0].person);
        refused(|set| {
            if let Finding::Named { subject, .. } = &mut set.namings[0].finding {
                subject.clear();
            }
        });
        refused(|set| {
            if let Finding::Named { why, .. } = &mut set.namings[0].finding {
                why.log_ratio = f32::NAN;
            }
        });
    }
}
