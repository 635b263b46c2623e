//! Tests of the combined effect of edits.

use std::path::Path;

use proptest::prelude::*;

use super::change::check_name;
use super::identities::PersonRoll;
use super::{Change, Edit, EditList, Identities, Roll};

/// Persons 3 and 7 one after the other; 9 overlaps both and has a gap.
fn roll() -> Roll {
    let mut roll = Roll::default();
    for tick in 0..300 {
        if tick < 100 {
            roll.add(tick, 3);
        }
        if tick >= 150 {
            roll.add(tick, 7);
        }
        if !(40..50).contains(&tick) {
            roll.add(tick, 9);
        }
    }
    roll
}

fn edit(change: Change) -> Edit {
    Edit {
        at: "2026-03-01T18:30:05Z".to_owned(),
        change,
    }
}

fn name(person: u32, name: &str) -> Change {
    Change::Name {
        person,
        name: name.to_owned(),
    }
}

fn list(changes: impl IntoIterator<Item = Change>) -> EditList {
    let text: String = changes
        .into_iter()
        .map(|change| edit(change).line())
        .collect();
    EditList::parse(&text, Path::new("edits.jsonl")).unwrap()
}

fn refused(changes: &[Change]) -> String {
    let list = list(changes.iter().cloned());
    list.identities(Some(&roll()))
        .unwrap_err()
        .in_file(Path::new("edits.jsonl"))
        .to_string()
}

#[test]
fn ids_that_never_overlap_can_be_merged() {
    let list = list([name(7, "Anna"), Change::Merge { person: 7, into: 3 }]);
    let identities = list.identities(Some(&roll())).unwrap();
    assert_eq!(identities.person_at(200, 7), Some(3));
    assert_eq!(identities.person_at(50, 3), Some(3));
    // The name of the merged id is kept.
    assert_eq!(identities.names(), &[(3, "Anna".to_owned())].into());
    let people = identities.people(&roll());
    let expected = PersonRoll {
        span: [0, 299],
        ticks: 250,
        gaps: 1,
    };
    assert_eq!(people.get(&3), Some(&expected));
    assert_eq!(people.keys().copied().collect::<Vec<_>>(), [3, 9]);
}

#[test]
fn overlapping_ids_cannot_be_merged() {
    let error = refused(&[Change::Merge { person: 9, into: 3 }]);
    assert_eq!(
        error,
        "edits.jsonl:1: found persons 9 and 3 both at ticks 0 to 39, 50 to 99 (90 in all), expected one of them at a time"
    );
}

#[test]
fn a_split_creates_an_id_that_can_be_named_and_merged() {
    let split = Change::Split {
        person: 9,
        tick: 120,
        new: 10,
    };
    let list = list([
        split.clone(),
        name(10, "Bo"),
        Change::Split {
            person: 10,
            tick: 200,
            new: 11,
        },
    ]);
    let identities = list.identities(Some(&roll())).unwrap();
    let at = |tick| identities.person_at(tick, 9);
    assert_eq!(
        [at(119), at(120), at(199), at(200)],
        [Some(9), Some(10), Some(10), Some(11)]
    );
    assert!(identities.has_made(11) && identities.whole(9).is_none());
    let error = refused(&[Change::Split {
        person: 3,
        tick: 100,
        new: 10,
    }]);
    assert!(
        error.contains("found tick 100, expected one from 1 to 99"),
        "{error}"
    );
    let error = refused(&[Change::Split {
        person: 3,
        tick: 50,
        new: 7,
    }]);
    assert!(error.contains("found 7 as the new id"), "{error}");
    // Merged again.
    let merged = [
        split,
        Change::Merge {
            person: 10,
            into: 9,
        },
    ];
    let identities = self::list(merged).identities(Some(&roll())).unwrap();
    assert_eq!(identities.whole(9), Some(9));
}

