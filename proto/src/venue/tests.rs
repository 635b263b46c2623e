//! Tests of the venue file.

mod people;
mod sources;

use std::path::Path;

use nalgebra::{Isometry3, Vector3};

use super::parameters::{Audience, PARAMETERS};
use super::*;
use crate::camera::{Distortion, Intrinsics};
use crate::frames::Transform;

const VENUE: &str = r#"name = "hall-3"
rate_hz = 60.0
calibration = "calibration.toml"
network = "models/net.toml"
first_tick = 300

[fusion]
listen = ["tcp/127.0.0.1:7447"]

[field]
min_m = [-12.0, -8.0, 0.0]
max_m = [12.0, 8.0, 2.5]

[[viewpoint]]
name = "north-east"
[[viewpoint.camera]]
name = "ne-left"
source = { kind = "video", path = "videos/ne-left.mp4" }
[[viewpoint.camera]]
name = "ne-right"
source = { kind = "keypoints", path = "ne-right.jsonl", grid = [96, 128] }

[[viewpoint]]
name = "south"
[[viewpoint.camera]]
name = "south"
source = { kind = "v4l", device = "/dev/video0" }

[[person]]
tick = 301
keypoints_m = { left_shoulder = [0.1, 0.2, 1.4], right_shoulder = [-0.2, 0.2, 1.4], left_hip = [0.0, 0.2, 0.9], left_knee = [0.0, 0.2, 0.5], nose = [0.0, 0.3, 1.6] }

[tuning]
lattice.half_width_m = 0.3
"#;

fn calibration() -> Calibration {
    let intrinsics = Intrinsics {
        fx_px: 900.0,
        fy_px: 900.0,
        cx_px: 640.0,
        cy_px: 360.0,
    };
    let cameras = [
        ("ne-left", 3.0),
        ("ne-right", 4.0),
        ("south", -7.0),
        ("spare", 90.0),
    ]
    .map(|(name, x)| {
        // Cameras at (x, 2 x, 1), not turned.
        let place = Transform::new(Isometry3::new(
            Vector3::new(-x, -2.0 * x, -1.0),
            Vector3::zeros(),
        ));
        let model = CameraModel::new(name, [1280, 720], intrinsics, Distortion::default(), place);
        (name.to_owned(), model.unwrap())
    });
    Calibration {
        cameras: cameras.into(),
        hash: "0123456789abcdef".to_owned(),
        rotation_lengths_rad: std::collections::BTreeMap::new(),
    }
}

fn parse(text: &str) -> Result<Venue, FileError> {
    Venue::parse(text, Path::new("venues/hall.toml"), calibration())
}

fn refusal(from: &str, to: &str) -> String {
    assert!(VENUE.contains(from));
    parse(&VENUE.replace(from, to)).unwrap_err().to_string()
}

fn check(from: &str, to: &str, expected: &str) {
    assert_eq!(refusal(from, to), format!("venues/hall.toml:{expected}"));
}

#[test]
fn a_whole_venue_is_read() {
    let venue = parse(VENUE).unwrap();
    assert_eq!(
        (venue.name.as_str(), venue.first_tick),
        ("hall-3", Tick(300))
    );
    assert_eq!(venue.calibration_path, Path::new("venues/calibration.toml"));
    assert_eq!(
        venue.network.as_deref(),
        Some(Path::new("venues/models/net.toml"))
    );
    assert_eq!(
        venue.viewpoints[0].cameras,
        [CameraIndex(0), CameraIndex(1)]
    );
    let south = venue.viewpoint_named("south").unwrap();
    assert_eq!(south, ViewpointIndex(1));
    let camera = venue.camera(CameraIndex(2)).unwrap();
    assert_eq!((camera.viewpoint, camera.model.name()), (south, "south"));
    assert_eq!(
        camera.source,
        Source::V4l {
            device: "/dev/video0".into(),
            settings: DeviceSettings::default(),
        }
    );
    assert_eq!(
        venue.cameras[1].source,
        Source::Keypoints {
            path: "venues/ne-right.jsonl".into(),
            grid: [96, 128],
            sigma_cells: 2.0
        }
    );
    assert!((venue.parameters.lattice.half_width_m - 0.3).abs() < 1e-12);
    assert_eq!(
        venue.parameters.births,
        parameters::BirthParameters::default()
    );
    assert!(venue.needs_network());
    assert_eq!(
        (venue.hashes.venue.len(), venue.hashes.calibration.as_str()),
        (16, "0123456789abcdef")
    );
}

