//! Mistakes in venue files, calibrations, keypoint files and videos.

use std::fs;
use std::path::Path;

use super::{
    Mistake, change_lines, change_ticks, check_mistakes, ffmpeg, nothing, replace, with_video,
    write,
};

const RUN: &str = "run venue.toml --out out";
const CAMERAS: [&str; 4] = ["north-east", "north-west", "south-west", "south-east"];

#[test]
#[expect(clippy::too_many_lines, reason = "a table of mistakes")]
fn a_wrong_venue_file_is_refused_with_line_and_field() {
    let mistake = |what, make, expected| Mistake {
        what,
        make,
        words: RUN,
        code: 2,
        expected,
    };
    check_mistakes(&[
        mistake(
            "no rate",
            |f| replace(f, "venue.toml", "rate_hz = 30.0\n", ""),
            &["venue.toml", "rate_hz", "missing"],
        ),
        mistake(
            "the rate as text",
            |f| replace(f, "venue.toml", "30.0", "\"30\""),
            &["venue.toml:3", "rate_hz"],
        ),
        mistake(
            "a rate of 0",
            |f| replace(f, "venue.toml", "30.0", "0.0"),
            &["venue.toml:3", "above 0"],
        ),
        mistake(
            "viewpoints in the plural",
            |f| replace(f, "venue.toml", "[[viewpoint]]", "[[viewpoints]]"),
            &["venue.toml", "viewpoint"],
        ),
        mistake(
            "a viewpoint twice",
            |f| {
                replace(
                    f,
                    "venue.toml",
                    "[[viewpoint]]\nname = \"north-west\"",
                    "[[viewpoint]]\nname = \"north-east\"",
                );
            },
            &["viewpoint[1].name", "differ"],
        ),
        mistake(
            "one recording for two cameras",
            |f| replace(f, "venue.toml", "north-west.jsonl", "north-east.jsonl"),
            &["north-east.jsonl", "the same recording"],
        ),
        mistake(
            "a field inside out",
            |f| replace(f, "venue.toml", "min_m = [-4.0", "min_m = [14.0"),
            &["field.max_m", "more than `min_m`"],
        ),
        mistake(
            "no viewpoint",
            without_viewpoints,
            &["viewpoint", "found 0"],
        ),
        mistake(
            "a kind in the singular",
            |f| replace(f, "venue.toml", "\"keypoints\"", "\"keypoint\""),
            &["did you mean `keypoints`"],
        ),
        mistake(
            "a path of Windows",
            |f| {
                replace(
                    f,
                    "venue.toml",
                    "\"north-east.jsonl\"",
                    "\"C:\\videos\\a.jsonl\"",
                );
            },
            &["venue.toml:14"],
        ),
        mistake(
            "a table that is called otherwise",
            |f| append(f, "[smooth]\ndelay_ms = 100\n"),
            &["venue.toml", "smooth"],
        ),
        mistake(
            "a parameter out of range",
            |f| append(f, "[tuning]\nsmoothing.cutoff_hz = -1.0\n"),
            &["smoothing.cutoff_hz", "-1"],
        ),
        mistake(
            "a file that is not there",
            |f| replace(f, "venue.toml", "south-east.jsonl", "southeast.jsonl"),
            &["southeast.jsonl"],
        ),
        mistake(
            "a video without a network",
            |f| {
                replace(
                    f,
                    "venue.toml",
                    "kind = \"keypoints\", path = \"north-east.jsonl\"",
                    "kind = \"video\", path = \"a.mp4\"",
                );
            },
            &["network", "north-east"],
        ),
        mistake(
            "a camera that is not calibrated",
            |f| {
                replace(
                    f,
                    "venue.toml",
                    "camera]]\nname = \"north-west\"",
                    "camera]]\nname = \"nw\"",
                );
            },
            &["venue.toml", "nw"],
        ),
    ]);
}

fn without_viewpoints(folder: &Path) {
    let text = fs::read_to_string(folder.join("venue.toml")).unwrap();
    write(
        folder,
        "venue.toml",
        text.split("[[viewpoint]]").next().unwrap(),
    );
}

fn append(folder: &Path, text: &str) {
    let venue = fs::read_to_string(folder.join("venue.toml")).unwrap();
    write(folder, "venue.toml", &format!("{venue}\n{text}"));
}

#[test]
fn a_wrong_calibration_is_refused_with_file_and_field() {
    let mistake = |what, make, expected| Mistake {
        what,
        make,
        words: RUN,
        code: 2,
        expected,
    };
    check_mistakes(&[
        mistake(
            "no calibration",
            |f| fs::remove_file(f.join("calibration.toml")).unwrap(),
            &["calibration.toml", "venue.toml:4"],
        ),
        mistake(
            "an empty calibration",
            |f| write(f, "calibration.toml", ""),
            &["calibration.toml", "no camera"],
        ),
        mistake(
            "a calibration in JSON",
            |f| write(f, "calibration.toml", "{\"cameras\": []}"),
            &["calibration.toml:1", "TOML"],
        ),
        mistake(
            "millimetres",
            millimetres,
            &["calibration.toml", "millimetres"],
        ),
        mistake(
            "a matrix in one row",
            |f| {
                replace(
                    f,
                    "calibration.toml",
                    "[[1050.0, 0.0, 959.5], [0.0, 1050.0, 599.5], [0.0, 0.0, 1.0]]",
                    "[1050.0, 1050.0, 959.5, 599.5]",
                );
            },
            &["calibration.toml:4", "matrix"],
        ),
        mistake(
            "three distortions",
            |f| {
                replace(
                    f,
                    "calibration.toml",
                    "[-0.08, 0.02, 0.0, 0.0, 0.0]",
                    "[-0.08, 0.02, 0.0]",
                );
            },
            &["distortions", "found 3"],
        ),
        mistake(
            "a size of one number",
            |f| replace(f, "calibration.toml", "size = [1920, 1200]", "size = 1920"),
            &["calibration.toml", "size"],
        ),
    ]);
}

