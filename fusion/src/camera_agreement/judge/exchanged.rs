//! Whether keypoints are written in each other's place in all cameras: left and right of the legs, elbows and wrists,
//! or the list of another program. Lines of sight meet as well as before, so only the bodies show it.
//!
//! ```text
//!   e(o) = mean over bones of |log(l / r) - median| + W (sum over pairs of max(0, -cos) + max(0, -n))
//! ```
//!
//! o is an order of keypoints, l a bone's length with it, and r this length in statures. The median is over the bones,
//! so that size does not count. A pair is two lines from left to right that point the same way in people, such as hips
//! and shoulders; cos is the cosine between them. n is how far the nose is ahead of the shoulders. Each body on which
//! lines of sight met votes for or against each order, relative to the order of the names.

use std::array::from_fn;

use farfield_proto::order_statistics::upper_median;
use nalgebra::Vector3;

use super::super::report::KeypointExchange;
use crate::body::observed::ObservedJoints;
use crate::body::segment::nose_ahead;
use crate::body::skeleton::Joint;
use crate::sightings::diagnosis::SightingDiagnosis;

/// Fewest bodies, and detection passes with bodies, for a decision.
const MIN_BODIES: usize = 10;
const MIN_PASSES: usize = 5;
/// Smallest share of bodies that must fit an order better than that of the names: among bodies that fit one of the two
/// clearly better, and among all. With a bent arm the wrist is as far from the shoulder as the elbow, so many bodies
/// are undecided.
const MIN_SHARE_OF_DECIDED: f64 = 0.85;
const MIN_SHARE_OF_ALL: f64 = 0.4;
/// Difference of costs from which a body fits one order clearly better.
const MIN_COST_GAIN: f64 = 0.05;
/// Largest share of the cost of all bodies that the order may leave, and largest mean cost of a body with it.
const MAX_COST_RATIO: f64 = 0.8;
const MAX_MEAN_COST: f64 = 0.3;
/// Largest cost of a bone.
const MAX_BONE_COST: f64 = 0.7;
/// W: the cost of a pair that points the other way.
const PAIR_COST: f64 = 0.25;
/// Smallest share of bodies with the nose behind the shoulders if left and right are exchanged. In valid recordings
/// (the sample, the Shelf, the treadmill) it was ahead in 98 to 100 %.
const MIN_BEHIND_SHARE: f64 = 0.85;
/// Bones that a body must show with an order to be compared.
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

    /// Whether keypoints of one side only are exchanged, so that half as many bones are wrong.
    fn is_of_one_side(self) -> bool {
        matches!(
            self,
            Self::LeftElbowAndWrist
                | Self::RightElbowAndWrist
                | Self::LeftKneeAndAnkle
                | Self::RightKneeAndAnkle
        )
    }

    fn min_cost_gain(self) -> f64 {
        if self.is_of_one_side() {
            0.5 * MIN_COST_GAIN
        } else {
            MIN_COST_GAIN
        }
    }

    fn max_cost_ratio(self) -> f64 {
        if self.is_of_one_side() {
            1.0 - 0.5 * (1.0 - MAX_COST_RATIO)
        } else {
            MAX_COST_RATIO
        }
    }

    /// The finding as a sentence, for people.
    pub(in crate::camera_agreement) fn words(self) -> String {
        let exchanged =
            |what: &str| format!("{what} are exchanged in the keypoints of all cameras");
        let listed = |list: &str| {
            format!(
                "the keypoints of all cameras are in the order of {list}, not in that of the network's card"
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

    /// Per keypoint the place where it is written; `None` if it is missing.
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

/// Both ends, and the length in statures (from [`crate::body::segment`]).
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
/// From the middle of the hips to the middle of the shoulders, statures.
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

/// How well bodies fit the possible orders of their keypoints.
#[derive(Debug, Clone)]
pub(in crate::camera_agreement) struct ExchangeVotes {
    /// Per order of [`Exchange::ALL`].
    orders: Vec<(Exchange, Places, Votes)>,
    passes: usize,
    is_pass_new: bool,
}

/// Sums over the bodies that can be compared with an order and with that of the names.
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
    /// Starts another detection pass.
    pub(in crate::camera_agreement) fn begin_pass(&mut self) {
        self.is_pass_new = true;
    }

    /// Adds the votes of a body.
    pub(in crate::camera_agreement) fn add(&mut self, body: &ObservedJoints) {
        let shown: Points = JOINTS.map(|joint| body.position_m(joint));
        let Some(cost_of_names) = cost(&shown) else {
            return;
        };
        if std::mem::take(&mut self.is_pass_new) {
            self.passes += 1;
        }
        for (exchange, places, votes) in &mut self.orders {
            if let Some(cost) = cost(&places.map(|place| shown[place?])) {
                let by = exchange.min_cost_gain();
                votes.bodies += 1;
                votes.better += usize::from(cost + by < cost_of_names);
                votes.worse += usize::from(cost_of_names + by < cost);
                votes.cost += cost;
                votes.cost_of_names += cost_of_names;
            }
        }
    }

    /// The order that clearly most bodies have; `None` if it is that of the names.
    pub(in crate::camera_agreement) fn winner(&self) -> Option<Exchange> {
        let known = self.orders.iter();
        let known = known.map(|(exchange, _, votes)| (*exchange, votes));
        let known = known.filter(|(_, votes)| votes.bodies >= MIN_BODIES);
        // Keypoints that an order lacks cost nothing, so orders are compared by ratios of cost.
        let (exchange, votes) =
            known.min_by(|a, b| a.1.cost_ratio().total_cmp(&b.1.cost_ratio()))?;
        let is_sure = self.passes >= MIN_PASSES
            && votes.better as f64 >= MIN_SHARE_OF_DECIDED * (votes.better + votes.worse) as f64
            && votes.better as f64 >= MIN_SHARE_OF_ALL * votes.bodies as f64
            && votes.cost_ratio() < exchange.max_cost_ratio()
            && votes.cost / (votes.bodies as f64) < MAX_MEAN_COST;
        is_sure.then_some(exchange)
    }
}

impl Votes {
    fn cost_ratio(&self) -> f64 {
        self.cost / self.cost_of_names.max(f64::MIN_POSITIVE)
    }
}

/// Whether left and right are exchanged in the keypoints of all cameras: with the left shoulder taken for the right
/// one, noses are behind shoulders.
pub(in crate::camera_agreement) fn are_sides_exchanged(sighted: &SightingDiagnosis) -> bool {
    let all = sighted.noses_ahead + sighted.noses_behind;
    all >= MIN_BODIES as u64
        && sighted.nose_passes >= MIN_PASSES as u64
        && sighted.noses_behind as f64 >= MIN_BEHIND_SHARE * all as f64
}

/// e(o) of a body with its keypoints in one order; `None` if it shows too few bones.
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
    let bones = off.iter().map(|it| (it - usual).abs().min(MAX_BONE_COST));
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
    Some(bones + PAIR_COST * (pairs.sum::<f64>() + behind))
}

#[cfg(test)]
mod tests {
    use super::super::super::fixture::{Hall, Mistake, names};
    use super::super::super::report::DisagreementCause;
    use super::*;
    use crate::body::fixture::{Noise, standing};

    /// The causes reported if all cameras of the hall write `from[k]` in the place of keypoint k.
    fn causes(from: [usize; N]) -> Vec<(Vec<String>, DisagreementCause)> {
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
    fn exchanged_parts_are_found_in_all_cameras() {
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
            assert_eq!(causes(exchanged(pairs)), [(Vec::new(), cause)]);
        }
    }

    #[test]
    fn every_order_is_found_in_its_bodies_and_none_in_valid_ones() {
        let mut noise = Noise(11);
        let bodies: Vec<Points> = (0..40)
            .map(|_| {
                let body = standing(0.0, 0.0, 1.6 + 0.4 * noise.uniform(), &mut noise);
                from_fn(|k| Some(body[k] + noise.vector(0.02)))
            })
            .collect();
        let winner = |written: &dyn Fn(&Points) -> Points| {
            let mut votes = ExchangeVotes::default();
            for body in &bodies {
                votes.begin_pass();
                let mut named = ObservedJoints::default();
                for (joint, point) in JOINTS.iter().zip(written(body)) {
                    if let Some(point) = point {
                        named.set(*joint, point, 1.0);
                    }
                }
                votes.add(&named);
            }
            votes.winner()
        };
        assert_eq!(winner(&|body| *body), None);
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
            assert_eq!(winner(&written), Some(exchange));
        }
    }

    #[test]
    fn few_bodies_decide_nothing() {
        let mut votes = ExchangeVotes::default();
        let body = standing(0.0, 0.0, 1.7, &mut Noise(2));
        let places = Exchange::SidesOfLegs.places();
        let mut named = ObservedJoints::default();
        for (joint, place) in JOINTS.iter().zip(places) {
            named.set(*joint, body[place.unwrap()], 1.0);
        }
        for _ in 0..MIN_BODIES - 1 {
            votes.begin_pass();
            votes.add(&named);
        }
        assert_eq!(votes.winner(), None);
        votes.add(&named);
        assert_eq!(votes.winner(), Some(Exchange::SidesOfLegs));
    }

    fn causes_with_exchanged_sides(cameras: &[usize]) -> Vec<(Vec<String>, DisagreementCause)> {
        let order = Exchange::AllSides.places().map(|k| k.unwrap() as u8);
        let mut hall = Hall::default();
        for &camera in cameras {
            hall.shows[camera].1 = Mistake {
                order: Some(order),
                ..Mistake::default()
            };
        }
        hall.causes()
    }

    #[test]
    fn exchanged_sides_in_all_cameras_are_found_by_noses() {
        let of_sides = DisagreementCause::KeypointOrder {
            moved: 16,
            sides: true,
        };
        assert_eq!(
            causes_with_exchanged_sides(&[0, 1, 2, 3]),
            [(Vec::new(), of_sides)]
        );
    }

    #[test]
    fn exchanged_sides_in_one_camera_name_that_camera() {
        assert_eq!(causes_with_exchanged_sides(&[]), []);
        let causes = causes_with_exchanged_sides(&[2]);
        assert_eq!(causes.len(), 1, "{causes:?}");
        assert_eq!(causes[0].0, names(&[2]));
    }
}
