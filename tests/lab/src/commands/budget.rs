//! `lab budget`: one scene with changed parameters: its scores, and the error after each stage.

use std::fmt::Write as _;
use std::sync::Arc;

use farfield::output;
use farfield_node::process::NodeError;
use farfield_score::table;
use farfield_sim::fault_profile::FaultProfile;

use super::scenes::SceneArgument;
use crate::conditions::{Cuts, FarLinks};
use crate::suite::budget::Budget;
use crate::suite::report::Baseline;
use crate::suite::run::parameters;
use crate::suite::run::{SceneRun, SceneRunPlan};
use farfield_sim::simulated::in_memory::Input;

/// Arguments of `lab budget`.
///
/// Columns of the budget: `predict` prediction to site, `p99.9` half width of a lattice that contains 99.9 % of the
/// prediction errors, `lost%` without support, `lattice` to site, `IK1`, `filter`, `IK2` to joint, `IK2site` to site, `const`
/// the part of IK2 that is constant in the axes of the pelvis, `along*` signed error along the motion (minus is behind),
/// `DLT` to site without a filter, `def` joint to site.
#[expect(clippy::struct_excessive_bools, reason = "the flags of a command line")]
#[derive(Debug, clap::Args)]
pub(super) struct BudgetArgs {
    /// A scene file, or the name of an embedded scene.
    scene: SceneArgument,
    /// Use only the first seconds.
    #[arg(long, value_name = "S")]
    seconds: Option<f64>,
    /// Change a parameter, as in a venue file; VALUE is TOML.
    #[arg(long, value_name = "TABLE.FIELD=VALUE")]
    set: Vec<String>,
    /// Run without the scene's faults.
    #[arg(long)]
    no_faults: bool,
    /// Run at this rate instead of the scene's, ticks per second.
    #[arg(long, value_name = "HZ")]
    rate_hz: Option<f64>,
    /// Omit plain triangulation.
    #[arg(long)]
    no_dlt: bool,
    /// Print a line for every actor.
    #[arg(long)]
    actors: bool,
    /// Print the identity events by tick.
    #[arg(long)]
    events: bool,
    /// Solve in two passes, with later data.
    #[arg(long)]
    two_passes: bool,
    /// Print the reported standard deviations against the errors.
    #[arg(long)]
    sureness: bool,
    /// Cut fusion off from all edges for this many ticks ...
    #[arg(long, value_name = "TICKS", default_value_t = 0)]
    cut: i64,
    /// ... in every period of this many.
    #[arg(long, value_name = "TICKS", default_value_t = 120)]
    cut_every: i64,
    /// Simulate links with this delay: boxes are used so many ticks after the one that made them.
    #[arg(long, value_name = "TICKS", default_value_t = FarLinks::default().ahead)]
    ahead: i64,
    /// Share of messages lost each way on such links.
    #[arg(long, value_name = "SHARE", default_value_t = 0.0)]
    loss: f64,
    /// Seed of the losses.
    #[arg(long, value_name = "N", default_value_t = FarLinks::default().seed)]
    seed: u64,
}

/// Runs the scene and prints its scores.
///
/// # Errors
/// The scene or a parameter is missing or wrong, or the run fails.
pub(super) fn budget(args: &BudgetArgs) -> Result<(), NodeError> {
    let mut scene = args.scene.load()?;
    if let Some(seconds) = args.seconds {
        scene = scene.shortened(seconds);
    }
    if let Some(rate_hz) = args.rate_hz {
        scene = scene.with_rate(rate_hz);
    }
    if args.no_faults {
        scene = scene.with_faults(FaultProfile::none());
    }
    let plan = SceneRunPlan {
        parameters: parameters(&args.set.join("\n")).map_err(NodeError::refused)?,
        keep_peaks: !args.no_dlt,
        keep_stages: true,
        cuts: (args.cut > 0).then_some(Cuts {
            every: args.cut_every,
            lasts: args.cut,
            late: None,
        }),
        links: FarLinks {
            ahead: args.ahead,
            loss: args.loss,
            seed: args.seed,
        },
        two_passes: args.two_passes,
        stand_in: None,
    };
    let run = SceneRun::make(&Arc::new(scene), &Input::Maps, plan).map_err(NodeError::Failed)?;
    let text = text_of(args, &run).map_err(NodeError::failed)?;
    output::print(&text).map_err(NodeError::Failed)
}

fn text_of(args: &BudgetArgs, run: &SceneRun) -> Result<String, std::fmt::Error> {
    let mut text = String::new();
    let scores = run.score(&run.finished);
    let mut sureness = vec![("ours", scores.calibration.clone())];
    writeln!(text, "{}", table::head(10))?;
    if args.actors {
        for (actor, score) in &scores.actors {
            writeln!(
                text,
                "{}",
                table::line(10, &actor.to_string(), &score.row())
            )?;
        }
    }
    writeln!(text, "{}", table::line(10, "ours", &scores.mean.row()))?;
    if run.smoothed.ticks().next().is_some() {
        let smoothed = run.score(&run.smoothed);
        writeln!(
            text,
            "{}",
            table::line(10, "smoothed", &smoothed.mean.row())
        )?;
        sureness.push(("smoothed", smoothed.calibration));
    }
    if !args.no_dlt {
        let baseline = Baseline::best(run);
        let name = format!("DLT {} Hz", baseline.cutoff_hz);
        writeln!(
            text,
            "{}",
            table::line(10, &name, &baseline.scores.mean.row())
        )?;
    }
    if args.events {
        for (tick, event) in &run.events {
            writeln!(text, "{:>8} {event}", tick.0)?;
        }
        for change in run.id_changes(&run.finished) {
            writeln!(text, "{change}")?;
        }
    }
    writeln!(text, "{}", scores.identity_line())?;
    for (name, calibration) in sureness {
        if let Some(calibration) = calibration.filter(|_| args.sureness) {
            writeln!(text, "{name}: {calibration}")?;
        }
    }
    writeln!(text, "{}", Budget::measure(run))?;
    Ok(text)
}
