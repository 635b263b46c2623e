//! The pose of a camera from points at known places (marks on the floor, a board): several starts, each refined with the whole
//! lens, and a comparison of the best two solutions.
//!
//! A flat set of points that looks small has two poses that fit nearly alike, mirrored at the line of sight (Schweighofer and
//! Pinz 2006); the residual alone does not decide between them.

use farfield_proto::camera::Intrinsics;
use nalgebra::{
    DMatrix, Isometry3, Matrix3, Matrix6, Point3, Rotation3, Translation3, Unit, UnitQuaternion,
    Vector2, Vector3,
};

use super::adjust::{Sighting, adjust_pose, pose_covariance, residuals};
use super::projection::Optics;
use super::start::{homography, pose};
use crate::formats::LensModel;

/// Least number of points: three have up to four solutions.
const FEWEST: usize = 4;
/// Most points: far more than are clicked by hand.
const MOST: usize = 10_000;
/// Poses whose rotations differ by less are the same, radians.
const SAME_RAD: f64 = 1e-3;
/// A second solution with an RMS of at most this multiple of the best one's may be the true one.
const AMBIGUOUS: f64 = 2.0;
/// Accuracy of a click at best, pixels: smaller residuals do not distinguish two solutions.
const CLICK_PX: f64 = 0.5;
/// Points are flat if their extent along one direction is a smaller share of the largest one.
const FLAT: f64 = 0.1;

/// A second pose that fits.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OtherPose {
    /// Camera from world, metres.
    pub camera_from_world: Isometry3<f64>,
    /// Its residual, pixels.
    pub rms_px: f64,
}

/// The pose of a camera.
#[derive(Debug, Clone, PartialEq)]
pub struct PointPose {
    /// Camera from world, metres.
    pub camera_from_world: Isometry3<f64>,
    /// Projected minus given, for each point, pixels.
    pub residuals_px: Vec<[f64; 2]>,
    /// Root of their mean squared length, pixels.
    pub rms_px: f64,
    /// Covariance for points with a standard deviation of one pixel per axis: rotation of the camera's axes (rad), shift (m).
    pub covariance_at_1_px: Matrix6<f64>,
    /// The next best pose with all points in front, if any.
    pub other: Option<OtherPose>,
    /// Whether the other pose may be the true one: add points off their plane.
    pub is_ambiguous: bool,
    /// Whether the camera is below points on a level plane (z up): usually left and right, or two points, were swapped, which a
    /// flat set fits without any residual.
    pub is_under_points: bool,
}

impl PointPose {
    /// The position of the camera in the world, metres.
    pub fn center_m(&self) -> Point3<f64> {
        self.camera_from_world.inverse() * Point3::origin()
    }

    /// Standard deviation of the camera's position for points with a standard deviation of `click_px`, metres.
    pub fn center_sigma_m(&self, click_px: f64) -> f64 {
        // center = -R' t; a rotation w and a shift s move it by -R' (s - t x w).
        let t = self.camera_from_world.translation.vector;
        let mut jacobian = nalgebra::Matrix3x6::zeros();
        jacobian
            .fixed_view_mut::<3, 3>(0, 0)
            .copy_from(&-t.cross_matrix());
        jacobian
            .fixed_view_mut::<3, 3>(0, 3)
            .copy_from(&Matrix3::identity());
        let covariance = jacobian * self.covariance_at_1_px * jacobian.transpose();
        click_px * covariance.trace().max(0.0).sqrt()
    }
}

/// The reason why points give no pose.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum PoseError {
    /// Too few or too many.
    #[error("found {found} points, expected {FEWEST} to {MOST}")]
    Count {
        /// The number of points.
        found: usize,
    },
    /// The numbers of pixels and points differ.
    #[error("found {points} points and {pixels} pixels, expected as many")]
    Pairs {
        /// Points.
        points: usize,
        /// Pixels.
        pixels: usize,
    },
    /// A coordinate is not finite.
    #[error("point {index} (from 0) has a coordinate that is not finite")]
    NotFinite {
        /// The index.
        index: usize,
    },
    /// The points lie on a line, or at one place.
    #[error("the points lie on a line, expected some off the line")]
    OnALine,
    /// No pose projects all points.
    #[error(
        "no pose of the camera has all points in front of it: a point or the focal length is wrong"
    )]
    None,
}

