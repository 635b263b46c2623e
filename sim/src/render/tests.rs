//! Objects appear at the right place, and pictures are reproducible.

use farfield_edge::crop::{CropGeometry, CropShape};
use farfield_proto::bounding_box::BoundingBox;
use farfield_proto::camera::{CameraModel, Distortion, Intrinsics};
use farfield_proto::frames::Point;
use image::RgbImage;
use nalgebra::{Point3, Vector2, Vector3};

use super::{Backdrop, CameraView, Figure, Sensor, Shot, Surroundings, paint};
use crate::body::standing::standing;
use crate::body::{BodyPart, Build, Cone, Volume};
use crate::look_at::look_at;

const SIZE_PX: [u32; 2] = [322, 202];

fn camera(distortion: Distortion) -> CameraModel {
    let intrinsics = Intrinsics {
        fx_px: 250.0,
        fy_px: 250.0,
        cx_px: 161.0,
        cy_px: 100.0,
    };
    let eye = Vector3::new(5.0, 1.0, 2.0);
    let place = look_at(eye, Vector3::new(0.0, 0.0, 1.0));
    CameraModel::new("c", SIZE_PX, intrinsics, distortion, place).unwrap()
}

fn bent() -> Distortion {
    Distortion {
        k1: -0.28,
        k2: 0.07,
        p1: 0.001,
        p2: -0.0008,
        ..Distortion::default()
    }
}

fn picture(view: &CameraView, figures: &[Figure<'_>], noise: f32) -> RgbImage {
    let eye = Vector3::new(5.0, 1.0, 2.0);
    let surroundings = Surroundings::new([6.0, 6.0], &[eye], 4);
    paint(&Shot {
        view,
        backdrop: &Backdrop::new(view, &surroundings, 1),
        light: surroundings.light(),
        figures,
        samples: 8,
        sensor: &Sensor::from_seed(1, noise),
        noise_seed: 9,
    })
}

fn ball_at(center_m: Vector3<f64>) -> Vec<Cone> {
    vec![Cone::round(BodyPart::Thing, [center_m; 2], [0.15; 2])]
}

/// The centre of the difference of two pictures, weighted by the difference of each pixel, within
/// `reach_px` of `around`, where no shadow falls.
fn changed(a: &RgbImage, b: &RgbImage, around: Vector2<f64>, reach_px: f64) -> Vector2<f64> {
    let (mut sum, mut weight) = (Vector2::zeros(), 0.0);
    for (x, y, pixel) in a.enumerate_pixels() {
        let at = Vector2::new(f64::from(x), f64::from(y));
        if (at - around).norm() > reach_px {
            continue;
        }
        let w = f64::from(pixel.0[1].abs_diff(b.get_pixel(x, y).0[1])).min(24.0);
        sum += at * w;
        weight += w;
    }
    sum / weight
}

#[test]
fn a_ball_is_drawn_at_its_projected_centre() {
    for distortion in [Distortion::default(), bent()] {
        let camera = camera(distortion);
        let view = CameraView::of_camera(&camera);
        let empty = picture(&view, &[], 0.0);
        for center in [
            Vector3::new(0.0, 0.0, 1.2),
            Vector3::new(0.3, 1.9, 1.9),
            Vector3::new(-1.0, -2.3, 1.8),
        ] {
            let ball = Figure::Thing {
                color: [0.95, 0.0, 0.0],
                moments: vec![ball_at(center)],
            };
            let seen = picture(&view, &[ball], 0.0);
            let ideal = camera.project(Point::new(Point3::from(center))).unwrap();
            let wanted = camera.distort(ideal).unwrap().vector_px();
            let found = changed(&seen, &empty, wanted, 13.0);
            // The outline of a ball is an ellipse whose centre is slightly beyond the ball's
            // centre.
            assert!((found - wanted).norm() < 0.2, "{found} {wanted}");
        }
    }
}

#[test]
fn a_crop_matches_the_undistorted_picture() {
    let camera = camera(Distortion::default());
    let center = Vector3::new(0.2, 0.4, 1.3);
    let ball = [Figure::Thing {
        color: [0.95, 0.0, 0.0],
        moments: vec![ball_at(center)],
    }];
    let at = camera.project(Point::new(Point3::from(center))).unwrap();
    let turned = BoundingBox {
        center_px: [at.x() as f32 + 6.0, at.y() as f32 - 3.0],
        size_px: [45.0, 60.0],
        rotation_rad: 0.6,
    };
    let geometry = CropGeometry::new(&turned, CropShape::without_maps([90, 120])).unwrap();
    let view = CameraView::of_crop(&camera, &geometry);
    let (seen, empty) = (picture(&view, &ball, 0.0), picture(&view, &[], 0.0));
    let wanted = geometry.input(at);
    let found = changed(&seen, &empty, wanted, 26.0);
    assert!((found - wanted).norm() < 0.3, "{found} {wanted}");
}

#[test]
fn a_picture_has_the_same_bytes_on_any_number_of_threads() {
    let build = Build::from_seed(1.75, 3);
    let figures = [Figure::Person {
        build: &build,
        moments: vec![Volume::new(&standing(1.75, [0.0, 0.0]), &build)],
    }];
    let view = CameraView::of_camera(&camera(bent()));
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        pool.install(|| picture(&view, &figures, 1.0))
    };
    assert_eq!(on(1).as_raw(), on(3).as_raw());
}

#[test]
fn an_open_shutter_blurs_motion() {
    let camera = camera(Distortion::default());
    let view = CameraView::of_camera(&camera);
    let empty = picture(&view, &[], 0.0);
    let width = |moments: Vec<Vec<Cone>>| {
        let ball = Figure::Thing {
            color: [0.95, 0.0, 0.0],
            moments,
        };
        let seen = picture(&view, &[ball], 0.0);
        let at = |x: u32| (60..100).any(|y| seen.get_pixel(x, y) != empty.get_pixel(x, y));
        (0..SIZE_PX[0]).filter(|&x| at(x)).count()
    };
    let places: Vec<_> = (0..8)
        .map(|n| ball_at(Vector3::new(0.0, f64::from(n) * 0.03, 1.4)))
        .collect();
    let still = width(places[..1].to_vec());
    let moving = width(places);
    assert!(moving > still + 7, "{still} {moving}");
}

#[test]
fn people_outside_the_view_cause_no_panic() {
    let build = Build::from_seed(1.75, 3);
    for at in [[5.0, 1.0], [5.2, 1.2], [9.0, 1.0], [4.7, 0.9]] {
        let figures = [Figure::Person {
            build: &build,
            moments: vec![Volume::new(&standing(1.75, at), &build)],
        }];
        let seen = picture(&CameraView::of_camera(&camera(bent())), &figures, 1.0);
        assert_eq!(seen.dimensions(), (SIZE_PX[0], SIZE_PX[1]));
    }
}