#[test]
fn dropped_and_merged_people_cannot_be_edited() {
    for gone in [
        Change::Drop { person: 7 },
        Change::Merge { person: 7, into: 3 },
    ] {
        let list = list([gone.clone(), name(7, "Anna")]);
        let error = list.identities(None).unwrap_err().to_string();
        assert!(
            error.starts_with("edit 2: found person 7, which was merged"),
            "{error}"
        );
        let error = refused(&[gone, name(7, "Anna")]);
        assert!(
            error.contains("edits.jsonl:2: found person 7, expected one of [3, 9]"),
            "{error}"
        );
    }
}

#[test]
fn names_of_unknown_people_are_read_but_not_added() {
    let list = list([name(77, "Anna"), name(3, "Bo")]);
    let identities = list.identities(Some(&roll())).unwrap();
    assert_eq!(identities.names().get(&3).map(String::as_str), Some("Bo"));
    let undo = edit(Change::Undo { number: 1 });
    assert_eq!(list.with(undo, Some(&roll())).unwrap().in_force().len(), 1);
    let new_edit = list.with(edit(name(78, "Cy")), Some(&roll()));
    let error = new_edit.unwrap_err().to_string();
    assert!(
        error.contains("found person 78, expected one of"),
        "{error}"
    );
}

#[test]
fn an_undo_that_invalidates_a_later_edit_is_refused() {
    let split = Change::Split {
        person: 9,
        tick: 120,
        new: 10,
    };
    let list = list([split, name(10, "Bo")]);
    let undo = |number| edit(Change::Undo { number });
    let error = list.with(undo(1), Some(&roll())).unwrap_err().to_string();
    assert_eq!(
        error,
        "edit 3: edit 2: found person 10, expected one of [3, 7, 9]: undo edit 2 before"
    );
    let list = list.with(undo(2), Some(&roll())).unwrap();
    let list = list.with(undo(1), Some(&roll())).unwrap();
    assert!(list.in_force().is_empty());
    for (number, error) in [
        (1, "undone already"),
        (3, "is an undo"),
        (9, "an edit before"),
    ] {
        let refused = list.with(undo(number), None).unwrap_err().to_string();
        assert!(refused.contains(error), "{refused}");
    }
}

#[test]
fn invalid_lines_are_refused_with_their_field() {
    let good = edit(name(3, "Anna")).line();
    for (line, error) in [
        ("{", "edits.jsonl:3: EOF while parsing"),
        (
            r#"{"at":"now","edit":"rename","person":3}"#,
            "edits.jsonl:3: `edit`: found \"rename\", expected one of name, guess, merge",
        ),
        (
            r#"{"at":"now","edit":"name","person":3}"#,
            "edits.jsonl:3: `name`: missing",
        ),
        (
            r#"{"at":"now","edit":"drop","person":3,"into":7}"#,
            "`into`: found it with the edit `drop`",
        ),
        (
            r#"{"at":"now","edit":"merge","person":3,"into":3}"#,
            "`into`: found 3, expected another",
        ),
        (
            r#"{"at":"now","edit":"name","person":3,"name":"a\nb"}"#,
            "`name`: found \"a\\nb\", expected",
        ),
        (
            r#"{"at":"now","edit":"undo","number":3}"#,
            "`number`: found 3, expected the number of an edit before",
        ),
        (
            r#"{"at":"now","edit":"drop","person":-1}"#,
            "edits.jsonl:3: invalid value",
        ),
        (
            r#"{"at":"now","edit":"drop","person":1,"who":2}"#,
            "unknown field `who`",
        ),
    ] {
        let text = format!("{good}\n{line}\n");
        let refused = EditList::parse(&text, Path::new("edits.jsonl")).unwrap_err();
        assert!(refused.to_string().contains(error), "{refused}\n{error}");
    }
    assert!(check_name(&"a".repeat(65)).is_err());
}

