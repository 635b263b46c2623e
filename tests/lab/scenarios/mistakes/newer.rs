//! Mistakes with calibrations, imports, exports, people, streams, pages, subjects and fisheyes. The list was written before
//! the mistakes were tried.

use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use serde_json::{Value, json};

use super::{Mistake, check_mistakes, nothing, replace, write};
use crate::farfield::{command, finish};

const CAMERAS: [&str; 4] = ["north-east", "north-west", "south-west", "south-east"];

fn mistake(
    what: &'static str,
    make: fn(&Path),
    words: &'static str,
    expected: &'static [&'static str],
) -> Mistake {
    Mistake {
        what,
        make,
        words,
        code: 2,
        expected,
    }
}

fn usage(what: &'static str, words: &'static str, expected: &'static [&'static str]) -> Mistake {
    mistake(what, nothing, words, expected)
}

fn recorded(folder: &Path, camera: &str) -> Vec<Value> {
    let text = fs::read_to_string(folder.join(format!("{camera}.jsonl"))).unwrap();
    text.lines()
        .map(|line| serde_json::from_str(line).unwrap())
        .collect()
}

/// Pixels of the first person's nose in two cameras, in the format of `calibrate points`.
fn points(folder: &Path) {
    for camera in &CAMERAS[..2] {
        let mut text = String::new();
        for line in recorded(folder, camera) {
            let nose = &line["persons"][0]["keypoints"][0];
            if !nose.is_null() {
                writeln!(text, "{} {} {}", line["tick"], nose[0], nose[1]).unwrap();
            }
        }
        write(folder, &format!("{camera}.txt"), &text);
    }
}

/// The recordings in the format of `OpenPose`, in folders of these names.
fn openpose(folder: &Path, names: [&str; 4]) {
    for (camera, name) in CAMERAS.into_iter().zip(names) {
        let own = folder.join("op").join(name);
        fs::create_dir_all(&own).unwrap();
        for line in recorded(folder, camera) {
            let persons = line["persons"].as_array().unwrap().iter();
            let people = persons.map(|person| {
                let seen = person["keypoints"].as_array().unwrap().iter();
                let numbers = seen.flat_map(|k| [0, 1, 2].map(|i| k[i].as_f64().unwrap_or(0.0)));
                let unseen = std::iter::repeat_n(0.0, 3 * 8);
                json!({"pose_keypoints_2d": numbers.chain(unseen).collect::<Vec<f64>>()})
            });
            let text = json!({"version": 1.3, "people": people.collect::<Vec<Value>>()});
            let file = format!(
                "{name}_{:012}_keypoints.json",
                line["tick"].as_i64().unwrap()
            );
            fs::write(own.join(file), text.to_string()).unwrap();
        }
    }
}

fn append(folder: &Path, text: &str) {
    let venue = fs::read_to_string(folder.join("venue.toml")).unwrap();
    write(folder, "venue.toml", &format!("{venue}\n{text}"));
}

fn farfield(folder: &Path, words: &str) {
    let mut command = command();
    command.current_dir(folder).args(words.split(' '));
    let output = finish(&command.output().unwrap());
    assert_eq!(output.code, 0, "{}", output.stderr);
}

