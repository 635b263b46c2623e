//! Whether keypoints are written in each other's place in all cameras alike: the legs' left for their right, elbows for wrists,
//! the list of another program for that of the network's card. Lines of sight meet as well as before, so only the bodies tell.
//!
//! ```text
//!   e(o) = mean over bones of |log(l / r) - median| + W (sum over pairs of max(0, -cos) + max(0, -n))
//! ```
//!
//! o is an order in which keypoints may be, l a bone's length with it, r what it is of a stature; the median is over the bones, so
//! that a size says nothing. A pair are two lines from left to right that point the same way in people (hips and shoulders), n is how
//! far ahead of the shoulders the nose is. Of every body on which lines of sight met it is asked which order costs least.

use std::array::from_fn;

use farfield_proto::order_statistics::upper_median;
use nalgebra::Vector3;

use super::super::report::KeypointExchange;
use crate::body::observed::ObservedJoints;
use crate::body::segment::nose_ahead;
use crate::body::skeleton::Joint;

/// Least bodies that tell, and in how many detection passes.
const MIN_BODIES: usize = 10;
const MIN_PASSES: usize = 5;
/// Which share must fit an order better than that of the names, and by how much: of those that fit one of the two better, and of
/// all. Of a bent arm the wrist is as far from the shoulder as the elbow.
const MOST: f64 = 0.85;
const MANY: f64 = 0.4;
const BETTER: f64 = 0.05;
/// What the order may leave of the cost of all bodies, and cost at the most.
const LEAVES: f64 = 0.8;
const FITS: f64 = 0.3;
/// Most that a bone may cost, and what it costs that a pair points the other way.
const MOST_OFF: f64 = 0.7;
const TURNED: f64 = 0.25;
/// Bones that an order must show to be compared.
const MIN_BONES: usize = 5;

use KeypointExchange as Exchange;

impl KeypointExchange {
    const ALL: [Self; 20] = [
        Self::AllSides,
        Self::SidesOfLegs,
        Self::SidesOfArms,
        Self::SidesOfLimbs,
        Self::SidesOfElbowsAndWrists,
        Self::SidesOfKneesAndAnkles,
        Self::SidesOfWrists,
        Self::SidesOfHips,
        Self::ElbowsAndWrists,
        Self::KneesAndAnkles,
        Self::LeftElbowAndWrist,
        Self::RightElbowAndWrist,
        Self::LeftKneeAndAnkle,
        Self::RightKneeAndAnkle,
        Self::HipsAndShoulders,
        Self::ShouldersAndElbows,
        Self::HipsAndKnees,
        Self::Body25,
        Self::OpenPoseCoco,
        Self::Human36m,
    ];

    /// Whether keypoints of one side alone are moved: one bone is wrong then where it is two of both sides.
    fn is_of_one_side(self) -> bool {
        matches!(
            self,
            Self::LeftElbowAndWrist
                | Self::RightElbowAndWrist
                | Self::LeftKneeAndAnkle
                | Self::RightKneeAndAnkle
        )
    }

    /// By how much an order must cost less than another for a body to have it.
    fn better(self) -> f64 {
        if self.is_of_one_side() {
            0.5 * BETTER
        } else {
            BETTER
        }
    }

    /// What the order may leave of the cost of all bodies.
    fn leaves(self) -> f64 {
        if self.is_of_one_side() {
            1.0 - 0.5 * (1.0 - LEAVES)
        } else {
            LEAVES
        }
    }

    /// What is found, for people.
    pub(in crate::camera_agreement) fn words(self) -> String {
        let exchanged =
            |what: &str| format!("{what} are exchanged in everybody, as all cameras show them");
        let listed = |list: &str| {
            format!(
                "the keypoints of all cameras are in the order of {list}, and taken for that of the network's card"
            )
        };
        match self {
            Self::AllSides => exchanged("left and right"),
            Self::SidesOfLegs => exchanged("left and right of the legs"),
            Self::SidesOfArms => exchanged("left and right of the arms"),
            Self::SidesOfLimbs => exchanged("left and right of arms and legs"),
            Self::SidesOfElbowsAndWrists => exchanged("left and right of elbows and wrists"),
            Self::SidesOfKneesAndAnkles => exchanged("left and right of knees and ankles"),
            Self::SidesOfWrists => exchanged("left and right of the wrists"),
            Self::SidesOfHips => exchanged("left and right of the hips"),
            Self::ElbowsAndWrists => exchanged("elbows and wrists"),
            Self::KneesAndAnkles => exchanged("knees and ankles"),
            Self::LeftElbowAndWrist => exchanged("elbow and wrist of the left arm"),
            Self::RightElbowAndWrist => exchanged("elbow and wrist of the right arm"),
            Self::LeftKneeAndAnkle => exchanged("knee and ankle of the left leg"),
            Self::RightKneeAndAnkle => exchanged("knee and ankle of the right leg"),
            Self::HipsAndShoulders => exchanged("hips and shoulders"),
            Self::ShouldersAndElbows => exchanged("shoulders and elbows"),
            Self::HipsAndKnees => exchanged("hips and knees"),
            Self::Body25 => listed("OpenPose's BODY_25"),
            Self::OpenPoseCoco => listed("OpenPose's COCO (with a neck)"),
            Self::Human36m => listed("Human3.6M"),
        }
    }

