//! The pose of one camera relative to the floor: direction of up, height, and positions of feet, from upright bodies of a
//! known stature.
//!
//! A body's ankles lie on a plane, its shoulders a known length above them along the vertical. The unknowns are the direction
//! n of up (in the camera's axes, 2) and the height h over the plane of ankles. Bodies sway and bend: Cauchy's loss limits the
//! residual of each.

use farfield_proto::order_statistics::upper_median;
use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector2, Vector3};

use crate::people::plan::{ANKLE_TO_SHOULDER, BodyPlan, LEG};
use crate::people::view::{Body, View};

/// Least number of bodies of a camera.
pub(in crate::people) const LEAST_BODIES: usize = 25;
/// Most bodies that are used.
const MOST_BODIES: usize = 400;
/// Usual horizontal distance of a walking body's shoulders from its ankles, relative to the distance between them.
const SWAY: f64 = 0.075;
/// Least sine of the angle below the horizon at which a ray meets the floor at a usable place.
const LEAST_DIP: f64 = 0.015;
/// Step of the grid of directions, degrees.
const PITCH_STEP_DEG: i32 = 6;
/// Step of the rotation about the axis, degrees.
const ROLL_STEP_DEG: i32 = 10;
/// Number of best directions that are refined.
const STARTS: usize = 6;
/// The loss of a body above the horizon: as much as for one with a very large residual.
const ABOVE_HORIZON: f64 = 6.0;

/// A camera over the floor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::people) struct Ground {
    /// Camera axes to axes over the floor: z up, x horizontally ahead, y to the left.
    pub(in crate::people) ground_from_camera: UnitQuaternion<f64>,
    /// Height of the pinhole over the plane of ankles, metres.
    pub(in crate::people) height_m: f64,
}

/// An upright body: directions to its ankles and its shoulders.
#[derive(Debug, Clone, Copy)]
struct Upright {
    ankles: Vector3<f64>,
    shoulders: Vector3<f64>,
}

impl Ground {
    /// The ground of the camera in a mirror that exchanges left and right.
    pub(in crate::people) fn mirrored(&self) -> Self {
        let up = self.ground_from_camera.inverse() * Vector3::z();
        Self {
            ground_from_camera: ground_from_camera(&Vector3::new(-up.x, up.y, up.z)),
            ..*self
        }
    }

    /// The position of a body on the floor, metres from below the camera: by its ankles, or by its hips if the ankles are
    /// hidden.
    pub(in crate::people) fn foot_m(
        &self,
        body: &Body,
        plan: &BodyPlan,
        stature_m: f64,
    ) -> Option<Vector2<f64>> {
        let by_ankles = body.bearing(&plan.ankles).map(|b| (b, self.height_m));
        let by_hips = || {
            let hips = body.bearing(&plan.hips)?;
            Some((hips, self.height_m - LEG * stature_m))
        };
        let (bearing, height_m) = by_ankles.or_else(by_hips)?;
        let down = self.ground_from_camera * bearing;
        (down.z < -LEAST_DIP && height_m > 0.1).then(|| down.xy() * (height_m / -down.z))
    }
}

/// The ground under `view`; the error is the number of usable bodies.
pub(in crate::people) fn ground(
    view: &View,
    plan: &BodyPlan,
    stature_m: f64,
) -> Result<Ground, usize> {
    let bodies = view.ticks.values().flatten();
    let upright = bodies.filter_map(|body| {
        Some(Upright {
            ankles: body.bearing_of_all(&plan.ankles)?,
            shoulders: body.bearing_of_all(&plan.shoulders)?,
        })
    });
    let all: Vec<Upright> = upright.collect();
    if all.len() < LEAST_BODIES {
        return Err(all.len());
    }
    let stride = all.len().div_ceil(MOST_BODIES);
    let chosen: Vec<Upright> = all.iter().step_by(stride).copied().collect();
    let length_m = ANKLE_TO_SHOULDER * stature_m;
    let mut starts = grid(&chosen, length_m);
    starts.sort_by(|a, b| a.0.total_cmp(&b.0));
    let refined = starts
        .into_iter()
        .take(STARTS)
        .map(|(_, up, height_m)| settle(up, height_m, &chosen, length_m));
    let best = refined.min_by(|a, b| a.0.total_cmp(&b.0));
    let (_, up, height_m) = best.ok_or(all.len())?;
    Ok(Ground {
        ground_from_camera: ground_from_camera(&up),
        height_m,
    })
}

/// The rows of the rotation are ahead, left, up.
fn ground_from_camera(up: &Vector3<f64>) -> UnitQuaternion<f64> {
    let forward = Vector3::z() - up * up.z;
    // Straight down, the picture's upper edge is ahead.
    let ahead = forward.try_normalize(0.05).unwrap_or_else(|| {
        let upper = -Vector3::y();
        (upper - up * up.dot(&upper)).normalize()
    });
    let left = up.cross(&ahead);
    let rows = [ahead.transpose(), left.transpose(), up.transpose()];
    UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(Matrix3::from_rows(
        &rows,
    )))
}

