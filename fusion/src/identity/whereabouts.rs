//! Where somebody may have got to since it was last seen.
//!
//! ```text
//!   p(x, t) = w p_way + (1 - w) p_about,   w = W exp(-t/T)
//!   p_way   = sum of m_i N(e, (a_i + b_i v t)² I),   e = x0 + t (v0 + v1)/2
//!   p_about = a N(x0, (G² + D t) I) + (1 - a) N(x0, (G + g t)² I),   a = A (1 - exp(-t/T)) exp(-t/U)
//!                                                                            density on the floor, 1/m²
//! ```
//!
//! N of `p_about` has a peak of at least one over the field: nobody is spread wider than that. Where no velocity is known, w is 0.
//!
//! x0 and v0 are place and velocity when it was last seen, v1 the velocity when it is seen again: measured, or v0
//! turned as the body has turned, since people run the way they face, and who runs backwards turns all the same.
//! What is taken is the mean of the two, so that who turned about in the meantime is where it was. The longer ago,
//! the less the way says: most people who leave turn about or stand. Of those a share a stays about the place and is
//! there at random, as who waits, works or keeps to a part of the field; the others may be anywhere that far, and in the
//! end everybody may.
//!
//! The numbers of the way, G and g are fitted on runs through corners and around them (`sim/scenes/lost.toml` and the like,
//! everybody withheld for 0.3 to 1 s). A, D and U are chosen: so that four walkers who stay within two metres keep their
//! ids while nobody looks for five seconds (`lab faults fusion-down`), and that after 40 s a place tells nothing.

use farfield_proto::tick::Tick;
use nalgebra::{Vector2, Vector3};

use crate::body::skeleton::{Joint, Joints};

/// Share of those who are gone for an instant who are on their way, `W`.
const ON_THE_WAY: f64 = 0.9;
/// After how long most of them have done something else, `T`, seconds.
const WAY_LASTS_S: f64 = 1.0;
/// How the way is told when the velocity is measured at both of its ends: share, spread, spread per length.
const MEASURED: [WaySpread; 2] = [way(0.6, 0.15, 0.10), way(0.4, 0.3, 0.3)];
/// And when the second velocity is the first one, turned as the body has turned.
const TURNED: [WaySpread; 2] = [way(0.5, 0.15, 0.12), way(0.5, 0.3, 0.45)];
/// How far from where it was last seen somebody is after no time, `G`, metres.
const ABOUT_M: f64 = 0.5;
/// How much farther per second, `g`, metres per second.
const ABOUT_M_S: f64 = 1.0;
/// Share of those who stay about a place, `A`.
const STAYS: f64 = 0.5;
/// After how long most of these have left it, `U`, seconds.
const STAYS_S: f64 = 8.0;
/// By how much the variance of their place grows, per axis, `D`, m²/s: a step or two to and fro every second.
const STAYS_M2_S: f64 = 0.5;
/// Faster than anybody runs, metres per second: what is more, is a filter that has lost its person.
const FASTEST_M_S: f64 = 10.0;
/// How far off a way may be that is explained, as a share of its length.
const EXPLAINED_WAY: f64 = 0.25;
/// Least length of the axis from right to left, seen from above, that tells where a body faces, metres.
const LEAST_AXIS_M: f64 = 0.2;

/// One part of how far people are from where their way leads.
#[derive(Debug, Clone, Copy)]
struct WaySpread {
    share: f64,
    sigma_m: f64,
    /// Per metre of the way.
    per_way: f64,
}

const fn way(share: f64, sigma_m: f64, per_way: f64) -> WaySpread {
    WaySpread {
        share,
        sigma_m,
        per_way,
    }
}

/// Where somebody is, how fast, and which way it faces, as far as that is known.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Whereabouts {
    /// The pelvis, world, metres.
    pub(crate) place_m: Vector3<f64>,
    /// On the floor, world, metres per second.
    pub(crate) velocity_m_s: Option<Vector2<f64>>,
    /// From the right of the body to its left, on the floor, of length 1; `None` of who lies on its side.
    pub(crate) to_left: Option<Vector2<f64>>,
}

/// Where a person was surely itself: seen by two viewpoints, with nobody else in its place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct LastSeen {
    pub(crate) tick: Tick,
    pub(crate) whereabouts: Whereabouts,
}

impl Whereabouts {
    /// Of who is there, and nothing else is known.
    pub(crate) fn at(place_m: Vector3<f64>) -> Self {
        Self {
            place_m,
            velocity_m_s: None,
            to_left: None,
        }
    }

