//! Tests of names: a person gets the name of a subject once its body is measured well enough.

use std::sync::Arc;

use farfield_proto::message::naming::{Finding, Naming};

use super::*;
use crate::body::prior::BodyPrior;
use crate::body::skeleton::Proportions;
use crate::identity::subjects::Subject;

/// Time of the last measurement of bodies, seconds.
const MEASURED_S: f64 = 18.0;

impl HallFixture {
    fn knowing(statures_m: &[f64]) -> Self {
        let mut stage = Self::new();
        let subject = |stature_m: &f64| Subject {
            name: format!("{stature_m:.2}"),
            body: Arc::new(BodyPrior::from_stature(*stature_m)),
        };
        stage
            .registry
            .know(statures_m.iter().map(subject).collect());
        stage
    }

    /// The namings while the same people stay.
    fn namings(&mut self, bodies: &[TruePoints], seconds: f64) -> Vec<Naming> {
        (0..(seconds * RATE_HZ) as usize)
            .flat_map(|_| self.step(bodies).namings)
            .collect()
    }
}

fn named(namings: &[Naming]) -> Vec<(u32, &str)> {
    let named = namings.iter();
    named
        .filter_map(|it| Some((it.person.0, it.name()?)))
        .collect()
}

#[test]
fn two_subjects_of_different_size_get_and_keep_their_names() {
    let mut stage = HallFixture::knowing(&[1.55, 1.95]);
    let bodies = [person(-2.0, 0.0, 1.95), person(2.0, 1.0, 1.55)];
    let namings = stage.namings(&bodies, MEASURED_S);
    let (tall, short) = (stage.who_at(-2.0, 0.0), stage.who_at(2.0, 1.0));
    let mut expected = [(tall.unwrap(), "1.95"), (short.unwrap(), "1.55")];
    let mut found = named(&namings);
    expected.sort_unstable();
    found.sort_unstable();
    assert_eq!(found, expected);
    // A person who comes back keeps its name: there is no second naming.
    stage.go_on(&bodies[1..], 6.0);
    assert!(named(&stage.namings(&bodies, MEASURED_S)).is_empty());
    assert_eq!(stage.who_at(-2.0, 0.0), tall);
}

#[test]
fn a_stranger_is_reported_once_without_a_name() {
    let mut stage = HallFixture::knowing(&[1.55]);
    let namings = stage.namings(&[person(0.0, 0.0, 1.9)], 2.0 * MEASURED_S);
    let [naming] = namings.as_slice() else {
        panic!("{namings:?}")
    };
    assert!(
        matches!(naming.finding, Finding::NobodyAlike { .. }),
        "{naming}"
    );
}

#[test]
fn a_team_is_measured_in_parts_unless_there_are_subjects() {
    let team: Vec<TruePoints> = (0..10)
        .map(|i| {
            let [row, place] = [i / 5, i % 5].map(f64::from);
            person(-3.0 + 1.5 * place, -1.0 + 2.0 * row, 1.75)
        })
        .collect();
    for (subjects_m, expected) in [(&[][..], &[8, 2][..]), (&[1.3], &[10])] {
        let mut stage = HallFixture::knowing(subjects_m);
        // They are confirmed within a second, and measured 2 and 4 s later.
        stage.go_on(&team, 1.5);
        let lengths = |stage: &HallFixture| -> Vec<Proportions> {
            let bodies = stage.registry.tracks().iter().map(|it| &it.estimator.body);
            bodies.map(|body| *body.skeleton.proportions()).collect()
        };
        let (mut before, mut measured) = (lengths(&stage), Vec::new());
        for _ in 0..(2.0 * RATE_HZ) as usize {
            stage.step(&team);
            let now = lengths(&stage);
            let new = now.iter().zip(&before).filter(|(now, was)| now != was);
            measured.extend(Some(new.count()).filter(|n| *n > 0));
            before = now;
        }
        assert_eq!(measured, expected);
    }
}

#[test]
fn lengths_move_to_the_subject_only_when_it_is_named() {
    // The true stature is 1.80 m: as near to the subject's 1.82 m as two measurements of one
    // person.
    let lengths = |subjects: &[f64]| {
        let mut stage = HallFixture::knowing(subjects);
        let body = [person(0.0, 0.0, 1.8)];
        let mut seen = Vec::new();
        for _ in 0..(MEASURED_S * RATE_HZ) as usize {
            let namings = stage.step(&body).namings;
            let track = stage.registry.tracks().first();
            let arm_m = track.map(|it| it.estimator.body.skeleton.proportions().upper_arm_m);
            seen.push((arm_m, !named(&namings).is_empty()));
        }
        seen
    };
    let (without, with) = (lengths(&[]), lengths(&[1.82]));
    let at = with.iter().position(|(_, is_named)| *is_named).unwrap();
    assert_eq!(without[..at], with[..at]);
    let known_m = Proportions::from_stature(1.82).upper_arm_m;
    let [free_m, drawn_m] = [&without, &with].map(|all| all.last().unwrap().0.unwrap());
    assert!(
        (drawn_m - known_m).abs() < (free_m - known_m).abs(),
        "{drawn_m} {free_m}"
    );
    let changes = with.windows(2).filter(|two| two[0].0 != two[1].0);
    let without = without.windows(2).filter(|two| two[0].0 != two[1].0);
    assert!(changes.count() <= without.count() + 1);
}
