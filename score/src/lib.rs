//! Scores poses against a truth: accuracy per actor, and identity over all. `farfield evaluate` prints the result.
//!
//! Read [`score`] first. Its inputs are two files of lines ([`lines`]), and [`overlap`] checks that both are of the same
//! people. The result is [`Scores`]. Each tick, true people and poses are matched one to one by the mean distance of their
//! common points ([`points`]). From the matching follow the errors of each actor ([`accuracy`]), the smoothness of its poses
//! ([`motion`]), the ids ([`identity`]), initiations and returns ([`lives`]), and how well the reported `sigma_m` predict
//! the errors ([`uncertainty_calibration`]). [`names`] collects unknown point names. [`truth_warnings`] reports evidence
//! against the truth. [`table`] and [`plot`] show the result. Coordinates are world, metres; figures are in millimetres and
//! percent.
//!
//! A true body without a pose counts as wrong in every percentage, as does a point that the truth has and the pose lacks. An
//! outlier counts too: the last pose of a person, now beyond the gate (0.5 m) and of no other person. It stays in the
//! person's errors, jitter and sigma statistics.

pub mod accuracy;
pub mod identity;
pub mod lines;
pub mod lives;
pub mod motion;
pub mod names;
pub mod overlap;
mod pairing;
pub mod plot;
pub mod points;
pub mod repeatability;
pub mod table;
pub mod truth_warnings;
pub mod uncertainty_calibration;

use std::collections::BTreeMap;

use farfield_proto::tick::Tick;
use serde::Serialize;

use accuracy::{ActorTally, FramePose};
use identity::{IdentityScore, IdentityTally};
use lines::{PoseLines, TruthExtent, TruthHole};
use lives::Lives;
use motion::Smoothness;
use names::UnknownNames;
use pairing::{Distances, Pairing};
use points::PointSet;
use uncertainty_calibration::{UncertaintyCalibration, UncertaintyTally};

pub use pairing::GATE_M;

/// What `farfield evaluate --json` prints.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Scores {
    /// Per actor (person of the truth).
    pub actors: BTreeMap<u32, ActorScore>,
    /// Plain mean over the actors; with [`PointSet::Shelf14`] over actors 1 to 3, as papers do.
    pub mean: MeanScore,
    /// Ids, over all actors.
    pub identity: IdentityScore,
    /// Initiations and returns.
    pub lives: Lives,
    /// The compared points.
    pub points: PointSet,
    /// Whether the truth was declared whole. With a partial truth no pose is known to be false, and false initiations
    /// (`false_births`) are not counted.
    pub truth: TruthExtent,
    /// The first gap of a person in a truth declared whole: absence, or missing annotation. `None` if there is none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub first_hole: Option<TruthHole>,
    /// The rate for [`ActorScore::jitter_m_s3`] and [`ActorScore::foot_slide_mm_s`]; without one they are absent.
    pub rate_hz: Option<f64>,
    /// Errors by reported sigma; `None` if the poses report none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub calibration: Option<UncertaintyCalibration>,
    /// Unknown point names in the poses; they are not compared.
    #[serde(skip_serializing_if = "UnknownNames::is_empty")]
    pub unknown_in_poses: UnknownNames,
    /// The same in the truth.
    #[serde(skip_serializing_if = "UnknownNames::is_empty")]
    pub unknown_in_truth: UnknownNames,
}

