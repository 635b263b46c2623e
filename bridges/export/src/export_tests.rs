//! Tests: complete exports of a synthetic run.

use std::fs;
use std::path::Path;

use crate::fixture::{camera, poses_jsonl, summary_json};
use crate::{Existing, ExportError, ExportRequest, Format, Options, Written, export};

const N_TICKS: i64 = 50;

/// A run of three people in `folder`, and a request for all formats.
fn request(folder: &Path) -> ExportRequest {
    fs::write(folder.join("poses.jsonl"), poses_jsonl(&[1, 2, 5], N_TICKS)).unwrap();
    fs::write(folder.join("summary.json"), summary_json(N_TICKS)).unwrap();
    ExportRequest {
        poses: folder.join("poses.jsonl"),
        summary: folder.join("summary.json"),
        edits: None,
        subjects: Vec::new(),
        cameras: vec![camera()],
        out: folder.join("out"),
        formats: Format::ALL.map(|(_, format)| format).to_vec(),
        options: Options::default(),
        existing: Existing::Refuse,
    }
}

fn run(request: &ExportRequest) -> Result<Vec<Written>, ExportError> {
    export(request, |_| ())
}

fn bytes_of(written: &[Written]) -> Vec<(String, Vec<u8>)> {
    let name = |w: &Written| w.path.file_name().unwrap().to_str().unwrap().to_owned();
    written
        .iter()
        .map(|w| (name(w), fs::read(&w.path).unwrap()))
        .collect()
}

#[test]
fn equal_runs_give_equal_bytes() {
    let folders = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
    let [one, other] = folders
        .each_ref()
        .map(|folder| bytes_of(&run(&request(folder.path())).unwrap()));
    assert!(one == other);
    for (written, (_, bytes)) in run(&ExportRequest {
        existing: Existing::Replace,
        ..request(folders[0].path())
    })
    .unwrap()
    .iter()
    .zip(&one)
    {
        assert_eq!(written.bytes, bytes.len() as u64);
    }
}

#[test]
fn a_failed_export_leaves_nothing_behind() {
    let folder = tempfile::tempdir().unwrap();
    let mut request = request(folder.path());
    fs::create_dir_all(&request.out).unwrap();
    let last = request.out.join("poses_5.bvh");
    fs::write(&last, "mine").unwrap();
    request.formats = vec![Format::Bvh];
    let refused = run(&request).unwrap_err();
    assert!(
        matches!(&refused, ExportError::Exists { path } if *path == last),
        "{refused}"
    );
    let left: Vec<_> = fs::read_dir(&request.out).unwrap().collect();
    assert_eq!(left.len(), 1);
    request.existing = Existing::Replace;
    assert_eq!(run(&request).unwrap().len(), 3);
    assert!(fs::read_to_string(&last).unwrap().starts_with("HIERARCHY"));
}

#[test]
fn invalid_options_are_refused_with_valid_values() {
    let folder = tempfile::tempdir().unwrap();
    let base = request(folder.path());
    let refused = |change: &dyn Fn(&mut ExportRequest)| {
        let mut request = base.clone();
        change(&mut request);
        run(&request).unwrap_err().to_string()
    };
    assert_eq!(
        refused(&|r| r.options.people = vec![3]),
        "found person 3, expected one of [1, 2, 5]"
    );
    assert_eq!(
        refused(&|r| r.options.ticks = Some(40..60)),
        "found ticks 40..60, expected some of the run's 0..50"
    );
    assert_eq!(
        refused(&|r| r.options.rate_hz = Some(f64::NAN)),
        "found a rate of NaN Hz, expected 0.5 to 2000 Hz"
    );
    assert!(
        refused(&|r| r.options.gaps = crate::timeline::Gaps::Mark)
            .starts_with("bvh has no place for marks")
    );
    fs::write(&base.summary, summary_json(0)).unwrap();
    let error = run(&base).unwrap_err();
    assert!(matches!(error, ExportError::Options(_)), "{error:?}");
    assert!(!base.out.exists());
}

