//! Exports people with hostile names to every format and checks the rules of its readers.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::{self, File};
use std::path::Path;

use parquet::file::reader::{FileReader as _, SerializedFileReader};
use parquet::record::RowAccessor as _;
use serde_json::Value;

use super::*;
use crate::fixture::{json, line_at, summary_json};
use crate::{Existing, ExportRequest, Format, Options, Written, export};

const N_TICKS: i64 = 3;
/// Size of the header of a C3D file: one block.
const BLOCK: usize = 512;
/// Longest file name that every file system accepts, bytes.
const LONGEST_FILE_NAME: usize = 255;

/// The longest name allowed, of this letter only.
fn long(letter: char) -> String {
    letter.to_string().repeat(MOST_WORD_CHARACTERS)
}

fn hostile_names() -> BTreeMap<u32, String> {
    let names = [
        "Anna Maria",
        "A*/B+C",
        "A__B_C",
        &long('é'),
        &long('𝔸'),
        "محمد علي",
        "O'Brien \"Bob\", jr.",
        "<&>",
        "7up",
        "=1+1",
        "\u{a0}\u{3000}x",
        "CON",
        "\\\\server\\share",
    ];
    (1..).zip(names.map(str::to_owned)).collect()
}

/// Exports a run with these people and with hostile keypoint names to all formats.
fn export_all(folder: &Path) -> Vec<Written> {
    let names = hostile_names();
    let mut poses = String::new();
    for tick in 0..N_TICKS {
        for &person in names.keys() {
            let mut line = line_at(person, tick);
            let at_m = line.keypoints_m[0].1;
            let keypoints = ["big toe/left", "big_toe_left", "left hip", &long('ñ')];
            line.keypoints_m
                .extend(keypoints.map(|name| (name.to_owned(), at_m)));
            poses += &json(&line);
        }
    }
    fs::write(folder.join("poses.jsonl"), poses).unwrap();
    fs::write(folder.join("summary.json"), summary_json(N_TICKS)).unwrap();
    let request = ExportRequest {
        poses: folder.join("poses.jsonl"),
        summary: folder.join("summary.json"),
        edits: None,
        subjects: Vec::new(),
        cameras: Vec::new(),
        out: folder.join("out"),
        formats: Format::ALL.map(|(_, format)| format).to_vec(),
        options: Options {
            called: names,
            ..Options::default()
        },
        existing: Existing::Refuse,
    };
    export(&request, |_| ()).unwrap()
}

#[test]
fn every_format_stays_readable_with_hostile_names() {
    let folder = tempfile::tempdir().unwrap();
    let written = export_all(folder.path());
    let mut files = BTreeSet::new();
    for file in &written {
        let name = file.path.file_name().unwrap().to_str().unwrap();
        assert!(name.len() < LONGEST_FILE_NAME - 50, "{name}");
        assert!(files.insert(name.to_lowercase()), "{name}");
        match file.format {
            Format::Osim => check_osim(&text_of(file), &person_name(file)),
            Format::Trc => check_trc(&text_of(file)),
            Format::Mot => check_mot(&text_of(file)),
            Format::C3d => check_c3d(&fs::read(&file.path).unwrap(), &person_name(file)),
            Format::Bvh => check_bvh(&text_of(file)),
            Format::Csv => drop(rows_of(file, None)),
            Format::CsvTidy => assert_eq!(rows_of(file, Some("name")), all_names()),
            Format::Parquet => assert_eq!(names_of_parquet(&file.path), all_names()),
            Format::Gltf | Format::Glb => assert_eq!(names_of_gltf(file), all_names()),
            Format::Mcap => assert_eq!(names_of_mcap(&file.path), all_names()),
        }
    }
    // One file per format; one per person for formats that hold one person.
    let single = Format::ALL.iter().filter(|(_, it)| !it.holds_all()).count();
    let n = Format::ALL.len() + single * (all_names().len() - 1);
    assert_eq!(written.len(), n);
}