    /// Per keypoint the place in which it is; `None` where it is in none.
    fn places(self) -> Places {
        let sides = |parts: &[usize]| exchange(parts.iter().map(|&left| (left, left + 1)));
        let parts = |a: usize, b: usize| exchange([(a, b), (a + 1, b + 1)].into_iter());
        let listed = |list: [usize; N]| list.map(|place| (place < N).then_some(place));
        match self {
            Self::AllSides => sides(&[EYES, EARS, SHOULDERS, ELBOWS, WRISTS, HIPS, KNEES, ANKLES]),
            Self::SidesOfLegs => sides(&[HIPS, KNEES, ANKLES]),
            Self::SidesOfArms => sides(&[SHOULDERS, ELBOWS, WRISTS]),
            Self::SidesOfLimbs => sides(&[SHOULDERS, ELBOWS, WRISTS, HIPS, KNEES, ANKLES]),
            Self::SidesOfElbowsAndWrists => sides(&[ELBOWS, WRISTS]),
            Self::SidesOfKneesAndAnkles => sides(&[KNEES, ANKLES]),
            Self::SidesOfWrists => sides(&[WRISTS]),
            Self::SidesOfHips => sides(&[HIPS]),
            Self::ElbowsAndWrists => parts(ELBOWS, WRISTS),
            Self::KneesAndAnkles => parts(KNEES, ANKLES),
            Self::LeftElbowAndWrist => exchange([(ELBOWS, WRISTS)].into_iter()),
            Self::RightElbowAndWrist => exchange([(ELBOWS + 1, WRISTS + 1)].into_iter()),
            Self::LeftKneeAndAnkle => exchange([(KNEES, ANKLES)].into_iter()),
            Self::RightKneeAndAnkle => exchange([(KNEES + 1, ANKLES + 1)].into_iter()),
            Self::HipsAndShoulders => parts(HIPS, SHOULDERS),
            Self::ShouldersAndElbows => parts(SHOULDERS, ELBOWS),
            Self::HipsAndKnees => parts(HIPS, KNEES),
            Self::Body25 => listed([0, 16, 15, N, N, 5, 2, 6, 3, 7, 4, 12, 9, 13, 10, 14, 11]),
            Self::OpenPoseCoco => {
                listed([0, 15, 14, N, 16, 5, 2, 6, 3, 7, 4, 11, 8, 12, 9, 13, 10])
            }
            Self::Human36m => listed([9, N, N, N, N, 11, 14, 12, 15, 13, 16, 4, 1, 5, 2, 6, 3]),
        }
    }
}

/// The keypoints that are compared: COCO's, left before right.
const N: usize = 17;
const JOINTS: [Joint; N] = [
    Joint::Nose,
    Joint::LeftEye,
    Joint::RightEye,
    Joint::LeftEar,
    Joint::RightEar,
    Joint::LeftShoulder,
    Joint::RightShoulder,
    Joint::LeftElbow,
    Joint::RightElbow,
    Joint::LeftWrist,
    Joint::RightWrist,
    Joint::LeftHip,
    Joint::RightHip,
    Joint::LeftKnee,
    Joint::RightKnee,
    Joint::LeftAnkle,
    Joint::RightAnkle,
];
const NOSE: usize = 0;
const EYES: usize = 1;
const EARS: usize = 3;
const SHOULDERS: usize = 5;
const ELBOWS: usize = 7;
const WRISTS: usize = 9;
const HIPS: usize = 11;
const KNEES: usize = 13;
const ANKLES: usize = 15;

/// Both ends, and the length in statures (as of [`crate::body::segment`]).
const BONES: [(usize, usize, f64); 10] = [
    (SHOULDERS, ELBOWS, 0.172),
    (SHOULDERS + 1, ELBOWS + 1, 0.172),
    (ELBOWS, WRISTS, 0.157),
    (ELBOWS + 1, WRISTS + 1, 0.157),
    (HIPS, KNEES, 0.245),
    (HIPS + 1, KNEES + 1, 0.245),
    (KNEES, ANKLES, 0.246),
    (KNEES + 1, ANKLES + 1, 0.246),
    (SHOULDERS, SHOULDERS + 1, 0.22),
    (HIPS, HIPS + 1, 0.10),
];
/// From the middle of the hips to that of the shoulders.
const TRUNK: f64 = 0.27;
/// Lines from left to right that point the same way.
const PAIRS: [(usize, usize); 7] = [
    (HIPS, SHOULDERS),
    (ELBOWS, SHOULDERS),
    (WRISTS, ELBOWS),
    (KNEES, HIPS),
    (ANKLES, KNEES),
    (EYES, SHOULDERS),
    (EARS, SHOULDERS),
];

