//! Sites of a network's keypoints on one person, learned while it moves.
//!
//! A network's hip or knee is some centimetres off the joint's centre, and fixed to the body. A
//! pose hides most of that: the leg bends until the keypoint fits. But the ends of limbs move on
//! circles about the true centres. So the offsets are estimated, together with the lengths that
//! they could be confused with, from many ticks with the pose of each eliminated
//! ([`PoseElimination`]):
//!
//! ```text
//!   (Σ w M + diag(1/s²)) c = Σ w (m + M c_then) + c_before/s²
//! ```
//!
//! `c_then` are the body's constants at the tick, `c_before` the prior: the offsets that the person
//! came with (those of the network's card), and the measured lengths. The resulting lengths are not
//! used: those of the body change at four times only.

use nalgebra::{SMatrix, SVector, Vector3};

use super::ik::{PoseElimination, SeenPoint};
use super::observed::{KeypointEstimate, ObservedJoints};
use super::skeleton::{Joint, Kinematics, Proportions, Side, Site};

/// The joints whose keypoints are learned: those deep inside the body.
const DEEP: [Joint; 4] = [
    Joint::LeftHip,
    Joint::RightHip,
    Joint::LeftKnee,
    Joint::RightKnee,
];
/// The constants: the offset of each deep joint along the axes of its link, then these lengths.
const N: usize = 3 * DEEP.len() + 4;
const THIGH: usize = 3 * DEEP.len();
const SHANK: usize = THIGH + 1;
const HIP_SIDE: usize = THIGH + 2;
const TRUNK: usize = THIGH + 3;

/// s: deviation of a keypoint from its place on the card, and of a length from its measurement,
/// metres per axis.
const OFFSET_SIGMA_M: f64 = 0.014;
const LENGTH_SIGMA_M: f64 = 0.02;
/// The same for the distance of a hip from the pelvis: one that could change would take most of what
/// the offsets of both hips explain, and it is not used.
const HIP_SIDE_SIGMA_M: f64 = 0.005;
/// Time between used ticks, seconds: errors of a network hardly change within.
const EVERY_S: f64 = 0.15;
/// Time after which a tick has full weight, seconds: w is the elapsed time over this.
const LASTS_S: f64 = 0.3;
/// Time constant of forgetting, seconds.
const FORGET_S: f64 = 120.0;
/// Time constant with which the sites follow the estimate, seconds: poses must not jump.
const FOLLOW_S: f64 = 0.2;
/// Distance of a keypoint from its place on the body at which it counts less, metres.
const ASTRAY_M: f64 = 0.06;

/// The estimate of one person's keypoint sites. Allocates once.
#[derive(Debug, Clone)]
pub(crate) struct SiteFit {
    elimination: PoseElimination,
    points: Vec<SeenPoint<N>>,
    /// Σ w M and Σ w (m + M c).
    information: Box<SMatrix<f64, N, N>>,
    pull: SVector<f64, N>,
    /// The offsets that the person came with.
    before: Option<SVector<f64, N>>,
    found: SVector<f64, N>,
    /// Time since the last used tick; initially negative by the remaining wait.
    due_s: f64,
}

/// Input of one tick for one person's sites.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SiteEvidence<'a> {
    /// The sites of the network's card.
    pub(crate) of_card: &'a [Option<Site>],
    /// The seen keypoints.
    pub(crate) estimates: &'a [KeypointEstimate],
    /// The pose that fits them.
    pub(crate) body: &'a Kinematics,
    /// The lengths of that body.
    pub(crate) lengths: &'a Proportions,
    /// Time since the last tick, seconds.
    pub(crate) dt_s: f64,
}

impl SiteFit {
    /// An estimate without data.
    pub(crate) fn new() -> Self {
        Self {
            elimination: PoseElimination::new(),
            points: Vec::new(),
            information: Box::new(SMatrix::zeros()),
            pull: SVector::zeros(),
            before: None,
            found: SVector::zeros(),
            due_s: 0.0,
        }
    }

