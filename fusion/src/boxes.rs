//! Boxes: predicted joints to the image regions that edges crop, paper, eq. (2) and (4).
//!
//! A box contains every joint with the margin m, and the cube around every joint in which it can be:
//! large for a person who is hardly seen, whose views disagree, or whose box is used later. It is no
//! larger: networks are trained with crops that people fill, and neighbours confuse them. Joints behind a camera have no projection and
//! are omitted; links that cross the near plane are cut there. Points beyond the used part of a
//! fisheye's view are moved to the rim of that part: there is nothing to crop behind it. Nothing
//! here assumes an upright person.

use farfield_proto::bounding_box::{BoundingBox, BoxRate};
use farfield_proto::camera::CameraModel;
use farfield_proto::frames::Pixel;
use farfield_proto::id::CameraIndex;
use farfield_proto::message::CameraBox;
use farfield_proto::venue::parameters::BoxParameters;
use nalgebra::{Matrix3x4, Rotation2, Vector2, Vector3};

use crate::body::skeleton::{Joint, Joints, N_JOINTS};

/// Depth below which a joint has no useful projection, metres: nearer, a hand fills the image.
const NEAR_M: f64 = 0.3;
/// Least joints in front of a camera for a box; fewer do not show where the body is.
const LEAST_JOINTS_IN_FRONT: usize = 10;
/// Smallest side of a box, pixels: a smaller crop has no detail.
const LEAST_SIDE_PX: f64 = 16.0;
/// How far outside the image a projected point counts, in image sizes: a limb next to a near camera
/// projects anywhere, and must not enlarge the box.
const FARTHEST_IMAGES: f64 = 1.0;
/// Share of `end_on_ratio` below which a box that is already turned becomes upright.
const END_ON_HYSTERESIS: f64 = 0.8;
/// Points per side of the raster that tests whether the camera sees any of a box.
const RASTER: usize = 7;

/// Size and rotation limits of boxes.
#[derive(Debug, Clone, PartialEq)]
pub struct BoxShape {
    /// The margin m of eq. (2): the venue's, else that of the network's card.
    pub margin: f64,
    /// Largest distance of a joint from its predicted place, per axis, metres.
    pub reach_m: f64,
    /// Whether and when boxes turn.
    pub parameters: BoxParameters,
}

impl BoxShape {
    /// The shape of boxes `horizon_s` ahead of a person whose joints are known to `doubt_m`: wider
    /// on each side by that and by a t²/2, for an unpredicted acceleration.
    #[must_use]
    pub fn after(&self, horizon_s: f64, doubt_m: f64) -> Self {
        let unforeseen_m = 0.5 * self.parameters.acceleration_m_s2 * horizon_s * horizon_s;
        Self {
            reach_m: self.reach_m + doubt_m + unforeseen_m,
            ..self.clone()
        }
    }
}

/// The boxes of one person in the cameras of the venue. Remembers which boxes were turned.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Boxes {
    /// Per camera, whether the last box was turned.
    turned: Vec<bool>,
}