type Places = [Option<usize>; N];
type Points = [Option<Vector3<f64>>; N];

fn exchange(pairs: impl Iterator<Item = (usize, usize)>) -> Places {
    let mut places = from_fn(Some);
    for (a, b) in pairs {
        places.swap(a, b);
    }
    places
}

/// How bodies fit the orders in which their keypoints may be.
#[derive(Debug, Clone)]
pub(in crate::camera_agreement) struct ExchangeVotes {
    /// Per order of [`Exchange::ALL`].
    orders: Vec<(Exchange, Places, Votes)>,
    passes: usize,
    is_pass_new: bool,
}

/// Of those bodies that show both an order and that of the names.
#[derive(Debug, Clone, Copy, Default)]
struct Votes {
    bodies: usize,
    better: usize,
    worse: usize,
    cost: f64,
    cost_of_names: f64,
}

impl Default for ExchangeVotes {
    fn default() -> Self {
        let order = |exchange: Exchange| (exchange, exchange.places(), Votes::default());
        Self {
            orders: Exchange::ALL.into_iter().map(order).collect(),
            passes: 0,
            is_pass_new: false,
        }
    }
}

impl ExchangeVotes {
    /// The bodies that come are of another detection pass.
    pub(in crate::camera_agreement) fn begin_pass(&mut self) {
        self.is_pass_new = true;
    }

    /// Asks a body.
    pub(in crate::camera_agreement) fn ask(&mut self, body: &ObservedJoints) {
        let shown: Points = JOINTS.map(|joint| body.position_m(joint));
        let Some(cost_of_names) = cost(&shown) else {
            return;
        };
        if std::mem::take(&mut self.is_pass_new) {
            self.passes += 1;
        }
        for (exchange, places, votes) in &mut self.orders {
            if let Some(cost) = cost(&places.map(|place| shown[place?])) {
                let by = exchange.better();
                votes.bodies += 1;
                votes.better += usize::from(cost + by < cost_of_names);
                votes.worse += usize::from(cost_of_names + by < cost);
                votes.cost += cost;
                votes.cost_of_names += cost_of_names;
            }
        }
    }

    /// The order that clearly most bodies have, where it is not that of the names.
    pub(in crate::camera_agreement) fn told(&self) -> Option<Exchange> {
        let known = self.orders.iter();
        let known = known.map(|(exchange, _, votes)| (*exchange, votes));
        let known = known.filter(|(_, votes)| votes.bodies >= MIN_BODIES);
        // What an order does not show costs nothing: so it is weighed by what it leaves of that of the names.
        let (exchange, votes) = known.min_by(|a, b| a.1.left().total_cmp(&b.1.left()))?;
        let is_told = self.passes >= MIN_PASSES
            && votes.better as f64 >= MOST * (votes.better + votes.worse) as f64
            && votes.better as f64 >= MANY * votes.bodies as f64
            && votes.left() < exchange.leaves()
            && votes.cost / (votes.bodies as f64) < FITS;
        is_told.then_some(exchange)
    }
}

impl Votes {
    fn left(&self) -> f64 {
        self.cost / self.cost_of_names.max(f64::MIN_POSITIVE)
    }
}

/// What it costs to take these points for a body; `None` where too little of it is known.
fn cost(at_m: &Points) -> Option<f64> {
    let middle = |left: usize| Some(0.5 * (at_m[left]? + at_m[left + 1]?));
    let bones = BONES.iter().filter_map(|&(near, far, ratio)| {
        let length_m = (at_m[near]? - at_m[far]?).norm();
        Some((length_m, ratio))
    });
    let trunk = middle(SHOULDERS).zip(middle(HIPS));
    let trunk = trunk.map(|(top, bottom)| ((top - bottom).norm(), TRUNK));
    let off = bones
        .chain(trunk)
        .map(|(length_m, ratio)| libm::log(length_m.max(1e-3) / ratio));
    let off: Vec<f64> = off.collect();
    if off.len() < MIN_BONES {
        return None;
    }
    let usual = upper_median(off.clone())?;
    let bones = off.iter().map(|it| (it - usual).abs().min(MOST_OFF));
    let bones = bones.sum::<f64>() / off.len() as f64;
    let across = |left: usize| (at_m[left + 1]? - at_m[left]?).try_normalize(1e-6);
    let pairs = PAIRS.iter().filter_map(|&(a, b)| {
        let cosine = across(a)?.dot(&across(b)?);
        Some((-cosine).max(0.0))
    });
    let ahead = || {
        let both = |left: usize| Some([at_m[left]?, at_m[left + 1]?]);
        nose_ahead(at_m[NOSE]?, both(SHOULDERS)?, both(HIPS)?)
    };
    let behind = ahead().map_or(0.0, |ahead| (-ahead).max(0.0));
    Some(bones + TURNED * (pairs.sum::<f64>() + behind))
}

