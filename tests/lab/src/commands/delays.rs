//! `lab delays`: the value of a delay: live, smoothed with 50, 100 and 200 ms, and in two passes, over the same maps.

use std::sync::Arc;

use farfield::output;
use farfield_node::process::NodeError;
use farfield_score::lines::PoseLines;
use farfield_sim::scene::Scene;

use super::scenes::SceneArgument;
use crate::conditions::Cuts;
use crate::suite::run::parameters;
use crate::suite::run::{SceneRun, SceneRunPlan};
use crate::suite::smoothed::{HEAD, OutputScore};
use farfield_sim::simulated::in_memory::Input;

/// The compared outputs, the live one first.
const OUTPUTS: [&str; 5] = ["live", "50 ms", "100 ms", "200 ms", "two passes"];

/// Arguments of `lab delays`.
///
/// `in cuts` and `worst` are mean and largest error of a person at the ticks of the cuts.
#[derive(Debug, clap::Args)]
pub(super) struct DelaysArgs {
    /// Scene files, or names of embedded scenes.
    #[arg(value_name = "SCENE", required = true)]
    scenes: Vec<SceneArgument>,
    /// Use only the first seconds of each scene.
    #[arg(long, value_name = "S", default_value_t = 5.0)]
    seconds: f64,
    /// Cut fusion off for LASTS seconds in every EVERY seconds.
    #[arg(long, value_names = ["EVERY", "LASTS"], num_args = 2)]
    cuts: Option<Vec<f64>>,
    /// Deliver the cut messages so many ticks later.
    #[arg(long, value_name = "TICKS", requires = "cuts")]
    late: Option<i64>,
}

/// Runs every scene with every delay, and prints the scores.
///
/// # Errors
/// A scene is missing or wrong, or a run fails.
pub(super) fn delays(args: &DelaysArgs) -> Result<(), NodeError> {
    let scenes = args
        .scenes
        .iter()
        .map(|scene| Ok((scene.name(), scene.load()?)));
    let scenes: Vec<(&str, Scene)> = scenes.collect::<Result<_, NodeError>>()?;
    compare(args, scenes).map_err(NodeError::Failed)
}

fn compare(args: &DelaysArgs, scenes: Vec<(&str, Scene)>) -> anyhow::Result<()> {
    for head in HEAD {
        output::print(&format!("{:27} {head}\n", ""))?;
    }
    let n = scenes.len() as f64;
    let mut sums = [[0.0; 2]; OUTPUTS.len()];
    for (name, scene) in scenes {
        let scene = Arc::new(scene.shortened(args.seconds));
        let cuts = args.cuts(scene.rate_hz());
        let runs = SceneRun::make_all(&scene, &Input::Maps, plans(cuts)?)?;
        let live = std::iter::once((&runs[0], &runs[0].causal));
        let outputs = live.chain(runs.iter().map(|run| (run, &run.smoothed)));
        let named: Vec<(&str, (&SceneRun, &PoseLines))> =
            OUTPUTS.into_iter().zip(outputs).collect();
        for ((output, (run, poses)), sum) in named.into_iter().zip(&mut sums) {
            let score = OutputScore::measure(run, poses, cuts);
            sum[0] += score.mean.mpjpe_mm.unwrap_or(f64::NAN);
            sum[1] += score.mean.jitter_m_s3.unwrap_or(f64::NAN);
            output::print(&format!("{name:>16} {output:>10} {score}\n"))?;
        }
    }
    for (output, [mpjpe_mm, jitter]) in OUTPUTS.iter().zip(sums.map(|sum| sum.map(|s| s / n))) {
        let name = "mean";
        output::print(&format!(
            "{name:>16} {output:>10} {mpjpe_mm:7.2} {:7} {jitter:7.0}\n",
            ""
        ))?;
    }
    Ok(())
}

impl DelaysArgs {
    /// The cuts in ticks at this rate.
    fn cuts(&self, rate_hz: f64) -> Option<Cuts> {
        let [every, lasts] = self.cuts.as_deref()?.try_into().ok()?;
        let ticks = |seconds: f64| (seconds * rate_hz).round() as i64;
        Some(Cuts {
            every: ticks(every),
            lasts: ticks(lasts),
            late: self.late,
        })
    }
}

fn plans(cuts: Option<Cuts>) -> anyhow::Result<[SceneRunPlan; 4]> {
    let plan = |delay_ms: u32| -> anyhow::Result<SceneRunPlan> {
        let parameters = parameters(&format!("smoothing.delay_ms = {delay_ms}.0"))?;
        Ok(SceneRunPlan {
            cuts,
            ..SceneRunPlan::with(parameters)
        })
    };
    let two_passes = SceneRunPlan {
        two_passes: true,
        ..plan(0)?
    };
    Ok([plan(50)?, plan(100)?, plan(200)?, two_passes])
}
