//! `lab agreement`: false alarms in scenes in which cameras run on clocks of their own and networks err.

use std::path::PathBuf;
use std::sync::Arc;

use anyhow::anyhow;
use farfield::output;
use farfield_fusion::camera_agreement::AgreementReport;
use farfield_node::process::NodeError;
use farfield_proto::venue::Parameters;
use farfield_sim::scene::Scene;
use farfield_sim::simulated::in_memory::{Input, sources_of, venue_of};

use super::DATA;
use crate::in_process::InProcess;
use crate::suite::scenes::{NamedScene, choose};

/// Arguments of `lab agreement`.
#[derive(Debug, clap::Args)]
pub(in crate::commands) struct AgreementArgs {
    /// Suites, scene files or embedded scenes, as in `lab suite`.
    #[arg(value_name = "NAME|FILE", default_value = "paper")]
    scenes: Vec<String>,
    /// Use only the first seconds of each scene.
    #[arg(long, value_name = "S", default_value_t = 12.0)]
    seconds: f64,
    /// Capture with all cameras at the ticks.
    #[arg(long)]
    synchronised: bool,
}

/// Runs every scene from maps with its faults, and prints a line per camera and all warnings.
///
/// # Errors
/// A scene is missing or wrong, a run fails, or there is a warning about a camera.
pub(in crate::commands) fn agreement(args: &AgreementArgs) -> Result<(), NodeError> {
    let root = std::env::var_os("FARFIELD_DATA").map_or_else(|| PathBuf::from(DATA), PathBuf::from);
    let chosen = choose(&args.scenes, &root).map_err(NodeError::Refused)?;
    if let Some(note) = &chosen.note {
        output::print(&format!("NOTE: {note}\n")).map_err(NodeError::Failed)?;
    }
    let (mut alarms, n) = (Vec::new(), chosen.scenes.len());
    for NamedScene { name, scene, .. } in chosen.scenes {
        let mut scene = scene.shortened(args.seconds);
        if !args.synchronised {
            let mut faults = scene.faults().clone();
            faults.free_running = true;
            scene = scene.with_faults(faults);
        }
        let report = report(&Arc::new(scene)).map_err(NodeError::Failed)?;
        let lines = report.lines().join("\n  ");
        output::print(&format!("[{name}]\n  {lines}\n")).map_err(NodeError::Failed)?;
        alarms.extend(report.warnings().map(|warning| format!("[{name}] {warning}")));
    }
    output::print(&format!("{n} scenes, {} false alarms\n", alarms.len()))
        .map_err(NodeError::Failed)?;
    if alarms.is_empty() {
        return Ok(());
    }
    Err(NodeError::Failed(anyhow!(
        "false alarms:\n{}",
        alarms.join("\n")
    )))
}

fn report(scene: &Arc<Scene>) -> anyhow::Result<AgreementReport> {
    let venue = venue_of(scene, &Input::Maps, Parameters::default());
    let sources = sources_of(scene, &Input::Maps)?;
    let mut nodes = InProcess::new(venue, sources, scene.ticks())?;
    while nodes.step()?.is_some() {}
    Ok(nodes.agreement())
}
