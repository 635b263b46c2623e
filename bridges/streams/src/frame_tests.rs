//! Tests of frames: people, names, roster.

use std::path::Path;

use farfield_export::edits::EditList;
use farfield_export::skeleton::Bone;

use super::*;
use crate::synthetic;

fn ids(roster: &Roster) -> Vec<u32> {
    roster.ids().map(|PersonId(id)| id).collect()
}

#[test]
fn joints_can_be_recovered_from_the_export_skeleton() {
    let frame = synthetic::frame(33);
    for person in &frame.persons {
        let heads_m = person.motion.heads_m(&person.rig);
        for bone in Bone::ALL {
            if !matches!(bone, Bone::LeftToes | Bone::RightToes) {
                let apart_m = heads_m[bone.index()] - person.joints_m[bone.joint().index()];
                assert!(apart_m.norm() < 1e-9, "{bone:?}");
            }
        }
    }
}

#[test]
fn missing_people_stay_in_the_roster_for_ten_seconds() {
    let mut maker = FrameMaker::new(synthetic::facts());
    let both = maker.frame(&synthetic::poses_at(2, 0)).roster;
    assert_eq!((ids(&both), both.version), (vec![1, 2], 1));
    let after = maker.frame(&synthetic::poses_at(1, 600)).roster;
    assert_eq!((ids(&after), after.version), (vec![1, 2], 1));
    let gone = maker.frame(&synthetic::poses_at(1, 601)).roster;
    assert_eq!((ids(&gone), gone.version), (vec![1], 2));
    // A person who returns is appended to the list.
    let mut poses = synthetic::poses_at(2, 602);
    poses.persons.swap(0, 1);
    let back = maker.frame(&poses).roster;
    assert_eq!((ids(&back), back.version), (vec![1, 2], 3));
}

#[test]
fn new_names_apply_from_the_next_tick() {
    let mut maker = FrameMaker::new(synthetic::facts());
    let before = maker.frame(&synthetic::poses_at(2, 0));
    maker.edit(edited(
        "{\"at\":\"\",\"edit\":\"name\",\"person\":2,\"name\":\"Anna\"}\n",
    ));
    let after = maker.frame(&synthetic::poses_at(2, 1));
    let names = |frame: &Frame| -> Vec<String> {
        let listed = frame.roster.people.iter().map(|it| it.name.to_string());
        let there = frame.persons.iter().map(|it| it.name.to_string());
        listed.chain(there).collect()
    };
    assert_eq!(names(&after), ["person_1", "Anna", "person_1", "Anna"]);
    assert_ne!(before.roster.version, after.roster.version);
    let named =
        |id| format!("{{\"at\":\"\",\"edit\":\"name\",\"person\":{id},\"name\":\"Anna\"}}\n");
    maker.edit(edited(&(named(1) + &named(2))));
    let repeated = maker.frame(&synthetic::poses_at(2, 2));
    assert_eq!(names(&repeated), ["Anna 1", "Anna 2", "Anna 1", "Anna 2"]);
}

fn edited(lines: &str) -> Identities {
    let list = EditList::parse(lines, Path::new("edits.jsonl")).unwrap();
    list.identities(None).unwrap()
}

#[test]
fn merged_people_are_one_from_the_next_tick() {
    let mut maker = FrameMaker::new(synthetic::facts());
    let before = maker.frame(&synthetic::poses_at(2, 0));
    assert_eq!(ids(&before.roster), [1, 2]);
    let merge = r#"{"at":"","edit":"merge","person":2,"into":1}"#;
    maker.edit(edited(&format!("{merge}\n")));
    // Of two poses at one tick, the better seen one is used.
    let mut poses = synthetic::poses_at(2, 1);
    poses.persons[0].state = PersonState::Coasting;
    let second = poses.persons[1].joints_m[0];
    let after = maker.frame(&poses);
    assert_eq!((after.persons.len(), ids(&after.roster)), (1, vec![1]));
    assert_eq!(after.persons[0].id, PersonId(1));
    assert_eq!(
        after.persons[0].joints_m[0].map(|v| v as f32),
        Vector3::from(second)
    );
    // A single remaining pose has the merged id.
    poses.tick = Tick(2);
    poses.persons.remove(0);
    let alone = maker.frame(&poses);
    assert_eq!(alone.persons[0].id, PersonId(1));
    assert_eq!(alone.roster.version, after.roster.version);
}

#[test]
fn split_people_change_id_and_dropped_people_are_not_streamed() {
    let mut maker = FrameMaker::new(synthetic::facts());
    let split = r#"{"at":"","edit":"split","person":1,"tick":5,"new":9}"#;
    let drop = r#"{"at":"","edit":"drop","person":2}"#;
    maker.edit(edited(&format!("{split}\n{drop}\n")));
    let ids_in = |frame: &Frame| frame.persons.iter().map(|it| it.id.0).collect::<Vec<_>>();
    assert_eq!(ids_in(&maker.frame(&synthetic::poses_at(2, 4))), [1]);
    assert_eq!(ids_in(&maker.frame(&synthetic::poses_at(2, 5))), [9]);
}

#[test]
fn tentative_people_are_in_frames_but_not_in_the_roster() {
    let mut maker = FrameMaker::new(synthetic::facts());
    let mut poses = synthetic::poses_at(2, 0);
    poses.persons[1].state = PersonState::Tentative;
    let frame = maker.frame(&poses);
    assert_eq!(frame.persons.len(), 2);
    assert_eq!(ids(&frame.roster), [1]);
    assert!(frame.find(PersonId(2)).is_none());
}

#[test]
fn invalid_poses_are_dropped_and_counted() {
    let mut maker = FrameMaker::new(synthetic::facts());
    let mut poses = synthetic::poses_at(4, 0);
    poses.persons[0].joints_m[3][1] = f32::NAN;
    poses.persons[1].joints_m.pop();
    poses.persons[2].angles.clear();
    let frame = maker.frame(&poses);
    assert_eq!(frame.persons.len(), 1);
    assert_eq!(frame.persons[0].id, PersonId(4));
    assert_eq!(maker.unreadable(), 3);
}

#[test]
fn a_new_session_starts_at_time_0_without_earlier_people() {
    let mut maker = FrameMaker::new(synthetic::facts());
    maker.frame(&synthetic::poses_at(2, 1000));
    let before = maker.frame(&synthetic::poses_at(2, 1030));
    assert_eq!(before.elapsed_us(), 500_000);
    let mut poses = synthetic::poses_at(1, 1031);
    poses.session = SessionId(8);
    let frame = maker.frame(&poses);
    assert_eq!((frame.elapsed_us(), ids(&frame.roster)), (0, vec![1]));
    assert_ne!(frame.roster.version, before.roster.version);
    // The same applies if the tick goes backwards.
    let again = maker.frame(&synthetic::poses_at(1, 5));
    assert_eq!(again.elapsed_us(), 0);
}