    /// With which of its sides where, as `joint_m` (world, metres) tells of hips and shoulders.
    pub(crate) fn facing(self, joint_m: impl Fn(Joint) -> Option<Vector3<f64>>) -> Self {
        let pairs = [
            (Joint::LeftHip, Joint::RightHip),
            (Joint::LeftShoulder, Joint::RightShoulder),
        ];
        let axes = pairs.map(|(left, right)| Some((joint_m(left)? - joint_m(right)?).xy()));
        let axis = axes.into_iter().flatten().sum::<Vector2<f64>>();
        Self {
            to_left: axis.try_normalize(LEAST_AXIS_M),
            ..self
        }
    }

    /// As [`Self::facing`], of a whole body.
    pub(crate) fn facing_as(self, joints_m: &Joints) -> Self {
        self.facing(|joint| Some(joints_m[joint.index()]))
    }

    /// Moving at `velocity_m_s` (world), but no faster than people run.
    pub(crate) fn moving(self, velocity_m_s: &Vector3<f64>) -> Self {
        Self {
            velocity_m_s: Some(velocity_m_s.xy().cap_magnitude(FASTEST_M_S)),
            ..self
        }
    }

    /// ln of the density (1/m²) at which somebody is `now` who was here `absence_s` ago; people who are nowhere in
    /// particular have the density 1/`field_m2`, and nobody is spread wider.
    pub(crate) fn ln_density(&self, now: &Self, absence_s: f64, field_m2: f64) -> f64 {
        let t = absence_s.max(0.0);
        let off_m = (now.place_m - self.place_m).xy();
        let about = |sigma_m| normal(off_m, sigma_m, 1.0 / field_m2);
        let under_way = libm::exp(-t / WAY_LASTS_S);
        let stays = STAYS * (1.0 - under_way) * libm::exp(-t / STAYS_S);
        let stays_m = (ABOUT_M * ABOUT_M + STAYS_M2_S * t).sqrt();
        let about = stays * about(stays_m) + (1.0 - stays) * about(ABOUT_M + ABOUT_M_S * t);
        let Some(v0) = self.velocity_m_s else {
            return libm::log(about);
        };
        let (v1, spreads) = match (now.velocity_m_s, self.turned_into(now)) {
            (Some(measured), _) => (measured, MEASURED),
            (None, turned) => (turned.unwrap_or(v0), TURNED),
        };
        let off_way_m = off_m - 0.5 * t * (v0 + v1);
        let way_m = t * v0.norm().max(v1.norm());
        let on_way = spreads.map(|spread| {
            let sigma_m = spread.sigma_m + spread.per_way * way_m;
            spread.share * normal(off_way_m, sigma_m, 0.0)
        });
        let share = ON_THE_WAY * under_way;
        libm::log(share * on_way.iter().sum::<f64>() + (1.0 - share) * about)
    }

    /// How fast who was here `absence_s` ago is `now`, on the floor, metres per second: as the body has turned where
    /// that explains the way, else what the way took on average.
    pub(crate) fn velocity_at(&self, now: &Self, absence_s: f64) -> Vector2<f64> {
        let way_m = (now.place_m - self.place_m).xy();
        let mean_m_s = way_m / absence_s;
        let explains = |v1: &Vector2<f64>| {
            let v0 = self.velocity_m_s.unwrap_or(*v1);
            let off_m = way_m - 0.5 * absence_s * (v0 + v1);
            off_m.norm() < EXPLAINED_WAY * absence_s * v0.norm()
        };
        self.turned_into(now).filter(explains).unwrap_or(mean_m_s)
    }

    /// The velocity, turned as the body turned until it was seen `now`.
    fn turned_into(&self, now: &Self) -> Option<Vector2<f64>> {
        let (v, from, to) = (self.velocity_m_s?, self.to_left?, now.to_left?);
        let (cos, sin) = (from.dot(&to), from.perp(&to));
        Some(Vector2::new(cos * v.x - sin * v.y, sin * v.x + cos * v.y))
    }
}

/// Density of a normal distribution on the floor, 1/m², whose peak is at least `least`.
fn normal(off_m: Vector2<f64>, sigma_m: f64, least: f64) -> f64 {
    let s2 = sigma_m * sigma_m;
    let peak = (1.0 / (std::f64::consts::TAU * s2)).max(least);
    // Far off, all that counts is that it is hardly possible, and not nothing.
    peak * libm::exp(-0.5 * off_m.norm_squared() / s2).max(f64::MIN_POSITIVE)
}

#[cfg(test)]
mod tests {
    use super::*;

    const FIELD_M2: f64 = 384.0;

