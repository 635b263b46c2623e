//! Contents of a run's files, also after an interrupted run.

use std::fs;

use farfield_proto::message::PersonState::Tracked;

use super::super::disk_policy::GiveUp;
use super::super::fixture;
use super::*;

fn written(ticks: &[(i64, &[u32])]) -> (tempfile::TempDir, Vec<Presence>) {
    let folder = tempfile::tempdir().unwrap();
    let mut files = PoseFiles::create(
        folder.path(),
        fixture::layout(),
        50.0,
        RunEnd::Known,
        Arc::new(GiveUp),
    )
    .unwrap();
    for &(tick, ids) in ticks {
        let persons: Vec<_> = ids.iter().map(|&id| (id, Tracked)).collect();
        files.write(&fixture::poses(tick, &persons)).unwrap();
    }
    let written = files.finish();
    assert!(written.failure.is_none() && written.unwritten_ticks == 0);
    (folder, written.people)
}

#[test]
fn a_run_has_lines_and_two_files_per_person() {
    let (folder, presences) = written(&[(10, &[2, 1]), (11, &[2])]);
    let mut names: Vec<String> = fs::read_dir(folder.path())
        .unwrap()
        .map(|e| e.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    assert_eq!(
        names,
        [
            "angles_1.mot",
            "angles_2.mot",
            "poses.jsonl",
            "poses_1.trc",
            "poses_2.trc"
        ]
    );
    let lines = fs::read_to_string(folder.path().join("poses.jsonl")).unwrap();
    let heads: Vec<&str> = lines.lines().map(|line| &line[..22]).collect();
    let head = |tick: i64, person: u32| format!("{{\"tick\":{tick},\"person\":{person},");
    assert_eq!(heads, [head(10, 1), head(10, 2), head(11, 2)]);
    assert_eq!(
        (
            presences[1].first_tick,
            presences[1].last_tick,
            presences[1].ticks
        ),
        (Tick(10), Tick(11), 2)
    );
}

#[test]
fn files_share_one_clock_and_have_blank_rows_for_absences() {
    let (folder, presences) = written(&[
        (8, &[]),
        (9, &[]),
        (10, &[1]),
        (11, &[]),
        (12, &[1]),
        (13, &[2]),
    ]);
    assert_eq!(presences[0].first_tick, Tick(10));
    let read = |name: &str| fs::read_to_string(folder.path().join(name)).unwrap();
    let rows = |name: &str, head: usize| -> Vec<String> {
        let text = read(name);
        let rows = text.lines().skip(head);
        rows.map(|row| row.split('\t').take(3).collect::<Vec<_>>().join(" "))
            .collect()
    };
    assert_eq!(
        rows("poses_1.trc", 5),
        [
            "8 0.000000 ",
            "9 0.020000 ",
            "10 0.040000 2.00000",
            "11 0.060000 ",
            "12 0.080000 2.00000",
            "13 0.100000 "
        ]
    );
    assert_eq!(rows("poses_2.trc", 5).len(), 6);
    assert!(read("poses_1.trc").contains("\n50\t50\t6\t3\tm\t50\t8\t6\n"));
    assert!(read("angles_1.mot").contains("nRows=2\n"));
    let angles = rows("angles_1.mot", 11);
    assert_eq!(
        angles,
        ["0.040000 30.000001 2.500000", "0.080000 30.000001 2.500000"]
    );
    assert!(rows("angles_2.mot", 11)[0].starts_with("0.100000 "));
}

#[test]
fn an_absence_of_hours_has_no_rows() {
    let hours = 8 * 3600 * 50;
    let (folder, _) = written(&[(0, &[1]), (hours, &[1, 2])]);
    let rows = |name: &str| {
        let text = fs::read_to_string(folder.path().join(name)).unwrap();
        text.lines().count() - 5
    };
    assert_eq!((rows("poses_1.trc"), rows("poses_2.trc")), (2, 1));
    let text = fs::read_to_string(folder.path().join("poses_2.trc")).unwrap();
    assert!(
        text.contains("\n1440000\t28800.000000\t"),
        "the clock is the run's"
    );
}

#[test]
fn a_run_without_people_has_an_empty_file_of_lines() {
    let (folder, presences) = written(&[(0, &[])]);
    assert!(presences.is_empty());
    assert_eq!(
        fs::read_to_string(folder.path().join("poses.jsonl")).unwrap(),
        ""
    );
}

#[test]
fn an_abandoned_run_leaves_no_partial_files() {
    let folder = tempfile::tempdir().unwrap();
    let mut files = PoseFiles::create(
        folder.path(),
        fixture::layout(),
        50.0,
        RunEnd::Known,
        Arc::new(GiveUp),
    )
    .unwrap();
    files.write(&fixture::poses(0, &[(1, Tracked)])).unwrap();
    drop(files);
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
}

#[test]
fn ticks_out_of_order_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let mut files = PoseFiles::create(
        folder.path(),
        fixture::layout(),
        50.0,
        RunEnd::Known,
        Arc::new(GiveUp),
    )
    .unwrap();
    files.write(&fixture::poses(5, &[])).unwrap();
    let error = files.write(&fixture::poses(5, &[])).unwrap_err();
    assert_eq!(error.to_string(), "tick 5 came after tick 5");
}

