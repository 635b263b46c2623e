//! Tests of the camera model: projection, its inverse, and the refusal of lenses that fold.

use nalgebra::Isometry3;
use proptest::prelude::*;

use super::*;

/// Allowed error of a distortion and its inverse, pixels.
const INVERSE_PX: f64 = 1e-9;

const PLAIN: Distortion = Distortion {
    k1: 0.0,
    k2: 0.0,
    p1: 0.0,
    p2: 0.0,
    k3: 0.0,
    k4: 0.0,
    k5: 0.0,
    k6: 0.0,
};

fn camera_at(motion: Isometry3<f64>, distortion: Distortion) -> Result<CameraModel, CameraError> {
    let intrinsics = Intrinsics {
        fx_px: 900.0,
        fy_px: 905.0,
        cx_px: 640.0,
        cy_px: 355.0,
    };
    CameraModel::new(
        "north",
        [1280, 720],
        intrinsics,
        distortion,
        Transform::new(motion),
    )
}

fn camera(distortion: Distortion) -> Result<CameraModel, CameraError> {
    camera_at(Isometry3::identity(), distortion)
}

/// Checks both directions for one distorted pixel.
fn check_inverse(camera: &CameraModel, x: f64, y: f64) {
    let drawn = Pixel::<Distorted>::new(x, y);
    let ideal = camera.undistort(drawn).unwrap();
    let again = camera.distort(ideal).unwrap();
    assert!((again.vector_px() - drawn.vector_px()).norm() < INVERSE_PX);
    let ideal_again = camera.undistort(again).unwrap();
    assert!((ideal_again.vector_px() - ideal.vector_px()).norm() < INVERSE_PX);
    assert!(camera.sees(ideal));
}

fn any_motion() -> impl Strategy<Value = Isometry3<f64>> {
    (
        prop::array::uniform3(-50.0f64..50.0),
        prop::array::uniform3(-3.0f64..3.0),
    )
        .prop_map(|(t, r)| Isometry3::new(t.into(), r.into()))
}

proptest! {
    #[test]
    fn project_and_ray_are_inverse(
        motion in any_motion(), x in -2000.0f64..3000.0, y in -2000.0f64..3000.0, distance in 1.0f64..100.0,
    ) {
        let camera = camera_at(motion, PLAIN).unwrap();
        let ray = camera.ray(Pixel::new(x, y));
        let point = Point::new(ray.origin.coordinates_m() + ray.direction.into_inner() * distance);
        let px = camera.project(point).unwrap();
        prop_assert!((px.vector_px() - Vector2::new(x, y)).norm() < 1e-6);
        let homogeneous = camera.projection_matrix() * point.coordinates_m().to_homogeneous();
        let by_matrix = homogeneous.xy() / homogeneous.z;
        prop_assert!((by_matrix - Vector2::new(x, y)).norm() < 1e-6);
    }

    #[test]
    fn lenses_are_undistorted_all_over_the_image(
        k1 in -0.35f64..0.25, k2 in -0.1f64..0.15, p1 in -0.005f64..0.005, p2 in -0.005f64..0.005,
        k3 in -0.02f64..0.08, x in -0.5f64..1279.5, y in -0.5f64..719.5,
    ) {
        // Some lenses fold and are refused; the next test covers them.
        if let Ok(camera) = camera(Distortion { k1, k2, p1, p2, k3, ..PLAIN }) {
            check_inverse(&camera, x, y);
        }
    }

    #[test]
    fn strong_lenses_are_undistorted_or_refused(
        c in prop::array::uniform8(-1.0f64..1.0), x in -0.5f64..1279.5, y in -0.5f64..719.5,
    ) {
        let distortion = Distortion {
            k1: c[0], k2: c[1], p1: 0.1 * c[2], p2: 0.1 * c[3], k3: c[4], k4: c[5], k5: c[6], k6: c[7],
        };
        match camera(distortion) {
            Ok(camera) => check_inverse(&camera, x, y),
            Err(error) => prop_assert!(matches!(error, CameraError::Folds { .. }), "{error}"),
        }
    }
}