pub(super) fn millimetres(folder: &Path) {
    let text = fs::read_to_string(folder.join("calibration.toml")).unwrap();
    let lines = text.lines().map(|line| {
        let Some(numbers) = line.strip_prefix("translation = [") else {
            return format!("{line}\n");
        };
        let numbers = numbers.trim_end_matches(']').split(", ");
        let mm = numbers.map(|m| format!("{:?}", m.parse::<f64>().unwrap() * 1000.0));
        format!("translation = [{}]\n", mm.collect::<Vec<_>>().join(", "))
    });
    let text: String = lines.collect();
    write(folder, "calibration.toml", &text);
}

#[test]
fn wrong_recordings_are_refused_with_camera_and_line() {
    let mistake = |what, make, expected| Mistake {
        what,
        make,
        words: RUN,
        code: 2,
        expected,
    };
    check_mistakes(&[
        mistake(
            "keypoints as CSV",
            |f| write(f, "north-east.jsonl", "tick,x,y\n0,1,2\n"),
            &["north-east.jsonl:1", "not JSON"],
        ),
        mistake(
            "keypoints of nothing",
            |f| write(f, "north-east.jsonl", ""),
            &["north-east.jsonl", "no lines"],
        ),
        mistake(
            "sixteen keypoints",
            sixteen_keypoints,
            &["found 16 keypoints", "17"],
        ),
        mistake(
            "a tick twice",
            |f| change_lines(f, "north-east.jsonl", |line| line["tick"] = 0.into()),
            &["north-east.jsonl:2", "twice"],
        ),
        mistake(
            "ticks counted from elsewhere",
            |f| change_ticks(f, "north-east.jsonl", 1000),
            &["north-east", "1000"],
        ),
        mistake(
            "shares of the picture",
            shares_of_the_picture,
            &["shares of a picture", "1920 x 1200"],
        ),
        mistake(
            "text called a video",
            text_as_video,
            &["a.mp4", "cannot be read"],
        ),
        mistake("sound without pictures", sound_as_video, &["a.mp4"]),
        mistake("a video that is half as fast", slow_video, &["a.mp4"]),
        mistake("a small video", small_video, &["a.mp4"]),
    ]);
}

fn sixteen_keypoints(folder: &Path) {
    change_lines(folder, "north-east.jsonl", |line| {
        for person in line["persons"].as_array_mut().unwrap() {
            person["keypoints"].as_array_mut().unwrap().pop();
        }
    });
}

fn shares_of_the_picture(folder: &Path) {
    for camera in CAMERAS {
        change_lines(folder, &format!("{camera}.jsonl"), |line| {
            for person in line["persons"].as_array_mut().unwrap() {
                for point in person["keypoints"].as_array_mut().unwrap() {
                    if let Some(point) = point.as_array_mut() {
                        point[0] = (point[0].as_f64().unwrap() / 1920.0).into();
                        point[1] = (point[1].as_f64().unwrap() / 1200.0).into();
                    }
                }
            }
        });
    }
}

fn text_as_video(folder: &Path) {
    with_video(folder, "a.mp4");
    write(folder, "a.mp4", "not a video");
}

fn sound_as_video(folder: &Path) {
    with_video(folder, "a.mp4");
    ffmpeg(folder, "-f lavfi -i sine=d=1", "a.mp4");
}

fn slow_video(folder: &Path) {
    with_video(folder, "a.mp4");
    ffmpeg(
        folder,
        "-f lavfi -i color=black:s=1920x1200:r=15:d=8",
        "a.mp4",
    );
}

fn small_video(folder: &Path) {
    with_video(folder, "a.mp4");
    ffmpeg(
        folder,
        "-f lavfi -i color=black:s=640x400:r=30:d=4",
        "a.mp4",
    );
}

#[test]
fn other_files_are_refused_as_a_venue() {
    let mistake = |what, words, expected| Mistake {
        what,
        make: nothing,
        words,
        code: 2,
        expected,
    };
    check_mistakes(&[
        mistake(
            "a folder in place of the venue",
            "run . --out out",
            &["found a folder", "expected the venue file"],
        ),
        mistake(
            "a venue that is misspelt",
            "run venue.tml --out out",
            &["venue.tml"],
        ),
        mistake(
            "the calibration in place of the venue",
            "run calibration.toml --out out",
            &["calibration.toml:1", "unknown field"],
        ),
        mistake(
            "a venue in place of a scene",
            "simulate venue.toml --out out",
            &["venue.toml", "field"],
        ),
        mistake(
            "a viewpoint that is not there",
            "edge venue.toml --viewpoint north",
            &["north", "north-east, north-west"],
        ),
    ]);
}
