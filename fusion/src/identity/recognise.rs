//! Whether a new person was here before: by place, speed and link lengths.
//!
//! Every pair of a newcomer and a person who left or was lost gets the logarithm of a likelihood
//! ratio, "the same" over "another person":
//!
//! ```text
//!   L = ln p(d | same) - ln p(d | other) + ln p(r | same) - ln p(r | other)
//!
//!   d_i = ln(newcomer's length i / known length i):   same  N(0, S),   S = diag s_i^2
//!                                                    other N(0, S + diag p^2 + c^2 1 1')
//!   r = the place on the floor:                      same  as `super::whereabouts` says
//!                                                    other uniform in the field
//! ```
//!
//! `s_i` is the measurement error of the two lengths. `p` and `c` are the spread among people of
//! single lengths and of stature. A pair that is farther apart than people run is excluded. All
//! pairs are decided together: the assignment with the greatest sum of L wins. Of it, only pairs
//! count without which the sum would be clearly less. An ambiguous person stays new: the id of a
//! stranger is worse than a new one.

use farfield_proto::message::identity_event::Likeness;
use farfield_proto::venue::Field;
use farfield_proto::venue::parameters::BirthParameters;

use super::whereabouts::Whereabouts;
use crate::assign::assign;
use crate::body::prior::{BodyPrior, measured_sigma_m};
use crate::body::skeleton::{Proportions, Skeleton};

/// Lengths that are compared.
const N_LENGTHS: usize = 7;
/// Spread of single lengths among people of one stature, `p`: two people, each with 4 %.
const SINGLE_SPREAD: f64 = 0.057;
/// Spread of stature among people, `c`: two people, each with 5.5 %.
const STATURE_SPREAD: f64 = 0.078;
/// Lower limit of the place term: some people run.
const LEAST_PLACE: f64 = -3.0;
/// Tolerance of a distance in addition to the distance that people can run, metres.
const REACH_M: f64 = 1.0;
/// Least gain of the whole assignment by a pair, for the pair to count: a factor of 7. A person who
/// waits is better known a little later, and a new id is better than a wrong one.
const MARGIN: f64 = 2.0;
/// Gain of an impossible pair; far below any sum of L.
const IMPOSSIBLE: f64 = -1e6;

/// Measured lengths of a body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Lengths {
    lengths_m: [f64; N_LENGTHS],
    sigma_m: [f64; N_LENGTHS],
}

impl Lengths {
    /// From `skeleton`, which was measured for `seconds`.
    pub(crate) fn from_skeleton(skeleton: &Skeleton, seconds: f64) -> Self {
        Self {
            lengths_m: compared(skeleton.proportions(), |a, b| a + b),
            sigma_m: [measured_sigma_m(seconds); N_LENGTHS],
        }
    }

    /// From a body that is known in advance.
    pub(crate) fn from_prior(body: &BodyPrior) -> Self {
        Self {
            lengths_m: compared(body.body(), |a, b| a + b),
            sigma_m: compared(body.sigma(), libm::hypot),
        }
    }

    /// The logarithm of the ratio of each length, and its variance if the two bodies were one.
    fn differences(&self, other: &Self) -> impl Iterator<Item = (f64, f64)> {
        let own = self.lengths_m.iter().zip(&self.sigma_m);
        let others = other.lengths_m.iter().zip(&other.sigma_m);
        own.zip(others).map(|((a, own_m), (b, others_m))| {
            let s2 = (own_m / a).powi(2) + (others_m / b).powi(2);
            (libm::log(a / b), s2)
        })
    }

    /// Root mean square difference of the lengths of two bodies, over their measurement errors.
    pub(crate) fn sigmas(&self, other: &Self) -> f64 {
        let off = self.differences(other).map(|(d, s2)| d.powi(2) / s2);
        (off.sum::<f64>() / N_LENGTHS as f64).sqrt()
    }

    /// ln p(d | same) - ln p(d | other).
    pub(crate) fn likeness(&self, other: &Self) -> f64 {
        let (mut same, mut apart, mut sum_d, mut sum_w) = (0.0, 0.0, 0.0, 0.0);
        for (d, s2) in self.differences(other) {
            let v = s2 + SINGLE_SPREAD * SINGLE_SPREAD;
            same += d * d / s2 + libm::log(s2);
            apart += d * d / v + libm::log(v);
            sum_d += d / v;
            sum_w += 1.0 / v;
        }
        // The inverse and determinant of D + c^2 1 1' (Sherman, Morrison 1950).
        let c2 = STATURE_SPREAD * STATURE_SPREAD;
        let shared = 1.0 + c2 * sum_w;
        apart += libm::log(shared) - c2 * sum_d * sum_d / shared;
        0.5 * (apart - same)
    }
}