    /// Somebody at x, y who runs along x at 4 m/s.
    fn runner() -> Whereabouts {
        Whereabouts {
            velocity_m_s: Some(Vector2::new(4.0, 0.0)),
            to_left: Some(Vector2::new(0.0, 1.0)),
            ..at(0.0, 0.0)
        }
    }

    fn at(x_m: f64, y_m: f64) -> Whereabouts {
        Whereabouts::at(Vector3::new(x_m, y_m, 0.95))
    }

    fn facing(heading: [f64; 2], at: Whereabouts) -> Whereabouts {
        Whereabouts {
            to_left: Some(Vector2::new(-heading[1], heading[0])),
            ..at
        }
    }

    fn ln(now: Whereabouts, absence_s: f64) -> f64 {
        runner().ln_density(&now, absence_s, FIELD_M2)
    }

    #[test]
    fn who_runs_on_is_farther_along_and_who_turned_about_is_where_it_was() {
        let (on, about) = (at(2.8, 0.0), at(0.0, 0.0));
        let [ahead, back] = [[1.0, 0.0], [-1.0, 0.0]];
        assert!(ln(facing(ahead, on), 0.7) > ln(facing(ahead, about), 0.7) + 0.5);
        assert!(ln(facing(back, about), 0.7) > ln(facing(back, on), 0.7) + 1.0);
        let corner = facing([0.0, 1.0], at(1.4, 1.4));
        let straight = facing([1.0, 0.0], at(1.4, 1.4));
        assert!(ln(corner, 0.7) > ln(straight, 0.7) + 0.5);
    }

    #[test]
    fn who_runs_backwards_turns_all_the_same() {
        let backwards = Whereabouts {
            to_left: Some(Vector2::new(0.0, -1.0)),
            ..runner()
        };
        let on = facing([-1.0, 0.0], at(2.8, 0.0));
        let far = facing([-1.0, 0.0], at(-2.8, 0.0));
        let ln = |now: &Whereabouts| backwards.ln_density(now, 0.7, FIELD_M2);
        assert!(ln(&on) > ln(&far) + 3.0);
    }

    #[test]
    fn a_velocity_that_is_measured_tells_more_than_where_somebody_faces() {
        let now = facing([1.0, 0.0], at(2.1, 0.7));
        let measured = now.moving(&Vector3::new(2.0, 2.0, 0.0));
        assert!(ln(measured, 0.7) > ln(now, 0.7));
    }

    #[test]
    fn long_ago_only_the_place_counts_and_says_little() {
        let after = |t| ln(facing([1.0, 0.0], at(1.0, 0.0)), t);
        assert!(after(1.0) > after(5.0) && after(5.0) > after(20.0));
        let nowhere = -libm::log(FIELD_M2);
        assert!((after(60.0) - nowhere).abs() < 0.1);
        assert!(ln(at(1e6, 0.0), 0.1).is_finite());
    }

    #[test]
    fn two_who_kept_to_their_corners_did_not_change_places() {
        // As after a fusion that nothing starts again for four seconds.
        let walked = |from: [f64; 2], to: [f64; 2]| {
            let before = at(from[0], from[1]).moving(&Vector3::new(0.9, 0.7, 0.0));
            before.ln_density(&at(to[0], to[1]), 5.0, 120.0)
        };
        let corners = [([-2.4, -2.6], [-3.8, -3.0]), ([3.5, -1.6], [4.0, -2.7])];
        let [(a, a_later), (b, b_later)] = corners;
        let stayed = walked(a, a_later) + walked(b, b_later);
        let changed = walked(a, b_later) + walked(b, a_later);
        assert!(stayed > changed + 3.0, "{stayed} {changed}");
    }

    #[test]
    fn who_comes_round_a_corner_runs_as_it_faces_and_who_stopped_does_not() {
        let round = facing([0.0, 1.0], at(1.4, 1.4));
        let velocity_m_s = runner().velocity_at(&round, 0.7);
        assert!((velocity_m_s - Vector2::new(0.0, 4.0)).norm() < 1e-9);
        let stopped = facing([0.0, 1.0], at(0.35, 0.0));
        let velocity_m_s = runner().velocity_at(&stopped, 0.7);
        assert!((velocity_m_s - Vector2::new(0.5, 0.0)).norm() < 1e-9);
    }

    #[test]
    fn who_lies_on_its_side_faces_nowhere() {
        let lying = |joint: Joint| {
            let height_m = if joint.name().starts_with("left") {
                0.6
            } else {
                0.2
            };
            Some(Vector3::new(0.0, 0.0, height_m))
        };
        assert_eq!(at(0.0, 0.0).facing(lying).to_left, None);
    }
}