#[test]
#[expect(clippy::too_many_lines, reason = "a table of mistakes")]
fn wrong_input_for_calibrations_is_refused() {
    check_mistakes(&[
        usage(
            "the venue in place of a calibration",
            "calibrate convert venue.toml --out c",
            &["venue.toml", "no camera was found", "`calibration` names"],
        ),
        usage(
            "an unknown format",
            "calibrate convert calibration.toml --to maya --out c",
            &["maya", "qualisys"],
        ),
        usage(
            "an axis called top",
            "calibrate convert calibration.toml --up top --out c",
            &["--up", "top", "-y"],
        ),
        usage(
            "no metres per unit",
            "calibrate convert calibration.toml --metres-per-unit 0 --out c",
            &["metres per unit", "above 0"],
        ),
        usage(
            "keypoints in place of points",
            "calibrate points north-east.jsonl north-west.jsonl --lens calibration.toml --out c.toml",
            &["north-east.jsonl:1", "frame x y"],
        ),
        mistake(
            "points of one camera",
            points,
            "calibrate points north-east.txt --lens calibration.toml --out c.toml",
            &["expected at least 2"],
        ),
        mistake(
            "points without lenses",
            points,
            "calibrate points north-east.txt north-west.txt --out c.toml",
            &["no lens", "--lens"],
        ),
        mistake(
            "a distance without metres",
            points,
            "calibrate points north-east.txt north-west.txt --lens calibration.toml --distance north-east,north-west",
            &["--distance", "north,south=24.1"],
        ),
        mistake(
            "a distance in centimetres",
            points,
            "calibrate points north-east.txt north-west.txt --lens calibration.toml --distance north-east,north-west=560cm",
            &["560cm", "METRES"],
        ),
        mistake(
            "a distance to a camera that is not there",
            points,
            "calibrate points north-east.txt north-west.txt --lens calibration.toml --distance north-east,west=5 --out c.toml",
            &["unknown camera `west`", "north-west"],
        ),
        usage(
            "people without a rate",
            "calibrate people north-east.jsonl north-west.jsonl --lens calibration.toml --out c.toml",
            &["no rate", "--rate-hz"],
        ),
        usage(
            "a stature in centimetres",
            "calibrate people north-east.jsonl north-west.jsonl --rate-hz 30 --lens calibration.toml --stature-m 175 --out c.toml",
            &["found 175", "2.5 metres"],
        ),
        usage(
            "results in place of recordings",
            "calibrate all good --lens calibration.toml --out c.toml",
            &["found no recordings in good", "mp4"],
        ),
        usage(
            "a calibration over the one that is there",
            "calibrate people north-east.jsonl --rate-hz 30 --lens calibration.toml",
            &["calibration.toml already exists", "--replace"],
        ),
        usage(
            "a chessboard of one number",
            "calibrate board . --chessboard 7 --square-mm 60 --camera a",
            &["found `7`", "4x7"],
        ),
        usage(
            "a chessboard without the size of its squares",
            "calibrate board . --chessboard 4x7 --camera a",
            &["--square-mm"],
        ),
        usage(
            "a folder without pictures of a board",
            "calibrate board good --chessboard 4x7 --square-mm 60 --camera a",
            &["good", "no image", "PNG"],
        ),
        usage(
            "a court that is misspelt",
            "calibrate marks . --court fotball",
            &["did you mean `football`"],
        ),
        usage(
            "marks for everybody on the network",
            "calibrate marks . --at 0.0.0.0:8080",
            &["loopback", "ssh -L"],
        ),
        usage(
            "marks at a port alone",
            "calibrate marks . --at 8080",
            &["127.0.0.1:8080"],
        ),
    ]);
}

#[test]
#[expect(clippy::too_many_lines, reason = "a table of mistakes")]
fn wrong_input_for_imports_and_exports_is_refused() {
    check_mistakes(&[
        mistake(
            "an import of nothing",
            |f| fs::create_dir(f.join("empty")).unwrap(),
            "import empty --calibration calibration.toml --rate 30",
            &["no 2D keypoints in empty", "openpose"],
        ),
        mistake(
            "an import without a rate",
            |f| openpose(f, CAMERAS),
            "import op --calibration calibration.toml",
            &["frames per second", "--rate HZ"],
        ),
        mistake(
            "an import of cameras that are not calibrated",
            |f| openpose(f, ["left", "right", "middle", "behind"]),
            "import op --calibration calibration.toml --rate 30 --camera left=op/left",
            &["left"],
        ),
        usage(
            "a model of keypoints that does not exist",
            "import . --calibration calibration.toml --rate 30 --keypoints COCO_19",
            &["COCO_19", "HALPE_26"],
        ),
        usage(
            "a format that is not written",
            "export good --format fbx",
            &["fbx", "glb"],
        ),
        usage(
            "the person of another run",
            "export good --format csv --person 9",
            &["--person: found person 9", "[1, 2]"],
        ),
        usage(
            "ticks of another run",
            "export good --format csv --ticks 500..600",
            &["--ticks: found ticks 500..600", "0..120"],
        ),
        usage(
            "a venue in place of a run",
            "export venue.toml --format csv",
            &["venue.toml", "expected the folder of a run"],
        ),
        usage(
            "marks where there is no place for them",
            "export good --format bvh --gaps mark",
            &["--gaps: bvh", "kept or filled"],
        ),
        usage(
            "a program that has no preset",
            "export good --format bvh --preset maya",
            &["maya", "unreal"],
        ),
        mistake(
            "an export twice",
            |f| farfield(f, "export good --format csv"),
            "export good --format csv",
            &["already exists", "--replace"],
        ),
        usage(
            "a name without a number",
            "export good --format csv --name Ada",
            &["found `Ada`", "3=Ada"],
        ),
        usage(
            "a run to look at",
            "view good",
            &["found a folder", "good/recording.mcap"],
        ),
        usage(
            "a run to replay",
            "replay good --out out",
            &["found a folder", "good/recording.mcap"],
        ),
        usage(
            "a venue to look at",
            "view venue.toml",
            &["venue.toml", "not an MCAP file"],
        ),
        usage(
            "a page at a port alone",
            "view good/recording.mcap --at 8080",
            &["127.0.0.1:8080"],
        ),
    ]);
}