#[test]
fn a_point_at_or_behind_the_near_plane_is_not_projected() {
    let camera = camera(PLAIN).unwrap();
    for z in [-3.0, 0.0, NEAR_PLANE_M] {
        assert_eq!(camera.project(Point::new(Point3::new(0.1, 0.2, z))), None);
    }
    assert!(
        camera
            .project(Point::new(Point3::new(0.0, 0.0, 0.06)))
            .is_some()
    );
}

#[test]
fn a_lens_that_folds_inside_its_image_is_refused_by_name() {
    let refused = camera(Distortion { k1: -0.9, ..PLAIN }).unwrap_err();
    let message = refused.to_string();
    assert!(
        message.starts_with("camera `north`: its lens distortion folds inside its image"),
        "{message}"
    );
}

#[test]
fn a_point_far_outside_the_view_does_not_fold_back_into_the_image() {
    // Known problem of OpenCV's polynomial: beyond r = 1.35 this lens draws towards the middle
    // again, and at r = 2.3 onto the principal point.
    let camera = camera(Distortion { k1: -0.18, ..PLAIN }).unwrap();
    let far = Pixel::new(640.0 + 900.0 * 2.3, 355.0);
    assert_eq!(camera.distort(far), None);
    assert!(!camera.sees(far));
}

#[test]
fn an_ideal_lens_moves_nothing() {
    let camera = camera(PLAIN).unwrap();
    let px = camera.distort(Pixel::new(0.1, 700.3)).unwrap();
    assert_eq!(px, Pixel::new(0.1, 700.3));
    assert!(camera.sees(Pixel::new(-0.5, -0.5)));
    assert!(!camera.sees(Pixel::new(1279.5, 0.0)));
}

#[test]
fn a_lens_distorts_as_in_opencv() {
    // cv2.projectPoints of (0.4, -0.3, 1) with this lens, by OpenCV's documented formula in
    // exact fractions: r2 = 0.25, g = (1 - 0.05 + 0.00625 + 0.00015625) / 1.0259375.
    let distortion = Distortion {
        k1: -0.2,
        k2: 0.1,
        p1: 0.001,
        p2: -0.002,
        k3: 0.01,
        k4: 0.1,
        k5: 0.01,
        k6: 0.02,
    };
    let camera = camera(distortion).unwrap();
    let g = 0.956_406_25 / 1.025_937_5;
    let x = 0.4 * g + 2.0 * 0.001 * -0.12 - 0.002 * (0.25 + 0.32);
    let y = -0.3 * g + 0.001 * (0.25 + 0.18) + 2.0 * -0.002 * -0.12;
    let px = camera
        .distort(
            camera
                .project(Point::new(Point3::new(0.4, -0.3, 1.0)))
                .unwrap(),
        )
        .unwrap();
    assert!((px.x() - (900.0 * x + 640.0)).abs() < INVERSE_PX);
    assert!((px.y() - (905.0 * y + 355.0)).abs() < INVERSE_PX);
}

#[test]
fn numbers_that_are_not_finite_are_refused_by_name() {
    let nan = camera(Distortion {
        k2: f64::NAN,
        ..PLAIN
    })
    .unwrap_err()
    .to_string();
    assert_eq!(
        nan,
        "camera `north`: distortion coefficient `k2` is NaN, expected a finite number"
    );
    let intrinsics = Intrinsics {
        fx_px: -1.0,
        fy_px: 1.0,
        cx_px: 0.0,
        cy_px: 0.0,
    };
    let place = Transform::new(Isometry3::identity());
    let refused = CameraModel::new("a", [4, 4], intrinsics, PLAIN, place)
        .unwrap_err()
        .to_string();
    assert_eq!(
        refused,
        "camera `a`: `fx`: found -1.0, expected a number from 1 to 1000000 pixels"
    );
    let lost = camera_at(Isometry3::translation(f64::INFINITY, 0.0, 0.0), PLAIN);
    assert_eq!(
        lost,
        Err(CameraError::Extrinsics {
            camera: "north".to_owned()
        })
    );
}
