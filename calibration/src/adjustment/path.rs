//! The positions of the observed points: each independent, along a smooth curve in time, or on a rigid body.

use nalgebra::{Isometry3, Matrix3, Translation3, UnitQuaternion, Vector3};

use super::camera_state::{CameraState, Observation};

/// A uniform cubic B-spline in time.
///
/// At s = (t - start) / spacing, i = floor(s), u = s - i, the point is the sum of the controls i to i + 3 with the weights
/// (1-u)^3 / 6, (3u^3 - 6u^2 + 4) / 6, (-3u^3 + 3u^2 + 3u + 1) / 6, u^3 / 6.
#[derive(Debug, Clone, PartialEq)]
pub struct Spline {
    /// Start time, seconds.
    pub start_s: f64,
    /// Time between knots, seconds.
    pub spacing_s: f64,
    /// Control points, world.
    pub controls: Vec<Vector3<f64>>,
    /// Weight of the squared second differences of the controls: it determines the curve where there are no observations.
    pub stiffness: f64,
}

/// One rigid body with a pose for each moment.
#[derive(Debug, Clone, PartialEq)]
pub struct Bodies {
    /// Per moment, the world from the body.
    pub poses: Vec<Isometry3<f64>>,
    /// The points of the body, in its own axes.
    pub shape: Vec<Vector3<f64>>,
}

impl Bodies {
    /// The [`Observation::point`] of a point of the shape at a moment.
    pub fn point(&self, moment: usize, of_shape: usize) -> usize {
        moment * self.shape.len() + of_shape
    }

    /// The moment of an observation's point.
    pub fn moment(&self, point: usize) -> usize {
        point / self.shape.len().max(1)
    }

    /// The rotated offset of a point from the body's origin, and the body's pose.
    fn arm(&self, point: usize) -> Option<(Vector3<f64>, &Isometry3<f64>)> {
        let pose = self.poses.get(self.moment(point))?;
        let shape = self.shape.get(point % self.shape.len().max(1))?;
        Some((pose.rotation * shape, pose))
    }
}

/// The observed points.
#[derive(Debug, Clone, PartialEq)]
pub enum Path {
    /// Independent points, by [`Observation::point`].
    Points(Vec<Vector3<f64>>),
    /// One curve, by the times of the frames.
    Curve(Spline),
    /// Points of a rigid body. Its nodes are a rotation (radians, world axes) and a shift for each moment.
    Bodies(Bodies),
}

/// The nodes that determine a point of the path.
#[derive(Debug, Clone, Copy)]
pub(super) struct Support {
    pub(super) first: usize,
    pub(super) count: usize,
    pub(super) weights: [f64; 4],
    /// Derivatives of the weights by time, 1/s.
    pub(super) slopes: [f64; 4],
    /// For a body, the offset of the point from its origin; the first node rotates it.
    arm: Option<Vector3<f64>>,
}

impl Support {
    /// The derivative of the point by the `i`-th of the nodes.
    pub(super) fn by_node(&self, i: usize) -> Matrix3<f64> {
        match self.arm {
            Some(arm) if i == 0 => -arm.cross_matrix(),
            _ => Matrix3::from_diagonal_element(self.weights[i]),
        }
    }
}

impl Spline {
    /// A curve from `start_s` to `end_s` at the origin.
    pub fn over(start_s: f64, end_s: f64, spacing_s: f64, stiffness: f64) -> Self {
        let spans = ((end_s - start_s) / spacing_s).ceil().max(1.0) as usize;
        Self {
            start_s,
            spacing_s,
            controls: vec![Vector3::zeros(); spans + 3],
            stiffness,
        }
    }

    /// The point at `time_s`; `None` outside the curve.
    pub fn at(&self, time_s: f64) -> Option<Vector3<f64>> {
        let support = self.support(time_s)?;
        Some(sum(&self.controls, &support, &support.weights))
    }