#[test]
fn names_with_direction_marks_are_read_but_not_added() {
    let line = "{\"at\":\"now\",\"edit\":\"name\",\"person\":1,\"name\":\"\u{5d3}\u{5e0}\u{5d4}\u{200f}\"}\n";
    assert!(EditList::parse(line, Path::new("edits.jsonl")).is_ok());
    let given = check_name("\u{5d3}\u{5e0}\u{5d4}\u{200f}").unwrap_err();
    assert!(given.contains("invisible"), "{given}");
}

#[test]
fn a_full_file_of_undos_is_read() {
    let half = 50_000;
    let named = (0..half).map(|n| Change::Name {
        person: 3,
        name: format!("p{n}"),
    });
    let undone = (1..=half).rev().map(|number| Change::Undo { number });
    let text: String = named.chain(undone).map(|it| edit(it).line()).collect();
    let list = EditList::parse(&text, Path::new("edits.jsonl")).unwrap();
    assert_eq!(list.all().count(), 2 * half);
    assert!(list.in_force().is_empty());
}

fn any_change() -> impl Strategy<Value = Change> {
    let id = 1_u32..12;
    prop_oneof![
        (id.clone(), "[A-Z][a-z]{0,5}").prop_map(|(person, name)| Change::Name { person, name }),
        (id.clone(), id.clone()).prop_map(|(person, into)| Change::Merge { person, into }),
        (id.clone(), -5_i64..320, 10_u32..20).prop_map(|(person, tick, new)| Change::Split {
            person,
            tick,
            new
        }),
        id.prop_map(|person| Change::Drop { person }),
        (1_usize..12).prop_map(|number| Change::Undo { number }),
    ]
}

/// Applies those of `changes` that are possible, one after the other.
fn possible(changes: Vec<Change>) -> EditList {
    changes
        .into_iter()
        .fold(EditList::default(), |list, change| {
            list.with(edit(change), Some(&roll())).unwrap_or(list)
        })
}

proptest! {
    #[test]
    fn undoing_from_the_end_restores_earlier_states(changes in prop::collection::vec(any_change(), 0..20)) {
        let mut list = possible(changes);
        loop {
            let in_force: Vec<usize> = list.in_force().iter().map(|(number, _)| *number).collect();
            let Some(&last) = in_force.last() else { break };
            list = list.with(edit(Change::Undo { number: last }), Some(&roll())).unwrap();
            prop_assert_eq!(list.in_force().len(), in_force.len() - 1);
        }
        prop_assert_eq!(list.identities(Some(&roll())).unwrap(), Identities::default());
        for id in [3, 7, 9] {
            prop_assert_eq!(Identities::default().person_at(70, id), Some(id));
        }
    }

    #[test]
    fn edits_without_drops_keep_every_pose_exactly_once(changes in prop::collection::vec(any_change(), 0..20)) {
        let changes = changes.into_iter().filter(|change| !matches!(change, Change::Drop { .. }));
        let identities = possible(changes.collect()).identities(Some(&roll())).unwrap();
        for tick in [0, 45, 99, 100, 149, 150, 299] {
            let present: Vec<u32> = [3, 7, 9].into_iter().filter(|&id| {
                Identities::default().edited(&roll())[&id].iter().any(|ticks| ticks.contains(&tick))
            }).collect();
            let mut shown: Vec<u32> = present.iter().filter_map(|&id| identities.person_at(tick, id)).collect();
            shown.sort_unstable();
            shown.dedup();
            prop_assert_eq!(shown.len(), present.len(), "at tick {}", tick);
        }
    }

    #[test]
    fn a_written_list_reads_back_with_the_same_effect(changes in prop::collection::vec(any_change(), 0..20)) {
        let written = possible(changes);
        let text: String = written.all().map(|(_, edit)| edit.line()).collect();
        let read = EditList::parse(&text, Path::new("edits.jsonl")).unwrap();
        prop_assert_eq!(read.identities(None), written.identities(Some(&roll())));
        prop_assert_eq!(read, written);
    }
}
