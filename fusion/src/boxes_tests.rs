//! Boxes contain all that they must, turn when they must, and have the right rates.

use std::f64::consts::{FRAC_PI_2, PI};

use farfield_proto::camera::{Distortion, FISHEYE_HALF_VIEW_RAD, Intrinsics, LensModel};
use farfield_proto::frames::{Point, Transform};
use nalgebra::{Isometry3, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};
use proptest::prelude::*;

use super::*;
use crate::body::skeleton::{Kinematics, Pose, Proportions, Skeleton};

/// Boxes travel in single precision.
const TOLERANCE_PX: f64 = 0.01;

fn shape() -> BoxShape {
    BoxShape {
        margin: 1.25,
        reach_m: 0.25,
        parameters: BoxParameters::default(),
    }
}

/// 1920 x 1200 at (-8, 0, 1), looking along world +x.
fn model() -> CameraModel {
    let intrinsics = Intrinsics {
        fx_px: 1000.0,
        fy_px: 1000.0,
        cx_px: 959.5,
        cy_px: 599.5,
    };
    let axes = Rotation3::from_matrix_unchecked(nalgebra::Matrix3::new(
        0.0, -1.0, 0.0, //
        0.0, 0.0, -1.0, //
        1.0, 0.0, 0.0,
    ));
    let rotation = UnitQuaternion::from_rotation_matrix(&axes);
    let isometry = Isometry3::from_parts(
        Translation3::from(-(axes * Vector3::new(-8.0, 0.0, 1.0))),
        rotation,
    );
    CameraModel::new(
        "test",
        [1920, 1200],
        intrinsics,
        Distortion::default(),
        Transform::new(isometry),
    )
    .unwrap()
}

/// A person of 1.7 m in neutral pose, turned about its pelvis and moved to `at_m`.
fn posed(rotation: Rotation3<f64>, at_m: [f64; 3]) -> Joints {
    let mut kinematics = Kinematics::default();
    let pose = Pose::neutral(at_m.into(), UnitQuaternion::from_rotation_matrix(&rotation));
    Skeleton::new(&Proportions::from_stature(1.7)).forward(&pose, &mut kinematics);
    kinematics.joints_m
}

fn camera_box(boxes: &mut Boxes, joints: &Joints) -> Option<CameraBox> {
    boxes.camera_box(CameraIndex(1), &model(), (joints, joints), &shape())
}

/// Where a pixel lies in a box, in half sizes: inside within -1..=1.
fn within(b: &CameraBox, px: Vector2<f64>) -> Vector2<f64> {
    let b = b.bounding_box;
    let center = Vector2::from(b.center_px.map(f64::from));
    let local = Rotation2::new(-f64::from(b.rotation_rad)) * (px - center);
    local.component_div(&(Vector2::from(b.size_px.map(f64::from)) * 0.5))
}

fn pixel(p_m: Vector3<f64>) -> Vector2<f64> {
    model()
        .project(Point::new(Point3::from(p_m)))
        .unwrap()
        .vector_px()
}

proptest! {
    #[test]
    fn a_box_contains_all_joints_and_lattices_in_any_posture(
        axis_angle in prop::array::uniform3(-3.0f64..3.0), at in prop::array::uniform3(-2.0f64..2.0),
        inside in prop::array::uniform3(-0.25f64..0.25),
    ) {
        let joints = posed(Rotation3::new(axis_angle.into()), at);
        let b = camera_box(&mut Boxes::default(), &joints).unwrap();
        for joint in joints {
            let place = within(&b, pixel(joint + Vector3::from(inside)));
            prop_assert!(place.amax() <= 1.0 + 1e-4, "{place}");
        }
    }

    #[test]
    fn a_box_turns_with_the_person_in_the_image(roll in -PI..PI) {
        // The camera looks along +x, so a turn about +x is clockwise on the screen.
        let joints = posed(Rotation3::from_axis_angle(&Vector3::x_axis(), roll), [0.0, 0.0, 1.0]);
        let b = camera_box(&mut Boxes::default(), &joints).unwrap();
        let expected = if roll.abs().to_degrees() > 40.0 { roll } else { 0.0 };
        let off = Rotation2::new(f64::from(b.bounding_box.rotation_rad) - expected).angle();
        prop_assert!(off.abs() < 1e-4, "{roll} {:?}", b.bounding_box);
    }

    #[test]
    fn numbers_stay_finite_and_sizes_positive_anywhere(
        axis_angle in prop::array::uniform3(-3.0f64..3.0), x in -10.0f64..-6.0, y in -1.5f64..1.5,
    ) {
        let joints = posed(Rotation3::new(axis_angle.into()), [x, y, 1.0]);
        if let Some(b) = camera_box(&mut Boxes::default(), &joints) {
            prop_assert!(b.bounding_box.is_valid());
            prop_assert!(b.bounding_box.size_px.iter().all(|&v| v < 10_000.0));
            prop_assert!(b.torso_px.iter().chain(&b.neck_px).all(|v| v.is_finite()));
        }
    }
}