#[test]
fn person_time_range_and_rate_can_be_selected() {
    let folder = tempfile::tempdir().unwrap();
    let mut request = request(folder.path());
    request.formats = vec![Format::Bvh];
    request.options.people = vec![2];
    request.options.called = [(2, "Ada L.".to_owned())].into();
    request.options.ticks = Some(10..40);
    request.options.rate_hz = Some(30.0);
    let written = run(&request).unwrap();
    assert_eq!(written.len(), 1);
    assert!(written[0].path.ends_with("poses_Ada_L_.bvh"));
    let text = fs::read_to_string(&written[0].path).unwrap();
    assert!(text.contains("Frames: 15\nFrame Time: 0.033333333\n"));
    assert_eq!(
        text.lines()
            .rev()
            .take_while(|line| *line != "Frame Time: 0.033333333")
            .count(),
        15
    );
}

#[test]
fn an_invalid_line_is_refused_with_its_number() {
    let folder = tempfile::tempdir().unwrap();
    let request = request(folder.path());
    fs::write(
        &request.poses,
        poses_jsonl(&[1], 3).replacen("\"pelvis\":", "\"pelvsi\":", 1),
    )
    .unwrap();
    let refused = run(&request).unwrap_err().to_string();
    assert!(
        refused.ends_with("poses.jsonl:1: `joints.pelvis`: missing, expected three numbers"),
        "{refused}"
    );
}

#[test]
fn trc_and_mot_row_counts_match_their_headers() {
    let folder = tempfile::tempdir().unwrap();
    let mut request = request(folder.path());
    request.formats = vec![Format::Trc, Format::Mot];
    request.options.people = vec![2];
    let written = bytes_of(&run(&request).unwrap());
    let text = |i: usize| String::from_utf8(written[i].1.clone()).unwrap();
    // Person 2 is absent for 10 of 50 ticks: blank rows in TRC, no rows in MOT.
    let (trc, mot) = (text(0), text(1));
    assert_eq!(trc.lines().nth(2).unwrap().split('\t').nth(2), Some("50"));
    assert_eq!(trc.lines().count(), 5 + 50);
    assert!(mot.contains("\nnRows=40\n"));
    let rows = mot.lines().skip_while(|line| *line != "endheader").count();
    assert_eq!(rows, 2 + 40);
}

#[test]
fn a_resampled_trc_file_contains_its_original_ticks() {
    let folder = tempfile::tempdir().unwrap();
    let mut request = request(folder.path());
    request.formats = vec![Format::Trc];
    request.options.people = vec![1];
    request.options.ticks = Some(10..40);
    request.existing = Existing::Replace;
    let mut head = |rate_hz: Option<f64>| {
        request.options.rate_hz = rate_hz;
        let written = bytes_of(&run(&request).unwrap());
        let text = String::from_utf8(written[0].1.clone()).unwrap();
        let words = text.lines().nth(2).unwrap().split('\t');
        words.map(str::to_owned).collect::<Vec<String>>()
    };
    let of_run = head(None);
    let run_hz = of_run[0].clone();
    assert_eq!(of_run[2], "30");
    assert_eq!(of_run[5..], [run_hz.clone(), "10".into(), "30".into()]);
    let twice_hz = 2.0 * run_hz.parse::<f64>().unwrap();
    let resampled = head(Some(twice_hz));
    assert_eq!(
        (&*resampled[0], &*resampled[2]),
        (&*twice_hz.to_string(), "59")
    );
    assert_eq!(resampled[5..], of_run[5..]);
}

#[test]
fn gltf_holds_a_pose_to_the_end_of_a_gap() {
    let folder = tempfile::tempdir().unwrap();
    let mut request = request(folder.path());
    request.formats = vec![Format::Gltf];
    request.options.people = vec![2];
    let held = bytes_of(&run(&request).unwrap());
    let json: serde_json::Value = serde_json::from_slice(&held[0].1).unwrap();
    let person = json["nodes"]
        .as_array()
        .unwrap()
        .iter()
        .find(|node| node["name"] == "person_2")
        .unwrap();
    let absent = person["extras"]["absent_s"][0].as_array().unwrap();
    assert!((absent[0].as_f64().unwrap() - 20.0 / 60.0).abs() < 1e-9);
    assert!((absent[1].as_f64().unwrap() - 29.0 / 60.0).abs() < 1e-9);
    let input = json["animations"][0]["samplers"][0]["input"]
        .as_u64()
        .unwrap();
    // 40 ticks, and the key that holds the pose.
    assert_eq!(
        json["accessors"][usize::try_from(input).unwrap()]["count"],
        41
    );
}

