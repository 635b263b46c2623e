//! Aligns the world of the adjustment with the venue: up and floor by feet and upright bodies, metres by stature, places or a
//! distance.

use farfield_proto::order_statistics::{percentile, upper_median};
use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};

use super::adjust::Adjusted;
use super::plan::{ANKLE_HEIGHT, ANKLE_TO_SHOULDER, BodyPlan, USUAL_STATURE_M};
use crate::adjustment::CameraState;
use crate::alignment::{Alignment, Anchors, Similarity};

/// Usual distance of a standing ankle from the plane of all, relative to the stature.
const FOOT_SHARE: f64 = 0.02;
/// Usual angle of a body's axis from the vertical.
const LEAN_RAD: f64 = 0.15;
/// Rounds that reduce the weight of ankles far from the plane.
const ROUNDS: usize = 12;

/// Measures of bodies for the floor and the scale; lengths in the unit of the adjustment.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Standing {
    /// The lower ankle of each body with both ankles.
    pub(super) ankles: Vec<Vector3<f64>>,
    /// Unit vectors from ankles to shoulders.
    pub(super) axes: Vec<Vector3<f64>>,
    /// Lengths from ankle over knee and hip to the shoulders, divided by the same length of a body of stature 1.
    pub(super) statures: Vec<f64>,
}

/// The floor, with measures of how well feet fit it.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Floor {
    /// Unit vector.
    pub(super) up: Vector3<f64>,
    /// Height of the standing ankles along it.
    pub(super) ankles: f64,
    /// Median distance of the ankles from their plane.
    pub(super) apart: f64,
    /// Extents of the positions of feet along the floor, from 10 to 90 %: along their main direction, and across it.
    pub(super) extent: [f64; 2],
    /// Angle between the mean of the bodies' axes and up, radians.
    pub(super) lean_rad: f64,
}

impl Standing {
    pub(super) fn new(adjusted: &Adjusted, plan: &BodyPlan) -> Self {
        let mut standing = Self::default();
        for body in adjusted.bodies(plan.count) {
            let joint = |index: usize| body.get(index).copied().flatten();
            let both = |pair: [usize; 2]| Some([joint(pair[0])?, joint(pair[1])?]);
            let middle = |pair: [usize; 2]| both(pair).map(|[a, b]| (a + b) / 2.0);
            let Some(ankles) = both(plan.ankles) else {
                continue;
            };
            let Some(axis) = middle(plan.shoulders)
                .and_then(|it| (it - (ankles[0] + ankles[1]) / 2.0).try_normalize(1e-6))
            else {
                continue;
            };
            let lower = usize::from(ankles[1].dot(&axis) < ankles[0].dot(&axis));
            standing.ankles.push(ankles[lower]);
            standing.axes.push(axis);
            let trunk = middle(plan.shoulders).zip(middle(plan.hips));
            let leg = |side: usize| {
                let (hip, ankle) = (joint(plan.hips[side])?, ankles[side]);
                let Some(knees) = plan.knees else {
                    return Some((hip - ankle).norm());
                };
                let knee = joint(knees[side])?;
                Some((hip - knee).norm() + (knee - ankle).norm())
            };
            if let (Some((shoulders, hips)), Some(left), Some(right)) = (trunk, leg(0), leg(1)) {
                let length = (shoulders - hips).norm() + f64::midpoint(left, right);
                standing.statures.push(length / ANKLE_TO_SHOULDER);
            }
        }
        standing
    }

    /// The floor under the feet; `None` for fewer than ten bodies.
    ///
    /// Up is the n with the least sum of (n (ankle - middle))^2 / foot^2 + |n x axis|^2 / lean^2: if people walk along a
    /// line, their axes determine what their feet do not.
    pub(super) fn floor(&self) -> Option<Floor> {
        if self.ankles.len() < 10 {
            return None;
        }
        let stature = self.stature().unwrap_or(USUAL_STATURE_M);
        let foot = FOOT_SHARE * stature;
        let mut up = self.axes.iter().fold(Vector3::zeros(), |s, a| s + a);
        up = up.try_normalize(1e-6)?;
        let mean_axis = up;
        let mut height = upper_median(self.ankles.iter().map(|a| a.dot(&up)).collect())?;
        for _ in 0..ROUNDS {
            let mut middle = Vector3::zeros();
            let mut total = 0.0;
            let weights = self.ankles.iter().map(|ankle| {
                let d = (ankle.dot(&up) - height) / foot;
                1.0 / (1.0 + d * d)
            });
            let weights: Vec<f64> = weights.collect();
            for (ankle, weight) in self.ankles.iter().zip(&weights) {
                middle += ankle * *weight;
                total += weight;
            }
            middle /= total.max(1e-12);
            let mut form = Matrix3::zeros();
            for (ankle, weight) in self.ankles.iter().zip(&weights) {
                let d = ankle - middle;
                form += d * d.transpose() * (weight / (foot * foot));
            }
            for axis in &self.axes {
                let sine2 = axis.cross(&up).norm_squared() / (LEAN_RAD * LEAN_RAD);
                let weight = 1.0 / (1.0 + sine2) / (LEAN_RAD * LEAN_RAD);
                form += (Matrix3::identity() - axis * axis.transpose()) * weight;
            }
            let eigen = form.symmetric_eigen();
            let least = eigen.eigenvalues.imin();
            let next = eigen.eigenvectors.column(least).into_owned();
            up = if next.dot(&mean_axis) < 0.0 {
                -next
            } else {
                next
            };
            height = upper_median(self.ankles.iter().map(|a| a.dot(&up)).collect())?;
        }
        let apart = self.ankles.iter().map(|a| (a.dot(&up) - height).abs());
        Some(Floor {
            apart: upper_median(apart.collect())?,
            extent: self.extent(&up),
            lean_rad: up.angle(&mean_axis),
            ankles: height,
            up,
        })
    }

