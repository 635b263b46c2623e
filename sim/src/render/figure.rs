//! The figures in a picture.

use nalgebra::Vector3;

use super::look::{Spot, color_at};
use super::place::{Light, times};
use crate::body::{BodyPart, Build, Color, Cone, Volume};
use crate::scene::Poster;

/// A figure in the picture, at each moment of the shutter.
#[derive(Debug, Clone)]
pub enum Figure<'a> {
    /// A person.
    Person {
        /// Shape and clothes.
        build: &'a Build,
        /// The body at each moment, all made with `build`.
        moments: Vec<Volume>,
    },
    /// A poster of a person.
    Print(&'a Print),
    /// An object of one colour, for example the ball.
    Thing {
        /// Reflectance.
        color: Color,
        /// Its solids at each moment, equally many.
        moments: Vec<Vec<Cone>>,
    },
}

/// A poster of a person. Its light is that of the photograph; shadows are those that fall on it.
#[derive(Debug, Clone)]
pub struct Print {
    poster: Poster,
    build: Build,
    body: Volume,
    flat: Volume,
}

impl Print {
    /// The print of `poster`.
    pub fn new(poster: &Poster) -> Self {
        let build = Build::from_seed(poster.stature_m, poster.build_seed);
        Self {
            body: poster.volume_before(&build),
            flat: poster.volume(&build),
            poster: poster.clone(),
            build,
        }
    }

    /// Whether the printed side is visible from a point (world, metres).
    pub fn faces(&self, eye_m: &Vector3<f64>) -> bool {
        self.poster.is_before(eye_m)
    }
}

impl Figure<'_> {
    pub(super) fn cones(&self, moment: usize) -> &[Cone] {
        match self {
            Figure::Person { moments, .. } => &moments[moment % moments.len()].cones,
            Figure::Print(print) => &print.flat.cones,
            Figure::Thing { moments, .. } => &moments[moment % moments.len()],
        }
    }

    pub(super) fn n_moments(&self) -> usize {
        match self {
            Figure::Person { moments, .. } => moments.len(),
            Figure::Print(_) => 1,
            Figure::Thing { moments, .. } => moments.len(),
        }
    }

    /// Whether a cone has details finer than one ray per pixel shows.
    pub(super) fn has_detail(&self, cone: usize) -> bool {
        match self {
            Figure::Person { moments, .. } => moments[0].cones[cone].part == BodyPart::Head,
            Figure::Print(print) => print.flat.cones[cone].part == BodyPart::Head,
            Figure::Thing { .. } => false,
        }
    }

    /// Light from a point of a cone (world, metres). `sunlit` is the share of the sun that reaches
    /// a point facing it.
    pub(super) fn shaded(
        &self,
        moment: usize,
        cone: usize,
        point_m: Vector3<f64>,
        light: &Light,
        sunlit: impl Fn(&Vector3<f32>) -> f32,
    ) -> [f32; 3] {
        let (cone, body_m) = match self {
            Figure::Print(print) => (&print.body.cones[cone], print.poster.before_print(&point_m)),
            Figure::Person { .. } | Figure::Thing { .. } => (&self.cones(moment)[cone], point_m),
        };
        let local = cone.to_local * (body_m - cone.origin_m);
        let normal = cone.to_local.tr_mul(&normal_at(cone, &local)).normalize();
        let spot = Spot {
            cone,
            point_m: body_m,
            normal,
            along: (local.z / cone.length.max(1e-6)).clamp(0.0, 1.0),
        };
        let (color, outward) = match self {
            Figure::Person { build, moments } => {
                let volume = &moments[moment % moments.len()];
                let out = (point_m - volume.bound_m.0).normalize();
                (color_at(&spot, volume, build), normal.dot(&out) as f32)
            }
            Figure::Print(print) => {
                let out = (body_m - print.body.bound_m.0).normalize();
                let color = color_at(&spot, &print.body, &print.build);
                (color, normal.dot(&out) as f32)
            }
            Figure::Thing { color, .. } => (*color, 1.0),
        };
        let (p, n) = (point_m.cast::<f32>(), normal.cast::<f32>());
        let faces_sun = n.dot(&light.to_sun) > 0.0;
        let sunlit = if faces_sun { sunlit(&p) } else { 0.0 };
        // Surfaces that face the rest of the body, or the nearby floor, receive less sky light.
        let near_floor = 0.6 + 0.4 * (p.z / 0.25).clamp(0.0, 1.0);
        let open = (0.72 + 0.28 * outward) * if n.z < 0.0 { near_floor } else { 1.0 };
        times(color, light.on(&n, sunlit, open))
    }
}

/// The normal in local coordinates, of any length.
fn normal_at(cone: &Cone, p: &Vector3<f64>) -> Vector3<f64> {
    if cone.length > 0.0 {
        let s = (cone.radii[0] - cone.radii[1]) / cone.length;
        let c2 = 1.0 - s * s;
        let y = p.z - cone.radii[0] * s;
        if y > 0.0 && y < cone.length * c2 {
            return Vector3::new(c2 * p.x, c2 * p.y, cone.radii[0] * s - s * s * p.z);
        }
        if y >= cone.length * c2 {
            return Vector3::new(p.x, p.y, p.z - cone.length);
        }
    }
    *p
}
