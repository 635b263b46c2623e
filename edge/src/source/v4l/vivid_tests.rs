//! Tests with a real driver: the kernel's test camera `vivid`. `.ci/measure v4l` runs them on a
//! kernel that has it.

use std::collections::BTreeMap;

use farfield_proto::venue::{ControlValue, TickFrom};

use super::super::SourceOrigin;
use super::*;

const DEVICE: &str = "/dev/video0";
const SIZE_PX: [u32; 2] = [640, 360];
/// Allowed colour error: rounding and a camera's gamma.
const COLOUR_TOLERANCE: u8 = 6;

/// Whether this kernel has the test camera. A variable reports it, so that no real camera is set to
/// a test picture.
fn has_test_camera() -> bool {
    let is_there = std::env::var_os("FARFIELD_TEST_CAMERA").is_some();
    if !is_there {
        println!("SKIPPED a camera of the kernel: `.ci/measure v4l` has one");
    }
    is_there
}

fn expected(size_px: [u32; 2], rate_hz: f64) -> ExpectedSource {
    ExpectedSource {
        at: SourceOrigin {
            camera: "left".to_owned(),
            place: DEVICE.to_owned(),
        },
        size_px,
        rate_hz,
        first_tick: Tick(0),
        keypoints: 17,
        tick_from: TickFrom::Clock,
    }
}

fn choice(text: &str) -> ControlValue {
    ControlValue::Choice(text.to_owned())
}

fn settings(format: Option<&str>, controls: &[(&str, ControlValue)]) -> DeviceSettings {
    let controls = controls
        .iter()
        .map(|(name, value)| ((*name).to_owned(), value.clone()));
    let plain = [
        ("osd_text_mode".to_owned(), choice("None")),
        (
            "insert_sav_code_in_image".to_owned(),
            ControlValue::Switch(false),
        ),
    ];
    DeviceSettings {
        format: format.map(str::to_owned),
        controls: plain
            .into_iter()
            .chain(controls)
            .collect::<BTreeMap<_, _>>(),
    }
}

/// The next frames of the camera at its default size and rate.
fn frames(settings: &DeviceSettings, n: usize) -> Vec<(Frame, i64)> {
    let mut source = open(
        Path::new(DEVICE),
        settings,
        expected(SIZE_PX, 30.0),
        Tick(100),
    )
    .unwrap();
    let mut next = || {
        (
            source.next_frame().unwrap().unwrap(),
            source.stamp_us().unwrap(),
        )
    };
    (0..n).map(|_| next()).collect()
}

fn refusal(settings: &DeviceSettings, expected: &ExpectedSource) -> String {
    let refused = probe(Path::new(DEVICE), settings, expected);
    let text = refused.unwrap_err().to_string();
    println!("{text}");
    text
}

#[test]
fn colours_are_the_same_in_every_format() {
    if !has_test_camera() {
        return;
    }
    let mut tried = 0;
    for pixels in &FORMATS {
        let is_grey = matches!(pixels.name, "GREY" | "Y10" | "Y12" | "Y16");
        let brightness = |[red, green, blue]: [u8; 3]| {
            let shares = [(red, 0.2126), (green, 0.7152), (blue, 0.0722)];
            shares
                .map(|(value, share)| f64::from(value) * share)
                .iter()
                .sum::<f64>() as u8
        };
        for (pattern, colour) in [
            ("100% Red", [255, 0, 0]),
            ("100% Green", [0, 255, 0]),
            ("100% Blue", [0, 0, 255]),
            ("100% White", [255; 3]),
            ("100% Black", [0; 3]),
        ] {
            let set = settings(Some(pixels.name), &[("test_pattern", choice(pattern))]);
            if probe(Path::new(DEVICE), &set, &expected(SIZE_PX, 30.0)).is_err() {
                println!("{}: not offered", pixels.name);
                break;
            }
            // The pattern changes with the next picture that the driver starts.
            let (frame, _) = frames(&set, 3).pop().unwrap();
            let FrameContent::Image(picture) = frame.content else {
                unreachable!("a camera gives pictures")
            };
            let image = picture.into_rgb();
            let expected = if is_grey {
                [brightness(colour); 3]
            } else {
                colour
            };
            assert_eq!([image.width(), image.height()], SIZE_PX);
            for [x, y] in [[100, 100], [101, 100], [100, 101], [500, 301]] {
                let found = image.get_pixel(x, y).0;
                let mut apart = found.iter().zip(expected).map(|(a, b)| a.abs_diff(b));
                let is_near = apart.all(|values| values <= COLOUR_TOLERANCE);
                assert!(
                    is_near,
                    "{} {pattern}: {found:?}, not {expected:?}",
                    pixels.name
                );
            }
            tried += 1;
        }
    }
    assert!(tried >= 5 * 15, "{tried} pictures");
}

#[test]
fn frames_lost_by_the_driver_leave_gaps_in_the_ticks() {
    if !has_test_camera() {
        return;
    }
    let percent = |lost| ("percentage_of_dropped_buffers", ControlValue::Number(lost));
    let whole = frames(&settings(None, &[percent(0)]), 30);
    let ticks: Vec<_> = whole.iter().map(|(frame, _)| frame.tick.0).collect();
    assert!(
        ticks[0] == 100 && ticks.windows(2).all(|two| two[0] + 1 == two[1]),
        "{ticks:?}"
    );
    let seconds = (whole[29].1 - whole[0].1) as f64 / 1e6;
    assert!(
        (seconds - 29.0 / 30.0).abs() < 0.05,
        "{seconds} s by the driver's clock"
    );

    let with_losses = frames(&settings(None, &[percent(40)]), 30);
    let last = with_losses[29].0.tick.0;
    assert!(
        (130..100 + 30 * 4).contains(&last),
        "30 frames up to tick {last}"
    );
    for two in with_losses.windows(2) {
        let (ticks, us) = (two[1].0.tick - two[0].0.tick, two[1].1 - two[0].1);
        assert!(
            (us as f64 / 1e6 * 30.0 - ticks as f64).abs() < 0.5,
            "{us} us in {ticks} ticks"
        );
    }
    drop(frames(&settings(None, &[percent(0)]), 1));
}

#[test]
fn unsupported_settings_are_refused_with_the_supported_ones() {
    if !has_test_camera() {
        return;
    }
    let plain = DeviceSettings::default();
    let refused = refusal(&plain, &expected([641, 360], 30.0));
    assert!(
        refused.contains("does not offer 641x360") && refused.contains("NV12"),
        "{refused}"
    );
    let refused = refusal(&plain, &expected(SIZE_PX, 200.0));
    assert!(
        refused.contains("640x360 at") && refused.contains("60"),
        "{refused}"
    );
    let refused = refusal(
        &settings(None, &[("exposur", ControlValue::Number(3))]),
        &expected(SIZE_PX, 30.0),
    );
    assert!(
        refused.contains("`source.controls`: unknown control `exposur`"),
        "{refused}"
    );
    let refused = refusal(
        &settings(None, &[("contrast", ControlValue::Number(300))]),
        &expected(SIZE_PX, 30.0),
    );
    assert!(
        refused.contains("expected a whole number from 0 to 255"),
        "{refused}"
    );
    let refused = refusal(
        &settings(None, &[("test_pattern", choice("Red"))]),
        &expected(SIZE_PX, 30.0),
    );
    assert!(refused.contains("\"100% Red\""), "{refused}");
}