impl Boxes {
    /// The box in `camera` of a person with joints `now_m` at the box's tick and `next_m` one tick
    /// later (world, metres).
    ///
    /// ```text
    ///   size = max(m (max - min), extent of the projected cubes)         along the box's own axes
    ///   rotation = atan2(vx, -vy), v = neck - pelvis in the image        = -B' of eq. (4)
    /// ```
    ///
    /// The pelvis is the paper's torso n(1), the neck its n(6). The box turns when the rotation
    /// exceeds `rotate_from_deg`. It becomes upright below `rotate_until_deg`, or when the trunk is
    /// seen end-on. The rates are the difference to the box of `next_m`. `None` if the person is
    /// behind the camera, the box is outside the image, or all joints are beyond the used part of a
    /// fisheye. If the neck is behind the camera, `neck_px` is `torso_px`.
    ///
    /// Cost: a projection per joint, twice, and eight more for the few outermost joints.
    pub fn camera_box(
        &mut self,
        camera: CameraIndex,
        model: &CameraModel,
        (now_m, next_m): (&Joints, &Joints),
        shape: &BoxShape,
    ) -> Option<CameraBox> {
        let index = usize::from(camera.0);
        if self.turned.len() <= index {
            self.turned.resize(index + 1, false);
        }
        let p = model.projection_matrix();
        let now_seen = ProjectedJoints::new(&p, now_m);
        let trunk = Trunk::seen_by(model, &now_seen)?;
        let turned = trunk.turns(self.turned[index], &shape.parameters);
        let rotation = |trunk: &Trunk| if turned { trunk.rotation_rad() } else { 0.0 };
        let cube = Cube::new(&p, shape.reach_m);
        let around = |seen: &ProjectedJoints<'_>, trunk: &Trunk| {
            Region::around(model, (seen, &cube), rotation(trunk), shape.margin)
        };
        let now = around(&now_seen, &trunk)?;
        self.turned[index] = turned;
        // Beyond the rim of a fisheye joints are moved to it: a box of only such joints would
        // contain no person.
        let is_in_view = |px: Vector2<f64>| model.is_within_view(Pixel::new(px.x, px.y));
        let is_anything = Joint::ALL
            .iter()
            .any(|joint| now_seen.pixel(*joint).is_some_and(is_in_view));
        if !is_anything || !now.touches_image(model) {
            return None;
        }
        let next_seen = ProjectedJoints::new(&p, next_m);
        let next = Trunk::seen_by(model, &next_seen).and_then(|trunk| around(&next_seen, &trunk));
        Some(CameraBox {
            camera,
            bounding_box: now.bounding_box(),
            rate: next.map_or_else(BoxRate::default, |next| now.rate_to(&next)),
            torso_px: single(trunk.pelvis_px),
            neck_px: single(trunk.neck_px.unwrap_or(trunk.pelvis_px)),
        })
    }
}

/// The trunk in one image: it turns a box.
struct Trunk {
    pelvis_px: Vector2<f64>,
    /// `None` if it is behind the camera.
    neck_px: Option<Vector2<f64>>,
    /// Length in the image over the length of the same trunk seen from the side.
    broadside: f64,
}

impl Trunk {
    fn seen_by(model: &CameraModel, seen: &ProjectedJoints<'_>) -> Option<Self> {
        let pelvis_px = seen.pixel(Joint::Pelvis)?;
        let neck_px = seen.pixel(Joint::Neck);
        let trunk_m = (seen.joint_m(Joint::Neck) - seen.joint_m(Joint::Pelvis)).norm();
        let focal_px = 0.5 * (model.intrinsics().fx_px + model.intrinsics().fy_px);
        let from_the_side_px = trunk_m * focal_px / seen.homogeneous(Joint::Pelvis).z;
        let broadside = neck_px.map_or(0.0, |neck| {
            (neck - pelvis_px).norm() / from_the_side_px.max(1e-9)
        });
        Some(Self {
            pelvis_px,
            neck_px,
            broadside,
        })
    }

    /// Minus B' of eq. (4): 0 for a trunk that points up in the image, positive clockwise.
    fn rotation_rad(&self) -> f64 {
        self.neck_px.map_or(0.0, |neck| {
            let v = neck - self.pelvis_px;
            libm::atan2(v.x, -v.y)
        })
    }

    /// Whether the box turns with the trunk; `did`: whether the last one did.
    fn turns(&self, was_turned: bool, parameters: &BoxParameters) -> bool {
        let (least_deg, least_broadside) = if was_turned {
            (
                parameters.rotate_until_deg,
                parameters.end_on_ratio * END_ON_HYSTERESIS,
            )
        } else {
            (parameters.rotate_from_deg, parameters.end_on_ratio)
        };
        let tilt_deg = self.rotation_rad().abs().to_degrees();
        parameters.rotate && tilt_deg > least_deg && self.broadside >= least_broadside
    }
}

/// A box in f64.
#[derive(Debug, Clone, Copy)]
struct Region {
    center_px: Vector2<f64>,
    size_px: Vector2<f64>,
    rotation_rad: f64,
}

