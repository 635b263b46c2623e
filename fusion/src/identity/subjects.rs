//! Which of the venue's subjects a person is, by the link lengths alone.
//!
//! As for returning people (`recognise.rs`), each pair of a person and a subject has the logarithm
//! of a likelihood ratio, and all pairs are decided together. There is no place term, so the
//! lengths must match better. An ambiguous person gets no name: the name of a stranger is worse
//! than none.

use std::collections::BTreeMap;
use std::sync::Arc;

use farfield_proto::id::PersonId;
use farfield_proto::message::naming::{BodyLikeness, Finding, Naming};

use super::recognise::{Lengths, Recognised, assign_best};
use crate::body::prior::BodyPrior;

/// Least ln of the likelihood ratio for a name: a factor of 20 against any person.
const LEAST_NAMED: f64 = 3.0;
/// Least ln of the likelihood ratio at which a pair competes with others. Such a person gets no
/// name, but may be the subject.
const LEAST_RIVAL: f64 = 0.0;
/// Greatest difference of two bodies of one person, also if there is no other candidate: root mean
/// square over the lengths' sigmas.
const FARTHEST_SIGMAS: f64 = 1.2;
/// Least gain of the whole assignment by a pair for a name. Measurement errors change all lengths
/// of a person together, so people a few centimetres apart cannot be distinguished with less.
const MARGIN_NAMED: f64 = 4.0;

/// A person who may come.
#[derive(Debug, Clone)]
pub struct Subject {
    /// The person's name.
    pub name: String,
    /// Prior of the body.
    pub body: Arc<BodyPrior>,
}

/// A confirmed person without a name.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Nameless {
    pub(crate) id: PersonId,
    pub(crate) lengths: Lengths,
    /// Whether the body was measured at this tick. Others compete for the subjects but get no name.
    pub(crate) is_due: bool,
    /// Whether it will not be measured again.
    pub(crate) is_last: bool,
}

/// The subjects, and which people have their names.
#[derive(Debug, Clone, Default)]
pub(crate) struct Subjects {
    all: Vec<Subject>,
    /// By index of the subject: the person.
    taken: BTreeMap<usize, PersonId>,
    /// People that were reported as matching no subject.
    reported: Vec<PersonId>,
}

impl Subjects {
    pub(crate) fn new(all: Vec<Subject>) -> Self {
        Self {
            all,
            ..Self::default()
        }
    }

    /// Whether there are no subjects.
    pub(crate) fn is_empty(&self) -> bool {
        self.all.is_empty()
    }

    /// Whether that person has a name.
    pub(crate) fn has(&self, id: PersonId) -> bool {
        self.taken.values().any(|taken| *taken == id)
    }

    /// The body prior of a person with a name.
    pub(crate) fn body_of(&self, id: PersonId) -> Option<&Arc<BodyPrior>> {
        let (index, _) = self.taken.iter().find(|(_, taken)| **taken == id)?;
        self.all.get(*index).map(|subject| &subject.body)
    }

    /// Frees the names of all people except those that `may_be_back`.
    pub(crate) fn forget(&mut self, may_be_back: impl Fn(PersonId) -> bool) {
        self.taken.retain(|_, id| may_be_back(*id));
        self.reported.retain(|id| may_be_back(*id));
    }

    /// Decides who the `nameless` are; returns the findings, by id.
    pub(crate) fn decide(&mut self, nameless: &[Nameless]) -> Vec<Naming> {
        let free: Vec<usize> = (0..self.all.len())
            .filter(|index| !self.taken.contains_key(index))
            .collect();
        if free.is_empty() {
            return Vec::new();
        }
        let known: Vec<Lengths> = free
            .iter()
            .map(|index| Lengths::from_prior(&self.all[*index].body))
            .collect();
        let pair = |own: &Lengths, known: &Lengths| {
            let is_near = own.sigmas(known) <= FARTHEST_SIGMAS;
            is_near.then(|| own.likeness(known))
        };
        let likeness: Vec<Vec<Option<f64>>> = nameless
            .iter()
            .map(|person| known.iter().map(|it| pair(&person.lengths, it)).collect())
            .collect();
        let chosen = assign_best(&likeness, LEAST_RIVAL);
        let due = || nameless.iter().zip(&chosen).filter(|(it, _)| it.is_due);
        let subject = |column: usize| (free[column], &known[column]);
        let mut namings = Vec::new();
        // Names first: the other findings depend on the names that are left.
        for (person, chosen) in due() {
            let Some(best) = chosen.as_ref().filter(|best| is_clear(best)) else {
                continue;
            };
            let (index, lengths) = subject(best.column);
            self.taken.insert(index, person.id);
            namings.push(Naming {
                person: person.id,
                finding: Finding::Named {
                    subject: self.all[index].name.clone(),
                    why: why(&person.lengths, lengths, best.log_ratio, best.margin),
                },
            });
        }
        for (person, chosen) in due() {
            if !person.is_last || self.reported.contains(&person.id) || self.has(person.id) {
                continue;
            }
            let finding = match chosen {
                Some(best) if best.log_ratio >= LEAST_NAMED => {
                    let (index, lengths) = subject(best.column);
                    Some(Finding::Ambiguous {
                        nearest: self.all[index].name.clone(),
                        why: why(&person.lengths, lengths, best.log_ratio, best.margin),
                    })
                }
                _ => self.unlike(person, &free, &known),
            };
            let Some(finding) = finding else { continue };
            self.reported.push(person.id);
            namings.push(Naming {
                person: person.id,
                finding,
            });
        }
        namings.sort_by_key(|naming| naming.person);
        namings
    }

