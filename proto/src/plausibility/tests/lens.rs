//! Impossible lenses, and unusual but valid ones.

use super::*;

/// The hall with these `distortions` for its second camera, in the order of a calibration.
fn lens(distortions: impl AsRef<[f64]>) -> Vec<Given> {
    let of = |i: usize| distortions.as_ref().get(i).copied().unwrap_or(0.0);
    with(|it| {
        it.distortion = Distortion {
            k1: of(0),
            k2: of(1),
            p1: of(2),
            p2: of(3),
            k3: of(4),
            k4: of(5),
            k5: of(6),
            k6: of(7),
        };
    })
}

#[test]
fn a_focal_length_wrong_along_one_axis_is_reported() {
    let pinhole = |change: fn(&mut Intrinsics)| with(|it| change(&mut it.intrinsics));
    let found = (Cause::PixelShape, Severity::Doubtful, ONE);
    check(vec![
        ("fx a tenth too long", pinhole(|it| it.fx_px *= 1.1), found),
        ("fx a tenth too short", pinhole(|it| it.fx_px *= 0.9), found),
    ]);
}

#[test]
fn an_impossible_lens_is_reported() {
    use Severity::{Doubtful, Wrong};
    let pinhole = |change: fn(&mut Intrinsics)| with(|it| change(&mut it.intrinsics));
    let doubtful = (Cause::Distortion, Doubtful, ONE);
    let bent = |k1: f64| with(|it| it.distortion.k1 = k1);
    check(vec![
        (
            "a focal length in mm",
            pinhole(|it| it.fx_px = 8.0),
            (Cause::FieldOfView, Wrong, ONE),
        ),
        (
            "a telescope",
            pinhole(|it| (it.fx_px, it.fy_px) = (2e4, 2e4)),
            (Cause::FieldOfView, Doubtful, ONE),
        ),
        (
            "another fy",
            pinhole(|it| it.fy_px = 1400.0),
            (Cause::PixelShape, Doubtful, ONE),
        ),
        (
            "fy of half the size",
            pinhole(|it| it.fy_px = 400.0),
            (Cause::PixelShape, Wrong, ONE),
        ),
        (
            "its middle outside",
            pinhole(|it| it.cx_px = 1300.0),
            (Cause::PrincipalPoint, Doubtful, ONE),
        ),
        (
            "its middle aside",
            pinhole(|it| it.cy_px = 500.0),
            (Cause::PrincipalPoint, Doubtful, ONE),
        ),
        (
            "the matrix of 4K in HD",
            pinhole(|it| {
                (it.fx_px, it.fy_px) = (2.0 * it.fx_px, 2.0 * it.fy_px);
                (it.cx_px, it.cy_px) = (2.0 * it.cx_px, 2.0 * it.cy_px);
            }),
            // A window in the corner of a sensor has the same effect.
            (Cause::PrincipalPoint, Doubtful, ONE),
        ),
        (
            "a distortion of 5",
            bent(5.0),
            (Cause::Distortion, Wrong, ONE),
        ),
        (
            "a distortion of 0.7",
            bent(0.7),
            (Cause::Distortion, Doubtful, ONE),
        ),
        (
            "k1 and k2 in the place of p1 and p2",
            lens([0.0004, -0.0003, -0.08, 0.02]),
            doubtful,
        ),
        (
            "k3 before p1 and p2",
            lens([-0.1, 0.12, -0.06, 0.0004, -0.0007]),
            doubtful,
        ),
        (
            "lens askew by a hundredth",
            lens([-0.08, 0.02, 0.001, -0.011]),
            doubtful,
        ),
        (
            "a fit to few pictures",
            lens([140.0, 0.0, 0.0, 0.0, 0.0, 140.0]),
            doubtful,
        ),
    ]);
}

/// The hall with pictures of `size_px` for its second camera, whose pixels are `shape` times as
/// wide as high.
fn with_pixels(size_px: [u32; 2], shape: f64) -> Vec<Given> {
    with(|it| {
        let [width_px, height_px] = size_px.map(f64::from);
        it.size_px = size_px;
        it.intrinsics = Intrinsics {
            fx_px: 0.8 * width_px,
            fy_px: 0.8 * width_px * shape,
            cx_px: 0.5 * (width_px - 1.0),
            cy_px: 0.5 * (height_px - 1.0),
        };
    })
}

