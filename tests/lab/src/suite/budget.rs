//! The error budget: distance from the truth after each stage, by kind of keypoint.

use std::collections::BTreeMap;
use std::fmt;

use farfield_fusion::body::skeleton::Joint;
use farfield_proto::keypoints::COCO17;
use farfield_proto::order_statistics::value_after;
use farfield_proto::tick::Tick;
use nalgebra::Vector3;
use serde::Serialize;

use super::baseline::Trajectory;
use super::baseline::outliers::Thresholds;
use super::run::SceneRun;
use farfield_sim::scene::SITE_JOINTS;

/// Kinds of keypoints, with their ranges in COCO's order.
const KINDS: [(&str, std::ops::Range<usize>); 7] = [
    ("face", 0..5),
    ("shoulders", 5..7),
    ("elbows", 7..9),
    ("wrists", 9..11),
    ("hips", 11..13),
    ("knees", 13..15),
    ("ankles", 15..17),
];
/// The scored points: all except the face.
const LIMBS: std::ops::Range<usize> = 5..17;
/// Speed from which a lag shows along the motion, m/s.
const MOVING_M_S: f64 = 0.5;
/// Share of prediction errors that the lattice must contain.
const HELD: f64 = 0.999;

/// A running mean.
#[derive(Debug, Clone, Copy, Default)]
struct Mean {
    sum: f64,
    n: u64,
}

impl Mean {
    fn add(&mut self, value: f64) {
        self.sum += value;
        self.n += 1;
    }

    fn get(self) -> Option<f64> {
        (self.n > 0).then(|| self.sum / self.n as f64)
    }
}

/// Sums of one kind of keypoint.
#[derive(Debug, Clone, Default)]
struct Sums {
    predicted: Mean,
    unsupported: Mean,
    lattice: Mean,
    ik1: Mean,
    filtered: Mean,
    ik2: Mean,
    ik2_site: Mean,
    dlt: Mean,
    definition: Mean,
    lag_ik1: Mean,
    lag_filtered: Mean,
    /// Per person and keypoint: the published error in the axes of the pelvis, summed.
    constant: BTreeMap<(usize, usize), (Vector3<f64>, u64)>,
    /// Largest axis of each prediction error, metres.
    prediction_axes_m: Vec<f64>,
}

/// Mean distances of one kind of keypoint, millimetres; `None` without data.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct KindBudget {
    /// `face`, `shoulders` and so on, or `limbs`: the 12 scored ones.
    pub kind: String,
    /// Prediction to site.
    pub predicted_mm: Option<f64>,
    /// Half width that contains 99.9 % of the prediction errors per axis.
    pub lattice_needed_mm: Option<f64>,
    /// Share without support by any view, percent.
    pub unsupported: Option<f64>,
    /// Lattice result to site, where supported.
    pub lattice_mm: Option<f64>,
    /// After the first inverse kinematics, to joint.
    pub ik1_mm: Option<f64>,
    /// After the filter, to joint.
    pub filtered_mm: Option<f64>,
    /// After the second inverse kinematics, to joint: the published pose.
    pub ik2_mm: Option<f64>,
    /// The same joint to the site.
    pub ik2_site_mm: Option<f64>,
    /// Part of the published error that is constant in the axes of the pelvis.
    pub constant_mm: Option<f64>,
    /// Signed error along the truth's velocity during motion, before the filter; minus is behind.
    pub along_ik1_mm: Option<f64>,
    /// The same after the filter.
    pub along_filtered_mm: Option<f64>,
    /// Triangulation without a filter, to site.
    pub dlt_mm: Option<f64>,
    /// Joint to site.
    pub definition_mm: Option<f64>,
}

/// The error budget of a scene.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Budget {
    /// The kinds, the limbs last.
    pub kinds: Vec<KindBudget>,
}

impl Budget {
    /// The budget of a run that kept its stages, and its peaks if it includes triangulation.
    pub fn measure(run: &SceneRun) -> Self {
        let dlt: Vec<Trajectory> = run
            .scene
            .people()
            .iter()
            .map(|who| {
                let ticks = run.scene.ticks();
                Trajectory::triangulated(
                    ticks.start..=ticks.end + -1,
                    run.keypoints.len(),
                    &run.views_of(who.number),
                    &run.pixel_from_world,
                    &Thresholds::default(),
                )
            })
            .collect();
        let mut of_keypoint = vec![Sums::default(); COCO17.len()];
        for (tick, person, stages) in run.matched_stages() {
            let Some(moment) = TrueMoment::at(run, tick, person) else {
                continue;
            };
            for (k, sums) in of_keypoint.iter_mut().enumerate() {
                let index = run.keypoints.index_of(COCO17[k]);
                sums.add(&moment, person, k, index, stages);
                if let Some(dlt) = index.and_then(|k| dlt[person].at(k, tick)) {
                    sums.dlt.add((dlt - moment.sites_m[k]).norm());
                }
            }
        }
        let limbs = [("limbs", LIMBS)];
        let kinds = KINDS.into_iter().chain(limbs);
        let kinds = kinds.map(|(kind, range)| KindBudget::from_sums(kind, &of_keypoint[range]));
        Self {
            kinds: kinds.collect(),
        }
    }
}

/// The truth of one person at one tick.
struct TrueMoment {
    joints_m: [Vector3<f64>; 17],
    sites_m: [Vector3<f64>; 17],
    velocity_m_s: [Vector3<f64>; 17],
    pelvis_from_world: nalgebra::Rotation3<f64>,
}

