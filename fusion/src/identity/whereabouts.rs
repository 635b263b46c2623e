//! Where a person may be some time after it was last seen.
//!
//! ```text
//!   p(x, t) = w p_path + (1 - w) p_about,   w = W exp(-t/T)
//!   p_path   = sum of m_i N(e, (a_i + b_i v t)² I),   e = x0 + t (v0 + v1)/2
//!   p_about = a N(x0, (G² + D t) I) + (1 - a) N(x0, (G + g t)² I),   a = A (1 - exp(-t/T)) exp(-t/U)
//!                                                                            density on the floor, 1/m²
//! ```
//!
//! N of `p_about` has a peak of at least one over the field: no one is spread wider than that. If
//! no velocity is known, w is 0.
//!
//! x0 and v0 are place and velocity when it was last seen, v1 the velocity when it is seen again.
//! v1 is measured, or it is v0 turned as the body has turned: people run the way they face, and a
//! backwards runner turns all the same. The mean of the two is used, so that a person who turned
//! around is where it was. The longer ago, the less the path predicts: most people who leave turn
//! around or stand. Of those, a share a stays about the place and moves at random there (waits,
//! works, keeps to a part of the field). The others may be anywhere within that distance, and in
//! the end all may.
//!
//! The numbers of the path, G and g are fitted on runs through and around corners
//! (`sim/scenes/lost.toml` and similar, all people withheld for 0.3 to 1 s). A, D and U are chosen.
//! Four walkers who stay within two metres must keep their ids while no camera sees them for five
//! seconds (`lab faults fusion-down`). After 40 s a place must predict nothing.

use farfield_proto::tick::Tick;
use nalgebra::{Vector2, Vector3};

use crate::body::skeleton::{Joint, Joints};

/// Initial share of people who continue on their path, `W`.
const ON_PATH: f64 = 0.9;
/// Time constant after which most of them do something else, `T`, seconds.
const PATH_LASTS_S: f64 = 1.0;
/// Spread about the path if the velocity is measured at both ends: share, spread, spread per
/// length.
const MEASURED: [PathSpread; 2] = [spread(0.6, 0.15, 0.10), spread(0.4, 0.3, 0.3)];
/// The same if the second velocity is the first one, turned as the body has turned.
const TURNED: [PathSpread; 2] = [spread(0.5, 0.15, 0.12), spread(0.5, 0.3, 0.45)];
/// Distance from the last place after no time, `G`, metres.
const ABOUT_M: f64 = 0.5;
/// Growth of that distance, `g`, metres per second.
const ABOUT_M_S: f64 = 1.0;
/// Share of people who stay about a place, `A`.
const STAYS: f64 = 0.5;
/// Time constant after which most of these have left it, `U`, seconds.
const STAYS_S: f64 = 8.0;
/// Growth of the variance of their place, per axis, `D`, m²/s: a step or two to and fro every
/// second.
const STAYS_M2_S: f64 = 0.5;
/// Upper limit of human speed, metres per second: a faster filter has lost its person.
const FASTEST_M_S: f64 = 10.0;
/// Greatest deviation from a path that is explained, as a share of its length.
const EXPLAINED_PATH: f64 = 0.25;
/// Least length of the right-to-left axis, seen from above, that gives a heading, metres.
const LEAST_AXIS_M: f64 = 0.2;

/// One part of the distribution of people about the end of their path.
#[derive(Debug, Clone, Copy)]
struct PathSpread {
    share: f64,
    sigma_m: f64,
    /// Per metre of the path.
    per_path: f64,
}

const fn spread(share: f64, sigma_m: f64, per_path: f64) -> PathSpread {
    PathSpread {
        share,
        sigma_m,
        per_path,
    }
}

/// Place, velocity and heading of a person, as far as known.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Whereabouts {
    /// The pelvis, world, metres.
    pub(crate) place_m: Vector3<f64>,
    /// On the floor, world, metres per second.
    pub(crate) velocity_m_s: Option<Vector2<f64>>,
    /// From the right of the body to its left, on the floor, of length 1; `None` if it lies on its
    /// side.
    pub(crate) to_left: Option<Vector2<f64>>,
}

/// Where a person was surely itself: seen by two viewpoints, with no other person in its place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct LastSeen {
    pub(crate) tick: Tick,
    pub(crate) whereabouts: Whereabouts,
}

impl Whereabouts {
    /// A place alone.
    pub(crate) fn at(place_m: Vector3<f64>) -> Self {
        Self {
            place_m,
            velocity_m_s: None,
            to_left: None,
        }
    }

    /// Adds the heading from hips and shoulders, `joint_m` (world, metres).
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

    /// As [`Self::facing`], from a whole body.
    pub(crate) fn facing_as(self, joints_m: &Joints) -> Self {
        self.facing(|joint| Some(joints_m[joint.index()]))
    }

    /// Adds the velocity `velocity_m_s` (world), limited to human speed.
    pub(crate) fn moving(self, velocity_m_s: &Vector3<f64>) -> Self {
        Self {
            velocity_m_s: Some(velocity_m_s.xy().cap_magnitude(FASTEST_M_S)),
            ..self
        }
    }