/// The compared lengths of `p`; `sum` adds the parts of one.
fn compared(p: &Proportions, sum: impl Fn(f64, f64) -> f64) -> [f64; N_LENGTHS] {
    [
        p.upper_arm_m,
        p.forearm_m,
        p.thigh_m,
        p.shank_m,
        sum(p.scapula_side_m, p.clavicle_m),
        sum(p.lumbar_m, p.trunk_m),
        sum(p.trunk_m, p.head_m),
    ]
}

/// One side of a pair: a body, and where it was when.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Appearance {
    /// The body.
    pub(crate) lengths: Lengths,
    /// Of a newcomer at its first tick, of a known person when it was last seen well.
    pub(crate) whereabouts: Whereabouts,
}

/// How much likelier a pair is one person than two: from link lengths, places and the time between.
#[derive(Debug, Clone, Copy)]
pub(crate) struct LikenessModel {
    field_m2: f64,
    speed_m_s: f64,
}

impl LikenessModel {
    pub(crate) fn new(field: &Field, births: &BirthParameters) -> Self {
        let side = |i: usize| (field.max_m[i] - field.min_m[i]).max(1.0);
        Self {
            field_m2: side(0) * side(1),
            speed_m_s: births.return_speed_m_s,
        }
    }

    /// L of a pair, `absence_s` apart; `None` if no one runs that fast.
    pub(crate) fn likeness(
        &self,
        newcomer: &Appearance,
        known: &Appearance,
        absence_s: f64,
    ) -> Option<f64> {
        let t = absence_s.max(0.0);
        let (now, before) = (&newcomer.whereabouts, &known.whereabouts);
        let r = (now.place_m - before.place_m).xy().norm();
        if r > REACH_M + self.speed_m_s * t {
            return None;
        }
        let place = before.ln_density(now, t, self.field_m2) + libm::log(self.field_m2);
        Some(newcomer.lengths.likeness(&known.lengths) + place.max(LEAST_PLACE))
    }
}

/// The match of a newcomer.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Recognised {
    /// Index of the known person.
    pub(crate) column: usize,
    /// L of the pair.
    pub(crate) log_ratio: f64,
    /// By how much the sum of L is less without the pair; `None` if there was no alternative.
    pub(crate) margin: Option<f64>,
}

impl Recognised {
    /// The evidence for the pair, `absence_s` apart.
    pub(crate) fn why(
        &self,
        newcomer: &Appearance,
        known: &Appearance,
        absence_s: f64,
    ) -> Likeness {
        let (now, before) = (&newcomer.whereabouts, &known.whereabouts);
        let distance_m = (now.place_m - before.place_m).xy().norm();
        Likeness {
            distance_m: distance_m as f32,
            absence_s: absence_s as f32,
            lengths_sigma: newcomer.lengths.sigmas(&known.lengths) as f32,
            log_ratio: self.log_ratio as f32,
            margin: self.margin.map(|margin| margin as f32),
        }
    }
}

/// Decides which row (newcomer) is which column (known person), from L of every possible pair. A
/// pair counts if its L is at least `least`, and it is clear.
pub(crate) fn assign_known(likeness: &[Vec<Option<f64>>], least: f64) -> Vec<Option<Recognised>> {
    let best = assign_best(likeness, least);
    let clear = best
        .into_iter()
        .map(|best| best.filter(Recognised::is_clear));
    clear.collect()
}

impl Recognised {
    /// Whether every other assignment is clearly worse.
    fn is_clear(&self) -> bool {
        // Against "a new person" the limit is the least L; here another assignment must be clearly
        // worse.
        self.margin.is_none_or(|margin| margin >= MARGIN)
    }
}

