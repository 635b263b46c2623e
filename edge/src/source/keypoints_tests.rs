//! Accepted keypoint files, and the errors for wrong ones.

use std::io::Write as _;

use farfield_proto::keypoints::COCO17;
use farfield_proto::venue::TickFrom;
use proptest::prelude::*;

use super::super::SourceOrigin;
use super::*;

fn expected() -> ExpectedSource {
    ExpectedSource {
        at: SourceOrigin {
            camera: "cam0".to_owned(),
            place: "cam0.jsonl".to_owned(),
        },
        size_px: [640, 480],
        rate_hz: 20.0,
        first_tick: Tick(0),
        keypoints: 17,
        tick_from: TickFrom::Clock,
    }
}

fn file(content: &[u8]) -> tempfile::NamedTempFile {
    let mut file = tempfile::NamedTempFile::new().unwrap();
    file.write_all(content).unwrap();
    file
}

fn line(tick: i64) -> String {
    let nulls = ["null"; 16].join(",");
    format!(r#"{{"tick":{tick},"persons":[{{"keypoints":[[1.5,2,0.9],{nulls}]}}],"by":"us"}}"#)
}

fn refusal(content: &str) -> String {
    probe(file(content.as_bytes()).path(), &expected())
        .unwrap_err()
        .to_string()
}

#[test]
fn ticks_are_read_from_the_lines() {
    let file = file(format!("{}\n{}\r\n\n{}", line(300), line(301), line(302)).as_bytes());
    let info = probe(file.path(), &expected()).unwrap();
    assert_eq!(info.ticks, Some(Tick(300)..Tick(303)));
    let mut source = open(file.path(), &expected(), Tick(301)).unwrap();
    for tick in [301, 302] {
        assert_eq!(source.next_frame().unwrap().unwrap().tick, Tick(tick));
    }
    assert_eq!(source.next_frame().unwrap(), None);
    assert!(matches!(
        open(file.path(), &expected(), Tick(303)),
        Err(SourceError::OutsideClip { .. })
    ));
}

#[test]
fn shares_of_the_picture_instead_of_pixels_are_refused() {
    let line = |tick: i64, scale: f64| {
        let point = format!("[{},{},0.9]", 0.4 * scale, 0.7 * scale);
        let points = vec![point; 17].join(",");
        format!(r#"{{"tick":{tick},"persons":[{{"keypoints":[{points}]}}]}}"#)
    };
    let file_of = |scale: f64| format!("{}\n{}", line(0, scale), line(1, scale));
    let error = refusal(&file_of(1.0));
    assert!(
        error.contains("34 of 34 keypoints lie within 1.5 pixels"),
        "{error}"
    );
    // One far keypoint and many missing ones do not turn shares into pixels.
    let lines: Vec<String> = (0..8).map(|tick| line(tick, 1.0)).collect();
    let with_one_far = lines.join("\n").replacen("[0.4,0.7,", "[300,200,", 1);
    let other_error = refusal(&with_one_far.replacen("[0.4,0.7,0.9]", "[0,0,0]", 50));
    assert!(other_error.contains("85 of 86 keypoints"), "{other_error}");
    assert!(error.contains("expected pixels of 640 x 480"), "{error}");
    assert!(probe(file(file_of(400.0).as_bytes()).path(), &expected()).is_ok());
}

#[test]
fn repeated_frames_are_reported_before_the_first_tick() {
    let repeats = |times: i64| {
        let at = |tick: i64| line(tick).replace("1.5", &format!("{}.5", 3 * (tick / times)));
        let lines: Vec<String> = (0..60).map(at).collect();
        let file = file(lines.join("\n").as_bytes());
        probe(file.path(), &expected()).unwrap().repeats
    };
    assert_eq!(repeats(1), None);
    let held = repeats(2).unwrap();
    assert_eq!((held.repeated, held.frames), (30, 60));
}

#[test]
fn a_byte_order_mark_and_windows_line_ends_are_read() {
    let text = format!("\u{feff}{}\r\n{}\r\n", line(0), line(1));
    let file = file(text.as_bytes());
    assert!(probe(file.path(), &expected()).is_ok());
}

#[test]
fn absent_peaks_are_those_of_the_persons() {
    let (_, frame) = parse_line(&line(0), 17).unwrap();
    let nose = KeypointCandidate {
        position: Pixel::new(1.5, 2.0),
        score: 0.9,
    };
    assert_eq!(frame.persons[0][0], Some(nose));
    assert_eq!(frame.persons[0][1], None);
    assert_eq!(frame.peaks[0], [nose]);
    assert!(frame.peaks[1..].iter().all(Vec::is_empty));
}

#[test]
fn files_with_feet_need_the_set_of_the_venue() {
    let feet = format!("{}{}", "null,".repeat(17), ["[5,6,0.7]"; 6].join(","));
    let text = format!(r#"{{"tick":0,"persons":[{{"keypoints":[{feet}]}}]}}"#);
    let (_, frame) = parse_line(&text, COCO23.len()).unwrap();
    assert_eq!(frame.peaks.iter().map(Vec::len).sum::<usize>(), 6);
    let error = parse_line(&text, COCO17.len()).unwrap_err();
    assert!(
        error.problem.contains("keypoints = \"coco23\""),
        "{error:?}"
    );
}

#[test]
fn peaks_hold_every_candidate() {
    let empty = ["[]"; 16].join(",");
    let text = format!(r#"{{"tick":0,"persons":[],"peaks":[[[1,2,0.5],[3,4,1.02]],{empty}]}}"#);
    let (_, frame) = parse_line(&text, 17).unwrap();
    assert!(frame.persons.is_empty());
    assert_eq!(
        frame.peaks[0][1],
        KeypointCandidate {
            position: Pixel::new(3.0, 4.0),
            score: 1.0
        }
    );
}

#[test]
fn a_wrong_line_is_reported_with_its_field() {
    let good = line(0);
    let cases = [
        (
            good.replace("[1.5,2,0.9],", ""),
            "`persons[0].keypoints`: found 16 keypoints, expected 17",
        ),
        (
            good.replace("[1.5,2,0.9]", "[1.5,2]"),
            "`persons[0].keypoints[0]`: found [1.5,2], expected [x, y, score]",
        ),
        (
            good.replace("0.9", "90"),
            "`persons[0].keypoints[0]`: found a score of 90.0, expected 0 to 1",
        ),
        (good.replace("0.9", "-0.1"), "found a score of -0.1"),
        (
            good.replace("1.5", "NaN"),
            "`cam0`: not JSON at column 37: ",
        ),
        (good.replace("1.5", "1e999"), "number out of range"),
        (
            good.replace("1.5", "1e300"),
            "found (1e300, 2.0), expected pixels",
        ),
        (
            good.replace("\"tick\":0", "\"tick\":0.5"),
            "`tick`: found 0.5, expected a tick between -9007199254740992 and 9007199254740992",
        ),
        (
            good.replace("\"tick\":0", "\"tick\":9223372036854775807"),
            "found 9223372036854775807, expected a tick between -9007199254740992 and",
        ),
        (
            good.replace("\"tick\":0", "\"tick\":-9223372036854775808"),
            "found -9223372036854775808, expected a tick between",
        ),
        (good.replace("tick", "frame"), "`tick`: missing"),
        (good.replace("persons", "people"), "`persons`: missing"),
        (
            good.replace("keypoints", "points"),
            "`persons[0].keypoints`: missing",
        ),
        ("[]".to_owned(), "`cam0`: found [], expected an object"),
        (
            r#"{"tick":0,"persons":[],"peaks":[[]]}"#.to_owned(),
            "`peaks`: found 1 keypoints, expected 17",
        ),
        (
            good[..good.len() / 2].to_owned(),
            "`cam0`: not JSON: the line ends early",
        ),
    ];
    for (text, says) in cases {
        let error = refusal(&format!("\n{text}\n"));
        assert!(
            error.starts_with("cam0.jsonl:2: camera `cam0`: "),
            "{error}"
        );
        assert!(error.contains(says), "{error}\nexpected: {says}");
    }
}

#[test]
fn ticks_are_in_order_and_without_gaps() {
    let lines = |ticks: &[i64]| ticks.iter().map(|&t| line(t) + "\n").collect::<String>();
    let gap = refusal(&lines(&[4, 5, 8]));
    assert!(
        gap.starts_with("cam0.jsonl:3: ") && gap.contains("found 8 after 5"),
        "{gap}"
    );
    assert!(refusal(&lines(&[4, 4])).contains("found 4 twice"));
    assert!(refusal(&lines(&[4, 3])).contains("found 3 after 4"));
}

#[test]
fn a_file_that_is_empty_absent_or_a_folder_is_refused() {
    assert!(matches!(
        probe(file(b"\n").path(), &expected()),
        Err(SourceError::Unreadable { .. })
    ));
    let folder = tempfile::tempdir().unwrap();
    for path in [folder.path().to_owned(), folder.path().join("absent.jsonl")] {
        assert!(matches!(
            probe(&path, &expected()),
            Err(SourceError::NotThere { .. })
        ));
    }
}

#[test]
fn a_line_without_end_is_refused_before_it_fills_the_memory() {
    let long = vec![b' '; MAX_LINE_BYTES as usize + 1];
    let error = probe(file(&long).path(), &expected()).unwrap_err();
    let limit = MAX_LINE_BYTES.to_string();
    assert!(error.to_string().contains(&limit), "{error}");
}

#[test]
fn a_file_that_shrinks_after_the_probe_does_not_end_quietly() {
    let file = file(format!("{}\n{}\n", line(0), line(1)).as_bytes());
    let mut source = open(file.path(), &expected(), Tick(0)).unwrap();
    source.ticks.end = Tick(3);
    while let Ok(frame) = source.next_frame() {
        assert!(frame.is_some(), "ended quietly");
    }
}

proptest! {
    #[test]
    fn random_bytes_are_refused(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
        prop_assert!(probe(file(&bytes).path(), &expected()).is_err());
    }

    #[test]
    fn a_damaged_line_is_read_or_refused(at in 0usize..120, byte in any::<u8>()) {
        let mut bytes = line(0).into_bytes();
        let at = at % bytes.len();
        bytes[at] = byte;
        if let Ok(text) = std::str::from_utf8(&bytes)
            && let Ok((_, frame)) = parse_line(text, 17)
        {
            prop_assert_eq!(frame.peaks.len(), COCO17.len());
        }
    }

    #[test]
    fn any_json_is_read_or_refused(text in r#"\{"tick":(-?[0-9]{1,20}|null),"persons":(\[(\{"keypoints":(\[(null,?){0,18}\]|null|3)\},?){0,2}\]|\{\}|null)(,"peaks":(\[(\[(\[[0-9e.,-]{0,12}\])?\],?){0,18}\]|null))?\}"#) {
        if let Ok((_, frame)) = parse_line(&text, 17) {
            prop_assert_eq!(frame.peaks.len(), COCO17.len());
        }
    }
}