/// Figures of one actor. `None` if there is nothing to measure: no matched tick, no rate, no foot, or no limb with both ends
/// in the truth.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ActorScore {
    /// Ticks at which the truth contains this actor.
    pub frames: u64,
    /// Share of the frames whose mean error is at most 150 mm, percent.
    pub success_150: Option<f64>,
    /// Mean distance over points and frames, millimetres. Outliers count with their whole distance; frames without a pose
    /// are left out.
    pub mpjpe_mm: Option<f64>,
    /// The same between the sites of the 12 keypoints (`keypoints` of a line), where both are known.
    pub mpjpe_sites_mm: Option<f64>,
    /// Share of the limbs with both ends within half the limb's length, percent.
    pub pcp_both_ends: Option<f64>,
    /// Share of the limbs whose end errors are on average within half the length, percent.
    pub pcp_mean_end: Option<f64>,
    /// Share of the limbs whose midpoint is within half the length, percent.
    pub pcp_midpoint: Option<f64>,
    /// Share of the points within 50 mm, percent.
    pub pck_50: Option<f64>,
    /// Share of the points within 100 mm, percent.
    pub pck_100: Option<f64>,
    /// Frames without a pose within [`GATE_M`].
    pub gaps: u64,
    /// Of these, frames with the actor's last pose beyond the gate and of no other actor.
    pub outliers: u64,
    /// Times that the pose had another id than the actor's previous pose.
    pub id_switches: u64,
    /// Points that the truth has and the matched pose lacks: wrong in the percentages, left out of the MPJPE.
    pub missing_points: u64,
    /// Mean norm of the third difference over dt^3, metres per second cubed.
    pub jitter_m_s3: Option<f64>,
    /// Mean horizontal speed of heel and toe while the true foot is still, millimetres per second.
    pub foot_slide_mm_s: Option<f64>,
    /// Mean horizontal speed of the ankle while the true foot is still, millimetres per second. It needs no heel and toe.
    pub ankle_slide_mm_s: Option<f64>,
}

/// Means over actors of the figures of [`ActorScore`]; a mean leaves out the actors that lack the figure.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[expect(
    missing_docs,
    reason = "the fields have the meaning of those of ActorScore"
)]
pub struct MeanScore {
    pub frames: f64,
    pub success_150: Option<f64>,
    pub mpjpe_mm: Option<f64>,
    pub mpjpe_sites_mm: Option<f64>,
    pub pcp_both_ends: Option<f64>,
    pub pcp_mean_end: Option<f64>,
    pub pcp_midpoint: Option<f64>,
    pub pck_50: Option<f64>,
    pub pck_100: Option<f64>,
    pub gaps: f64,
    pub outliers: f64,
    pub id_switches: f64,
    pub missing_points: f64,
    pub jitter_m_s3: Option<f64>,
    pub foot_slide_mm_s: Option<f64>,
    pub ankle_slide_mm_s: Option<f64>,
}

/// Scores `poses` against `truth`, both read with the same [`PointSet`] and ticks. `extent` declares whether the truth is
/// whole.
///
/// A partial truth is scored at its own ticks only.
/// Cost: one assignment per tick, and a few distances per pair.
pub fn score(
    poses: &PoseLines,
    truth: &PoseLines,
    extent: TruthExtent,
    rate_hz: Option<f64>,
) -> Scores {
    let points = truth.points();
    let no_people = BTreeMap::new();
    let mut actors: BTreeMap<u32, (ActorTally, Smoothness)> = BTreeMap::new();
    let mut identity = IdentityTally::new(extent);
    let mut calibration = UncertaintyTally::default();
    let mut pairing = Pairing::new(extent);
    for tick in scored_ticks(poses, truth, extent) {
        let true_bodies = truth.people_at(tick).unwrap_or(&no_people);
        let pose_bodies = poses.people_at(tick).unwrap_or(&no_people);
        let distances = Distances::new(true_bodies, pose_bodies);
        pairing.pair(&distances);
        identity.add(&distances, pairing.matched());
        calibration.add(true_bodies, pose_bodies, pairing.pairs(&distances));
        for (i, (&actor, body)) in true_bodies.iter().enumerate() {
            let pose_of =
                |j: Option<usize>| j.and_then(|j| pose_bodies.get(&distances.pose_ids[j]));
            let pose = match (
                pose_of(pairing.matched()[i]),
                pose_of(pairing.outliers()[i]),
            ) {
                (Some(pose), _) => FramePose::Near(pose),
                (None, Some(pose)) => FramePose::Outlier(pose),
                (None, None) => FramePose::Missing,
            };
            let (tally, motion) = actors.entry(actor).or_default();
            tally.add(body, pose, points);
            motion.add(tick, body, pose.body());
        }
    }
    let actors: BTreeMap<u32, ActorScore> = actors
        .into_iter()
        .map(|(id, (tally, motion))| (id, tally.finish(&motion, identity.switches_of(id), rate_hz)))
        .collect();
    let averaged: Vec<&ActorScore> = actors
        .iter()
        .filter(|(id, _)| points != PointSet::Shelf14 || (1..=3).contains(*id))
        .map(|(_, score)| score)
        .collect();
    Scores {
        mean: MeanScore::average(&averaged),
        identity: identity.finish(),
        lives: Lives::of(poses, truth, rate_hz),
        points,
        truth: extent,
        first_hole: truth.first_hole().filter(|_| extent == TruthExtent::Whole),
        rate_hz,
        calibration: calibration.finish(),
        unknown_in_poses: poses.unknown().clone(),
        unknown_in_truth: truth.unknown().clone(),
        actors,
    }
}

