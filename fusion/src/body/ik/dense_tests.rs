//! Sums, factor and inverse against plain dense formulas.

use nalgebra::{Matrix3, SMatrix, SVector, Unit, Vector3};
use proptest::prelude::*;

use super::constants::{PoseElimination, SeenPoint};
use super::normal::{Factor, NormalEquations};
use super::tests::{all_joints, any_pose, placed};
use super::{JointSpread, PointInformation};
use crate::body::skeleton::dof::{ANCESTORS, DofGroup, MAX_CHAIN, first_of};
use crate::body::skeleton::{Joint, Kinematics, N_DOF, N_ROOT_DOF, Pose, Side, Site};

fn jacobian(at: &Kinematics, joint: Joint) -> SMatrix<f64, 3, N_DOF> {
    let place_m = at.joint_m(joint);
    SMatrix::from_fn(|row, dof| at.column(dof, joint.link(), &place_m)[row])
}

proptest! {
    #[test]
    fn the_factor_equals_a_dense_one(
        pose in any_pose(),
        weights in prop::collection::vec(0.1..1000.0, 29),
        rays in prop::collection::vec(prop::option::of(prop::array::uniform3(0.1..1.0)), 29),
    ) {
        let at = placed(&pose);
        let mut normal = NormalEquations::new();
        normal.begin(&at);
        let mut dense = SMatrix::<f64, N_DOF, N_DOF>::identity();
        let mut gradient = SVector::<f64, N_DOF>::zeros();
        let residual = Vector3::new(0.1, -0.2, 0.3);
        for ((joint, w), ray) in Joint::ALL.into_iter().zip(weights).zip(rays) {
            let ray = ray.map(|d| Unit::new_normalize(Vector3::from(d)));
            let across = ray.map_or(Matrix3::identity(), |d| Matrix3::identity() - d.as_ref() * d.transpose());
            let point = at.joint_m(joint);
            normal.add(joint.link(), &point, &(across * w), &(across * residual * w));
            let j = SMatrix::<f64, 3, N_DOF>::from_fn(|row, dof| at.column(dof, joint.link(), &point)[row]);
            dense += j.transpose() * across * j * w;
            gradient += j.transpose() * across * residual * w;
        }
        normal.gather(&at, false);
        let mut factor = Factor::new();
        factor.compute(&normal, &[1.0; N_DOF], &[false; N_DOF]);
        let mut x = *normal.gradient();
        factor.solve(&mut x);
        let mut covariance = [[0.0; MAX_CHAIN]; N_DOF];
        factor.invert(&mut covariance);
        let inverse = dense.cholesky().unwrap().inverse();
        let expected = inverse * gradient;
        for i in 0..N_DOF {
            prop_assert!((x[i] - expected[i]).abs() < 1e-8);
            let chain = ANCESTORS[i].dofs().iter().chain([&i]);
            for (entry, &j) in covariance[i].iter().zip(chain) {
                prop_assert!((entry - inverse[(i, j)]).abs() < 1e-8, "{i}, {j}");
            }
        }
    }

    #[test]
    fn eliminating_the_pose_equals_the_dense_formula(
        pose in any_pose(),
        weights in prop::collection::vec(0.1..1000.0, 29),
        moves in prop::collection::vec(prop::array::uniform3(-1.0..1.0), 58),
    ) {
        let at = placed(&pose);
        let mut hessian = SMatrix::<f64, N_DOF, N_DOF>::from_diagonal(
            &SVector::from(super::observability::spread_before().map(|s| s.powi(-2))),
        );
        let (mut gradient, mut shared) = (SVector::<f64, N_DOF>::zeros(), SMatrix::<f64, N_DOF, 2>::zeros());
        let (mut information, mut pull) = (SMatrix::<f64, 2, 2>::zeros(), SVector::<f64, 2>::zeros());
        let off_m = Vector3::new(0.01, -0.02, 0.03);
        let mut points = Vec::new();
        for ((joint, w), moves) in Joint::ALL.into_iter().zip(weights).zip(moves.chunks(2)) {
            let (j, i) = (jacobian(&at, joint), Matrix3::from_diagonal_element(w));
            let c = SMatrix::<f64, 3, 2>::from_fn(|row, k| moves[k][row]);
            hessian += j.transpose() * i * j;
            gradient += j.transpose() * i * off_m;
            shared += j.transpose() * i * c;
            information += c.transpose() * i * c;
            pull += c.transpose() * i * off_m;
            points.push(SeenPoint {
                joint,
                place_m: at.joint_m(joint),
                off_m,
                information: i,
                moves: [0, 1].map(|k| Vector3::from(moves[k])),
            });
        }
        let inverse = hessian.cholesky().unwrap().inverse();
        let found = PoseElimination::new().information(&at, &points);
        let expected = information - shared.transpose() * inverse * shared;
        let expected_pull = pull - shared.transpose() * inverse * gradient;
        prop_assert!((found.information - expected).amax() < 1e-8 * (1.0 + information.amax()));
        prop_assert!((found.pull - expected_pull).amax() < 1e-8 * (1.0 + information.amax()));
    }

    #[test]
    fn the_spread_of_the_joints_equals_the_dense_formula(
        pose in any_pose(),
        weights in prop::collection::vec(prop::option::of(1.0..10_000.0), 29),
        rays in prop::collection::vec(prop::option::of(prop::array::uniform3(0.1..1.0)), 29),
    ) {
        let at = placed(&pose);
        let mut dense = SMatrix::<f64, N_DOF, N_DOF>::from_diagonal(
            &SVector::from(super::observability::spread_before().map(|s| s.powi(-2))),
        );
        let mut seen = Vec::new();
        for ((joint, weight), ray) in Joint::ALL.into_iter().zip(weights).zip(rays) {
            let Some(weight) = weight else { continue };
            let ray = ray.map(|d| Unit::new_normalize(Vector3::from(d)));
            let across = ray.map_or(Matrix3::identity(), |d| Matrix3::identity() - d.as_ref() * d.transpose());
            let j = jacobian(&at, joint);
            dense += j.transpose() * across * j * weight;
            seen.push(PointInformation { site: Site::at(joint), information: across * weight });
        }
        let covariance = dense.cholesky().unwrap().inverse();
        let variances_m2 = JointSpread::default().variances_m2(&at, seen.into_iter());
        for (joint, variance_m2) in Joint::ALL.into_iter().zip(variances_m2) {
            let j = jacobian(&at, joint);
            let expected_m2 = (j * covariance * j.transpose()).trace() / 3.0;
            prop_assert!((variance_m2 - expected_m2).abs() < 1e-9, "{joint:?}: {variance_m2} {expected_m2}");
        }
    }

    #[test]
    fn the_curvature_is_the_second_derivative_of_the_cost(
        pose in any_pose(),
        off in prop::collection::vec(prop::array::uniform3(-0.1..0.1), 29),
    ) {
        // For hinges only: the shoulder's swings and the root's rotation are not applied one after
        // the other.
        let is_hinge = |i: usize| !(3..N_ROOT_DOF).contains(&i) && Side::BOTH.into_iter().all(|side| {
            let first = N_ROOT_DOF + first_of(side, DofGroup::Shoulder);
            !(first..first + 3).contains(&i)
        });
        let goals: Vec<_> = all_joints(&pose).into_iter().zip(off).map(|(t, off)| t.position_m + Vector3::from(off)).collect();
        let equations = |pose: &Pose| {
            let at = placed(pose);
            let mut normal = NormalEquations::new();
            normal.begin(&at);
            for (joint, goal_m) in Joint::ALL.into_iter().zip(&goals) {
                let point_m = at.joint_m(joint);
                normal.add(joint.link(), &point_m, &Matrix3::identity(), &(point_m - goal_m));
            }
            normal.gather(&at, true);
            normal
        };
        let here = equations(&pose);
        for j in (0..N_DOF).filter(|&j| is_hinge(j)) {
            let moved = |by: f64| pose.moved(&std::array::from_fn(|i| if i == j { by } else { 0.0 }));
            let (less, more) = (equations(&moved(-1e-5)), equations(&moved(1e-5)));
            for i in (j..N_DOF).filter(|&i| is_hinge(i)) {
                let Some(at) = ANCESTORS[i].dofs().iter().chain([&i]).position(|&a| a == j) else { continue };
                let slope = (more.gradient()[i] - less.gradient()[i]) / 2e-5;
                prop_assert!((here.row(i)[at] - slope).abs() < 1e-6, "{i}, {j}: {} {slope}", here.row(i)[at]);
            }
        }
    }
}