#[test]
fn nonsquare_pixels_are_accepted_in_their_video_format() {
    let (pal, ntsc) = (12.0 / 11.0, 10.0 / 11.0);
    let formats = [
        ([720, 576], pal),
        ([704, 576], pal),
        ([352, 288], pal),
        // As in players, and wide.
        ([720, 576], 16.0 / 15.0),
        ([720, 576], 16.0 / 11.0),
        ([720, 480], ntsc),
        ([704, 480], ntsc),
        ([720, 486], ntsc),
        ([720, 480], 8.0 / 9.0),
        ([720, 480], 40.0 / 33.0),
        ([1440, 1080], 4.0 / 3.0),
        ([960, 720], 4.0 / 3.0),
        ([1280, 1080], 3.0 / 2.0),
        // Square pixels with calibration errors.
        ([720, 576], 1.0),
        ([1440, 1080], 1.0),
        ([1920, 1080], 1.03),
        ([1920, 1080], 0.97),
    ];
    for (size_px, shape) in formats {
        assert_eq!(
            findings(&with_pixels(size_px, shape)),
            [],
            "{size_px:?} {shape}"
        );
    }
}

#[test]
fn pixels_of_another_video_format_are_suspect() {
    let (pal, ntsc) = (12.0 / 11.0, 10.0 / 11.0);
    let others = [
        ([1920, 1080], pal),
        ([1920, 1080], ntsc),
        ([1920, 1080], 4.0 / 3.0),
        ([1088, 1920], ntsc),
        ([1280, 720], 3.0 / 2.0),
        ([640, 480], ntsc),
        ([1440, 1080], pal),
        ([720, 576], ntsc),
    ];
    for (size_px, shape) in others {
        let findings = findings(&with_pixels(size_px, shape));
        assert_eq!(findings.len(), 1, "{size_px:?} {shape}: {findings:?}");
        assert_eq!(findings[0].cause, Cause::PixelShape);
        assert_eq!(findings[0].severity, Severity::Doubtful);
    }
}

#[test]
fn lenses_at_the_limit_have_no_findings() {
    // A tilt just below the limit, a pincushion, rational terms that nearly cancel, large ones that
    // cancel exactly, and a wide lens.
    let usual: [&[f64]; 5] = [
        &[-0.08, 0.02, 0.0095, -0.0095],
        &[0.3, -0.1, 0.001, 0.0],
        &[8.0, 5.0, 0.0004, -0.0002, 0.3, 8.1, 5.2, 0.4],
        &[95.0, 0.0, 0.0, 0.0, 0.0, 95.0],
        &[-0.33, 0.12, -0.0043, 0.0041, -0.02],
    ];
    for distortion in usual {
        assert_eq!(findings(&lens(distortion)), [], "{distortion:?}");
    }
}

/// The finding for the second camera with these `distortions`.
fn of_lens(distortions: impl AsRef<[f64]>) -> String {
    findings(&lens(distortions))[0].to_string()
}

#[test]
fn tangential_coefficients_have_their_own_limit() {
    let text = of_lens([-0.1, 0.12, -0.06, 0.0004, -0.0007]);
    for words in [
        "p1 and p2",
        "-0.06 and 0.0004",
        "thousandths",
        "k1 k2 p1 p2",
    ] {
        assert!(text.contains(words), "{words}: {text}");
    }
}

#[test]
fn the_probable_order_of_coefficients_is_reported() {
    let text = of_lens([-0.1, 0.12, -0.06, 0.0004, -0.0007]);
    for words in ["k1 k2 k3 p1 p2", "[-0.1, 0.12, 0.0004, -0.0007, -0.06]"] {
        assert!(text.contains(words), "{words}: {text}");
    }
    // A lens without k2, p1 and p2, whose k3 is read as p1.
    let text = of_lens([-0.086, 0.0, 0.02, 0.0, 0.0]);
    assert!(text.contains("[-0.086, 0.0, 0.0, 0.0, 0.02]"), "{text}");
    let text = of_lens([0.0004, -0.0003, -0.08, 0.02]);
    for words in ["p1 p2 k1 k2", "[-0.08, 0.02, 0.0004, -0.0003, 0.0]"] {
        assert!(text.contains(words), "{words}: {text}");
    }
    // Four numbers, whose last would be p1 alone.
    let text = of_lens([-0.3, 0.1, 0.011, 0.0005]);
    assert!(!text.contains("look like"), "{text}");
    // In no order are these the coefficients of a lens.
    let text = of_lens([-0.1, 0.12, -0.06, 0.05, 0.02]);
    assert!(!text.contains("look like"), "{text}");
}

#[test]
fn misplaced_coefficients_come_before_their_consequences() {
    let text = findings(&lens([140.0, 0.0, 0.05, 0.0, 0.0, 140.0]))[0].to_string();
    assert!(text.contains("p1 and p2"), "{text}");
    let text = findings(&lens([140.0, 0.0, 0.0, 0.0, 0.0, 140.0]))[0].to_string();
    assert!(text.contains("none beyond 100"), "{text}");
}