/// Mean error of each actor at each tick, metres, under the pairing of [`score`], with outliers; `None` without a pose. Ticks
/// ascend.
pub fn errors_over_time(
    poses: &PoseLines,
    truth: &PoseLines,
) -> BTreeMap<u32, Vec<(Tick, Option<f64>)>> {
    let no_people = BTreeMap::new();
    let mut errors: BTreeMap<u32, Vec<(Tick, Option<f64>)>> = BTreeMap::new();
    let mut pairing = Pairing::new(TruthExtent::Whole);
    for tick in truth.ticks() {
        let true_bodies = truth.people_at(tick).unwrap_or(&no_people);
        let pose_bodies = poses.people_at(tick).unwrap_or(&no_people);
        let distances = Distances::new(true_bodies, pose_bodies);
        pairing.pair(&distances);
        for (i, &actor) in true_bodies.keys().enumerate() {
            let pose = pairing.matched()[i].or(pairing.outliers()[i]);
            let error_m = pose.map(|j| distances.pair_m(i, j));
            errors.entry(actor).or_default().push((tick, error_m));
        }
    }
    errors
}

/// The matching of [`score`] at one tick: per actor the id of its pose.
pub fn matches_at(tick: Tick, poses: &PoseLines, truth: &PoseLines) -> BTreeMap<u32, u32> {
    let (Some(true_bodies), Some(pose_bodies)) = (truth.people_at(tick), poses.people_at(tick))
    else {
        return BTreeMap::new();
    };
    let distances = Distances::new(true_bodies, pose_bodies);
    let pairs = true_bodies.keys().zip(distances.matches());
    pairs
        .filter_map(|(&actor, j)| Some((actor, distances.pose_ids[j?])))
        .collect()
}

fn scored_ticks(poses: &PoseLines, truth: &PoseLines, extent: TruthExtent) -> Vec<Tick> {
    let mut ticks: Vec<Tick> = truth.ticks().collect();
    if extent == TruthExtent::Whole {
        ticks.extend(poses.ticks());
        ticks.sort_unstable();
        ticks.dedup();
    }
    ticks
}

impl MeanScore {
    fn average(actors: &[&ActorScore]) -> Self {
        let mean = |figure: fn(&ActorScore) -> f64| {
            mean_of(actors.iter().map(|a| Some(figure(a)))).unwrap_or(0.0)
        };
        Self {
            frames: mean(|a| a.frames as f64),
            success_150: mean_of(actors.iter().map(|a| a.success_150)),
            mpjpe_mm: mean_of(actors.iter().map(|a| a.mpjpe_mm)),
            mpjpe_sites_mm: mean_of(actors.iter().map(|a| a.mpjpe_sites_mm)),
            pcp_both_ends: mean_of(actors.iter().map(|a| a.pcp_both_ends)),
            pcp_mean_end: mean_of(actors.iter().map(|a| a.pcp_mean_end)),
            pcp_midpoint: mean_of(actors.iter().map(|a| a.pcp_midpoint)),
            pck_50: mean_of(actors.iter().map(|a| a.pck_50)),
            pck_100: mean_of(actors.iter().map(|a| a.pck_100)),
            gaps: mean(|a| a.gaps as f64),
            outliers: mean(|a| a.outliers as f64),
            id_switches: mean(|a| a.id_switches as f64),
            missing_points: mean(|a| a.missing_points as f64),
            jitter_m_s3: mean_of(actors.iter().map(|a| a.jitter_m_s3)),
            foot_slide_mm_s: mean_of(actors.iter().map(|a| a.foot_slide_mm_s)),
            ankle_slide_mm_s: mean_of(actors.iter().map(|a| a.ankle_slide_mm_s)),
        }
    }
}

fn mean_of(values: impl Iterator<Item = Option<f64>>) -> Option<f64> {
    let known: Vec<f64> = values.flatten().collect();
    (!known.is_empty()).then(|| known.iter().sum::<f64>() / known.len() as f64)
}

#[cfg(test)]
mod tests;