    fn extent(&self, up: &Vector3<f64>) -> [f64; 2] {
        let count = self.ankles.len().max(1) as f64;
        let middle = self.ankles.iter().fold(Vector3::zeros(), |s, a| s + a) / count;
        let mut spread = Matrix3::zeros();
        for ankle in &self.ankles {
            let d = ankle - middle;
            let d = d - up * up.dot(&d);
            spread += d * d.transpose() / count;
        }
        let eigen = spread.symmetric_eigen();
        let along = eigen.eigenvectors.column(eigen.eigenvalues.imax());
        let across = up.cross(&along);
        let width = |axis: &Vector3<f64>| {
            let mut at: Vec<f64> = self.ankles.iter().map(|ankle| ankle.dot(axis)).collect();
            at.sort_by(f64::total_cmp);
            let ends = percentile(&at, 0.1).zip(percentile(&at, 0.9));
            ends.map_or(0.0, |(low, high)| high - low)
        };
        [width(&along.into_owned()), width(&across)]
    }

    /// Median stature in the unit of the adjustment.
    pub(super) fn stature(&self) -> Option<f64> {
        upper_median(self.statures.clone()).filter(|it| *it > 0.0)
    }
}

/// The source of the scale.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Scale {
    /// Known places or distances.
    Measured,
    /// The stature of the people.
    Stature,
    /// None: people of usual stature are assumed.
    Assumed,
}

/// The alignment with the venue, and the source of its scale.
///
/// Unless three places are known, the origin is on the floor below the middle of the cameras, and the first camera in the
/// direction of x: a second calibration of the same cameras has the same axes.
pub(super) fn align(
    anchors: &Anchors,
    cameras: &[(String, CameraState)],
    standing: &Standing,
    floor: Option<&Floor>,
    stature_m: Option<f64>,
) -> Result<(Alignment, Scale), String> {
    let known = anchors.align(cameras)?;
    if known.rms_m.is_some() {
        return Ok((known, Scale::Measured));
    }
    let by_stature = |stature_m: f64| standing.stature().map(|found| stature_m / found);
    let (scale, from) = if known.has_scale {
        (known.venue_from_found.scale, Scale::Measured)
    } else if let Some(scale) = stature_m.and_then(by_stature) {
        (scale, Scale::Stature)
    } else {
        (by_stature(USUAL_STATURE_M).unwrap_or(1.0), Scale::Assumed)
    };
    let mut alignment = Alignment {
        has_scale: from != Scale::Assumed,
        ..known
    };
    alignment.venue_from_found.scale = scale;
    let (Some(floor), false) = (floor, known.has_floor) else {
        return Ok((alignment, from));
    };
    let ankle_height = ANKLE_HEIGHT * standing.stature().unwrap_or(0.0);
    let count = cameras.len().max(1) as f64;
    let middle = cameras
        .iter()
        .fold(Vector3::zeros(), |s, (_, c)| s + c.center_w)
        / count;
    let foot = middle - floor.up * (floor.up.dot(&middle) - floor.ankles + ankle_height);
    let to_first = cameras
        .first()
        .map_or(Vector3::x(), |(_, c)| c.center_w - middle);
    let flat = to_first - floor.up * floor.up.dot(&to_first);
    let ahead = flat.try_normalize(1e-6).unwrap_or_else(|| {
        let aside = if floor.up.x.abs() < 0.7 {
            Vector3::x()
        } else {
            Vector3::y()
        };
        floor.up.cross(&aside).normalize()
    });
    let left = floor.up.cross(&ahead);
    let rows = [ahead.transpose(), left.transpose(), floor.up.transpose()];
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(
        Matrix3::from_rows(&rows),
    ));
    alignment.venue_from_found = Similarity {
        scale,
        rotation,
        shift: -(rotation * foot) * scale,
    };
    alignment.has_floor = true;
    Ok((alignment, from))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_few_feet_off_a_straight_walk_do_not_make_it_wide() {
        let ankles = (0..200).map(|i: u32| {
            // One in twenty belongs to another person.
            let across = if i.is_multiple_of(20) {
                4.0
            } else {
                0.1 * f64::from(i % 3)
            };
            Vector3::new(0.1 * f64::from(i), across, 0.0)
        });
        let standing = Standing {
            ankles: ankles.collect(),
            ..Standing::default()
        };
        let [along, across] = standing.extent(&Vector3::z());
        assert!((along - 16.0).abs() < 0.2, "{along}");
        assert!(across < 0.5, "{across}");
    }
}
