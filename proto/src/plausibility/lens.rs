//! Checks that pinhole and lens are plausible for the size of the pictures.

use nalgebra::Vector2;

use crate::camera::{CameraModel, Distortion, FISHEYE_HALF_VIEW_RAD, Intrinsics, LensModel};
use crate::frames::Pixel;

use super::{Cause, Finding, Severity};

/// Horizontal fields of view that are usual, and that exist, degrees. No rectilinear lens reaches
/// 165; one of half a degree is a telescope.
const USUAL_VIEW_DEG: [f64; 2] = [5.0, 150.0];
const POSSIBLE_VIEW_DEG: [f64; 2] = [0.5, 165.0];
/// The same for fisheyes; some see behind themselves.
const USUAL_FISHEYE_DEG: [f64; 2] = [40.0, 235.0];
const POSSIBLE_FISHEYE_DEG: [f64; 2] = [10.0, 280.0];
/// Drawn radius of a fisheye relative to an equidistant one (radius = angle), at the edge of the
/// used part.
const USUAL_FISHEYE: [f64; 2] = [0.8, 1.25];
const POSSIBLE_FISHEYE: [f64; 2] = [0.5, 2.0];
/// fx over fy of square pixels with calibration errors: 27 real cameras have up to 0.022.
const SQUARE: [f64; 2] = [0.95, 1.05];
/// fx over fy outside any sensor or video format.
const POSSIBLE_SHAPE: [f64; 2] = [0.45, 2.2];
/// Pixel aspect ratios of video formats without square pixels, normal and wide: of PAL and NTSC by
/// the standard (players, which count all 720 columns, use 2.2 % less), of HDV and of DVCPRO HD.
const PAL: [f64; 2] = [12.0 / 11.0, 16.0 / 11.0];
const NTSC: [f64; 2] = [10.0 / 11.0, 40.0 / 33.0];
const HDV: [f64; 1] = [4.0 / 3.0];
const DVCPRO: [f64; 1] = [3.0 / 2.0];
const SHAPE_TOLERANCE: f64 = 0.05;
/// Usual distance of the principal point from the middle, as shares of width and height. Any
/// distance is possible: for a camera that reads a window of its sensor it depends on the window.
const USUAL_OFFSET: f64 = 0.15;
/// Radius of the picture's edge in an ideal pinhole over that in the lens; less means a lens that
/// stretches its edges. Pincushion of a tenth is much; zooms have a few hundredths.
const USUAL_STRETCH: f64 = 0.85;
const POSSIBLE_STRETCH: f64 = 0.75;
/// Largest compression of a barrel lens in OpenCV's model; beyond it the edges are extrapolated.
const USUAL_PULL: f64 = 3.0;
/// Larger radial coefficients come from fits to too few pictures.
const USUAL_RADIAL: f64 = 100.0;
/// Larger p1 and p2 are misplaced coefficients, or a fit to too few pictures. A lens whose centre
/// is offset by the share d of its focal length has tangential coefficients of about k1 d (the
/// change of k1 |y|² y when y moves by d). 0.01 means a wide lens, with k1 0.3, offset by a
/// thirtieth of its focal length, a tenth of a millimetre. In fifteen calibrations of real lenses
/// they are 0.0043 at most.
const USUAL_TANGENTIAL: f64 = 0.01;

pub(super) fn findings(camera: &CameraModel) -> Vec<Finding> {
    let found = [
        field_of_view(camera),
        pixel_shape(camera),
        principal_point(camera),
        match camera.lens() {
            LensModel::Rational(lens) => distorted(camera, lens),
            LensModel::KannalaBrandt(_) => fisheye(camera),
        },
    ];
    found.into_iter().flatten().collect()
}

fn finding(
    camera: &CameraModel,
    cause: Cause,
    severity: Severity,
    found: String,
    expected: String,
    remedy: &str,
) -> Finding {
    Finding {
        camera: Some(camera.name().to_owned()),
        cause,
        severity,
        found,
        expected,
        remedy: remedy.to_owned(),
    }
}

fn is_within(value: f64, [low, high]: [f64; 2]) -> bool {
    (low..=high).contains(&value)
}

/// Doubtful outside `usual`, wrong outside `possible`.
fn severity(value: f64, usual: [f64; 2], possible: [f64; 2]) -> Option<Severity> {
    match (is_within(value, usual), is_within(value, possible)) {
        (true, _) => None,
        (false, true) => Some(Severity::Doubtful),
        (false, false) => Some(Severity::Wrong),
    }
}