/// Writes this many ticks of two people, all synced every `sync_every` ticks, while the disk fails
/// from tick 50 on; returns the files by name.
fn written_while(
    n_ticks: i64,
    sync_every: i64,
    fail: impl Fn(),
) -> (BTreeMap<String, String>, Written) {
    let folder = tempfile::tempdir().unwrap();
    let (layout, disk) = (fixture::layout(), Arc::new(GiveUp));
    let mut files = PoseFiles::create(folder.path(), layout, 50.0, RunEnd::Known, disk).unwrap();
    for tick in 0..n_ticks {
        if tick == 50 {
            fail();
        }
        let people = [(1, Tracked), (2, Tracked)];
        files.write(&fixture::poses(tick, &people)).unwrap();
        if tick % sync_every == 0 {
            files.sync_lines().unwrap();
            files.sync_persons().unwrap();
        }
    }
    let written = files.finish();
    fixture::fail("", fixture::Work::Write, 0);
    let entries = fs::read_dir(folder.path()).unwrap().map(Result::unwrap);
    let texts = entries.map(|entry| {
        let name = entry.file_name().into_string().unwrap();
        (name, fs::read_to_string(entry.path()).unwrap())
    });
    (texts.collect(), written)
}

#[test]
fn a_disk_error_loses_no_row_and_is_reported() {
    // Symptom: one EIO, of a write or a sync, also on one person's TRC, ended all pose files of a run.
    use fixture::Work::{Sync, Write};
    let (sound, written) = written_while(400, 7, || ());
    assert!(written.refusals.is_empty() && written.failure.is_none());
    assert_eq!(sound.len(), 5);
    for (name, part) in [
        ("poses.jsonl", "poses-2.jsonl"),
        ("poses_2.trc", "poses_2-2.trc"),
        ("angles_1.mot", "angles_1-2.mot"),
    ] {
        for work in [Write, Sync] {
            for sync_every in [7, 30] {
                let fail = || fixture::fail(name, work, 1);
                let (files, written) = written_while(400, sync_every, fail);
                assert_eq!(
                    (written.failure.is_none(), written.unwritten_ticks),
                    (true, 0)
                );
                assert!(files == sound, "{name} {work:?} {:?}", files.keys());
                let [refusal] = &written.refusals[..] else {
                    panic!("{:?}", written.refusals);
                };
                assert_eq!(refusal.file, name);
                assert_eq!(refusal.goes_on_in.as_deref(), Some(part));
                assert!(
                    refusal.failure.contains("os error 5"),
                    "{}",
                    refusal.failure
                );
            }
        }
    }
}

#[test]
fn an_unconfirming_disk_is_reported_once_and_has_all_rows() {
    let (sound, _) = written_while(200, 7, || ());
    let fail = || fixture::fail("poses", fixture::Work::Sync, u32::MAX);
    let (files, written) = written_while(200, 7, fail);
    assert!(files == sound, "{:?}", files.keys());
    assert_eq!(written.unwritten_ticks, 0);
    let unconfirmed = written.refusals.iter().filter(|it| it.goes_on_in.is_none());
    assert_eq!(unconfirmed.count(), 3, "{:?}", written.refusals);
    assert_eq!(written.refusals.len(), 6);
}

#[test]
fn unjoined_parts_are_complete_under_their_own_names() {
    let folder = tempfile::tempdir().unwrap();
    let (layout, disk) = (fixture::layout(), Arc::new(GiveUp));
    let mut files = PoseFiles::create(folder.path(), layout, 50.0, RunEnd::Known, disk).unwrap();
    for tick in 0..90 {
        files.write(&fixture::poses(tick, &[(1, Tracked)])).unwrap();
        if tick % 20 == 10 {
            files.sync_persons().unwrap();
        }
        if tick == 40 {
            fixture::fail("poses_1", fixture::Work::Sync, 1);
            files.sync_persons().unwrap();
        }
    }
    fixture::fail("poses_1", fixture::Work::Join, 2);
    let written = files.finish();
    assert!(written.failure.is_none(), "{:?}", written.failure);
    let rows = ["poses_1.trc", "poses_1-2.trc"].map(|name| {
        let text = fs::read_to_string(folder.path().join(name)).unwrap();
        let rows: Vec<i64> = text.lines().skip(5).map(first_number).collect();
        let counted = format!("50\t50\t{}\t3\tm\t50\t0\t", rows.len());
        assert!(text.contains(&counted), "{text}");
        rows
    });
    assert_eq!(rows[0], (0..31).collect::<Vec<i64>>());
    assert_eq!(rows[1], (31..90).collect::<Vec<i64>>());
}

fn first_number(row: &str) -> i64 {
    row.split('\t').next().unwrap().parse().unwrap()
}