#[test]
fn an_upright_person_has_an_upright_box_with_the_margin() {
    let joints = posed(Rotation3::identity(), [0.0, 0.0, 1.0]);
    let b = camera_box(&mut Boxes::default(), &joints).unwrap();
    assert!(b.bounding_box.rotation_rad.abs() < 1e-9);
    let rows = joints.map(|joint| pixel(joint).y);
    let body_px =
        rows.iter().fold(f64::MIN, |a, &b| a.max(b)) - rows.iter().fold(f64::MAX, |a, &b| a.min(b));
    assert!(f64::from(b.bounding_box.size_px[1]) >= 1.25 * body_px - TOLERANCE_PX);
    assert!((f64::from(b.torso_px[1]) - 599.5).abs() < TOLERANCE_PX);
    assert!(b.neck_px[1] < b.torso_px[1]);
}

#[test]
fn lying_and_upside_down_boxes_turn_by_quarter_and_half() {
    let turned = |roll: f64| {
        let joints = posed(
            Rotation3::from_axis_angle(&Vector3::x_axis(), roll),
            [0.0, 0.0, 1.0],
        );
        camera_box(&mut Boxes::default(), &joints).unwrap()
    };
    let lying = turned(FRAC_PI_2);
    assert!(lying.neck_px[0] > lying.torso_px[0]);
    assert!((f64::from(lying.bounding_box.rotation_rad) - FRAC_PI_2).abs() < 1e-6);
    // Sizes are along the body: long from feet to head.
    assert!(lying.bounding_box.size_px[1] > lying.bounding_box.size_px[0]);
    assert!((f64::from(turned(PI).bounding_box.rotation_rad).abs() - PI).abs() < 1e-6);
}

#[test]
fn a_turned_box_stays_turned_until_the_lower_threshold() {
    let mut boxes = Boxes::default();
    let mut turned_at = |deg: f64| {
        let roll = Rotation3::from_axis_angle(&Vector3::x_axis(), deg.to_radians());
        camera_box(&mut boxes, &posed(roll, [0.0, 0.0, 1.0]))
            .unwrap()
            .bounding_box
            .rotation_rad
            != 0.0
    };
    assert!(
        !turned_at(35.0)
            && turned_at(45.0)
            && turned_at(35.0)
            && !turned_at(25.0)
            && !turned_at(35.0)
    );
}

#[test]
fn a_trunk_seen_end_on_does_not_turn_the_box() {
    // Lying along the view, head to the camera and a little to the side: a meaningless tilt.
    let along = Rotation3::from_axis_angle(&Vector3::z_axis(), 0.2)
        * Rotation3::from_axis_angle(&Vector3::y_axis(), -FRAC_PI_2);
    let b = camera_box(&mut Boxes::default(), &posed(along, [0.0, 0.0, 1.0])).unwrap();
    assert!(b.bounding_box.rotation_rad.abs() < 1e-9);
}

#[test]
fn boxes_that_must_not_turn_do_not() {
    let lying = posed(
        Rotation3::from_axis_angle(&Vector3::x_axis(), FRAC_PI_2),
        [0.0, 0.0, 1.0],
    );
    let mut shape = shape();
    shape.parameters.rotate = false;
    let b = Boxes::default()
        .camera_box(CameraIndex(0), &model(), (&lying, &lying), &shape)
        .unwrap();
    assert!(
        b.bounding_box.rotation_rad.abs() < 1e-9
            && b.bounding_box.size_px[0] > b.bounding_box.size_px[1]
    );
}

#[test]
fn people_outside_the_image_have_no_box() {
    let at = |at: [f64; 3]| camera_box(&mut Boxes::default(), &posed(Rotation3::identity(), at));
    assert!(at([-12.0, 0.0, 1.0]).is_none());
    assert!(at([0.0, 14.0, 1.0]).is_none());
    assert!(
        at([0.0, 8.2, 1.0]).is_some(),
        "an arm is still in the image"
    );
}

#[test]
fn the_rate_is_the_motion_of_one_tick() {
    let now = posed(Rotation3::identity(), [0.0, 0.0, 1.0]);
    let next = posed(Rotation3::identity(), [0.0, -0.08, 1.0]);
    let b = Boxes::default()
        .camera_box(CameraIndex(0), &model(), (&now, &next), &shape())
        .unwrap();
    // World -y is the image's right: 0.08 m at 8 m and 1000 px.
    assert!(
        (f64::from(b.rate.center_px[0]) - 10.0).abs() < 0.5,
        "{:?}",
        b.rate
    );
    assert!(b.rate.size_px.iter().all(|v| v.abs() < 0.5));
}