/// As [`assign_known`], with pairs that are not clear.
pub(crate) fn assign_best(likeness: &[Vec<Option<f64>>], least: f64) -> Vec<Option<Recognised>> {
    let n_known = likeness.first().map_or(0, Vec::len);
    let gain = |row: usize, column: usize| match likeness[row].get(column) {
        Some(Some(l)) if *l >= least => *l - least + f64::EPSILON,
        // Each row has its own column for "a new person".
        None if column == n_known + row => 0.0,
        _ => IMPOSSIBLE,
    };
    let n = likeness.len();
    let best = |without: Option<(usize, usize)>| {
        let cost = |row, column| {
            if without == Some((row, column)) {
                -IMPOSSIBLE
            } else {
                -gain(row, column)
            }
        };
        let chosen = assign(n, n_known + n, cost);
        let pairs = chosen.iter().enumerate();
        let sum: f64 = pairs
            .filter_map(|(row, column)| Some(-cost(row, (*column)?)))
            .sum();
        (sum, chosen)
    };
    let (sum, chosen) = best(None);
    let pairs = chosen.into_iter().enumerate();
    pairs
        .map(|(row, column)| {
            let column = column.filter(|&column| column < n_known)?;
            let rivals = (0..n).any(|r| r != row && gain(r, column) > 0.0)
                || (0..n_known).any(|c| c != column && gain(row, c) > 0.0);
            let margin = rivals.then(|| sum - best(Some((row, column))).0);
            Some(Recognised {
                column,
                log_ratio: likeness[row][column].unwrap_or(least),
                margin,
            })
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;

    fn model() -> LikenessModel {
        let field = Field {
            min_m: [-12.0, -8.0, 0.0],
            max_m: [12.0, 8.0, 2.5],
            floor_m: 0.0,
        };
        LikenessModel::new(&field, &BirthParameters::default())
    }

    /// The column of each row.
    fn columns(likeness: &[Vec<Option<f64>>], least: f64) -> Vec<Option<usize>> {
        let chosen = assign_known(likeness, least);
        chosen.iter().map(|c| c.map(|c| c.column)).collect()
    }

    fn person(stature_m: f64, seconds: f64, x: f64, y: f64) -> Appearance {
        Appearance {
            lengths: Lengths::from_skeleton(
                &Skeleton::new(&Proportions::from_stature(stature_m)),
                seconds,
            ),
            whereabouts: Whereabouts::at(Vector3::new(x, y, 0.95)),
        }
    }

    #[test]
    fn a_returning_body_is_recognised_and_a_different_one_is_not() {
        let left = person(1.75, 20.0, -12.0, -2.8);
        let same = model().likeness(&person(1.76, 0.2, -11.9, -2.0), &left, 4.0);
        assert!(same.unwrap() > 2.0, "{same:?}");
        let taller = model().likeness(&person(1.95, 0.2, -11.9, -2.0), &left, 4.0);
        assert!(taller.unwrap() < -2.0, "{taller:?}");
    }

    #[test]
    fn speed_is_limited() {
        let left = person(1.75, 20.0, -12.0, 0.0);
        let far = person(1.75, 0.2, 12.0, 0.0);
        assert_eq!(model().likeness(&far, &left, 2.5), None);
        assert!(model().likeness(&far, &left, 3.0).is_some());
    }

    #[test]
    fn older_places_weigh_less() {
        let left = person(1.75, 20.0, -12.0, 0.0);
        let back = person(1.75, 0.2, -11.5, 0.0);
        let after = |t| model().likeness(&back, &left, t).unwrap();
        assert!(after(1.0) > after(5.0) && after(5.0) > after(20.0));
        assert!(
            (after(40.0) - after(50.0)).abs() < 0.01,
            "then lengths alone count"
        );
    }

    #[test]
    fn all_are_decided_together() {
        // The first newcomer fits the first known best alone, but the second has no alternative.
        let likeness = [vec![Some(4.0), Some(3.5)], vec![Some(3.8), None]];
        assert_eq!(columns(&likeness, 1.0), [Some(1), Some(0)]);
    }

    #[test]
    fn a_match_has_its_margin() {
        let likeness = [vec![Some(4.0), Some(1.9)]];
        let chosen = assign_known(&likeness, 1.0)[0].unwrap();
        assert!((chosen.log_ratio - 4.0).abs() < 1e-9);
        assert!((chosen.margin.unwrap() - 2.1).abs() < 1e-9);
        let alone = assign_known(&[vec![Some(3.0)]], 1.0)[0].unwrap();
        assert_eq!(alone.margin, None);
    }

    #[test]
    fn an_ambiguous_person_is_new() {
        assert_eq!(columns(&[vec![Some(3.0), Some(2.8)]], 1.0), [None]);
        assert_eq!(columns(&[vec![Some(4.0), Some(1.9)]], 1.0), [Some(0)]);
        assert_eq!(columns(&[vec![Some(0.5), None]], 1.0), [None]);
        assert_eq!(
            columns(&[vec![Some(3.0)], vec![Some(2.9)]], 1.0),
            [None, None]
        );
        assert_eq!(columns(&[Vec::new()], 1.0), [None]);
        assert_eq!(columns(&[], 1.0), []);
    }
}