    /// The finding for a person without a pair, among the free names: no subject is alike, or other
    /// people match it better.
    fn unlike(&self, person: &Nameless, free: &[usize], known: &[Lengths]) -> Option<Finding> {
        let own = &person.lengths;
        let pairs = free.iter().zip(known);
        let pairs = pairs.filter(|(index, _)| !self.taken.contains_key(index));
        let ratios = pairs.map(|(index, it)| (*index, it, own.likeness(it)));
        let (index, it, log_ratio) = ratios.max_by(|a, b| a.2.total_cmp(&b.2))?;
        let (nearest, why) = (self.all[index].name.clone(), why(own, it, log_ratio, None));
        let is_like = log_ratio >= LEAST_NAMED && own.sigmas(it) <= FARTHEST_SIGMAS;
        Some(if is_like {
            Finding::Ambiguous { nearest, why }
        } else {
            Finding::NobodyAlike { nearest, why }
        })
    }
}

/// Whether a pair is sure enough for a name.
fn is_clear(best: &Recognised) -> bool {
    best.log_ratio >= LEAST_NAMED && best.margin.is_none_or(|margin| margin >= MARGIN_NAMED)
}

fn why(own: &Lengths, known: &Lengths, log_ratio: f64, margin: Option<f64>) -> BodyLikeness {
    BodyLikeness {
        lengths_sigma: own.sigmas(known) as f32,
        log_ratio: log_ratio as f32,
        margin: margin.map(|margin| margin as f32),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::skeleton::{Proportions, Skeleton};

    fn subjects(statures_m: &[f64]) -> Subjects {
        let subject = |stature_m: &f64| Subject {
            name: format!("{:.0} cm", 100.0 * stature_m),
            body: Arc::new(BodyPrior::from_stature(*stature_m)),
        };
        Subjects::new(statures_m.iter().map(subject).collect())
    }

    fn nameless(id: u32, body: &Proportions, is_last: bool) -> Nameless {
        Nameless {
            id: PersonId(id),
            lengths: Lengths::from_skeleton(&Skeleton::new(body), 16.0),
            is_due: true,
            is_last,
        }
    }

    fn names(namings: &[Naming]) -> Vec<(u32, Option<&str>)> {
        namings.iter().map(|it| (it.person.0, it.name())).collect()
    }

    #[test]
    fn people_get_the_names_of_matching_subjects() {
        let mut subjects = subjects(&[1.55, 1.95]);
        let [tall, short] = [1.95, 1.55].map(Proportions::from_stature);
        let found = subjects.decide(&[nameless(3, &tall, false), nameless(4, &short, false)]);
        assert_eq!(names(&found), [(3, Some("195 cm")), (4, Some("155 cm"))]);
        assert!(subjects.has(PersonId(3)) && subjects.body_of(PersonId(4)).is_some());
        // A name in use is not given again until its person cannot come back.
        let again = [nameless(5, &tall, true)];
        assert!(subjects.decide(&again).is_empty());
        subjects.forget(|id| id == PersonId(4));
        assert_eq!(names(&subjects.decide(&again)), [(5, Some("195 cm"))]);
    }

    #[test]
    fn strangers_and_ambiguous_people_are_reported_once_without_a_name() {
        let mut alike = subjects(&[1.80, 1.80]);
        let body = Proportions::from_stature(1.8);
        assert!(alike.decide(&[nameless(3, &body, false)]).is_empty());
        let namings = alike.decide(&[nameless(3, &body, true)]);
        assert!(
            matches!(namings[0].finding, Finding::Ambiguous { .. }),
            "{namings:?}"
        );
        assert!(alike.decide(&[nameless(3, &body, true)]).is_empty());
        let mut other = subjects(&[1.50]);
        let namings = other.decide(&[nameless(3, &body, true)]);
        assert!(
            matches!(namings[0].finding, Finding::NobodyAlike { .. }),
            "{namings:?}"
        );
        // Two people who are like one subject.
        let mut one = subjects(&[1.80]);
        let namings = one.decide(&[nameless(3, &body, true), nameless(4, &body, true)]);
        assert_eq!(names(&namings), [(3, None), (4, None)]);
        let is_ambiguous = |it: &Naming| matches!(it.finding, Finding::Ambiguous { .. });
        assert!(namings.iter().all(is_ambiguous), "{namings:?}");
    }

    #[test]
    fn a_stranger_is_compared_with_the_free_names() {
        let [tall, taller] = [1.80, 2.02].map(Proportions::from_stature);
        for order in [[3, 4], [4, 3]] {
            let mut subjects = subjects(&[1.80, 1.50]);
            let two = order.map(|id| match id {
                3 => nameless(3, &tall, true),
                _ => nameless(4, &taller, true),
            });
            let found = subjects.decide(&two);
            assert_eq!(names(&found), [(3, Some("180 cm")), (4, None)]);
            let Finding::NobodyAlike { nearest, .. } = &found[1].finding else {
                panic!("{found:?}");
            };
            assert_eq!(nearest, "150 cm", "the other name is taken");
        }
        // If no name is left, there is no finding.
        let mut one = subjects(&[1.80]);
        let found = one.decide(&[nameless(3, &tall, true), nameless(4, &taller, true)]);
        assert_eq!(names(&found), [(3, Some("180 cm"))]);
    }

    #[test]
    fn an_unmeasured_person_competes_but_gets_no_name() {
        let mut one = subjects(&[1.80]);
        let body = Proportions::from_stature(1.8);
        let waits = Nameless {
            is_due: false,
            ..nameless(4, &body, false)
        };
        assert!(one.decide(&[nameless(3, &body, false), waits]).is_empty());
        assert!(!one.has(PersonId(3)) && !one.has(PersonId(4)));
    }
}
