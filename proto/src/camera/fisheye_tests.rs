//! A camera with a fisheye: it agrees with OpenCV, is its own inverse, and is used up to 60 degrees
//! off its axis.

use nalgebra::{Isometry3, Vector3};
use proptest::prelude::*;

use super::*;

/// Allowed error of a distortion and its inverse, pixels.
const INVERSE_PX: f64 = 1e-9;

/// Rounding of printed numbers with 16 digits, and of OpenCV's last step, pixels.
const GOLDEN_PX: f64 = 1e-9;

const LENS: [f64; 4] = [-0.021, 0.0065, -0.0031, 0.000_42];

fn camera_at(motion: Isometry3<f64>, k: [f64; 4]) -> CameraModel {
    let intrinsics = Intrinsics {
        fx_px: 420.0,
        fy_px: 424.0,
        cx_px: 639.5,
        cy_px: 361.25,
    };
    let (lens, place) = (LensModel::KannalaBrandt(k), Transform::new(motion));
    CameraModel::new("north", [1280, 720], intrinsics, lens, place).unwrap()
}

fn camera() -> CameraModel {
    camera_at(Isometry3::identity(), LENS)
}

/// The pixel of the pinhole at `angle_deg` off the axis, to the right.
fn off_axis(camera: &CameraModel, angle_deg: f64) -> Pixel<Undistorted> {
    let i = camera.intrinsics();
    Pixel::new(
        i.cx_px + i.fx_px * libm::tan(angle_deg.to_radians()),
        i.cy_px,
    )
}

/// Made by OpenCV 5.0.0 (`opencv-python-headless`): `cv2.fisheye.projectPoints` of these points
/// with this camera and the Rodrigues vector and translation below. The fifth point is 63.6 degrees
/// off the axis.
#[test]
fn a_fisheye_distorts_as_in_opencv() {
    let motion = Isometry3::new(
        Vector3::new(0.4, -0.3, 2.5),
        Vector3::new(0.31, -0.42, 0.17),
    );
    let camera = camera_at(motion, LENS);
    let golden = [
        (
            [0.0, 0.0, 0.0],
            [705.771_279_194_441_3, 311.073_174_324_208_8],
        ),
        (
            [1.2, -0.7, 0.5],
            [809.912_584_129_278_7, 242.144_179_057_203],
        ),
        (
            [-2.1, 0.9, 0.2],
            [341.159_083_279_553_3, 407.819_915_561_690_8],
        ),
        (
            [3.0, 1.5, 0.4],
            [854.237_724_798_070_8, 466.717_910_391_563_1],
        ),
        (
            [-1.0, -2.0, -0.6],
            [677.661_504_831_233_2, -98.029_169_732_219_09],
        ),
        (
            [0.3, 2.6, 0.1],
            [644.711_575_779_325_8, 598.371_454_975_944_6],
        ),
    ];
    for (i, (point_m, expected_px)) in golden.into_iter().enumerate() {
        let ideal = camera.project(Point::new(point_m.into())).unwrap();
        let drawn = camera.distort_wide(ideal).unwrap();
        let off_px = (drawn.vector_px() - Vector2::from(expected_px)).norm();
        assert!(off_px < GOLDEN_PX, "{point_m:?}: {off_px}");
        assert_eq!(camera.distort(ideal), (i != 4).then_some(drawn));
    }
}