fn field_of_view(camera: &CameraModel) -> Option<Finding> {
    let width_px = f64::from(camera.size_px()[0]);
    let fx_px = camera.intrinsics().fx_px;
    // A fisheye's coefficients hardly change the view of its focal length.
    let (view_rad, usual, possible) = if camera.lens().is_fisheye() {
        (width_px / fx_px, USUAL_FISHEYE_DEG, POSSIBLE_FISHEYE_DEG)
    } else {
        (
            2.0 * libm::atan(0.5 * width_px / fx_px),
            USUAL_VIEW_DEG,
            POSSIBLE_VIEW_DEG,
        )
    };
    let view_deg = view_rad.to_degrees();
    let severity = severity(view_deg, usual, possible)?;
    Some(finding(
        camera,
        Cause::FieldOfView,
        severity,
        format!(
            "a focal length of {fx_px:.0} px with pictures {width_px:.0} px wide sees {view_deg:.1} degrees"
        ),
        format!("{} to {} degrees", usual[0], usual[1]),
        "`matrix` is in pixels, not millimetres, and of pictures of this `size`",
    ))
}

/// Aspect ratios of nonsquare pixels in the video formats with this picture size.
fn format_shapes(size_px: [u32; 2]) -> &'static [f64] {
    match size_px {
        [700..=720, 576] | [352..=360, 288] | [176..=180, 144] => &PAL,
        [700..=720, 480 | 486] | [352..=360, 240 | 243] => &NTSC,
        [1440, 1080] | [960, 720] => &HDV,
        [1280, 1080] => &DVCPRO,
        _ => &[],
    }
}

fn pixel_shape(camera: &CameraModel) -> Option<Finding> {
    let Intrinsics { fx_px, fy_px, .. } = *camera.intrinsics();
    let ratio = fx_px / fy_px;
    // fx counts pixels: wide pixels give a smaller fx.
    let is_format = |shape: &f64| (ratio * shape - 1.0).abs() < SHAPE_TOLERANCE;
    if format_shapes(camera.size_px()).iter().any(is_format) {
        return None;
    }
    let severity = severity(ratio, SQUARE, POSSIBLE_SHAPE)?;
    let [width_px, height_px] = camera.size_px();
    Some(finding(
        camera,
        Cause::PixelShape,
        severity,
        format!("fx is {fx_px:.0} px and fy {fy_px:.0} px"),
        format!("two that differ by a few hundredths, in pictures of {width_px}x{height_px}"),
        "check `matrix`: one of the two may be wrong, rows or numbers may be exchanged, or the pictures were stretched \
         after it was made; with an anamorphic lens they do differ",
    ))
}

fn principal_point(camera: &CameraModel) -> Option<Finding> {
    let [width_px, height_px] = camera.size_px().map(f64::from);
    let Intrinsics { cx_px, cy_px, .. } = *camera.intrinsics();
    let offset = [cx_px / width_px - 0.5, cy_px / height_px - 0.5];
    let farthest = offset[0].abs().max(offset[1].abs());
    if farthest <= USUAL_OFFSET {
        return None;
    }
    let is_turned = (cx_px / height_px - 0.5).abs() < 0.1 && (cy_px / width_px - 0.5).abs() < 0.1;
    let factor = 0.5 * (cx_px / width_px + cy_px / height_px) * 2.0;
    let is_scaled = (offset[0] - offset[1]).abs() < 0.1;
    let remedy = if is_turned {
        "cx and cy fit a picture turned by 90 degrees: `size` is [width, height] of the pictures as they are decoded".to_owned()
    } else if is_scaled {
        format!(
            "`matrix` looks like that of pictures of {:.0}x{:.0}: scale its first two rows, or correct `size`",
            width_px * factor,
            height_px * factor
        )
    } else {
        "check `matrix`: [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] of pictures of this `size`"
            .to_owned()
    };
    Some(finding(
        camera,
        Cause::PrincipalPoint,
        Severity::Doubtful,
        format!(
            "its principal point is ({cx_px:.0}, {cy_px:.0}) in pictures of {width_px}x{height_px}"
        ),
        "one near the middle, unless the camera reads a window of its sensor".to_owned(),
        &remedy,
    ))
}

/// A fisheye whose coefficients bend the used part far from any real fisheye.
fn fisheye(camera: &CameraModel) -> Option<Finding> {
    let r = libm::tan(FISHEYE_HALF_VIEW_RAD);
    let drawn = camera.lens().draw_with_jacobian(Vector2::new(r, 0.0)).0.x;
    let ratio = drawn / FISHEYE_HALF_VIEW_RAD;
    let severity = severity(ratio, USUAL_FISHEYE, POSSIBLE_FISHEYE)?;
    Some(finding(
        camera,
        Cause::Distortion,
        severity,
        format!(
            "60 degrees off its axis its distortion draws {ratio:.2} times as far out as an equidistant fisheye does"
        ),
        format!("{} to {} times", USUAL_FISHEYE[0], USUAL_FISHEYE[1]),
        "check `distortions`: k1 k2 k3 k4 of OpenCV's fisheye model; for another lens set `fisheye = false`",
    ))
}

