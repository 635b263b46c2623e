//! The solid that bodies are made of: the volume swept by a ball that moves along a line, changes
//! its radius, and is flattened along an axis.

use nalgebra::{Matrix3, Vector3};

use super::parts::across;

/// The part of the body that a cone belongs to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[expect(missing_docs, reason = "the names are the documentation")]
pub enum BodyPart {
    Pelvis,
    Abdomen,
    Chest,
    /// From the base of the neck to a shoulder.
    Girdle,
    Neck,
    /// The skull, its jaw and its nose.
    Head,
    /// Hair that stands off the skull.
    Hair,
    LeftUpperArm,
    RightUpperArm,
    LeftForearm,
    RightForearm,
    LeftHand,
    RightHand,
    LeftThigh,
    RightThigh,
    LeftShank,
    RightShank,
    LeftFoot,
    RightFoot,
    /// No part of a body, for example a ball or a post.
    Thing,
}

/// The volume swept by a ball that moves from one end to the other while its radius changes
/// linearly, flattened along its own axes.
///
/// In local coordinates it is round, with the first end at the origin and the other at (0, 0,
/// [`Self::length`]).
#[derive(Debug, Clone, PartialEq)]
pub struct Cone {
    /// The part of the body.
    pub part: BodyPart,
    /// Positions of the two ends on the scale of sleeves and trousers, see
    /// [`Build::sleeves`](super::Build::sleeves).
    pub along: [f64; 2],
    /// World to local: local = `to_local` x (world - `origin_m`).
    pub to_local: Matrix3<f64>,
    /// The first end, world, metres.
    pub origin_m: Vector3<f64>,
    /// Distance of the ends, local units (metres without flattening).
    pub length: f64,
    /// Radii at the ends, local units.
    pub radii: [f64; 2],
    /// The other end, world, metres.
    pub tip_m: Vector3<f64>,
    /// Radii of balls around the ends that contain the solid between them, metres.
    pub reach_m: [f64; 2],
}

impl Cone {
    /// A round cone between two ends, world metres.
    pub fn round(part: BodyPart, ends_m: [Vector3<f64>; 2], radii_m: [f64; 2]) -> Self {
        Self::squashed(part, ends_m, radii_m, Vector3::x(), 1.0)
    }

    /// A cone between two ends whose thickness along `flat` (world, made perpendicular to the axis)
    /// is `share` (0 to 1) of `radii_m`.
    pub fn squashed(
        part: BodyPart,
        ends_m: [Vector3<f64>; 2],
        radii_m: [f64; 2],
        flat: Vector3<f64>,
        share: f64,
    ) -> Self {
        let axis = ends_m[1] - ends_m[0];
        let length = axis.norm();
        let z = axis.try_normalize(1e-6).unwrap_or_else(Vector3::z);
        let x = across(flat, &z);
        let y = z.cross(&x);
        Self {
            part,
            along: [0.0, 0.0],
            to_local: Matrix3::from_rows(&[(x / share).transpose(), y.transpose(), z.transpose()]),
            origin_m: ends_m[0],
            length,
            radii: radii_m,
            tip_m: ends_m[1],
            reach_m: radii_m,
        }
    }

    /// An ellipsoid: centre in world metres, unit axes as columns, half-lengths along them.
    pub fn ellipsoid(
        part: BodyPart,
        center_m: Vector3<f64>,
        axes: &Matrix3<f64>,
        halves_m: [f64; 3],
    ) -> Self {
        let reach = halves_m.iter().fold(0.0_f64, |a, &b| a.max(b));
        let shrink = Vector3::from(halves_m.map(|h| reach / h));
        Self {
            part,
            along: [0.0, 0.0],
            to_local: Matrix3::from_diagonal(&shrink) * axes.transpose(),
            origin_m: center_m,
            length: 0.0,
            radii: [reach, reach],
            tip_m: center_m,
            reach_m: [reach, reach],
        }
    }

    /// The same with its ends at `along` on the scale of sleeves and trousers.
    #[must_use]
    pub fn with_along(mut self, along: [f64; 2]) -> Self {
        self.along = along;
        self
    }

    /// A ball that contains the solid: centre and radius, world metres.
    pub fn bound_m(&self) -> (Vector3<f64>, f64) {
        let half = (self.tip_m - self.origin_m) / 2.0;
        let reach = self.reach_m[0].max(self.reach_m[1]);
        (self.origin_m + half, half.norm() + reach)
    }