impl Region {
    /// The region of eq. (2), measured along axes turned by `rotation_rad`.
    fn around(
        model: &CameraModel,
        (seen, cube): (&ProjectedJoints<'_>, &Cube),
        rotation_rad: f64,
        margin: f64,
    ) -> Option<Self> {
        let n_in_front = seen.n_in_front();
        if n_in_front < LEAST_JOINTS_IN_FRONT {
            return None;
        }
        let to_box = Rotation2::new(-rotation_rad);
        let far_px = model.size_px().map(f64::from);
        let place = |px: Vector2<f64>| {
            let kept = |v: f64, size: f64| {
                v.clamp(-FARTHEST_IMAGES * size, (1.0 + FARTHEST_IMAGES) * size)
            };
            let px = model.within_view(Pixel::new(px.x, px.y)).vector_px();
            to_box * Vector2::new(kept(px.x, far_px[0]), kept(px.y, far_px[1]))
        };
        // Rotation of the box's sides relative to the image's.
        let turned = to_box.matrix().abs();
        // Filled in place: `map` of an array of options is compiled to calls and copies.
        let mut cubes = [const { None }; N_JOINTS];
        for (placed, joint) in cubes.iter_mut().zip(Joint::ALL) {
            let h = seen.homogeneous(joint);
            *placed = seen.pixel(joint).map(|px| PlacedCube {
                h,
                middle: place(px),
                reach: turned * cube.reach_px(h, px),
            });
        }
        let mut body = Extent::EMPTY;
        for (joint, cube) in Joint::ALL.into_iter().zip(&cubes) {
            if let Some(cube) = cube {
                body.add(cube.middle);
            }
            // If a link crosses the near plane, the body extends to the crossing.
            if n_in_front < N_JOINTS
                && let Some(px) = seen.crossing(joint)
            {
                body.add(place(px));
            }
        }
        let half = body.size() * (0.5 * margin);
        let mut lattice = Extent::EMPTY;
        lattice.add(body.center() - half);
        lattice.add(body.center() + half);
        // The outermost cubes first: most others are then inside. A fisheye's rim moves points, so
        // the result could depend on the order: there it is that of the joints.
        let outermost = if model.lens().is_fisheye() {
            [None; 4]
        } else {
            PlacedCube::outermost(&cubes)
        };
        for i in outermost.into_iter().flatten().chain(0..cubes.len()) {
            if let Some(placed) = cubes[i].take()
                && !lattice.contains(placed.middle, placed.reach)
            {
                for corner in cube.corners(placed.h) {
                    lattice.add(place(corner));
                }
            }
        }
        let size_px = lattice.size().map(|side| side.max(LEAST_SIDE_PX));
        let center_px = to_box.inverse() * lattice.center();
        size_px.iter().all(|v| v.is_finite()).then_some(Self {
            center_px,
            size_px,
            rotation_rad,
        })
    }

    /// Whether the camera sees any point of a raster over the region.
    fn touches_image(&self, model: &CameraModel) -> bool {
        let from_box = Rotation2::new(self.rotation_rad);
        let share = |i: usize| i as f64 / (RASTER - 1) as f64 - 0.5;
        (0..RASTER * RASTER).any(|i| {
            // From the middle outwards: the first point usually decides.
            let i = (i + RASTER * RASTER / 2) % (RASTER * RASTER);
            let local =
                Vector2::new(share(i % RASTER), share(i / RASTER)).component_mul(&self.size_px);
            let px = self.center_px + from_box * local;
            model.sees(Pixel::new(px.x, px.y))
        })
    }

    fn bounding_box(&self) -> BoundingBox {
        BoundingBox {
            center_px: single(self.center_px),
            size_px: single(self.size_px),
            rotation_rad: self.rotation_rad as f32,
        }
    }

    fn rate_to(&self, next: &Self) -> BoxRate {
        let turn = Rotation2::new(next.rotation_rad - self.rotation_rad).angle();
        BoxRate {
            center_px: single(next.center_px - self.center_px),
            size_px: single(next.size_px - self.size_px),
            rotation_rad: turn as f32,
        }
    }
}

/// The wire's precision.
fn single(v: Vector2<f64>) -> [f32; 2] {
    [v.x as f32, v.y as f32]
}

/// Limit of rounding errors of a pixel, pixels; far above them.
const ROUNDING_PX: f64 = 1e-6;

/// The joints of a body as one camera projects them.
struct ProjectedJoints<'a> {
    p: &'a Matrix3x4<f64>,
    joints_m: &'a Joints,
    /// Homogeneous pixels; the third number is the depth in metres.
    h: [Vector3<f64>; N_JOINTS],
}