/// Made by OpenCV 5.0.0: `cv2.fisheye.undistortPoints` with `P` the same matrix and 1000 steps to
/// 1e-14.
#[test]
fn a_fisheye_is_undistorted_as_in_opencv() {
    let camera = camera();
    for (drawn_px, expected_px) in [
        (
            [640.0, 360.0],
            [640.000_001_790_915_5, 359.999_995_522_711_3],
        ),
        (
            [900.0, 200.0],
            [963.048_845_982_620_5, 160.972_643_321_698_46],
        ),
        (
            [310.25, 300.5],
            [208.671_185_930_510_1, 281.757_667_563_488_2],
        ),
        (
            [700.5, 40.75],
            [717.625_617_197_063_7, -49.229_677_240_310_08],
        ),
    ] {
        let ideal = camera.undistort(Pixel::new(drawn_px[0], drawn_px[1]));
        let off_px = (ideal.unwrap().vector_px() - Vector2::from(expected_px)).norm();
        assert!(off_px < GOLDEN_PX, "{drawn_px:?}: {off_px}");
    }
    // 61.9 and 78.4 degrees off the axis: drawn but not used.
    for (drawn_px, expected_px) in [
        (
            [1010.0, 610.0],
            [1_295.229_236_202_144_4, 801.500_060_743_005_2],
        ),
        (
            [100.0, 500.0],
            [-1_350.159_032_524_816, 872.955_636_261_016_1],
        ),
    ] {
        let drawn = Pixel::new(drawn_px[0], drawn_px[1]);
        assert_eq!(camera.undistort(drawn), None);
        let ideal = camera.undistort_wide(drawn).unwrap();
        let off_px = (ideal.vector_px() - Vector2::from(expected_px)).norm();
        assert!(off_px < 10.0 * GOLDEN_PX, "{drawn_px:?}: {off_px}");
    }
}

#[test]
fn a_fisheye_is_used_up_to_sixty_degrees_off_its_axis() {
    let camera = camera();
    let [inside, outside] = [59.99, 60.01].map(|angle_deg| off_axis(&camera, angle_deg));
    assert!(camera.sees(inside) && !camera.sees(outside));
    assert_eq!(camera.distort(outside), None);
    // Both are in the picture.
    let drawn = camera.distort_wide(outside).unwrap();
    assert!(drawn.x() < 1279.0, "{}", drawn.x());
    assert_eq!(camera.undistort(drawn), None);
    assert!(camera.undistort(camera.distort(inside).unwrap()).is_some());
}

#[test]
fn a_pixel_beyond_the_used_part_moves_to_the_rim() {
    let camera = camera();
    let far = off_axis(&camera, 75.0);
    let rim = camera.within_view(far);
    assert!((rim.vector_px() - off_axis(&camera, 60.0).vector_px()).norm() < INVERSE_PX);
    let inside = off_axis(&camera, 50.0);
    assert!((camera.within_view(inside).vector_px() - inside.vector_px()).norm() < INVERSE_PX);
}

#[test]
fn a_coefficient_that_is_not_finite_is_refused_by_name() {
    let lens = LensModel::KannalaBrandt([0.0, 0.0, f64::NAN, 0.0]);
    let (intrinsics, place) = (
        *camera().intrinsics(),
        Transform::new(Isometry3::identity()),
    );
    let refused = CameraModel::new("north", [4, 4], intrinsics, lens, place).unwrap_err();
    assert_eq!(
        refused.to_string(),
        "camera `north`: distortion coefficient `k3` is NaN, expected a finite number"
    );
}

proptest! {
    #[test]
    fn a_fisheye_is_undistorted_in_its_whole_used_part(
        k in prop::array::uniform4(-0.03f64..0.03), angle_deg in 0.0f64..59.999, turn in 0.0f64..7.0,
    ) {
        let camera = camera_at(Isometry3::identity(), k);
        let r = libm::tan(angle_deg.to_radians());
        let i = camera.intrinsics();
        let ideal = Pixel::new(i.cx_px + i.fx_px * r * libm::cos(turn), i.cy_px + i.fy_px * r * libm::sin(turn));
        let drawn = camera.distort(ideal).unwrap();
        let back = camera.undistort(drawn).unwrap();
        prop_assert!((back.vector_px() - ideal.vector_px()).norm() < INVERSE_PX);
        let again = camera.distort(back).unwrap();
        prop_assert!((again.vector_px() - drawn.vector_px()).norm() < INVERSE_PX);
    }

    #[test]
    fn every_pixel_of_the_picture_is_used_or_beyond_sixty_degrees(x in -0.5f64..1279.5, y in -0.5f64..719.5) {
        let camera = camera();
        let drawn = Pixel::new(x, y);
        if let Some(ideal) = camera.undistort(drawn) {
            prop_assert!(camera.sees(ideal));
        } else {
            // Beyond the drawn part it is even farther out.
            let ideal = camera.undistort_wide(drawn);
            prop_assert!(ideal.is_none_or(|ideal| !camera.sees(ideal)));
        }
    }
}