    /// The smaller t at which the line `from + t * direction` (world metres) enters the solid. It
    /// is negative if the solid is behind `from`.
    pub fn entry(&self, from: &Vector3<f64>, direction: &Vector3<f64>) -> Option<f64> {
        let o = self.to_local * (from - self.origin_m);
        let d = self.to_local * direction;
        let [ra, rb] = self.radii;
        let dd = d.norm_squared();
        if self.length > 0.0 {
            // The tangent cone contains both balls: a line that misses it also misses them.
            let s = (ra - rb) / self.length;
            let c2 = 1.0 - s * s;
            let k2 = c2 * dd - d.z * d.z;
            let k1 = c2 * d.dot(&o) - o.z * d.z + d.z * s * ra;
            let k0 = c2 * o.norm_squared() - o.z * o.z + 2.0 * o.z * s * ra - ra * ra;
            let h = k1 * k1 - k0 * k2;
            if h < 0.0 {
                return None;
            }
            let t = (-h.sqrt() - k1) / k2;
            let y = o.z - ra * s + t * d.z;
            if y > 0.0 && y < self.length * c2 {
                return Some(t);
            }
        }
        let tip = Vector3::new(o.x, o.y, o.z - self.length);
        match (ball(&o, &d, dd, ra), ball(&tip, &d, dd, rb)) {
            (Some(a), Some(b)) => Some(a.min(b)),
            (a, b) => a.or(b),
        }
    }
}

/// Where a line enters a ball around the origin.
fn ball(from: &Vector3<f64>, direction: &Vector3<f64>, dd: f64, radius: f64) -> Option<f64> {
    let b = direction.dot(from);
    let h = b * b - dd * (from.norm_squared() - radius * radius);
    (h >= 0.0).then(|| (-b - h.sqrt()) / dd)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Whether a point is inside a round cone, by sampling its balls.
    fn inside(cone: &Cone, point: &Vector3<f64>) -> bool {
        let p = cone.to_local * (point - cone.origin_m);
        (0..=400).any(|n| {
            let s = f64::from(n) / 400.0;
            let center = Vector3::new(0.0, 0.0, s * cone.length);
            let radius = cone.radii[0] + s * (cone.radii[1] - cone.radii[0]);
            (p - center).norm() <= radius
        })
    }

    #[test]
    fn a_line_enters_at_the_surface_of_the_swept_balls() {
        let cone = Cone::squashed(
            BodyPart::Thing,
            [Vector3::new(0.1, 0.2, 0.3), Vector3::new(0.5, -0.1, 0.9)],
            [0.2, 0.1],
            Vector3::new(1.0, 2.0, 0.0),
            0.6,
        );
        let mut hits = 0;
        for n in 0..400 {
            let a = f64::from(n) * 0.37;
            let from = Vector3::new(3.0 * a.cos(), 3.0 * a.sin(), 0.5 + 0.8 * (a * 1.7).sin());
            let to = Vector3::new(
                0.3 + 0.3 * (a * 2.3).sin(),
                0.05,
                0.6 + 0.4 * (a * 3.1).cos(),
            );
            let direction = to - from;
            let marched = (0..2000)
                .map(|n| f64::from(n) / 1000.0)
                .find(|&t| inside(&cone, &(from + direction * t)));
            match (cone.entry(&from, &direction), marched) {
                (Some(t), Some(m)) => {
                    hits += 1;
                    assert!((t - m).abs() < 2e-3, "{t} {m}");
                }
                (None, None) => {}
                // A grazing hit between two steps of the march.
                (Some(t), None) => assert!(!inside(&cone, &(from + direction * (t + 0.01)))),
                (None, Some(m)) => panic!("missed at {m}"),
            }
        }
        assert!(hits > 100);
    }

    #[test]
    fn an_ellipsoid_has_the_given_half_lengths() {
        let egg = Cone::ellipsoid(
            BodyPart::Head,
            Vector3::new(0.0, 0.0, 1.0),
            &Matrix3::identity(),
            [0.3, 0.2, 0.1],
        );
        for (axis, half) in [
            (Vector3::x(), 0.3),
            (Vector3::y(), 0.2),
            (Vector3::z(), 0.1),
        ] {
            let from = Vector3::new(0.0, 0.0, 1.0) - axis * 2.0;
            let t = egg.entry(&from, &axis).unwrap();
            assert!((t - (2.0 - half)).abs() < 1e-12);
        }
    }
}