#[test]
fn a_rate_across_half_a_turn_goes_the_short_way() {
    let rolled = |roll: f64| {
        posed(
            Rotation3::from_axis_angle(&Vector3::x_axis(), roll),
            [0.0, 0.0, 1.0],
        )
    };
    let b = Boxes::default()
        .camera_box(
            CameraIndex(0),
            &model(),
            (&rolled(PI - 0.02), &rolled(PI + 0.03)),
            &shape(),
        )
        .unwrap();
    assert!((f64::from(b.rate.rotation_rad) - 0.05).abs() < 1e-4);
}

/// Everything that a box must contain, in the axes of a box turned by `rotation_rad`: every corner
/// of every cube, and the body with its margin.
fn plain_extent(joints: &Joints, rotation_rad: f64) -> (Vector2<f64>, Vector2<f64>) {
    let (shape, p) = (shape(), model().projection_matrix());
    let far_px = model().size_px().map(f64::from);
    let place = |h: Vector3<f64>| {
        let kept =
            |v: f64, size: f64| v.clamp(-FARTHEST_IMAGES * size, (1.0 + FARTHEST_IMAGES) * size);
        Rotation2::new(-rotation_rad)
            * Vector2::new(kept(h.x / h.z, far_px[0]), kept(h.y / h.z, far_px[1]))
    };
    let half_m = shape.reach_m;
    let (mut body, mut all) = (Vec::new(), Vec::new());
    for joint in Joint::ALL {
        let h = p * joints[joint.index()].push(1.0);
        if h.z >= NEAR_M {
            body.push(place(h));
            for corner in 0..8 {
                let side = |i: usize| {
                    p.column(i)
                        * if corner >> i & 1 == 0 {
                            half_m
                        } else {
                            -half_m
                        }
                };
                let h = h + side(0) + side(1) + side(2);
                if h.z >= NEAR_M {
                    all.push(place(h));
                }
            }
        }
        body.extend(
            ProjectedJoints::new(&p, joints)
                .crossing(joint)
                .map(|px| place(px.push(1.0))),
        );
    }
    let rim = |points: &[Vector2<f64>]| {
        let first = points[0];
        points.iter().fold((first, first), |(least, most), p| {
            (least.inf(p), most.sup(p))
        })
    };
    let (least, most) = rim(&body);
    let half = (most - least) * (0.5 * shape.margin);
    all.push((most + least) * 0.5 - half);
    all.push((most + least) * 0.5 + half);
    rim(&all)
}

proptest! {
    #[test]
    fn skipped_cubes_do_not_change_a_box(
        axis_angle in prop::array::uniform3(-3.0f64..3.0), x in -7.5f64..5.0, y in -3.0f64..3.0, turn in -PI..PI,
    ) {
        let joints = posed(Rotation3::new(axis_angle.into()), [x, y, 1.0]);
        let (model, shape) = (model(), shape());
        let p = model.projection_matrix();
        let (seen, cube) = (ProjectedJoints::new(&p, &joints), Cube::new(&p, shape.reach_m));
        if let Some(region) = Region::around(&model, (&seen, &cube), turn, shape.margin) {
            let (least, most) = plain_extent(&joints, turn);
            let size_px = (most - least).map(|side| side.max(LEAST_SIDE_PX));
            prop_assert_eq!(region.size_px, size_px);
            prop_assert_eq!(region.center_px, Rotation2::new(-turn).inverse() * ((most + least) * 0.5));
        }
    }
}

/// The same camera with a fisheye that sees 180 degrees across its picture.
fn fisheye() -> CameraModel {
    let focal_px = 1920.0 / PI;
    let intrinsics = Intrinsics {
        fx_px: focal_px,
        fy_px: focal_px,
        ..*model().intrinsics()
    };
    let lens = LensModel::KannalaBrandt([0.0; 4]);
    let place = *model().camera_from_world();
    CameraModel::new("fisheye", [1920, 1200], intrinsics, lens, place).unwrap()
}

#[test]
fn a_box_ends_at_the_rim_of_a_fisheye() {
    let camera = fisheye();
    let rim_px = camera.intrinsics().fx_px * libm::tan(FISHEYE_HALF_VIEW_RAD);
    // Two metres ahead, and from 55 to 63 degrees to the right.
    let boxed = |y_m: f64| {
        let joints = posed(Rotation3::identity(), [-6.0, y_m, 1.0]);
        Boxes::default().camera_box(CameraIndex(1), &camera, (&joints, &joints), &shape())
    };
    let cut = boxed(-3.3).unwrap().bounding_box;
    let [center, size] = [cut.center_px[0], cut.size_px[0]].map(f64::from);
    let right_px = center + 0.5 * size - camera.intrinsics().cx_px;
    assert!(right_px < rim_px + 0.2 * size, "{right_px} of {rim_px}");
    assert!(right_px > 0.9 * rim_px, "{right_px} of {rim_px}");
    // Straight ahead the box is not cut.
    assert!(boxed(0.0).is_some());
    // 68 degrees to the right, in the picture: there is nothing to crop.
    assert_eq!(boxed(-5.0), None);
}