#[test]
fn names_are_checked_and_kept_as_given() {
    let folder = tempfile::tempdir().unwrap();
    let mut request = request(folder.path());
    request.formats = vec![Format::CsvTidy, Format::Osim, Format::C3d];
    request.options.people = vec![1, 1];
    request.options.called = [(1, "Ada & L.".to_owned())].into();
    let written = bytes_of(&run(&request).unwrap());
    let names: Vec<&str> = written.iter().map(|(name, _)| name.as_str()).collect();
    assert_eq!(
        names,
        [
            "poses_tidy.csv",
            "model_Ada___L_.osim",
            "poses_Ada___L_.c3d"
        ]
    );
    let text = |i: usize| String::from_utf8_lossy(&written[i].1).into_owned();
    assert!(
        text(0)
            .lines()
            .nth(1)
            .unwrap()
            .contains(",1,Ada & L.,joint,pelvis,")
    );
    assert!(text(1).contains("\"person_Ada_&amp;_L.\""));
    assert!(text(2).contains("Ada & L."));
    request.existing = Existing::Replace;
    let mut refused = |person: u32, name: &str| {
        request.options.called = [(person, name.to_owned())].into();
        let error = run(&request).unwrap_err();
        let source = std::error::Error::source(&error).map(ToString::to_string);
        format!("{error} {}", source.unwrap_or_default())
    };
    assert!(
        refused(777, "Ada").starts_with("found a name for person 777, expected one of [1, 2, 5]")
    );
    assert!(refused(1, "a\tb").contains("as the name of person 1"));
}

#[test]
fn lengths_do_not_depend_on_the_selected_ticks() {
    let folder = tempfile::tempdir().unwrap();
    let mut request = request(folder.path());
    // In the first ten ticks, person 1 has a longer head.
    let mut text = String::new();
    for tick in 0..N_TICKS {
        let mut line = crate::fixture::line_at(1, tick);
        if tick < 10 {
            line.joints_m[3].z += 0.05;
        }
        text += &crate::fixture::json(&line);
    }
    fs::write(&request.poses, text).unwrap();
    request.formats = vec![Format::Osim];
    request.existing = Existing::Replace;
    let whole = bytes_of(&run(&request).unwrap());
    request.options.ticks = Some(0..10);
    assert!(whole == bytes_of(&run(&request).unwrap()));
}

#[test]
fn a_wrong_summary_cannot_make_files_endless() {
    let folder = tempfile::tempdir().unwrap();
    let mut request = request(folder.path());
    request.formats = vec![Format::Csv];
    request.options.people = vec![1];
    let far = 1_i64 << 41;
    fs::write(&request.summary, summary_json(far)).unwrap();
    // Years without a pose: the file ends with the last pose.
    let written = bytes_of(&run(&request).unwrap());
    let rows = String::from_utf8(written[0].1.clone()).unwrap();
    assert_eq!(rows.lines().count(), 1 + 50);
    let late = crate::run::PoseLine {
        tick: far - 1,
        ..crate::fixture::line_at(1, N_TICKS)
    };
    let late = crate::fixture::json(&late);
    let early = fs::read_to_string(&request.poses).unwrap();
    fs::write(&request.poses, early + &late).unwrap();
    request.existing = Existing::Replace;
    let refused = run(&request).unwrap_err().to_string();
    assert!(
        refused.contains("frames of person 1, expected at most 10000000"),
        "{refused}"
    );
}