/// The pose of a camera with this lens that sees `points_m` (world, z up, metres) at `pixels` (distorted; (0, 0) is the centre
/// of the first).
///
/// # Errors
/// [`PoseError`] for fewer than four points, points on a line, numbers that are not finite, and if no pose fits.
pub fn pose_from_points(
    intrinsics: &Intrinsics,
    lens: &LensModel,
    points_m: &[[f64; 3]],
    pixels: &[[f64; 2]],
) -> Result<PointPose, PoseError> {
    check(points_m, pixels)?;
    let optics = Optics::new(intrinsics, lens);
    let sighting = Sighting {
        board: points_m.iter().copied().map(Vector3::from).collect(),
        pixels: pixels.iter().copied().map(Vector2::from).collect(),
    };
    let cloud = Cloud::new(&sighting.board)?;
    let mut found: Vec<(f64, Isometry3<f64>)> = Vec::new();
    for start in starts(&optics, &sighting, &cloud) {
        keep(&mut found, &optics, start, &sighting);
    }
    // Also try the mirrored twin of every solution, so that it is found if it is a minimum.
    for (_, solution) in found.clone() {
        if let Some(axis) = cloud.flat_axis() {
            keep(
                &mut found,
                &optics,
                twin(&solution, &axis, &cloud.mean),
                &sighting,
            );
        }
    }
    found.sort_by(|a, b| a.0.total_cmp(&b.0));
    let Some((rms_px, camera_from_world)) = found.first().copied() else {
        return Err(PoseError::None);
    };
    let all = residuals(&optics, &camera_from_world, &sighting).ok_or(PoseError::None)?;
    let other = found.get(1).map(|(rms_px, camera_from_world)| OtherPose {
        camera_from_world: *camera_from_world,
        rms_px: *rms_px,
    });
    let center = camera_from_world.inverse().translation.vector;
    let level = cloud.flat_axis().iter().any(|axis| axis.z.abs() > 0.95);
    Ok(PointPose {
        camera_from_world,
        residuals_px: all.iter().map(|r| [r.x, r.y]).collect(),
        rms_px,
        covariance_at_1_px: pose_covariance(&optics, &camera_from_world, &sighting)
            .ok_or(PoseError::OnALine)?,
        is_ambiguous: other.is_some_and(|other| other.rms_px <= AMBIGUOUS * rms_px.max(CLICK_PX)),
        other,
        is_under_points: level && center.z < cloud.mean.z,
    })
}

fn check(points_m: &[[f64; 3]], pixels: &[[f64; 2]]) -> Result<(), PoseError> {
    if points_m.len() != pixels.len() {
        return Err(PoseError::Pairs {
            points: points_m.len(),
            pixels: pixels.len(),
        });
    }
    if !(FEWEST..=MOST).contains(&points_m.len()) {
        return Err(PoseError::Count {
            found: points_m.len(),
        });
    }
    let finite = |list: &[f64]| list.iter().all(|v| v.is_finite());
    let bad = points_m
        .iter()
        .zip(pixels)
        .position(|(p, q)| !finite(p) || !finite(q));
    bad.map_or(Ok(()), |index| Err(PoseError::NotFinite { index }))
}

/// The shape of the points.
struct Cloud {
    mean: Vector3<f64>,
    /// Orthonormal directions, from the longest extent to the shortest; right-handed.
    axes: Matrix3<f64>,
    /// Standard deviations along them, metres.
    extents: Vector3<f64>,
}