/// All directions with the height that fits the bodies: (loss, up, height).
fn grid(bodies: &[Upright], length_m: f64) -> Vec<(f64, Vector3<f64>, f64)> {
    let mut found = Vec::new();
    for pitch in (-12..=84).step_by(PITCH_STEP_DEG as usize) {
        for roll in (-180..180).step_by(ROLL_STEP_DEG as usize) {
            let (p, r) = (f64::from(pitch).to_radians(), f64::from(roll).to_radians());
            // Looking down by p, rotated about the axis by r.
            let up = Vector3::new(
                libm::sin(r) * libm::cos(p),
                -libm::cos(r) * libm::cos(p),
                -libm::sin(p),
            );
            let heights = bodies.iter().filter_map(|it| height_m(it, &up, length_m));
            let Some(height_m) = upper_median(heights.collect()) else {
                continue;
            };
            found.push((cost(bodies, &up, height_m, length_m), up, height_m));
        }
    }
    found
}

/// The height that gives one body its length: the ray of the shoulders passes nearest to the vertical above the ankles.
fn height_m(body: &Upright, up: &Vector3<f64>, length_m: f64) -> Option<f64> {
    let dip = -body.ankles.dot(up);
    if dip < LEAST_DIP {
        return None;
    }
    // At height 1: the points of the line ankle + t up and the ray of the shoulders that are nearest to each other.
    let ankle = body.ankles / dip;
    let s = body.shoulders;
    let across = up.dot(&s);
    let sine2 = 1.0 - across * across;
    let t = (across * ankle.dot(&s) - ankle.dot(up)) / sine2.max(1e-9);
    (t > 1e-3).then(|| length_m / t)
}

fn residual(
    body: &Upright,
    up: &Vector3<f64>,
    height_m: f64,
    length_m: f64,
) -> Option<Vector3<f64>> {
    let dip = -body.ankles.dot(up);
    if dip < LEAST_DIP {
        return None;
    }
    let shoulders = body.ankles * (height_m / dip) + up * length_m;
    // Divide by the angular size of the body: in metres the floor could rise to the pinhole without loss.
    let length_rad = (body.shoulders - body.ankles).norm().max(1e-4);
    Some((shoulders.normalize() - body.shoulders) / (SWAY * length_rad))
}

fn cost(bodies: &[Upright], up: &Vector3<f64>, height_m: f64, length_m: f64) -> f64 {
    let each = bodies.iter().map(|body| {
        residual(body, up, height_m, length_m)
            .map_or(ABOVE_HORIZON, |r| libm::log1p(r.norm_squared()))
    });
    each.sum()
}

/// Damped Gauss-Newton steps with Cauchy's weights: (loss, up, height).
fn settle(
    mut up: Vector3<f64>,
    mut height_m: f64,
    bodies: &[Upright],
    length_m: f64,
) -> (f64, Vector3<f64>, f64) {
    const STEP: f64 = 1e-5;
    let mut current = cost(bodies, &up, height_m, length_m);
    let mut damping = 1e-3;
    for _ in 0..40 {
        let mut hessian = Matrix3::zeros();
        let mut gradient = Vector3::zeros();
        let steps: [(Vector3<f64>, f64); 3] = std::array::from_fn(|k| {
            let mut by = Vector3::zeros();
            by[k] = STEP;
            moved(&up, height_m, &by)
        });
        for body in bodies {
            let Some(r) = residual(body, &up, height_m, length_m) else {
                continue;
            };
            let weight = 1.0 / (1.0 + r.norm_squared());
            let mut by = Matrix3::zeros();
            for (k, (up, height_m)) in steps.iter().enumerate() {
                if let Some(next) = residual(body, up, *height_m, length_m) {
                    by.set_column(k, &((next - r) / STEP));
                }
            }
            hessian += by.transpose() * by * weight;
            gradient += by.transpose() * r * weight;
        }
        for k in 0..3 {
            hessian[(k, k)] *= 1.0 + damping;
        }
        let Some(cholesky) = hessian.cholesky() else {
            break;
        };
        let next = moved(&up, height_m, &-cholesky.solve(&gradient));
        let found = cost(bodies, &next.0, next.1, length_m);
        if found < current {
            let enough = current - found < 1e-7 * current;
            (up, height_m) = next;
            current = found;
            damping *= 0.1;
            if enough {
                break;
            }
        } else {
            damping = 10.0 * damping + 1e-6;
        }
    }
    (current, up, height_m)
}

/// `up` moved on the sphere by the first two numbers, the height scaled by the exponential of the third.
fn moved(up: &Vector3<f64>, height_m: f64, by: &Vector3<f64>) -> (Vector3<f64>, f64) {
    let aside = if up.x.abs() < 0.7 {
        Vector3::x()
    } else {
        Vector3::y()
    };
    let first = up.cross(&aside).normalize();
    let second = up.cross(&first);
    (
        (up + first * by[0] + second * by[1]).normalize(),
        height_m * libm::exp(by[2].clamp(-1.0, 1.0)),
    )
}