#[test]
fn pictures_leave_an_edge_only_if_allowed_and_over_tls() {
    let security = |lines: &str| {
        let text = VENUE.replace("[field]", &format!("[security]\n{lines}\n[field]"));
        parse(&text).map(|venue| venue.security)
    };
    assert!(!parse(VENUE).unwrap().security.pictures);
    assert!(!security("certificates = \"certs\"").unwrap().pictures);
    assert!(
        !security("allow_plaintext = true\npictures = false")
            .unwrap()
            .pictures
    );
    assert!(
        security("certificates = \"certs\"\npictures = true")
            .unwrap()
            .pictures
    );
    // Without keys, nodes and pictures stay on one machine.
    assert!(security("pictures = true").unwrap().pictures);
    let refused = security("allow_plaintext = true\npictures = true").unwrap_err();
    assert_eq!(
        refused.to_string(),
        "venues/hall.toml:12: `security.pictures`: pictures leave an edge over TLS only: remove `allow_plaintext`, or set `pictures = false`"
    );
}

#[test]
fn the_default_floor_is_0_or_the_nearest_height_in_the_field() {
    let floor_m = |from: &str, to: &str| parse(&VENUE.replace(from, to)).unwrap().field.floor_m;
    assert!(floor_m("2.5]", "2.5]").abs() < 1e-12);
    assert!((floor_m("2.5]", "2.5]\nfloor_m = 1.2") - 1.2).abs() < 1e-12);
    let low = VENUE
        .lines()
        .find(|line| line.starts_with("min_m"))
        .unwrap();
    assert!((floor_m(low, "min_m = [-12.0, -8.0, 0.8]") - 0.8).abs() < 1e-12);
}

#[test]
fn without_a_field_people_are_tracked_around_the_cameras() {
    let cut = VENUE.find("[field]").unwrap()..VENUE.find("[[viewpoint]]").unwrap();
    let mut text = VENUE.to_owned();
    text.replace_range(cut, "");
    let field = parse(&text).unwrap().field;
    let corners = [-12.0, -19.0, -0.3, 9.0, 13.0, 2.6];
    let found = field.min_m.into_iter().chain(field.max_m);
    assert!(
        found.zip(corners).all(|(a, b)| (a - b).abs() < 1e-9),
        "{field:?}"
    );
}

#[test]
fn a_court_is_at_the_origin_or_at_the_given_place() {
    let court = |more: &str| {
        let from = "[12.0, 8.0, 2.5]";
        let text = VENUE.replace(from, &format!("{from}\n{more}"));
        parse(&text).unwrap().court
    };
    assert_eq!(court(""), None);
    let usual = court("court = \"futsal\"").unwrap();
    assert_eq!(
        (usual.court.name, usual.court.size_m),
        ("futsal", [40.0, 20.0])
    );
    assert_eq!((usual.centre_m, usual.turn_rad), ([0.0, 0.0], 0.0));
    let placed = "court = \"futsal\"\ncourt_size_m = [38, 19]\ncourt_centre_m = [1.5, -2]\ncourt_turn_deg = 90";
    let placed = court(placed).unwrap();
    assert_eq!(
        (placed.court.size_m, placed.centre_m),
        ([38.0, 19.0], [1.5, -2.0])
    );
    assert!((placed.turn_rad - std::f64::consts::FRAC_PI_2).abs() < 1e-12);
}

#[test]
fn a_court_needs_no_box() {
    let boxed = "min_m = [-12.0, -8.0, 0.0]\nmax_m = [12.0, 8.0, 2.5]";
    let venue = parse(&VENUE.replace(boxed, "court = \"tennis\"")).unwrap();
    assert_eq!(venue.court.unwrap().court.name, "tennis");
    assert!((venue.field.min_m[0] + 12.0).abs() < 1e-9);
}

