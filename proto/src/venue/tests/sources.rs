//! Tests of the sources of cameras.

use std::path::Path;

use super::super::*;
use super::{VENUE, calibration, check, parse, refusal};

#[test]
fn a_camera_has_a_source_of_tick_numbers() {
    let with = |line: &str| {
        let south = "source = { kind = \"v4l\", device = \"/dev/video0\" }";
        let text = VENUE.replace(south, &format!("{south}\n{line}"));
        Venue::parse(&text, Path::new("venue.toml"), calibration())
    };
    let venue = with("tick_from = \"count\"\ncapture_delay_ms = 12.5").unwrap();
    assert_eq!(venue.cameras[2].tick_from, TickFrom::Count);
    assert_eq!(venue.cameras[2].capture_delay_s, Some(0.0125));
    assert_eq!(venue.cameras[1].capture_delay_s, None);
    assert_eq!(venue.cameras[0].tick_from, TickFrom::Clock);
    for (wrong, expected) in [
        ("tick_from = \"timecode\"", "kind \"video\""),
        ("tick_from = \"cuont\"", "count"),
        ("capture_delay_ms = -1.0", "0 to 10000"),
    ] {
        let message = with(wrong).unwrap_err().to_string();
        assert!(message.contains(expected), "{message}");
    }
}

#[test]
fn a_kernel_camera_has_a_format_and_controls_of_its_own() {
    let with = |more: &str| {
        let south = "kind = \"v4l\", device = \"/dev/video0\"";
        let text = VENUE.replace(south, &format!("{south}, {more}"));
        Venue::parse(&text, Path::new("venue.toml"), calibration())
    };
    let controls = "controls = { gain = 64, auto_exposure = \"Manual Mode\", autofocus = false }";
    let venue = with(&format!("format = \"MJPG\", {controls}")).unwrap();
    let Source::V4l { settings, .. } = &venue.cameras[2].source else {
        unreachable!("the source was written above")
    };
    assert_eq!(settings.format.as_deref(), Some("MJPG"));
    let given: Vec<_> = settings.controls.iter().collect();
    let [focus, exposure, gain] = ["autofocus", "auto_exposure", "gain"].map(str::to_owned);
    assert_eq!(
        given,
        [
            (&exposure, &ControlValue::Choice("Manual Mode".to_owned())),
            (&focus, &ControlValue::Switch(false)),
            (&gain, &ControlValue::Number(64)),
        ]
    );
    let refused = with("controls = { gain = 1.5 }").unwrap_err().to_string();
    assert!(
        refused.contains(
            "source.controls.gain`: found 1.5, expected true, false, a whole number or a text"
        ),
        "{refused}"
    );
}

#[test]
fn a_stream_has_the_options_that_read_it_and_no_others() {
    let with = |more: &str| {
        let video = "kind = \"video\", path = \"videos/ne-left.mp4\"";
        let text = format!("kind = \"ffmpeg\", url = \"rtsp://c/1\", {more}");
        Venue::parse(
            &VENUE.replace(video, &text),
            Path::new("venue.toml"),
            calibration(),
        )
    };
    let venue = with("options = { hwaccel = \"vaapi\", rtsp_transport = \"udp\" }").unwrap();
    let Source::Ffmpeg { options, .. } = &venue.cameras[0].source else {
        unreachable!("the source was written above")
    };
    assert_eq!((options.len(), options["hwaccel"].as_str()), (2, "vaapi"));
    for (option, expected) in [
        ("hwacel", "unknown option `hwacel`, did you mean `hwaccel`?"),
        (
            "progress",
            "source.options.progress`: unknown option `progress`",
        ),
    ] {
        let refused = with(&format!("options = {{ {option} = \"x\" }}"))
            .unwrap_err()
            .to_string();
        assert!(refused.contains(expected), "{refused}");
    }
}

#[test]
fn keypoint_files_need_no_network_and_pictures_do() {
    let text = "name = \"k\"\nrate_hz = 20\ncalibration = \"c.toml\"\n[[viewpoint]]\nname = \"v\"\n\
        [[viewpoint.camera]]\nname = \"south\"\nsource = { kind = \"keypoints\", path = \"k.jsonl\" }\n";
    assert!(!parse(text).unwrap().needs_network());
    let refused = refusal("network = \"models/net.toml\"\n", "");
    assert!(
        refused.contains(
            "`network`: the field is missing: camera `ne-left` of viewpoint `north-east`"
        ),
        "{refused}"
    );
}

#[test]
fn a_simulated_camera_has_a_scene_and_a_content() {
    let simulated = |more: &str| {
        let text = format!("kind = \"simulated\", path = \"scene.toml\"{more}");
        VENUE.replace("kind = \"video\", path = \"videos/ne-left.mp4\"", &text)
    };
    let venue = parse(&simulated(", content = \"pixels\"")).unwrap();
    assert_eq!(
        venue.cameras[0].source,
        Source::Simulated {
            path: "venues/scene.toml".into(),
            content: SimulatedContent::Pixels,
            grid: [48, 64],
            sigma_cells: 2.0
        }
    );
    assert!(venue.cameras[0].source.gives_pictures());
    let maps = ", content = \"maps\", grid = [72, 96], sigma_cells = 3.0";
    let source = parse(&simulated(maps)).unwrap().cameras[0].source.clone();
    assert!(!source.gives_pictures());
    assert_eq!(source.drawing(), Some(([72, 96], 3.0)));
    for (more, expected) in [
        (
            "",
            "18: `viewpoint[0].camera[0].source.content`: the field is missing in a source of kind \"simulated\"",
        ),
        (
            ", content = \"map\"",
            "18: `viewpoint[0].camera[0].source.content`: unknown content `map`, did you mean `maps`?",
        ),
    ] {
        let refused = parse(&simulated(more)).unwrap_err().to_string();
        assert_eq!(refused, format!("venues/hall.toml:{expected}"));
    }
}

#[test]
fn simulated_maps_need_no_network_and_simulated_pictures_do() {
    let text = |content: &str| {
        format!(
            "name = \"k\"\nrate_hz = 20\ncalibration = \"c.toml\"\n[[viewpoint]]\nname = \"v\"\n\
            [[viewpoint.camera]]\nname = \"south\"\n\
            source = {{ kind = \"simulated\", path = \"s.toml\", content = \"{content}\" }}\n"
        )
    };
    assert_eq!(parse(&text("maps")).unwrap().network, None);
    let refused = parse(&text("pixels")).unwrap_err().to_string();
    assert!(
        refused.contains("`network`: the field is missing: camera `south`"),
        "{refused}"
    );
}

#[test]
fn a_source_has_the_fields_of_its_kind() {
    check(
        "path = \"videos/ne-left.mp4\"",
        "device = \"/dev/video1\"",
        "18: `viewpoint[0].camera[0].source.device`: a source of kind \"video\" has no such field, expected `path`",
    );
    check(
        "kind = \"video\", path = \"videos/ne-left.mp4\"",
        "kind = \"ffmpeg\"",
        "18: `viewpoint[0].camera[0].source.url`: the field is missing in a source of kind \"ffmpeg\"",
    );
    check(
        "[96, 128]",
        "[96, 1280]",
        "21: `viewpoint[0].camera[1].source.grid`: found [96, 1280], expected [width, height] of 1 to 256 cells",
    );
}