#[cfg(test)]
mod tests {
    use super::super::super::fixture::Hall;
    use super::super::super::report::DisagreementCause;
    use super::*;
    use crate::body::fixture::{Noise, standing};

    /// What is said of people in a hall all of whose cameras write `from[k]` in the place of the keypoint k.
    fn told_of(from: [usize; N]) -> Vec<(Vec<String>, DisagreementCause)> {
        let mut hall = Hall {
            bursts: 3,
            ..Hall::default()
        };
        for (_, mistake) in &mut hall.shows {
            mistake.order = Some(from.map(|k| k as u8));
        }
        hall.causes()
    }

    fn exchanged(pairs: &[(usize, usize)]) -> [usize; N] {
        let mut from = from_fn(|k| k);
        for &(a, b) in pairs {
            from.swap(a, b);
        }
        from
    }

    #[test]
    fn parts_that_are_exchanged_in_all_cameras_are_named() {
        let cases: [(&[(usize, usize)], Exchange); 11] = [
            (&[(11, 12), (13, 14), (15, 16)], Exchange::SidesOfLegs),
            (&[(5, 6), (7, 8), (9, 10)], Exchange::SidesOfArms),
            (&[(7, 9), (8, 10)], Exchange::ElbowsAndWrists),
            (&[(13, 15), (14, 16)], Exchange::KneesAndAnkles),
            (&[(5, 11), (6, 12)], Exchange::HipsAndShoulders),
            (&[(7, 8), (9, 10)], Exchange::SidesOfElbowsAndWrists),
            (&[(13, 14), (15, 16)], Exchange::SidesOfKneesAndAnkles),
            (&[(7, 9)], Exchange::LeftElbowAndWrist),
            (&[(8, 10)], Exchange::RightElbowAndWrist),
            (&[(13, 15)], Exchange::LeftKneeAndAnkle),
            (&[(14, 16)], Exchange::RightKneeAndAnkle),
        ];
        for (pairs, exchange) in cases {
            let cause = DisagreementCause::ExchangedKeypoints { exchange };
            assert_eq!(told_of(exchanged(pairs)), [(Vec::new(), cause)]);
        }
    }

    #[test]
    fn every_order_is_found_among_bodies_that_have_it_and_none_among_those_that_are_right() {
        let mut noise = Noise(11);
        let bodies: Vec<Points> = (0..40)
            .map(|_| {
                let body = standing(0.0, 0.0, 1.6 + 0.4 * noise.uniform(), &mut noise);
                from_fn(|k| Some(body[k] + noise.vector(0.02)))
            })
            .collect();
        let told = |written: &dyn Fn(&Points) -> Points| {
            let mut votes = ExchangeVotes::default();
            for body in &bodies {
                votes.begin_pass();
                let mut named = ObservedJoints::default();
                for (joint, point) in JOINTS.iter().zip(written(body)) {
                    if let Some(point) = point {
                        named.set(*joint, point, 1.0);
                    }
                }
                votes.ask(&named);
            }
            votes.told()
        };
        assert_eq!(told(&|body| *body), None);
        for exchange in Exchange::ALL {
            let places = exchange.places();
            let written = |body: &Points| {
                let mut written: Points = [None; N];
                for (point, place) in body.iter().zip(places) {
                    if let Some(place) = place {
                        written[place] = *point;
                    }
                }
                written
            };
            assert_eq!(told(&written), Some(exchange));
        }
    }

    #[test]
    fn a_few_bodies_tell_nothing() {
        let mut votes = ExchangeVotes::default();
        let body = standing(0.0, 0.0, 1.7, &mut Noise(2));
        let places = Exchange::SidesOfLegs.places();
        let mut named = ObservedJoints::default();
        for (joint, place) in JOINTS.iter().zip(places) {
            named.set(*joint, body[place.unwrap()], 1.0);
        }
        for _ in 0..MIN_BODIES - 1 {
            votes.begin_pass();
            votes.ask(&named);
        }
        assert_eq!(votes.told(), None);
        votes.ask(&named);
        assert_eq!(votes.told(), Some(Exchange::SidesOfLegs));
    }
}