impl Cloud {
    fn new(points: &[Vector3<f64>]) -> Result<Self, PoseError> {
        let n = points.len() as f64;
        let mean: Vector3<f64> = points.iter().sum::<Vector3<f64>>() / n;
        let scatter: Matrix3<f64> = points
            .iter()
            .map(|p| (p - mean) * (p - mean).transpose())
            .sum();
        let eigen = (scatter / n).symmetric_eigen();
        let mut order = [0, 1, 2];
        order.sort_by(|a, b| eigen.eigenvalues[*b].total_cmp(&eigen.eigenvalues[*a]));
        let [a, b, c] = order;
        let (x, y) = (
            eigen.eigenvectors.column(a).into_owned(),
            eigen.eigenvectors.column(b).into_owned(),
        );
        let extents = Vector3::new(
            eigen.eigenvalues[a],
            eigen.eigenvalues[b],
            eigen.eigenvalues[c],
        );
        let extents = extents.map(|v| v.max(0.0).sqrt());
        if extents.y <= 1e-4 * extents.x || extents.x <= 0.0 {
            return Err(PoseError::OnALine);
        }
        Ok(Self {
            mean,
            axes: Matrix3::from_columns(&[x, y, x.cross(&y)]),
            extents,
        })
    }

    /// The normal of flat points.
    fn flat_axis(&self) -> Option<Vector3<f64>> {
        let is_flat = self.extents.z < FLAT * self.extents.x;
        is_flat.then(|| self.axes.column(2).into_owned())
    }
}

/// Refines `start`, and adds it to `found` unless it is a known pose.
fn keep(
    found: &mut Vec<(f64, Isometry3<f64>)>,
    optics: &Optics,
    start: Isometry3<f64>,
    sighting: &Sighting,
) {
    let Some(refined) = adjust_pose(optics, start, sighting) else {
        return;
    };
    let Some(all) = residuals(optics, &refined, sighting) else {
        return;
    };
    let rms_px = (all.iter().map(Vector2::norm_squared).sum::<f64>() / all.len() as f64).sqrt();
    let same = found
        .iter_mut()
        .find(|(_, other)| other.rotation.angle_to(&refined.rotation) < SAME_RAD);
    match same {
        Some(same) if rms_px < same.0 => *same = (rms_px, refined),
        Some(_) => {}
        None => found.push((rms_px, refined)),
    }
}

/// Start poses: from the points' plane, from the linear equations, and 24 rotations of the cloud at its apparent distance.
fn starts(optics: &Optics, sighting: &Sighting, cloud: &Cloud) -> Vec<Isometry3<f64>> {
    let image: Vec<Vector2<f64>> = sighting
        .pixels
        .iter()
        .map(|px| normalised(optics, px))
        .collect();
    let mut all = Vec::new();
    // The points' own plane becomes z = 0.
    let cloud_from_world = Isometry3::from_parts(
        Translation3::identity(),
        UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(
            cloud.axes.transpose(),
        )),
    ) * Translation3::from(-cloud.mean);
    let plane: Vec<Vector2<f64>> = sighting
        .board
        .iter()
        .map(|p| (cloud_from_world * Point3::from(*p)).coords.xy())
        .collect();
    all.extend(
        homography(&plane, &image)
            .and_then(|h| pose(&h))
            .map(|camera| camera * cloud_from_world),
    );
    if cloud.flat_axis().is_none() {
        all.extend(linear(&sighting.board, &image));
    }
    let n = image.len() as f64;
    let middle: Vector2<f64> = image.iter().sum::<Vector2<f64>>() / n;
    let seen = (image
        .iter()
        .map(|p| (p - middle).norm_squared())
        .sum::<f64>()
        / n)
        .sqrt();
    let distance = cloud.extents.norm() / seen.max(1e-6);
    let ray = middle.push(1.0) * distance;
    for turn in quarter_turns() {
        all.push(Isometry3::from_parts(Translation3::from(ray), turn) * cloud_from_world);
    }
    all
}