    /// ln of the density (1/m²) at which a person that was here `absence_s` ago is `now`. A
    /// uniformly placed person has the density 1/`field_m2`, and no density is spread wider.
    pub(crate) fn ln_density(&self, now: &Self, absence_s: f64, field_m2: f64) -> f64 {
        let t = absence_s.max(0.0);
        let off_m = (now.place_m - self.place_m).xy();
        let about = |sigma_m| normal(off_m, sigma_m, 1.0 / field_m2);
        let on_course = libm::exp(-t / PATH_LASTS_S);
        let stays = STAYS * (1.0 - on_course) * libm::exp(-t / STAYS_S);
        let stays_m = (ABOUT_M * ABOUT_M + STAYS_M2_S * t).sqrt();
        let about = stays * about(stays_m) + (1.0 - stays) * about(ABOUT_M + ABOUT_M_S * t);
        let Some(v0) = self.velocity_m_s else {
            return libm::log(about);
        };
        let (v1, spreads) = match (now.velocity_m_s, self.turned_into(now)) {
            (Some(measured), _) => (measured, MEASURED),
            (None, turned) => (turned.unwrap_or(v0), TURNED),
        };
        let off_path_m = off_m - 0.5 * t * (v0 + v1);
        let path_m = t * v0.norm().max(v1.norm());
        let on_path = spreads.map(|spread| {
            let sigma_m = spread.sigma_m + spread.per_path * path_m;
            spread.share * normal(off_path_m, sigma_m, 0.0)
        });
        let share = ON_PATH * on_course;
        libm::log(share * on_path.iter().sum::<f64>() + (1.0 - share) * about)
    }

    /// Current velocity of a person that was here `absence_s` ago and is `now`, on the floor,
    /// metres per second: the turned velocity if it explains the path, else the mean over the path.
    pub(crate) fn velocity_at(&self, now: &Self, absence_s: f64) -> Vector2<f64> {
        let path_m = (now.place_m - self.place_m).xy();
        let mean_m_s = path_m / absence_s;
        let explains = |v1: &Vector2<f64>| {
            let v0 = self.velocity_m_s.unwrap_or(*v1);
            let off_m = path_m - 0.5 * absence_s * (v0 + v1);
            off_m.norm() < EXPLAINED_PATH * absence_s * v0.norm()
        };
        self.turned_into(now).filter(explains).unwrap_or(mean_m_s)
    }

    /// The velocity, turned as the body turned until `now`.
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
    // Far away the result only has to be very small, and not zero.
    peak * libm::exp(-0.5 * off_m.norm_squared() / s2).max(f64::MIN_POSITIVE)
}

#[cfg(test)]
mod tests {
    use super::*;

    const FIELD_M2: f64 = 384.0;

    /// A person at x, y who runs along x at 4 m/s.
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
    fn a_runner_is_farther_along_or_has_turned_around() {
        let (on, about) = (at(2.8, 0.0), at(0.0, 0.0));
        let [ahead, back] = [[1.0, 0.0], [-1.0, 0.0]];
        assert!(ln(facing(ahead, on), 0.7) > ln(facing(ahead, about), 0.7) + 0.5);
        assert!(ln(facing(back, about), 0.7) > ln(facing(back, on), 0.7) + 1.0);
        let corner = facing([0.0, 1.0], at(1.4, 1.4));
        let straight = facing([1.0, 0.0], at(1.4, 1.4));
        assert!(ln(corner, 0.7) > ln(straight, 0.7) + 0.5);
    }

    #[test]
    fn a_backwards_runner_turns_with_its_body() {
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
    fn a_measured_velocity_beats_the_heading() {
        let now = facing([1.0, 0.0], at(2.1, 0.7));
        let measured = now.moving(&Vector3::new(2.0, 2.0, 0.0));
        assert!(ln(measured, 0.7) > ln(now, 0.7));
    }

    #[test]
    fn after_a_long_time_only_the_place_has_a_small_weight() {
        let after = |t| ln(facing([1.0, 0.0], at(1.0, 0.0)), t);
        assert!(after(1.0) > after(5.0) && after(5.0) > after(20.0));
        let nowhere = -libm::log(FIELD_M2);
        assert!((after(60.0) - nowhere).abs() < 0.1);
        assert!(ln(at(1e6, 0.0), 0.1).is_finite());
    }

    #[test]
    fn two_people_in_their_corners_are_not_swapped() {
        // As if fusion was not restarted for four seconds.
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
    fn velocity_follows_the_heading_if_it_explains_the_path() {
        let round = facing([0.0, 1.0], at(1.4, 1.4));
        let velocity_m_s = runner().velocity_at(&round, 0.7);
        assert!((velocity_m_s - Vector2::new(0.0, 4.0)).norm() < 1e-9);
        let stopped = facing([0.0, 1.0], at(0.35, 0.0));
        let velocity_m_s = runner().velocity_at(&stopped, 0.7);
        assert!((velocity_m_s - Vector2::new(0.5, 0.0)).norm() < 1e-9);
    }

    #[test]
    fn a_body_lying_on_its_side_has_no_heading() {
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