#[test]
fn equal_names_become_unique_and_profiles_apply() {
    let folder = tempfile::tempdir().unwrap();
    let mut request = request(folder.path());
    request.formats = vec![Format::Bvh];
    let edits = crate::EditsFile::of_run(folder.path());
    for (person, name) in [(1, "Ada"), (5, "ada"), (2, "Bo")] {
        let name = name.to_owned();
        let change = |_: &_| Ok(crate::edits::Change::Name { person, name });
        edits.add("now", None, change).unwrap();
    }
    request.edits = Some(edits.path().to_owned());
    let names = |written: &[Written]| -> Vec<String> {
        let mut names: Vec<String> = bytes_of(written)
            .into_iter()
            .map(|(name, _)| name)
            .collect();
        names.sort();
        names
    };
    let before = run(&request).unwrap();
    assert_eq!(
        names(&before),
        ["poses_Ada_1.bvh", "poses_Bo.bvh", "poses_ada_5.bvh"]
    );
    let before = bytes_of(&before);

    // Bo gets the body of person 5.
    let profile = crate::profile_of(&request.poses, edits.path(), 5).unwrap();
    assert!(profile.sigma_m.iter().all(|sigma_m| *sigma_m < 1e-4));
    let path = folder.path().join("subjects/bo.toml");
    let bo = crate::SubjectProfile {
        name: "Bo".to_owned(),
        ..profile
    };
    bo.write(&path).unwrap();
    assert!(bo.write(&path).is_err(), "it is there");
    request.existing = Existing::Replace;
    request.subjects = vec![path];
    let after = bytes_of(&run(&request).unwrap());
    let offsets_in = |files: &[(String, Vec<u8>)], name: &str| -> String {
        let found = files.iter().find(|(known, _)| known == name).unwrap();
        let text = String::from_utf8(found.1.clone()).unwrap();
        let offsets = text.lines().take_while(|line| *line != "MOTION");
        offsets.collect::<Vec<_>>().join("\n")
    };
    assert_eq!(
        offsets_in(&after, "poses_Bo.bvh"),
        offsets_in(&before, "poses_ada_5.bvh")
    );
    assert_ne!(
        offsets_in(&before, "poses_Bo.bvh"),
        offsets_in(&before, "poses_ada_5.bvh")
    );
    // Two profiles with one name.
    let second = folder.path().join("subjects/bo-again.toml");
    fs::copy(&request.subjects[0], &second).unwrap();
    request.subjects.push(second);
    let refused = run(&request).unwrap_err().to_string();
    assert!(
        refused.contains("bo-again.toml: `name`: found \"Bo\", who has the profile "),
        "{refused}"
    );
    request.subjects.pop();
    request.options.people = vec![1];
    let refused = run(&request).unwrap_err().to_string();
    assert!(
        refused.ends_with("no person is named Bo, expected one of Ada"),
        "{refused}"
    );
}

#[test]
fn a_person_named_tidy_does_not_replace_the_shared_file() {
    let folder = tempfile::tempdir().unwrap();
    let mut request = request(folder.path());
    request.options.called = [(2, "tidy".to_owned())].into();
    let written = bytes_of(&run(&request).unwrap());
    let n_columns = |wanted: &str| {
        let (_, bytes) = written.iter().find(|(name, _)| name == wanted).unwrap();
        let text = String::from_utf8_lossy(bytes);
        text.lines().next().unwrap().split(',').count()
    };
    assert_eq!(n_columns("poses_tidy.csv"), 14);
    assert!(n_columns("poses_tidy_2.csv") > 100);
}

#[test]
fn one_mcap_contains_all_people_in_order_of_time() {
    let folder = tempfile::tempdir().unwrap();
    let mut request = request(folder.path());
    request.formats = vec!["foxglove".parse().unwrap()];
    let written = run(&request).unwrap();
    assert!(written[0].path.ends_with("poses.mcap"));
    let bytes = fs::read(&written[0].path).unwrap();
    let (mut last, mut of_two, mut topics) = (0, 0, std::collections::BTreeSet::new());
    for message in mcap::MessageStream::new(&bytes).unwrap() {
        let message = message.unwrap();
        assert!(last <= message.log_time);
        last = message.log_time;
        of_two += u32::from(message.channel.topic == "/person_2/angles");
        topics.insert(message.channel.topic.clone());
    }
    // Person 2 is absent in ticks 20 to 29.
    assert_eq!(of_two, 40);
    assert_eq!(last, 816_666_667);
    let topics: Vec<&str> = topics.iter().map(String::as_str).collect();
    let expected = [
        "/camera_corner/calibration",
        "/people",
        "/person_1/angles",
        "/person_2/angles",
        "/person_5/angles",
        "/tf",
        "/tf_static",
    ];
    assert_eq!(topics, expected);
}