fn text_of(file: &Written) -> String {
    fs::read_to_string(&file.path).unwrap()
}

fn person_name(file: &Written) -> String {
    hostile_names()[&file.people[0]].clone()
}

fn all_names() -> BTreeSet<String> {
    hostile_names().into_values().collect()
}

/// `OpenSim` refuses some characters in component names; XML refuses a bare `&` or `<`.
fn check_osim(text: &str, name: &str) {
    let names: Vec<&str> = text
        .split(" name=\"")
        .skip(1)
        .map(|rest| rest.split_once('"').unwrap().0)
        .collect();
    for name in &names {
        let is_refused = |c: char| "\\/*+".contains(c) || c.is_whitespace() || c.is_control();
        assert!(!name.is_empty() && !name.contains(is_refused), "{name}");
    }
    for after in text.split('&').skip(1) {
        let is_entity = |word: &&str| after.starts_with(*word);
        assert!(["amp;", "lt;", "gt;", "quot;"].iter().any(is_entity));
    }
    let markers = text.split("<Marker name=\"").skip(1);
    let markers: Vec<&str> = markers.map(|it| it.split_once('"').unwrap().0).collect();
    let unique: BTreeSet<&&str> = markers.iter().collect();
    assert_eq!(unique.len(), markers.len(), "{markers:?}");
    if name == "Anna Maria" {
        assert!(text.contains("<Model name=\"person_Anna_Maria\">"));
    }
}

/// Each name is one cell, and there are as many names as the header says.
fn check_trc(text: &str) {
    let lines: Vec<&str> = text.lines().collect();
    let n_markers: usize = lines[2].split('\t').nth(3).unwrap().parse().unwrap();
    let names: Vec<&str> = lines[3].split('\t').filter(|it| !it.is_empty()).collect();
    assert_eq!(names.len(), 2 + n_markers);
    for name in &names {
        assert!(!name.contains(char::is_whitespace), "{name}");
    }
    let unique: BTreeSet<&&str> = names.iter().collect();
    assert_eq!(unique.len(), names.len());
    for marker in ["big_toe_left", "big_toe_left_2", "keypoint_left_hip"] {
        assert!(names.contains(&marker), "{names:?}");
    }
    let cells = 2 + 3 * n_markers;
    assert!(
        lines[5..]
            .iter()
            .all(|row| row.split('\t').count() == cells)
    );
    assert_eq!(lines.len(), 5 + N_TICKS as usize);
}

fn check_mot(text: &str) {
    let (_, table) = text.split_once("endheader\n").unwrap();
    let counts = table.lines().map(|row| row.split_whitespace().count());
    assert_eq!(counts.collect::<BTreeSet<usize>>().len(), 1);
}

/// Bone names contain no spaces.
fn check_bvh(text: &str) {
    for line in text.lines().map(str::trim) {
        if line.starts_with("ROOT") || line.starts_with("JOINT") {
            assert_eq!(line.split_whitespace().count(), 2, "{line}");
        }
    }
}

/// Reads the parameters like a reader that treats lengths as signed bytes.
fn check_c3d(bytes: &[u8], name: &str) {
    let signed = |at: usize| usize::try_from(bytes[at].cast_signed()).unwrap();
    let mut texts: BTreeMap<String, Vec<String>> = BTreeMap::new();
    let mut at = BLOCK + 4;
    while bytes[at] != 0 {
        let length = signed(at);
        let is_group = bytes[at + 1].cast_signed() < 0;
        let parameter = String::from_utf8(bytes[at + 2..at + 2 + length].to_vec()).unwrap();
        let next = at + 2 + length;
        at = next + usize::from(u16::from_le_bytes([bytes[next], bytes[next + 1]]));
        let is_text = bytes[next + 2].cast_signed() == -1;
        if is_group || !is_text {
            continue;
        }
        let (longest, data) = (signed(next + 4), next + 4 + usize::from(bytes[next + 3]));
        let data = &bytes[data..at - 1];
        let all = data.chunks(longest.max(1));
        let all = all.map(|text| String::from_utf8(text.to_vec()).unwrap());
        texts.insert(parameter, all.map(|it| it.trim_end().to_owned()).collect());
    }
    assert!(name.starts_with(&texts["NAMES"][0]), "{:?}", texts["NAMES"]);
    assert!(texts["NAMES"][0].len() >= name.len().min(C3D_BYTES - 3));
    let labels: BTreeSet<&String> = texts["LABELS"].iter().collect();
    assert_eq!(labels.len(), texts["LABELS"].len());
}