/// The undistorted pixel in focal lengths; at most 80 degrees off the axis.
fn normalised(optics: &Optics, px: &Vector2<f64>) -> Vector2<f64> {
    let Intrinsics {
        fx_px,
        fy_px,
        cx_px,
        cy_px,
    } = optics.intrinsics();
    let target = Vector2::new((px.x - cx_px) / fx_px, (px.y - cy_px) / fy_px);
    let mut ray = target;
    if optics.lens().is_fisheye() {
        let theta = target.norm().min(1.4);
        ray = target.try_normalize(1e-12).unwrap_or_else(Vector2::zeros) * libm::tan(theta);
    }
    // A start need not be exact: a few Newton steps are enough.
    for _ in 0..20 {
        let Some(drawn) = optics.draw(&ray.push(1.0)) else {
            break;
        };
        let slope = drawn.by_point.fixed_view::<2, 2>(0, 0).into_owned();
        let Some(step) = slope
            .try_inverse()
            .map(|inverse| inverse * (drawn.pixel - px))
        else {
            break;
        };
        ray -= step;
        if step.norm() < 1e-12 || !ray.iter().all(|v| v.is_finite()) {
            break;
        }
    }
    if ray.iter().all(|v| v.is_finite() && v.abs() < 10.0) {
        ray
    } else {
        target
    }
}

/// Direct linear transformation for six or more points in space (Hartley and Zisserman 2004, 7.1).
fn linear(points: &[Vector3<f64>], image: &[Vector2<f64>]) -> Option<Isometry3<f64>> {
    if points.len() < 6 {
        return None;
    }
    let mut a = DMatrix::<f64>::zeros(2 * points.len(), 12);
    for (i, (p, q)) in points.iter().zip(image).enumerate() {
        for (offset, value) in [q.x, q.y].into_iter().enumerate() {
            for (j, entry) in p.push(1.0).iter().enumerate() {
                a[(2 * i + offset, 4 * offset + j)] = *entry;
                a[(2 * i + offset, 8 + j)] = -value * entry;
            }
        }
    }
    let last = a.svd(false, true).v_t?.row(11).transpose();
    let m = nalgebra::Matrix3x4::from_row_slice(last.as_slice());
    let left = m.fixed_view::<3, 3>(0, 0).into_owned();
    let sign = if left.determinant() < 0.0 { -1.0 } else { 1.0 };
    let svd = (left * sign).svd(true, true);
    let rotation = svd.u? * svd.v_t?;
    let scale = svd.singular_values.mean();
    let translation: Vector3<f64> = m.column(3) * (sign / scale);
    let finite = rotation
        .iter()
        .chain(translation.iter())
        .all(|v| v.is_finite());
    (finite && rotation.determinant() > 0.0).then(|| {
        Isometry3::from_parts(
            Translation3::from(translation),
            UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation)),
        )
    })
}

/// The 24 rotations of a cube.
fn quarter_turns() -> Vec<UnitQuaternion<f64>> {
    use std::f64::consts::{FRAC_PI_2, PI};
    let about =
        |axis: &Unit<Vector3<f64>>, angle: f64| UnitQuaternion::from_axis_angle(axis, angle);
    let (x, y, z) = (Vector3::x_axis(), Vector3::y_axis(), Vector3::z_axis());
    let faces = [
        UnitQuaternion::identity(),
        about(&x, FRAC_PI_2),
        about(&x, -FRAC_PI_2),
        about(&x, PI),
        about(&y, FRAC_PI_2),
        about(&y, -FRAC_PI_2),
    ];
    let spins = [0.0, FRAC_PI_2, PI, -FRAC_PI_2];
    faces
        .iter()
        .flat_map(|face| spins.iter().map(move |spin| face * about(&z, *spin)))
        .collect()
}

/// The pose whose plane through `mean` with the world normal `axis` is mirrored at the line of sight.
fn twin(pose: &Isometry3<f64>, axis: &Vector3<f64>, mean: &Vector3<f64>) -> Isometry3<f64> {
    let place = pose * Point3::from(*mean);
    let sight = place.coords.normalize();
    let normal = pose.rotation * axis;
    let normal = if normal.dot(&sight) > 0.0 {
        -normal
    } else {
        normal
    };
    // Rotates the normal to its mirror image, 2 (n . s) s - n, about the line of sight.
    let mirrored = 2.0 * normal.dot(&sight) * sight - normal;
    let turn = UnitQuaternion::rotation_between(&normal, &mirrored)
        .unwrap_or_else(UnitQuaternion::identity);
    let rotation = turn * pose.rotation;
    Isometry3::from_parts(Translation3::from(place.coords - rotation * mean), rotation)
}