/// First the surely wrong values; then misplaced coefficients, which may cause the rest.
fn distorted(camera: &CameraModel, lens: &Distortion) -> Option<Finding> {
    let radial = distortion(camera, lens);
    match radial {
        Some(Finding {
            severity: Severity::Wrong,
            ..
        }) => radial,
        _ => askew(camera, lens).or(radial),
    }
}

fn distortion(camera: &CameraModel, lens: &Distortion) -> Option<Finding> {
    if lens.is_none() {
        return None;
    }
    let pulls = edge_pulls(camera);
    let least = pulls.iter().copied().fold(f64::INFINITY, f64::min);
    let most = pulls.iter().copied().fold(0.0, f64::max);
    let radial = [lens.k1, lens.k2, lens.k3, lens.k4, lens.k5, lens.k6];
    let at_edges = "a few hundredths, or tenths inwards for a wide lens".to_owned();
    let (severity, found, expected) = if least < USUAL_STRETCH {
        let severity = if least < POSSIBLE_STRETCH {
            Severity::Wrong
        } else {
            Severity::Doubtful
        };
        let found = format!(
            "its distortion moves the edge of the picture out by {:.0} %",
            100.0 * (1.0 / least - 1.0)
        );
        (severity, found, at_edges)
    } else if most > USUAL_PULL {
        let found = format!("its distortion shrinks the edge of the picture to a {most:.1}th");
        (Severity::Doubtful, found, at_edges)
    } else if radial.iter().any(|k| k.abs() > USUAL_RADIAL) {
        let found = format!("its radial coefficients are {radial:?}");
        let expected = format!("none beyond {USUAL_RADIAL}, whatever the sign");
        (Severity::Doubtful, found, expected)
    } else {
        return None;
    };
    Some(finding(
        camera,
        Cause::Distortion,
        severity,
        found,
        expected,
        "check `distortions`: k1 k2 p1 p2 (k3 (k4 k5 k6)); calibrate with more pictures, or write zeros",
    ))
}

/// A lens with a larger tilt than any real mount.
fn askew(camera: &CameraModel, lens: &Distortion) -> Option<Finding> {
    if is_tangential([lens.p1, lens.p2]) {
        return None;
    }
    Some(finding(
        camera,
        Cause::Distortion,
        Severity::Doubtful,
        format!(
            "its tangential coefficients p1 and p2, third and fourth of `distortions`, are {:?} and {:?}",
            lens.p1, lens.p2
        ),
        "thousandths: real lenses have no larger tilt".to_owned(),
        &format!(
            "the order is k1 k2 p1 p2 (k3 (k4 k5 k6)){}; \
             if the order is right, calibrate with more pictures, or write zeros for p1 and p2",
            likely_order(lens)
        ),
    ))
}

/// Whether these are plausible tangential coefficients.
fn is_tangential(pair: [f64; 2]) -> bool {
    pair.iter().all(|p| p.abs() <= USUAL_TANGENTIAL)
}

/// The probable order of misplaced coefficients, as the end of a clause. For four numbers the fifth
/// is zero, and a lens has no p1 without a p2.
fn likely_order(lens: &Distortion) -> String {
    let Distortion {
        k1, k2, p1, p2, k3, ..
    } = *lens;
    let is_rational = [lens.k4, lens.k5, lens.k6].iter().any(|k| *k != 0.0);
    if is_rational {
        String::new()
    } else if is_tangential([p2, k3]) && (k3 != 0.0 || p2 == 0.0) {
        format!(
            ", and these look like k1 k2 k3 p1 p2: then write `distortions = [{k1:?}, {k2:?}, {p2:?}, {k3:?}, {p1:?}]`"
        )
    } else if is_tangential([k1, k2]) {
        format!(
            ", and these look like p1 p2 k1 k2: then write `distortions = [{p1:?}, {p2:?}, {k1:?}, {k2:?}, {k3:?}]`"
        )
    } else {
        String::new()
    }
}

/// Radius in the pinhole over radius in the lens, at the corners and edge centres of the picture.
fn edge_pulls(camera: &CameraModel) -> Vec<f64> {
    let [width_px, height_px] = camera.size_px().map(f64::from);
    let Intrinsics { cx_px, cy_px, .. } = *camera.intrinsics();
    let shares = [0.0, 0.5, 1.0];
    let mut pulls = Vec::new();
    for x in shares {
        for y in shares {
            let at = [x * width_px - 0.5, y * height_px - 0.5];
            let drawn_px = libm::hypot(at[0] - cx_px, at[1] - cy_px);
            // Near the axis nothing is moved.
            if (x, y) == (0.5, 0.5) || drawn_px < 1.0 {
                continue;
            }
            if let Some(ideal) = camera.undistort(Pixel::new(at[0], at[1])) {
                pulls.push(libm::hypot(ideal.x() - cx_px, ideal.y() - cy_px) / drawn_px);
            }
        }
    }
    pulls
}
