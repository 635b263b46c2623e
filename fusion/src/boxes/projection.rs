//! A body in one image, and the cubes of the lattice around its joints.

use nalgebra::{Matrix3x4, Vector2, Vector3};

use super::NEAR_M;
use crate::body::skeleton::{Joint, Joints, N_JOINTS};

/// Limit of rounding errors of a pixel, pixels; far above them.
const ROUNDING_PX: f64 = 1e-6;

/// The joints of a body as one camera projects them.
pub(super) struct ProjectedJoints<'a> {
    p: &'a Matrix3x4<f64>,
    joints_m: &'a Joints,
    /// Homogeneous pixels; the third number is the depth in metres.
    h: [Vector3<f64>; N_JOINTS],
}

impl<'a> ProjectedJoints<'a> {
    /// `joints_m` (world, metres) through the projection matrix `p` of a camera.
    pub(super) fn new(p: &'a Matrix3x4<f64>, joints_m: &'a Joints) -> Self {
        Self {
            p,
            joints_m,
            h: std::array::from_fn(|i| p * joints_m[i].push(1.0)),
        }
    }

    /// A joint in the world, metres.
    pub(super) fn joint_m(&self, joint: Joint) -> Vector3<f64> {
        self.joints_m[joint.index()]
    }

    /// A joint's homogeneous pixel.
    pub(super) fn homogeneous(&self, joint: Joint) -> Vector3<f64> {
        self.h[joint.index()]
    }

    /// Where `joint` is in the image, if it is in front of the camera.
    pub(super) fn pixel(&self, joint: Joint) -> Option<Vector2<f64>> {
        in_front(self.homogeneous(joint))
    }

    /// How many joints are in front of the camera.
    pub(super) fn n_in_front(&self) -> usize {
        self.h.iter().filter(|h| h.z >= NEAR_M).count()
    }

    /// Where the link from `joint` to its parent crosses the near plane, if it does.
    pub(super) fn crossing(&self, joint: Joint) -> Option<Vector2<f64>> {
        let parent = joint.parent()?;
        let (depth_m, parent_depth_m) = (self.homogeneous(joint).z, self.homogeneous(parent).z);
        if (depth_m >= NEAR_M) == (parent_depth_m >= NEAR_M) {
            return None;
        }
        let t = (NEAR_M - depth_m) / (parent_depth_m - depth_m);
        let place_m = self.joint_m(joint).lerp(&self.joint_m(parent), t);
        let h = self.p * place_m.push(1.0);
        Some(Vector2::new(h.x, h.y) / h.z)
    }
}

/// A cube around any joint, in one image.
pub(super) struct Cube {
    /// Half of its sides, as homogeneous pixels.
    sides: [Vector3<f64>; 3],
}

impl Cube {
    /// With `half_width_m`, in the image of the camera with the projection matrix `p`.
    pub(super) fn new(p: &Matrix3x4<f64>, half_width_m: f64) -> Self {
        Self {
            sides: [0, 1, 2].map(|i| p.column(i) * half_width_m),
        }
    }

    /// Its projected corners around a point that projects to the homogeneous pixel `h`, without
    /// corners behind the near plane.
    pub(super) fn corners(&self, h: Vector3<f64>) -> impl Iterator<Item = Vector2<f64>> {
        let [first, second, third] = self.sides;
        let both = |h: Vector3<f64>, side: Vector3<f64>| [h + side, h - side];
        let edges = both(h, first).map(|h| both(h, second));
        let corners = edges.map(|edges| edges.map(|h| both(h, third)));
        corners.into_iter().flatten().flatten().filter_map(in_front)
    }

    /// Largest distance of a corner's projection from that of the middle, horizontally and
    /// vertically, pixels; not finite or negative if unknown.
    ///
    /// ```text
    ///   (x + Σ ± xᵢ)/(z + Σ ± zᵢ) - u = (Σ ± (xᵢ - u zᵢ))/(z + Σ ± zᵢ),   u = x/z
    /// ```
    pub(super) fn reach_px(&self, h: Vector3<f64>, px: Vector2<f64>) -> Vector2<f64> {
        let (mut reach, mut least_z) = (Vector2::zeros(), h.z);
        for side in &self.sides {
            reach += (Vector2::new(side.x, side.y) - px * side.z).abs();
            least_z -= side.z.abs();
        }
        reach / least_z
    }
}

/// The cube around one joint, along the axes of a box.
pub(super) struct PlacedCube {
    /// The joint, as a homogeneous pixel.
    pub(super) h: Vector3<f64>,
    /// Where the joint is.
    pub(super) middle: Vector2<f64>,
    /// Largest distance of a corner from there, along both axes; not finite or negative if unknown.
    pub(super) reach: Vector2<f64>,
}

impl PlacedCube {
    /// Which of `cubes` are outermost to the left, to the right, at the top and at the bottom.
    pub(super) fn outermost(cubes: &[Option<Self>]) -> [Option<usize>; 4] {
        let (mut outermost, mut farthest) = ([None; 4], [f64::NEG_INFINITY; 4]);
        for (i, cube) in cubes.iter().enumerate() {
            let Some(Self { middle, reach, .. }) = cube else {
                continue;
            };
            let (least, most) = (middle - reach, middle + reach);
            for (side, far) in [-least.x, most.x, -least.y, most.y].into_iter().enumerate() {
                if far > farthest[side] {
                    (outermost[side], farthest[side]) = (Some(i), far);
                }
            }
        }
        outermost
    }
}

/// Smallest and largest coordinates.
pub(super) struct Extent {
    least: Vector2<f64>,
    most: Vector2<f64>,
}

impl Extent {
    pub(super) const EMPTY: Self = Self {
        least: Vector2::new(f64::INFINITY, f64::INFINITY),
        most: Vector2::new(f64::NEG_INFINITY, f64::NEG_INFINITY),
    };

    pub(super) fn add(&mut self, p: Vector2<f64>) {
        self.least = self.least.inf(&p);
        self.most = self.most.sup(&p);
    }

    /// Whether nothing within `reach` of `p`, each way, can extend it.
    pub(super) fn contains(&self, p: Vector2<f64>, reach: Vector2<f64>) -> bool {
        (0..2).all(|i| {
            let reach = reach[i] + ROUNDING_PX;
            reach >= 0.0 && p[i] - reach >= self.least[i] && p[i] + reach <= self.most[i]
        })
    }

    pub(super) fn size(&self) -> Vector2<f64> {
        self.most - self.least
    }

    pub(super) fn center(&self) -> Vector2<f64> {
        (self.most + self.least) * 0.5
    }
}

/// The pixel of a homogeneous pixel whose third number is a depth in metres.
fn in_front(h: Vector3<f64>) -> Option<Vector2<f64>> {
    (h.z >= NEAR_M).then(|| Vector2::new(h.x, h.y) / h.z)
}