/// Values of a column. The reader fails if a row has a different length from the header.
fn rows_of(file: &Written, column: Option<&str>) -> BTreeSet<String> {
    let mut reader = csv::Reader::from_path(&file.path).unwrap();
    let head = reader.headers().unwrap().clone();
    let unique: BTreeSet<&str> = head.iter().collect();
    assert_eq!(unique.len(), head.len());
    let column = column.map(|name| head.iter().position(|known| known == name).unwrap());
    let rows = reader.into_records().map(Result::unwrap);
    let values = rows.map(|row| column.map_or_else(String::new, |at| row[at].to_owned()));
    values.collect()
}

fn names_of_parquet(path: &Path) -> BTreeSet<String> {
    let reader = SerializedFileReader::new(File::open(path).unwrap()).unwrap();
    let schema = reader.metadata().file_metadata().schema_descr_ptr();
    let column = schema.columns().iter().position(|it| it.name() == "name");
    let rows = reader.get_row_iter(None).unwrap().map(Result::unwrap);
    let names = rows.map(|row| row.get_string(column.unwrap()).unwrap().clone());
    names.collect()
}

fn names_of_gltf(file: &Written) -> BTreeSet<String> {
    let bytes = fs::read(&file.path).unwrap();
    let json = if file.format == Format::Glb {
        let length = u32::from_le_bytes(bytes[12..16].try_into().unwrap());
        &bytes[20..20 + length as usize]
    } else {
        &bytes[..]
    };
    let json: Value = serde_json::from_slice(json).unwrap();
    let nodes = json["nodes"].as_array().unwrap().iter();
    let names = nodes.filter_map(|node| node["name"].as_str()?.strip_prefix("person_"));
    names.map(str::to_owned).collect()
}

fn names_of_mcap(path: &Path) -> BTreeSet<String> {
    let bytes = fs::read(path).unwrap();
    let messages = mcap::MessageStream::new(&bytes)
        .unwrap()
        .map(Result::unwrap);
    let angles = messages.filter(|message| message.channel.topic.ends_with("/angles"));
    let names = angles.map(|message| {
        let value: Value = serde_json::from_slice(&message.data).unwrap();
        value["name"].as_str().unwrap().to_owned()
    });
    names.collect()
}

#[test]
fn long_c3d_texts_are_cut_between_letters_and_stay_unique() {
    let name = long('é');
    assert_eq!(name.len(), 128);
    assert_eq!(c3d_text(&name), "é".repeat(63));
    assert_eq!(c3d_text("Ada"), "Ada");
    let end = |end: &str| "é".repeat(80) + end;
    let labels = c3d_labels(vec![end("a"), end("b"), "c".to_owned(), end("d")]);
    let unique: BTreeSet<&String> = labels.iter().collect();
    assert_eq!(unique.len(), 4);
    assert!(labels.iter().all(|it| it.len() <= C3D_BYTES), "{labels:?}");
    assert!(labels[1].ends_with("é_2"), "{labels:?}");
}

#[test]
fn file_names_fit_every_file_system() {
    assert_eq!(file_word("A*/B+C"), "A__B_C");
    for letter in ['a', 'é', '漢', '𝔸'] {
        let word = file_word(&long(letter));
        assert!(word.len() <= MOST_WORD_BYTES && word.starts_with(letter));
    }
}
