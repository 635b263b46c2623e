//! Parts of the method against those of the paper: the predictor, and the choice of the camera.

use std::collections::BTreeMap;
use std::fmt;
use std::sync::Arc;

use anyhow::Context as _;
use farfield_fusion::estimate::predict::Motion;
use farfield_proto::order_statistics::value_after;
use farfield_proto::tick::Tick;
use farfield_proto::venue::Parameters;
use farfield_proto::venue::parameters::{CameraChoice, PredictionParameters, Predictor};
use serde::Serialize;

use super::run::{SceneRun, SceneRunPlan};
use farfield_sim::scene::{SITE_JOINTS, Scene};
use farfield_sim::simulated::in_memory::Input;

/// Share of prediction errors, per axis, that a lattice must contain.
const HELD: f64 = 0.999;
/// Widest lattice to try, metres.
const WIDEST_M: f64 = 0.6;
/// Step of the lattices, metres.
const LATTICE_STEP_M: f64 = 0.05;

/// One variant of the method.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct MethodVariant {
    /// Its name.
    pub name: String,
    /// Mean error over actors, millimetres, live.
    pub mpjpe_mm: Option<f64>,
    /// Mean share of frames up to 150 mm, percent.
    pub success_150: Option<f64>,
    /// Frames without a pose, of all actors.
    pub gaps: u64,
    /// Changes of id, of all actors.
    pub id_switches: u64,
    /// Actors that were never found.
    pub never_found: usize,
    /// Ticks per second.
    pub rate_hz: f64,
    /// Half width of its lattice, millimetres.
    pub lattice_mm: f64,
    /// Half width that contains 99.9 % of the errors of its predictions one tick ahead, per axis, millimetres. The predictions are
    /// made from the poses of our own run; `None` if nothing was tracked, or the study does not include it.
    pub lattice_needed_mm: Option<f64>,
    /// Mean error of these predictions, millimetres.
    pub predicted_mm: Option<f64>,
}

/// A comparison of variants.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct MethodStudy {
    /// What is compared, and in which scene.
    pub name: String,
    /// The variants.
    pub variants: Vec<MethodVariant>,
}

/// The paper's predictor, eq. (3), against ours in `scene` at its rate and at half of it, each with the default lattice and
/// with the one that it needs.
///
/// # Errors
/// See [`SceneRun::make`]; also if the scene is still in use elsewhere.
pub fn predictors(name: &str, scene: Arc<Scene>) -> anyhow::Result<MethodStudy> {
    let mut variants = Vec::new();
    compare_predictors(&scene, &mut variants)?;
    let half_hz = scene.rate_hz() / 2.0;
    let scene = Arc::into_inner(scene).context("the scene is still in use")?;
    compare_predictors(&Arc::new(scene.with_rate(half_hz)), &mut variants)?;
    let name = format!("predictor in {name}");
    Ok(MethodStudy { name, variants })
}

fn compare_predictors(scene: &Arc<Scene>, variants: &mut Vec<MethodVariant>) -> anyhow::Result<()> {
    let with_stages = SceneRunPlan {
        keep_stages: true,
        ..SceneRunPlan::default()
    };
    let tracked = SceneRun::make(scene, &Input::Maps, with_stages)?;
    for (called, predictor) in [
        ("ours", PredictionParameters::default().predictor),
        ("paper (3)", Predictor::Paper),
    ] {
        let mut used = Parameters::default();
        used.prediction.predictor = predictor;
        let errors = PredictionErrors::measure(&tracked, &used.prediction);
        let needed_m = errors.as_ref().map(|errors| errors.needed_m);
        let mut fitting = used.clone();
        if let Some(needed_m) = needed_m {
            let steps = (needed_m / LATTICE_STEP_M).ceil().max(1.0);
            fitting.lattice.half_width_m = (steps * LATTICE_STEP_M).min(WIDEST_M);
        }
        for mut variant in compare(scene, [(called, used), (called, fitting)])? {
            variant.lattice_needed_mm = needed_m.map(|m| 1000.0 * m);
            variant.predicted_mm = errors.as_ref().map(|errors| 1000.0 * errors.mean_m);
            variants.push(variant);
        }
    }
    Ok(())
}

/// Errors of predictions one tick ahead from the true keypoints, metres.
struct PredictionErrors {
    mean_m: f64,
    needed_m: f64,
}

