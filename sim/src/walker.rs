//! A person who walks along a circle and swings the arms: truth as a pure function of time.
//!
//! The body is a simple chain of sines. It is not the skeletal model of fusion, so that an error of
//! that model is visible in the results.

use std::collections::BTreeMap;
use std::f64::consts::{PI, TAU};

use nalgebra::{Rotation3, Vector3};

/// One walking person.
#[derive(Debug, Clone, PartialEq)]
pub struct Walker {
    /// Centre of the circle on the floor, metres.
    pub center_m: [f64; 2],
    /// Radius of the circle, metres; above zero.
    pub radius_m: f64,
    /// Speed along the circle, metres per second; negative walks clockwise.
    pub speed_m_s: f64,
    /// Start position on the circle, radians.
    pub start_rad: f64,
    /// Body height, metres.
    pub stature_m: f64,
}

/// Steps per second, left and right together.
const CADENCE_HZ: f64 = 1.8;

impl Walker {
    /// World positions in metres of the 17 COCO keypoints and the pelvis and neck at `time_s`, by
    /// name.
    pub fn points_m(&self, time_s: f64) -> BTreeMap<String, Vector3<f64>> {
        let h = self.stature_m;
        let along = self.start_rad + self.speed_m_s * time_s / self.radius_m;
        let heading = along + PI / 2.0 * self.speed_m_s.signum();
        let phase = TAU * CADENCE_HZ / 2.0 * time_s + self.start_rad;
        let bob = 0.012 * h * (2.0 * phase).cos();
        let pelvis = Vector3::new(
            self.center_m[0] + self.radius_m * along.cos(),
            self.center_m[1] + self.radius_m * along.sin(),
            0.52 * h + bob,
        );
        let body = Rotation3::from_axis_angle(&Vector3::z_axis(), heading);
        let trunk =
            body * Rotation3::from_axis_angle(&Vector3::y_axis(), 0.06) * turn(0.08 * phase.sin());
        let mut points = BTreeMap::new();
        points.insert("pelvis".to_owned(), pelvis);
        points.insert(
            "neck".to_owned(),
            pelvis + trunk * Vector3::new(0.0, 0.0, 0.29 * h),
        );
        self.face(&mut points, pelvis, trunk);
        for (side, name) in [(1.0, "left"), (-1.0, "right")] {
            let swing = if side > 0.0 {
                phase.sin()
            } else {
                -phase.sin()
            };
            let lift = if side > 0.0 {
                phase.cos()
            } else {
                -phase.cos()
            };
            leg(
                &mut points,
                name,
                pelvis + body * Vector3::new(0.0, side * 0.05 * h, 0.0),
                body,
                swing,
                lift,
                h,
            );
            arm(
                &mut points,
                name,
                pelvis + trunk * Vector3::new(0.0, side * 0.11 * h, 0.27 * h),
                trunk,
                -swing,
                h,
            );
        }
        points
    }

    fn face(
        &self,
        points: &mut BTreeMap<String, Vector3<f64>>,
        pelvis: Vector3<f64>,
        trunk: Rotation3<f64>,
    ) {
        let h = self.stature_m;
        let head = pelvis + trunk * Vector3::new(0.01 * h, 0.0, 0.39 * h);
        points.insert(
            "nose".to_owned(),
            head + trunk * Vector3::new(0.06 * h, 0.0, 0.0),
        );
        for (side, name) in [(1.0, "left"), (-1.0, "right")] {
            points.insert(
                format!("{name}_eye"),
                head + trunk * Vector3::new(0.05 * h, side * 0.019 * h, 0.015 * h),
            );
            points.insert(
                format!("{name}_ear"),
                head + trunk * Vector3::new(0.0, side * 0.042 * h, 0.0),
            );
        }
    }
}

fn turn(rad: f64) -> Rotation3<f64> {
    Rotation3::from_axis_angle(&Vector3::z_axis(), rad)
}

/// A rotation that swings a hanging limb forward by `rad`.
fn forward(rad: f64) -> Rotation3<f64> {
    Rotation3::from_axis_angle(&Vector3::y_axis(), -rad)
}

fn leg(
    points: &mut BTreeMap<String, Vector3<f64>>,
    name: &str,
    hip: Vector3<f64>,
    body: Rotation3<f64>,
    swing: f64,
    lift: f64,
    stature_m: f64,
) {
    let thigh = body * forward(0.08 + 0.42 * swing);
    let shank = thigh * forward(-(0.12 + 0.75 * lift.max(0.0).powi(2)));
    let knee = hip + thigh * Vector3::new(0.0, 0.0, -0.245 * stature_m);
    points.insert(format!("{name}_hip"), hip);
    points.insert(format!("{name}_knee"), knee);
    points.insert(
        format!("{name}_ankle"),
        knee + shank * Vector3::new(0.0, 0.0, -0.246 * stature_m),
    );
}

fn arm(
    points: &mut BTreeMap<String, Vector3<f64>>,
    name: &str,
    shoulder: Vector3<f64>,
    trunk: Rotation3<f64>,
    swing: f64,
    stature_m: f64,
) {
    let upper = trunk * forward(0.45 * swing);
    let fore = upper * forward(0.35 + 0.25 * swing.max(0.0));
    let elbow = shoulder + upper * Vector3::new(0.0, 0.0, -0.172 * stature_m);
    points.insert(format!("{name}_shoulder"), shoulder);
    points.insert(format!("{name}_elbow"), elbow);
    points.insert(
        format!("{name}_wrist"),
        elbow + fore * Vector3::new(0.0, 0.0, -0.157 * stature_m),
    );
}

#[cfg(test)]
mod tests {
    use super::*;

    const WALKER: Walker = Walker {
        center_m: [0.0, 0.0],
        radius_m: 1.5,
        speed_m_s: 1.2,
        start_rad: 0.3,
        stature_m: 1.75,
    };

    #[test]
    fn limbs_keep_their_lengths_and_feet_stay_above_the_floor() {
        for n in 0..200 {
            let p = WALKER.points_m(f64::from(n) * 0.02);
            let thigh = (p["left_hip"] - p["left_knee"]).norm();
            assert!((thigh - 0.245 * 1.75).abs() < 1e-12);
            assert!(p["left_ankle"].z > 0.0 && p["right_ankle"].z > 0.0);
            assert!(p["nose"].z < 1.75 && p["nose"].z > 1.4);
        }
    }

    #[test]
    fn the_walker_faces_forward() {
        let (p, q) = (WALKER.points_m(1.0), WALKER.points_m(1.01));
        let motion = (q["pelvis"] - p["pelvis"]).normalize();
        let gaze = (p["nose"] - (p["left_ear"] + p["right_ear"]) / 2.0).normalize();
        assert!(motion.dot(&gaze) > 0.9);
    }
}