impl<'a> ProjectedJoints<'a> {
    /// `joints_m` (world, metres) through the projection matrix `p` of a camera.
    fn new(p: &'a Matrix3x4<f64>, joints_m: &'a Joints) -> Self {
        Self {
            p,
            joints_m,
            h: std::array::from_fn(|i| p * joints_m[i].push(1.0)),
        }
    }

    /// A joint in the world, metres.
    fn joint_m(&self, joint: Joint) -> Vector3<f64> {
        self.joints_m[joint.index()]
    }

    /// A joint's homogeneous pixel.
    fn homogeneous(&self, joint: Joint) -> Vector3<f64> {
        self.h[joint.index()]
    }

    /// Where `joint` is in the image, if it is in front of the camera.
    fn pixel(&self, joint: Joint) -> Option<Vector2<f64>> {
        in_front(self.homogeneous(joint))
    }

    /// How many joints are in front of the camera.
    fn n_in_front(&self) -> usize {
        self.h.iter().filter(|h| h.z >= NEAR_M).count()
    }

    /// Where the link from `joint` to its parent crosses the near plane, if it does.
    fn crossing(&self, joint: Joint) -> Option<Vector2<f64>> {
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
struct Cube {
    /// Half of its sides, as homogeneous pixels.
    sides: [Vector3<f64>; 3],
}

impl Cube {
    /// With `half_width_m`, in the image of the camera with the projection matrix `p`.
    fn new(p: &Matrix3x4<f64>, half_width_m: f64) -> Self {
        Self {
            sides: [0, 1, 2].map(|i| p.column(i) * half_width_m),
        }
    }

    /// Its projected corners around a point that projects to the homogeneous pixel `h`, without
    /// corners behind the near plane.
    fn corners(&self, h: Vector3<f64>) -> impl Iterator<Item = Vector2<f64>> {
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
    fn reach_px(&self, h: Vector3<f64>, px: Vector2<f64>) -> Vector2<f64> {
        let (mut reach, mut least_z) = (Vector2::zeros(), h.z);
        for side in &self.sides {
            reach += (Vector2::new(side.x, side.y) - px * side.z).abs();
            least_z -= side.z.abs();
        }
        reach / least_z
    }
}

/// The cube around one joint, along the axes of a box.
struct PlacedCube {
    /// The joint, as a homogeneous pixel.
    h: Vector3<f64>,
    /// Where the joint is.
    middle: Vector2<f64>,
    /// Largest distance of a corner from there, along both axes; not finite or negative if unknown.
    reach: Vector2<f64>,
}

impl PlacedCube {
    /// Which of `cubes` are outermost to the left, to the right, at the top and at the bottom.
    fn outermost(cubes: &[Option<Self>]) -> [Option<usize>; 4] {
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
struct Extent {
    least: Vector2<f64>,
    most: Vector2<f64>,
}

impl Extent {
    const EMPTY: Self = Self {
        least: Vector2::new(f64::INFINITY, f64::INFINITY),
        most: Vector2::new(f64::NEG_INFINITY, f64::NEG_INFINITY),
    };

    fn add(&mut self, p: Vector2<f64>) {
        self.least = self.least.inf(&p);
        self.most = self.most.sup(&p);
    }

    /// Whether nothing within `reach` of `p`, each way, can extend it.
    fn contains(&self, p: Vector2<f64>, reach: Vector2<f64>) -> bool {
        (0..2).all(|i| {
            let reach = reach[i] + ROUNDING_PX;
            reach >= 0.0 && p[i] - reach >= self.least[i] && p[i] + reach <= self.most[i]
        })
    }

    fn size(&self) -> Vector2<f64> {
        self.most - self.least
    }

    fn center(&self) -> Vector2<f64> {
        (self.most + self.least) * 0.5
    }
}

/// The pixel of a homogeneous pixel whose third number is a depth in metres.
fn in_front(h: Vector3<f64>) -> Option<Vector2<f64>> {
    (h.z >= NEAR_M).then(|| Vector2::new(h.x, h.y) / h.z)
}

#[cfg(test)]
#[path = "boxes_tests.rs"]
mod tests;