    /// Sets the turn of learning by the person's `number`: if all people who arrive together learn
    /// at one tick, that tick takes an eighth longer than others (five people, 60 Hz).
    pub(crate) fn take_turn(&mut self, number: u32) {
        // Multiples of the golden ratio, here of 2^32, fall into the largest gaps between earlier
        // ones.
        let turn = f64::from(number.wrapping_mul(0x9e37_79b9)) / f64::from(u32::MAX);
        self.due_s = -EVERY_S * turn;
    }

    /// Moves the sites of deep joints towards the estimate from all ticks.
    pub(crate) fn learn(&mut self, sites: &mut [Option<Site>], tick: &SiteEvidence<'_>) {
        if self.before.is_none() {
            self.found = offsets_of(sites, tick.of_card);
            self.before = Some(self.found);
        }
        self.due_s += tick.dt_s;
        if self.due_s >= EVERY_S {
            self.take_in(sites, tick);
            self.solve(tick.lengths);
            self.due_s = 0.0;
        }
        let share = (tick.dt_s / FOLLOW_S).clamp(0.0, 1.0);
        for (site, card) in sites.iter_mut().zip(tick.of_card) {
            if let (Some(site), Some(card)) = (site, card)
                && let Some(first) = first_constant_of(site.joint)
            {
                let goal_m = card.offset_m + self.found.fixed_rows::<3>(first);
                site.offset_m += (goal_m - site.offset_m) * share;
            }
        }
    }

    /// Adds the information of a tick.
    fn take_in(&mut self, sites: &[Option<Site>], tick: &SiteEvidence<'_>) {
        self.points.clear();
        for (site, estimate) in sites.iter().zip(tick.estimates) {
            let Some(site) = site else { continue };
            if estimate.weight <= 0.0 || estimate.information.trace() <= 0.0 {
                continue;
            }
            let place_m = tick.body.site_m(site);
            let off_m = estimate.position_m - place_m;
            let trust = ASTRAY_M / off_m.norm().max(ASTRAY_M);
            self.points.push(SeenPoint {
                joint: site.joint,
                place_m,
                off_m,
                information: estimate.information * (trust * trust),
                moves: moves(site.joint, tick.body),
            });
        }
        let tick_information = self.elimination.information(tick.body, &self.points);
        let then = offsets_of(sites, tick.of_card) + lengths(tick.lengths);
        let (keep, share) = (1.0 - self.due_s / FORGET_S, self.due_s / LASTS_S);
        *self.information = *self.information * keep + tick_information.information * share;
        self.pull = self.pull * keep
            + (tick_information.pull + tick_information.information * then) * share;
    }

    /// Solves for the common constants of all ticks.
    fn solve(&mut self, measured: &Proportions) {
        let before = self.before.unwrap_or_default() + lengths(measured);
        let (mut information, mut pull) = (*self.information, self.pull);
        for a in 0..N {
            let sigma_m = match a {
                HIP_SIDE => HIP_SIDE_SIGMA_M,
                THIGH.. => LENGTH_SIGMA_M,
                _ => OFFSET_SIGMA_M,
            };
            let precision = 1.0 / (sigma_m * sigma_m);
            information[(a, a)] += precision;
            pull[a] += precision * before[a];
        }
        let factor = information.cholesky();
        let found: Option<SVector<f64, N>> = factor.map(|factor| factor.solve(&pull));
        if let Some(found) = found.filter(|found| found.iter().all(|v| v.is_finite())) {
            self.found = found;
        }
    }
}

/// First constant of the offset of `joint`, if it is learned.
fn first_constant_of(joint: Joint) -> Option<usize> {
    DEEP.iter().position(|deep| *deep == joint).map(|i| 3 * i)
}

/// The offsets of `sites` from those of the card, as constants; the lengths are 0.
fn offsets_of(sites: &[Option<Site>], of_card: &[Option<Site>]) -> SVector<f64, N> {
    let mut constants = SVector::<f64, N>::zeros();
    for (site, card) in sites.iter().zip(of_card) {
        if let (Some(site), Some(card)) = (site, card)
            && let Some(first) = first_constant_of(site.joint)
        {
            let offset_m = site.offset_m - card.offset_m;
            constants.fixed_rows_mut::<3>(first).copy_from(&offset_m);
        }
    }
    constants
}