#[test]
fn keypoint_files_have_the_named_set() {
    let named = |set: &str| VENUE.replace("first_tick = 300", &format!("keypoints = \"{set}\""));
    let parse = |text: &str| Venue::parse(text, Path::new("venue.toml"), calibration());
    assert_eq!(parse(VENUE).unwrap().keypoints.len(), 17);
    assert_eq!(parse(&named("coco23")).unwrap().keypoints.len(), 23);
    let error = |text: &str| parse(text).unwrap_err().to_string();
    assert!(error(&named("coco18")).contains("`keypoints`: found \"coco18\""));
    let file = r#"kind = "keypoints", path = "ne-right.jsonl""#;
    let video = named("coco23").replace(
        &format!("{file}, grid = [96, 128]"),
        r#"kind = "video", path = "a.mp4""#,
    );
    assert!(error(&video).contains("without keypoint files"));
    let simulated = r#"kind = "simulated", path = "scene.toml", content = "maps""#;
    let mixed = named("coco23").replace(r#"kind = "v4l", device = "/dev/video0""#, simulated);
    assert!(error(&mixed).contains("simulated maps"));
}

#[test]
fn an_unknown_court_is_refused_with_the_known_ones() {
    let max = "max_m = [12.0, 8.0, 2.5]";
    let refused = |more: &str, expected: &str| check(max, &format!("{max}\n{more}"), expected);
    refused(
        "court = \"curling\"",
        "13: `field.court`: unknown court `curling`, expected one of `basketball`, `football`, `futsal`, `handball`, `tennis`, `volleyball`",
    );
    refused(
        "court = \"fustal\"",
        "13: `field.court`: unknown court `fustal`, did you mean `futsal`?",
    );
    refused(
        "court = \"futsal\"\ncourt_size_m = [20, 40]",
        "14: `field.court_size_m`: found a futsal court of 20 x 40 m, expected 25 to 42 m by 15 to 25 m (FIFA, Futsal Laws of the Game, law 1)",
    );
    refused(
        "court = \"futsal\"\ncourt_centre_m = [0, inf]",
        "14: `field.court_centre_m`: found inf, expected metres from -10000 to 10000",
    );
    refused(
        "court = \"futsal\"\ncourt_turn_deg = nan",
        "14: `field.court_turn_deg`: found NaN, expected degrees from -360 to 360",
    );
    refused(
        "court_turn_deg = 90",
        "13: `field.court_turn_deg`: found it without a court, expected a `court` that it applies to",
    );
    check(
        max,
        "",
        "10: `field`: found no `max_m`, expected it together with `min_m`",
    );
}

#[test]
fn unknown_names_are_refused_with_the_nearest() {
    check(
        "rate_hz",
        "rate_herz",
        "2: `rate_herz`: unknown field `rate_herz`, did you mean `rate_hz`?",
    );
    check(
        "half_width_m",
        "halfwidth_m",
        "34: `tuning.lattice.halfwidth_m`: unknown field `halfwidth_m`, did you mean `[tuning] lattice.half_width_m`?",
    );
    check(
        "\"video\"",
        "\"vidoe\"",
        "18: `viewpoint[0].camera[0].source.kind`: unknown kind `vidoe`, did you mean `video`?",
    );
    check(
        "lattice.",
        "latice.",
        "34: `tuning.latice`: unknown field `latice`, did you mean `lattice`?",
    );
    check(
        "name = \"ne-left\"",
        "name = \"ne-lest\"",
        "17: `viewpoint[0].camera[0].name`: unknown camera of the calibration `ne-lest`, did you mean `ne-left`?",
    );
}

#[test]
fn a_mistyped_camera_is_never_matched_to_one_in_use() {
    // The nearest name is `ne-right`, which the venue uses two lines further down.
    check(
        "name = \"ne-left\"",
        "name = \"ne-rigth\"",
        "17: `viewpoint[0].camera[0].name`: unknown camera of the calibration `ne-rigth`, expected one of `ne-left`, `spare`",
    );
}

#[test]
fn cameras_and_viewpoints_have_one_place() {
    check(
        "name = \"ne-right\"",
        "name = \"ne-left\"",
        "20: `viewpoint[0].camera[1].name`: camera `ne-left` is used twice",
    );
    check(
        "name = \"south\"\n[[",
        "name = \"north-east\"\n[[",
        "24: `viewpoint[1].name`: a second viewpoint is called `north-east`, expected names that differ",
    );
    check(
        "name = \"north-east\"",
        "name = \"north/east\"",
        "15: `viewpoint[0].name`: found \"north/east\", expected 1 to 64 ASCII letters, digits, `-`, `_` or `.`",
    );
    check(
        "name = \"north-east\"",
        "name = \"fusion\"",
        "15: `viewpoint[0].name`: found \"fusion\", which is the name of the fusion node",
    );
}

#[test]
fn numbers_out_of_their_range_are_refused() {
    check(
        "rate_hz = 60.0",
        "rate_hz = -3",
        "2: `rate_hz`: found -3.0, expected a number above 0 and up to 1000",
    );
    check(
        "half_width_m = 0.3",
        "half_width_m = nan",
        "34: `tuning.lattice.half_width_m`: found NaN, expected a number from 0.01 to 2",
    );
    check(
        "[12.0, 8.0, 2.5]",
        "[12.0, -8.0, 2.5]",
        "12: `field.max_m[1]`: found -8.0, expected more than `min_m` (-8.0)",
    );
    check(
        "max_m = [12.0, 8.0, 2.5]",
        "max_m = [12.0, 8.0, 2.5]\nfloor_m = 2.6",
        "13: `field.floor_m`: found 2.6, expected a height of the field, 0.0 to 2.5",
    );
    check(
        "lattice.half_width_m = 0.3",
        "boxes.rotate_until_deg = 60",
        "34: `tuning.boxes.rotate_until_deg`: found 60.0, expected at most `rotate_from_deg` (40.0)",
    );
    check(
        "[0.1, 0.2, 1.4]",
        "[0.1, inf, 1.4]",
        "31: `person[0].keypoints_m.left_shoulder`: found inf, expected metres",
    );
    check(
        "tcp/127.0.0.1:7447",
        "127.0.0.1:7447",
        "8: `fusion.listen[0]`: found \"127.0.0.1:7447\", expected an endpoint such as \"tcp/127.0.0.1:7447\"",
    );
}

#[test]
fn huge_numbers_are_printed_in_few_digits() {
    check(
        "half_width_m = 0.3",
        "half_width_m = 1e300",
        "34: `tuning.lattice.half_width_m`: found 1e300, expected a number from 0.01 to 2",
    );
    check(
        "rate_hz = 60.0",
        "rate_hz = 1e300",
        "2: `rate_hz`: found 1e300, expected a number above 0 and up to 1000",
    );
}

#[test]
fn ticks_without_an_exact_time_are_refused() {
    check(
        "first_tick = 300",
        "first_tick = 9007199254740993",
        "5: `first_tick`: found 9007199254740993, expected a tick from -9007199254740992 to 9007199254740992",
    );
    check(
        "tick = 301",
        "tick = -9223372036854775808",
        "30: `person[0].tick`: found -9223372036854775808, expected a tick from -9007199254740992 to 9007199254740992",
    );
    let last = VENUE.replace("first_tick = 300", "first_tick = 9007199254740992");
    assert_eq!(parse(&last).unwrap().first_tick, Tick(1 << 53));
}

/// A table of the venue in these tests at which parameters may be.
const TUNED: &str = "[tuning]\nlattice.half_width_m = 0.3";

#[test]
fn a_field_of_tuning_is_refused_elsewhere_with_its_place() {
    check(
        TUNED,
        "[births]\nflat_m = 0.05",
        "34: `births.flat_m`: it belongs at `[tuning] births.flat_m`",
    );
    check(
        TUNED,
        "[smoothing]\ndelay_ms = 100.0\ncutoff_hz = 2.0\n[ik]\niterations = 12",
        "35: `smoothing.cutoff_hz`: it belongs at `[tuning] smoothing.cutoff_hz`",
    );
    check(
        TUNED,
        "[contact]",
        "33: `contact`: it belongs at `[tuning] contact`",
    );
}

#[test]
fn a_users_field_is_refused_under_tuning() {
    check(
        TUNED,
        "[tuning]\nbirths.flat_m = 0.05\nbirths.coast_s = 2.0",
        "35: `tuning.births.coast_s`: `coast_s` is a user's field: write it in `[births]`",
    );
}

#[test]
fn an_unknown_field_is_refused_with_the_place_of_the_nearest() {
    check(
        TUNED,
        "[smoothing]\ncutof_hz = 2.0",
        "34: `smoothing.cutof_hz`: unknown field `cutof_hz`, did you mean `[tuning] smoothing.cutoff_hz`?",
    );
    check(
        TUNED,
        "[tuning]\nbirths.coasts_s = 2.0",
        "34: `tuning.births.coasts_s`: unknown field `coasts_s`, did you mean `[births] coast_s`?",
    );
}

#[test]
fn every_tuning_field_in_a_users_table_is_refused_with_its_place() {
    let tuning = PARAMETERS.iter().filter(|p| p.audience == Audience::Tuning);
    for (table, name) in tuning.map(|p| (p.table, p.name)) {
        check(
            TUNED,
            &format!("[{table}]\n{name} = 1"),
            &format!("34: `{table}.{name}`: it belongs at `[tuning] {table}.{name}`"),
        );
    }
}

fn with_streams(text: &str) -> String {
    VENUE.replace("[tuning]", &format!("{text}\n[tuning]"))
}

#[test]
fn streams_are_text_with_their_lines() {
    let text = with_streams(
        "[[stream]]\nto = \"vmc\"\naddress = \"127.0.0.1:39539\"\n[[stream]]\nto = \"carrier-pigeon\"",
    );
    let venue = parse(&text).unwrap();
    let [vmc, other] = &venue.streams[..] else {
        panic!("{:?}", venue.streams)
    };
    assert_eq!(vmc.to, "vmc");
    assert_eq!(vmc.address.as_deref(), Some("127.0.0.1:39539"));
    // Unknown protocols are refused by the command that opens streams; an edge opens none.
    assert_eq!(
        (other.to.as_str(), &other.address),
        ("carrier-pigeon", &None)
    );
    let at = |field| other.error(field, "found it").to_string();
    assert_eq!(
        at(StreamField::To),
        "venues/hall.toml:37: `stream[1].to`: found it"
    );
    // For an absent field, the line of its table.
    assert_eq!(
        at(StreamField::Address),
        "venues/hall.toml:36: `stream[1].address`: found it"
    );
}

#[test]
fn impossible_streams_are_refused_with_line_and_field() {
    let refused = |text: &str| parse(&with_streams(text)).unwrap_err().to_string();
    for (text, expected) in [
        (
            "[[stream]]\nto = \"\"",
            "34: `stream[0].to`: found \"\", expected the name of a protocol",
        ),
        (
            "[[stream]]\nto = \"v m\"",
            "34: `stream[0].to`: found \"v m\"",
        ),
        (
            "[[stream]]\nto = \"qtm\"\naddress = \"\"",
            "35: `stream[0].address`: found \"\", expected an address",
        ),
        (
            "[[stream]]\nto = \"qtm\"\n[[stream]]\nto = \"qtm\"",
            "36: `stream[1].to`: found \"qtm\" a second time",
        ),
        (
            "[[stream]]\nname = \"qtm\"",
            "34: `stream[0].name`: unknown field `name`",
        ),
        (
            "[[stream]]\naddress = \"::1\"",
            "`stream[0].to`: the field is missing",
        ),
    ] {
        let message = refused(text);
        assert!(message.contains(expected), "{message}\n{expected}");
    }
    let many = (0..33).map(|i| format!("[[stream]]\nto = \"s{i}\"\n"));
    let many = many.collect::<Vec<_>>().concat();
    assert!(refused(&many).contains("`stream`: found 33, expected at most 32"));
}