impl PredictionErrors {
    /// The errors of `prediction` from the poses of `run`; `None` without any.
    fn measure(run: &SceneRun, prediction: &PredictionParameters) -> Option<Self> {
        let dt_s = 1.0 / run.scene.rate_hz();
        let mut motions: BTreeMap<usize, (Tick, Motion)> = BTreeMap::new();
        let (mut axes_m, mut sum_m) = (Vec::new(), 0.0);
        for (tick, person, stages) in run.matched_stages() {
            let last = motions.remove(&person).filter(|(at, _)| tick - *at == 1);
            let truth = run.scene.person_at(person, run.scene.time_s(tick));
            if let (Some((_, motion)), Some(truth)) = (&last, truth) {
                let mut ahead_m = stages.ik2_m;
                motion.predict(1.0, dt_s, prediction, &mut ahead_m);
                for (joint, site_m) in SITE_JOINTS.iter().zip(&truth.sites_m) {
                    let off_m = ahead_m[joint.index()] - site_m;
                    sum_m += off_m.norm();
                    axes_m.push(off_m.amax());
                }
            }
            let mut motion =
                last.map_or_else(|| Motion::at_rest(stages.ik2_m), |(_, motion)| motion);
            motion.push(&stages.ik2_m, &stages.velocity_m_s);
            motions.insert(person, (tick, motion));
        }
        axes_m.sort_by(f64::total_cmp);
        let needed_m = value_after(&axes_m, HELD)?;
        Some(Self {
            mean_m: sum_m / axes_m.len() as f64,
            needed_m,
        })
    }
}

/// The paper's choice of the camera, eq. (5), against ours in `scene`.
///
/// # Errors
/// See [`SceneRun::make`].
pub fn camera_choices(name: &str, scene: &Arc<Scene>) -> anyhow::Result<MethodStudy> {
    let with = |choice| {
        let mut parameters = Parameters::default();
        parameters.boxes.camera_choice = choice;
        parameters
    };
    let variants = compare(
        scene,
        [
            ("ours", with(CameraChoice::BestView)),
            ("paper (5)", with(CameraChoice::NearestCenter)),
        ],
    )?;
    let name = format!("camera choice in {name}");
    Ok(MethodStudy { name, variants })
}

/// Runs `scene` with both parameters, over the same maps.
fn compare(
    scene: &Arc<Scene>,
    named: [(&str, Parameters); 2],
) -> anyhow::Result<Vec<MethodVariant>> {
    let lattices_m = named.each_ref().map(|(_, p)| p.lattice.half_width_m);
    let names = named.each_ref().map(|(name, _)| *name);
    let plans = named.map(|(_, parameters)| SceneRunPlan::with(parameters));
    let runs = SceneRun::make_all(scene, &Input::Maps, plans)?;
    let runs = names.into_iter().zip(runs).zip(lattices_m);
    Ok(runs
        .map(|((name, run), half_width_m)| MethodVariant {
            lattice_mm: 1000.0 * half_width_m,
            ..MethodVariant::measure(name, &run)
        })
        .collect())
}

impl MethodVariant {
    fn measure(name: &str, run: &SceneRun) -> Self {
        let first_ticks = run.first_ticks();
        let scores = run.score(&run.causal);
        Self {
            name: name.to_owned(),
            mpjpe_mm: scores.mean.mpjpe_mm,
            success_150: scores.mean.success_150,
            gaps: scores.actors.values().map(|a| a.gaps).sum(),
            id_switches: scores.identity.switches,
            never_found: scores.actors.len().saturating_sub(first_ticks.len()),
            rate_hz: run.scene.rate_hz(),
            lattice_mm: 0.0,
            lattice_needed_mm: None,
            predicted_mm: None,
        }
    }
}

impl fmt::Display for MethodStudy {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{}\n{:>12} {:>6} {:>10} {:>10} {:>9} {:>8} {:>7} {:>6} {:>4} {:>6}",
            self.name,
            "",
            "Hz",
            "lattice mm",
            "needed mm",
            "predicts",
            "MPJPE mm",
            "SR@150",
            "gaps",
            "ids",
            "never"
        )?;
        let some = |value: Option<f64>| value.map_or_else(|| "-".to_owned(), |v| format!("{v:.1}"));
        for v in &self.variants {
            write!(
                f,
                "\n{:>12} {:>6.0} {:>10.0} {:>10} {:>9} {:>8} {:>7} {:>6} {:>4} {:>6}",
                v.name,
                v.rate_hz,
                v.lattice_mm,
                some(v.lattice_needed_mm),
                some(v.predicted_mm),
                some(v.mpjpe_mm),
                some(v.success_150),
                v.gaps,
                v.id_switches,
                v.never_found
            )?;
        }
        Ok(())
    }
}