/// The lengths, as constants; the offsets are 0.
fn lengths(of: &Proportions) -> SVector<f64, N> {
    let mut constants = SVector::<f64, N>::zeros();
    constants[THIGH] = of.thigh_m;
    constants[SHANK] = of.shank_m;
    constants[HIP_SIDE] = of.hip_side_m;
    constants[TRUNK] = of.lumbar_m + of.trunk_m;
    constants
}

/// Motion of a keypoint on `joint` per unit of each constant in a fixed pose.
fn moves(joint: Joint, body: &Kinematics) -> [Vector3<f64>; N] {
    let mut moves = [Vector3::zeros(); N];
    if let Some(first) = first_constant_of(joint) {
        let axes = body.rotation(joint.link());
        for (moved, axis) in moves[first..first + 3].iter_mut().zip(axes.column_iter()) {
            *moved = axis.into_owned();
        }
    }
    let along = |of: Joint, axis: usize| body.rotation(of.link()).column(axis).into_owned();
    let leg = Side::BOTH.into_iter().find_map(|side| {
        let leg = match side {
            Side::Left => [Joint::LeftHip, Joint::LeftKnee, Joint::LeftAnkle],
            Side::Right => [Joint::RightHip, Joint::RightKnee, Joint::RightAnkle],
        };
        Some((side, leg, leg.iter().position(|part| *part == joint)?))
    });
    match leg {
        Some((side, [hip, knee, ankle], at)) => {
            moves[HIP_SIDE] = along(hip, 1) * -side.mirror();
            if at >= 1 {
                moves[THIGH] = -along(knee, 2);
            }
            if at >= 2 {
                moves[SHANK] = -along(ankle, 2);
            }
        }
        None if joint != Joint::Pelvis => moves[TRUNK] = along(Joint::Neck, 2),
        None => {}
    }
    moves
}

/// The joints of keypoints with evidence from two viewpoints, without their offsets.
pub(crate) fn without_offsets(
    estimates: &[KeypointEstimate],
    sites: &[Option<Site>],
    kinematics: &Kinematics,
) -> ObservedJoints {
    let mut joints = ObservedJoints::default();
    for (joint, point) in ObservedJoints::from_estimates(estimates, sites).iter() {
        let offset_m: Vector3<f64> = kinematics.rotation(joint.link()) * point.offset_m;
        joints.set(joint, point.position_m - offset_m, point.weight);
    }
    joints
}

#[cfg(test)]
mod tests {
    use farfield_proto::keypoints::KeypointSet;
    use farfield_proto::venue::parameters::IkParameters;
    use nalgebra::Matrix3;

    use super::*;
    use crate::body::fixture::{Noise, postures};
    use crate::body::ik::{IkSolver, Priors, Target};
    use crate::body::skeleton::Skeleton;

    /// Time between two postures, seconds.
    const DT_S: f64 = EVERY_S;
    const KEYPOINT_SIGMA_M: f64 = 0.01;

    fn card() -> Vec<Option<Site>> {
        let keypoints = KeypointSet::coco17();
        let joints = keypoints.names().iter().map(|name| Joint::from_name(name));
        joints.map(|joint| joint.map(Site::at)).collect()
    }

    /// The learned sites of a person in `n` everyday postures whose keypoints sit at `truth`.
    fn learned(truth: &[Option<Site>], n: usize) -> Vec<Option<Site>> {
        let skeleton = Skeleton::new(&Proportions::from_stature(1.75));
        let (card, parameters) = (card(), IkParameters::default());
        let (mut sites, mut fit) = (card.clone(), SiteFit::new());
        let mut solver = IkSolver::new(&parameters);
        let mut body = Kinematics::default();
        for pose in postures(n, &mut Noise(4)) {
            skeleton.forward(&pose, &mut body);
            let information = Matrix3::from_diagonal_element(KEYPOINT_SIGMA_M.powi(-2));
            let seen = |site: &Option<Site>| {
                let place_m = body.site_m(&site.unwrap());
                let mut estimate = KeypointEstimate::unsupported(place_m, 1.0);
                (estimate.weight, estimate.views, estimate.information) = (1.0, 4, information);
                estimate
            };
            let estimates: Vec<KeypointEstimate> = truth.iter().map(seen).collect();
            let target = |(site, seen): (&Option<Site>, &KeypointEstimate)| {
                Target::isotropic(&site.unwrap(), seen.position_m, KEYPOINT_SIGMA_M.powi(-2))
            };
            let targets: Vec<Target> = sites.iter().zip(&estimates).map(target).collect();
            let priors = Priors::new(&parameters, &pose, DT_S);
            solver.fit(&skeleton, &pose, &targets, &priors, None);
            let tick = SiteEvidence {
                of_card: &card,
                estimates: &estimates,
                body: solver.body(),
                lengths: skeleton.proportions(),
                dt_s: DT_S,
            };
            fit.learn(&mut sites, &tick);
        }
        sites
    }