impl TrueMoment {
    fn at(run: &SceneRun, tick: Tick, person: usize) -> Option<Self> {
        let scene = &run.scene;
        let truth = |tick: Tick| scene.person_at(person, scene.time_s(tick));
        let now = truth(tick)?;
        let before = truth(tick + -1).unwrap_or_else(|| now.clone());
        let joints = |joints: &farfield_fusion::body::skeleton::Joints| {
            SITE_JOINTS.map(|joint: Joint| joints[joint.index()])
        };
        let (joints_m, before_m) = (joints(&now.joints_m), joints(&before.joints_m));
        let rate_hz = scene.rate_hz();
        let left = now.joint_m(Joint::LeftHip) - now.joint_m(Joint::RightHip);
        let up = now.joint_m(Joint::Spine) - now.joint_m(Joint::Pelvis);
        let pelvis_from_world = nalgebra::Rotation3::look_at_rh(&left, &up);
        Some(Self {
            velocity_m_s: std::array::from_fn(|k| (joints_m[k] - before_m[k]) * rate_hz),
            joints_m,
            sites_m: now.sites_m,
            pelvis_from_world,
        })
    }
}

impl Sums {
    fn add(
        &mut self,
        truth: &TrueMoment,
        person: usize,
        k: usize,
        index: Option<usize>,
        stages: &super::run::Stages,
    ) {
        let (joint, site) = (truth.joints_m[k], truth.sites_m[k]);
        if let Some(index) = index
            && let (Some(predicted), Some((lattice, supported))) =
                (stages.predicted_m.get(index), stages.lattice_m.get(index))
        {
            let off = predicted - site;
            self.predicted.add(off.norm());
            self.prediction_axes_m.push(off.amax());
            self.unsupported.add(if *supported { 0.0 } else { 1.0 });
            if *supported {
                self.lattice.add((lattice - site).norm());
            }
        }
        let at = |joints: &farfield_fusion::body::skeleton::Joints| joints[SITE_JOINTS[k].index()];
        let (ik1, filtered, ik2) = (at(&stages.ik1_m), at(&stages.filtered_m), at(&stages.ik2_m));
        self.ik1.add((ik1 - joint).norm());
        self.filtered.add((filtered - joint).norm());
        self.ik2.add((ik2 - joint).norm());
        self.ik2_site.add((ik2 - site).norm());
        self.definition.add((site - joint).norm());
        let speed = truth.velocity_m_s[k].norm();
        if speed > MOVING_M_S {
            let along = truth.velocity_m_s[k] / speed;
            self.lag_ik1.add((ik1 - joint).dot(&along));
            self.lag_filtered.add((filtered - joint).dot(&along));
        }
        let sum = self.constant.entry((person, k)).or_default();
        sum.0 += truth.pelvis_from_world * (ik2 - joint);
        sum.1 += 1;
    }
}

impl KindBudget {
    fn from_sums(kind: &str, keypoints: &[Sums]) -> Self {
        let mean = |of: fn(&Sums) -> Mean| {
            let mut all = Mean::default();
            for sums in keypoints {
                let one = of(sums);
                all.sum += one.sum;
                all.n += one.n;
            }
            all.get()
        };
        let mm = |of: fn(&Sums) -> Mean| mean(of).map(|m| 1000.0 * m);
        let mut constant = Mean::default();
        for (sum, n) in keypoints.iter().flat_map(|s| s.constant.values()) {
            constant.sum += sum.norm();
            constant.n += n;
        }
        let mut axes_m: Vec<f64> = keypoints
            .iter()
            .flat_map(|s| s.prediction_axes_m.iter().copied())
            .collect();
        axes_m.sort_by(f64::total_cmp);
        Self {
            kind: kind.to_owned(),
            predicted_mm: mm(|s| s.predicted),
            lattice_needed_mm: value_after(&axes_m, HELD).map(|m| 1000.0 * m),
            unsupported: mean(|s| s.unsupported).map(|share| 100.0 * share),
            lattice_mm: mm(|s| s.lattice),
            ik1_mm: mm(|s| s.ik1),
            filtered_mm: mm(|s| s.filtered),
            ik2_mm: mm(|s| s.ik2),
            ik2_site_mm: mm(|s| s.ik2_site),
            constant_mm: constant.get().map(|m| 1000.0 * m),
            along_ik1_mm: mm(|s| s.lag_ik1),
            along_filtered_mm: mm(|s| s.lag_filtered),
            dlt_mm: mm(|s| s.dlt),
            definition_mm: mm(|s| s.definition),
        }
    }
}

impl fmt::Display for Budget {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let heads = [
            "predict", "p99.9", "lost%", "lattice", "IK1", "filter", "IK2", "IK2site", "const",
            "alongIK1", "alongFil", "DLT", "def",
        ];
        write!(f, "{:>9}", "mm")?;
        for head in heads {
            write!(f, " {head:>8}")?;
        }
        for kind in &self.kinds {
            write!(f, "\n{:>9}", kind.kind)?;
            for value in [
                kind.predicted_mm,
                kind.lattice_needed_mm,
                kind.unsupported,
                kind.lattice_mm,
                kind.ik1_mm,
                kind.filtered_mm,
                kind.ik2_mm,
                kind.ik2_site_mm,
                kind.constant_mm,
                kind.along_ik1_mm,
                kind.along_filtered_mm,
                kind.dlt_mm,
                kind.definition_mm,
            ] {
                match value {
                    Some(value) => write!(f, " {value:>8.1}")?,
                    None => write!(f, " {:>8}", "-")?,
                }
            }
        }
        Ok(())
    }
}