#[test]
fn wrong_edits_of_people_are_refused() {
    check_mistakes(&[
        usage(
            "name and number exchanged",
            "people good name Anna 1",
            &["found `Anna`", "name 3 Anna"],
        ),
        usage(
            "a name for an unknown person",
            "people good name 9 Anna",
            &["found person 9", "[1, 2]"],
        ),
        usage(
            "a merge with oneself",
            "people good merge 1 --into 1",
            &["merge 1 --into 1: found 1, expected another"],
        ),
        usage(
            "a merge of two who are both there",
            "people good merge 2 --into 1",
            &["merge 2 --into 1: found persons", "both at ticks 0 to 119"],
        ),
        usage(
            "a split after the end",
            "people good split 1 --at 5000",
            &["found tick 5000", "1 to 119"],
        ),
        usage(
            "an undo of nothing",
            "people good undo",
            &["undo: there is no edit to undo"],
        ),
        usage(
            "an undo of an edit that is not there",
            "people good undo 4",
            &["undo 4: found 4", "`farfield people RUN` lists edits"],
        ),
        usage(
            "a body without a name",
            "people good save 1 --to anna.toml",
            &["no name of person 1"],
        ),
        usage(
            "the people of a venue",
            "people venue.toml",
            &["venue.toml", "expected the folder of a run"],
        ),
        mistake(
            "a subject that is not there",
            |f| append(f, "[[subject]]\nprofile = \"subjects/anna.toml\"\n"),
            "run venue.toml --out out",
            &["venue.toml:35", "subjects/anna.toml"],
        ),
        mistake(
            "poses in place of a subject",
            |f| append(f, "[[subject]]\nprofile = \"good/summary.json\"\n"),
            "run venue.toml --out out",
            &["good/summary.json"],
        ),
        mistake(
            "one subject twice",
            |f| {
                farfield(f, "people good name 1 Anna");
                farfield(f, "people good save 1 --to anna.toml");
                let subject = "[[subject]]\nprofile = \"anna.toml\"\n";
                append(f, &format!("{subject}{subject}"));
            },
            "run venue.toml --out out",
            &["subject[1].profile", "each subject once"],
        ),
    ]);
}

#[test]
fn impossible_streams_pages_and_fisheyes_are_refused() {
    const RUN: &str = "run venue.toml --out out";
    check_mistakes(&[
        usage(
            "an unknown protocol",
            "run venue.toml --out out --stream osc",
            &["osc", "vmc"],
        ),
        usage(
            "a stream with a colon",
            "run venue.toml --out out --stream vmc:192.168.1.20",
            &["vmc:192.168.1.20", "expected one of qtm"],
        ),
        usage(
            "a stream to no address",
            "run venue.toml --out out --stream qtm=256.0.0.1",
            &["256.0.0.1", "127.0.0.1:22223"],
        ),
        mistake(
            "a stream with a name",
            |f| append(f, "[[stream]]\nname = \"qtm\"\n"),
            RUN,
            &["stream[0].name", "`to`"],
        ),
        usage(
            "a page for everybody",
            "run venue.toml --out out --page=0.0.0.0:8080",
            &["--page=0.0.0.0:8080", "other machines", "farfield certs"],
        ),
        usage(
            "a page of a fusion for everybody",
            "fusion venue.toml --page=0.0.0.0:8080",
            &["--page=0.0.0.0:8080", "other machines", "farfield certs"],
        ),
        mistake(
            "a page at all addresses of a machine without a name",
            |f| farfield(f, "certs venue.toml --out certs"),
            "fusion venue.toml --certificates certs --page=0.0.0.0:8080",
            &["--page=0.0.0.0:8080", "--page-name NAME"],
        ),
        usage(
            "a page at a port alone",
            "run venue.toml --out out --page=8080",
            &["127.0.0.1:8080"],
        ),
        mistake(
            "a fisheye with five numbers",
            |f| replace(f, "calibration.toml", "fisheye = false", "fisheye = true"),
            RUN,
            &["calibration.toml:5", "expected 4 of a fisheye"],
        ),
        mistake(
            "a fisheye in words",
            |f| {
                replace(
                    f,
                    "calibration.toml",
                    "fisheye = false",
                    "fisheye = \"yes\"",
                );
            },
            RUN,
            &["calibration.toml:8", "true or false"],
        ),
    ]);
}