    fn moved(joint: Joint, offset_m: Vector3<f64>) -> Vec<Option<Site>> {
        let mut sites = card();
        let site = sites.iter_mut().flatten().find(|site| site.joint == joint);
        site.unwrap().offset_m = offset_m;
        sites
    }

    fn offset_of(sites: &[Option<Site>], joint: Joint) -> Vector3<f64> {
        let site = sites.iter().flatten().find(|site| site.joint == joint);
        site.unwrap().offset_m
    }

    #[test]
    fn the_offset_of_a_keypoint_is_learned_from_motion() {
        for (joint, offset_m) in [
            (Joint::LeftKnee, Vector3::new(0.025, 0.0, 0.01)),
            (Joint::RightKnee, Vector3::new(0.0, 0.01, -0.025)),
            (Joint::LeftHip, Vector3::new(0.0, 0.02, 0.015)),
        ] {
            let sites = learned(&moved(joint, offset_m), 60);
            let off_m = (offset_of(&sites, joint) - offset_m).norm();
            assert!(off_m < 0.5 * offset_m.norm(), "{}: {off_m} m", joint.name());
        }
    }

    #[test]
    fn keypoints_on_their_joints_stay_there() {
        let sites = learned(&card(), 60);
        for joint in DEEP {
            let off_m = offset_of(&sites, joint).norm();
            assert!(off_m < 0.003, "{}: {off_m} m", joint.name());
        }
    }

    #[test]
    fn people_of_one_arrival_learn_at_different_ticks() {
        const TICK_S: f64 = 1.0 / 60.0;
        let skeleton = Skeleton::new(&Proportions::from_stature(1.75));
        let (mut body, known) = (Kinematics::default(), card());
        skeleton.forward(&postures(1, &mut Noise(1))[0], &mut body);
        let tick = SiteEvidence {
            of_card: &known,
            estimates: &[],
            body: &body,
            lengths: skeleton.proportions(),
            dt_s: TICK_S,
        };
        let mut together: Vec<SiteFit> = (1..=22).map(|_| SiteFit::new()).collect();
        for (number, fit) in (1..).zip(&mut together) {
            fit.take_turn(number);
        }
        let mut most = 0;
        for _ in 0..60 {
            for fit in &mut together {
                fit.learn(&mut known.clone(), &tick);
            }
            let learned = together.iter().filter(|fit| fit.due_s == 0.0);
            most = most.max(learned.count());
        }
        // 22 in the nine ticks between two times.
        assert!((3..=4).contains(&most), "{most}");
    }

    #[test]
    fn known_sites_stay_without_new_evidence() {
        let known = moved(Joint::LeftHip, Vector3::new(0.0, 0.02, 0.0));
        let (mut sites, mut body) = (known.clone(), Kinematics::default());
        let skeleton = Skeleton::new(&Proportions::from_stature(1.75));
        skeleton.forward(&postures(1, &mut Noise(1))[0], &mut body);
        let mut fit = SiteFit::new();
        for _ in 0..100 {
            let tick = SiteEvidence {
                of_card: &card(),
                estimates: &[],
                body: &body,
                lengths: skeleton.proportions(),
                dt_s: DT_S,
            };
            fit.learn(&mut sites, &tick);
        }
        let off_m = offset_of(&sites, Joint::LeftHip) - offset_of(&known, Joint::LeftHip);
        assert!(off_m.norm() < 1e-12, "{off_m}");
    }
}