    pub(super) fn support(&self, time_s: f64) -> Option<Support> {
        let s = (time_s - self.start_s) / self.spacing_s;
        let spans = self.controls.len().checked_sub(3)?;
        if !(s >= 0.0 && s <= spans as f64) || spans == 0 {
            return None;
        }
        let first = (s as usize).min(spans - 1);
        let u = s - first as f64;
        let v = 1.0 - u;
        let weights = [
            v * v * v,
            (3.0 * u - 6.0) * u * u + 4.0,
            ((-3.0 * u + 3.0) * u + 3.0) * u + 1.0,
            u * u * u,
        ];
        let slopes = [
            -3.0 * v * v,
            (9.0 * u - 12.0) * u,
            (-9.0 * u + 6.0) * u + 3.0,
            3.0 * u * u,
        ];
        Some(Support {
            first,
            count: 4,
            weights: weights.map(|w| w / 6.0),
            slopes: slopes.map(|w| w / (6.0 * self.spacing_s)),
            arm: None,
        })
    }
}

impl Path {
    /// The points or controls; empty for bodies.
    pub fn nodes(&self) -> &[Vector3<f64>] {
        match self {
            Self::Points(points) => points,
            Self::Curve(spline) => &spline.controls,
            Self::Bodies(_) => &[],
        }
    }

    /// The points or controls, mutable; empty for bodies.
    pub fn nodes_mut(&mut self) -> &mut [Vector3<f64>] {
        match self {
            Self::Points(points) => points,
            Self::Curve(spline) => &mut spline.controls,
            Self::Bodies(_) => &mut [],
        }
    }

    /// The number of nodes, of three numbers each.
    pub fn node_count(&self) -> usize {
        match self {
            Self::Points(_) | Self::Curve(_) => self.nodes().len(),
            Self::Bodies(bodies) => 2 * bodies.poses.len(),
        }
    }

    /// Moves all nodes.
    pub(super) fn step(&mut self, by: &[f64]) {
        let by: Vec<Vector3<f64>> = by.chunks_exact(3).map(Vector3::from_column_slice).collect();
        for (node, by) in self.nodes_mut().iter_mut().zip(&by) {
            *node += by;
        }
        if let Self::Bodies(bodies) = self {
            for (pose, by) in bodies.poses.iter_mut().zip(by.chunks_exact(2)) {
                let mut rotation = UnitQuaternion::from_scaled_axis(by[0]) * pose.rotation;
                rotation.renormalize();
                let shift = Translation3::from(pose.translation.vector + by[1]);
                *pose = Isometry3::from_parts(shift, rotation);
            }
        }
    }

    /// The point of `observation`; `None` outside the path.
    pub fn place(&self, observation: &Observation, camera: &CameraState) -> Option<Vector3<f64>> {
        if let Self::Bodies(bodies) = self {
            let (arm, pose) = bodies.arm(observation.point)?;
            return Some(pose.translation.vector + arm);
        }
        let support = self.support(observation, camera)?;
        Some(sum(self.nodes(), &support, &support.weights))
    }

    pub(super) fn support(
        &self,
        observation: &Observation,
        camera: &CameraState,
    ) -> Option<Support> {
        match self {
            Self::Points(points) => (observation.point < points.len()).then_some(Support {
                first: observation.point,
                count: 1,
                weights: [1.0, 0.0, 0.0, 0.0],
                slopes: [0.0; 4],
                arm: None,
            }),
            Self::Bodies(bodies) => bodies.arm(observation.point).map(|(arm, _)| Support {
                first: 2 * bodies.moment(observation.point),
                count: 2,
                weights: [0.0, 1.0, 0.0, 0.0],
                slopes: [0.0; 4],
                arm: Some(arm),
            }),
            Self::Curve(spline) => spline.support(camera.time_s(observation.frame)),
        }
    }

    /// The number of previous nodes to which a node is coupled.
    pub(super) fn reach(&self) -> usize {
        match self {
            Self::Points(_) => 0,
            Self::Curve(_) => 3,
            Self::Bodies(_) => 1,
        }
    }
}

/// The weighted sum of the nodes of `support`.
pub(super) fn sum(nodes: &[Vector3<f64>], support: &Support, weights: &[f64; 4]) -> Vector3<f64> {
    let used = nodes.iter().skip(support.first).take(support.count);
    used.zip(weights)
        .fold(Vector3::zeros(), |total, (node, w)| total + node * *w)
}
