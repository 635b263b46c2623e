//! What edits come to.

use std::path::Path;

use proptest::prelude::*;

use super::change::check_name;
use super::roll::PersonRoll;
use super::{Change, Edit, EditList, Identities, Roll};

/// Persons 3 and 7 one after the other, 9 beside both with a gap.
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
fn two_ids_that_are_never_there_together_become_one_person() {
    let list = list([name(7, "Anna"), Change::Merge { person: 7, into: 3 }]);
    let identities = list.identities(Some(&roll())).unwrap();
    assert_eq!(identities.person_at(200, 7), Some(3));
    assert_eq!(identities.person_at(50, 3), Some(3));
    // Who has no name takes that of the other.
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
fn who_is_there_twice_is_not_one_person() {
    let told = refused(&[Change::Merge { person: 9, into: 3 }]);
    assert_eq!(
        told,
        "edits.jsonl:1: found persons 9 and 3 both at ticks 0 to 39, 50 to 99 (90 in all), expected one of them at a time"
    );
}

#[test]
fn a_split_gives_the_rest_another_id_which_can_be_named_and_merged() {
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
    let told = refused(&[Change::Split {
        person: 3,
        tick: 100,
        new: 10,
    }]);
    assert!(
        told.contains("found tick 100, expected one from 1 to 99"),
        "{told}"
    );
    let told = refused(&[Change::Split {
        person: 3,
        tick: 50,
        new: 7,
    }]);
    assert!(told.contains("found 7 as the new id"), "{told}");
    // Back together.
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
fn who_is_left_out_or_merged_cannot_be_edited_any_more() {
    for gone in [
        Change::Drop { person: 7 },
        Change::Merge { person: 7, into: 3 },
    ] {
        let list = list([gone.clone(), name(7, "Anna")]);
        let told = list.identities(None).unwrap_err().to_string();
        assert!(
            told.starts_with("edit 2: found person 7, who is not there any more"),
            "{told}"
        );
        let told = refused(&[gone, name(7, "Anna")]);
        assert!(
            told.contains("edits.jsonl:2: found person 7, expected one of [3, 9]"),
            "{told}"
        );
    }
}

#[test]
fn a_name_of_somebody_whom_the_poses_lack_is_borne_in_the_file_and_refused_anew() {
    let list = list([name(77, "Anna"), name(3, "Bo")]);
    let identities = list.identities(Some(&roll())).unwrap();
    assert_eq!(identities.names().get(&3).map(String::as_str), Some("Bo"));
    let undo = edit(Change::Undo { number: 1 });
    assert_eq!(list.with(undo, Some(&roll())).unwrap().in_force().len(), 1);
    let anew = list.with(edit(name(78, "Cy")), Some(&roll()));
    let told = anew.unwrap_err().to_string();
    assert!(told.contains("found person 78, expected one of"), "{told}");
}

#[test]
fn an_undo_that_would_leave_a_later_edit_without_ground_is_refused() {
    let split = Change::Split {
        person: 9,
        tick: 120,
        new: 10,
    };
    let list = list([split, name(10, "Bo")]);
    let undo = |number| edit(Change::Undo { number });
    let told = list.with(undo(1), Some(&roll())).unwrap_err().to_string();
    assert_eq!(
        told,
        "edit 3: edit 2: found person 10, expected one of [3, 7, 9]: undo edit 2 before"
    );
    let list = list.with(undo(2), Some(&roll())).unwrap();
    let list = list.with(undo(1), Some(&roll())).unwrap();
    assert!(list.in_force().is_empty());
    for (number, told) in [
        (1, "undone already"),
        (3, "is an undo"),
        (9, "an edit before"),
    ] {
        let refused = list.with(undo(number), None).unwrap_err().to_string();
        assert!(refused.contains(told), "{refused}");
    }
}

#[test]
fn a_line_that_is_none_is_named_with_its_field() {
    let good = edit(name(3, "Anna")).line();
    for (line, told) in [
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
        assert!(refused.to_string().contains(told), "{refused}\n{told}");
    }
    assert!(check_name(&"a".repeat(65)).is_err());
}

#[test]
fn a_name_that_turns_text_is_read_where_it_stands_and_given_to_nobody() {
    let line = "{\"at\":\"now\",\"edit\":\"name\",\"person\":1,\"name\":\"\u{5d3}\u{5e0}\u{5d4}\u{200f}\"}\n";
    assert!(EditList::parse(line, Path::new("edits.jsonl")).is_ok());
    let given = check_name("\u{5d3}\u{5e0}\u{5d4}\u{200f}").unwrap_err();
    assert!(given.contains("not seen"), "{given}");
}

#[test]
fn as_many_undos_as_a_file_holds_are_read() {
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

/// What of `changes` can be, one after the other.
fn possible(changes: Vec<Change>) -> EditList {
    changes
        .into_iter()
        .fold(EditList::default(), |list, change| {
            list.with(edit(change), Some(&roll())).unwrap_or(list)
        })
}

proptest! {
    #[test]
    fn what_is_undone_from_the_end_gives_what_was_before(changes in prop::collection::vec(any_change(), 0..20)) {
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
    fn nobody_is_lost_but_who_is_left_out_and_nobody_is_there_twice(changes in prop::collection::vec(any_change(), 0..20)) {
        let changes = changes.into_iter().filter(|change| !matches!(change, Change::Drop { .. }));
        let identities = possible(changes.collect()).identities(Some(&roll())).unwrap();
        for tick in [0, 45, 99, 100, 149, 150, 299] {
            let there: Vec<u32> = [3, 7, 9].into_iter().filter(|&id| {
                Identities::default().edited(&roll())[&id].iter().any(|ticks| ticks.contains(&tick))
            }).collect();
            let mut shown: Vec<u32> = there.iter().filter_map(|&id| identities.person_at(tick, id)).collect();
            shown.sort_unstable();
            shown.dedup();
            prop_assert_eq!(shown.len(), there.len(), "at tick {}", tick);
        }
    }

    #[test]
    fn a_list_reads_back_as_it_was_written_and_comes_to_the_same(changes in prop::collection::vec(any_change(), 0..20)) {
        let written = possible(changes);
        let text: String = written.all().map(|(_, edit)| edit.line()).collect();
        let read = EditList::parse(&text, Path::new("edits.jsonl")).unwrap();
        prop_assert_eq!(read.identities(None), written.identities(Some(&roll())));
        prop_assert_eq!(read, written);
    }
}
