//! `lab suite`: fixed scenes through the whole system in this process, scored against plain triangulation of the same maps.
//! `lab agreement`: false alarms about cameras in scenes without wrong cameras.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context as _, anyhow};
use farfield::output;
use farfield_fusion::camera_agreement::AgreementReport;
use farfield_node::process::NodeError;
use farfield_proto::venue::Parameters;
use farfield_score::uncertainty_calibration::UncertaintyCalibration;
use farfield_sim::embedded::{write_detector, write_network};
use farfield_sim::scene::Scene;
use farfield_sim::simulated::in_memory::{Input, sources_of, venue_of};
use farfield_sim::simulated::without_map_faults;
use serde::Serialize;
use tempfile::TempDir;

use super::recordings_folder;
use crate::in_process::InProcess;
use crate::suite::report::bars::{BarVerdict, verdicts};
use crate::suite::report::limits::behind_limits;
use crate::suite::report::{Overview, SceneReport};
use crate::suite::scenes::{NamedScene, choose};
use crate::suite::studies::{MethodStudy, camera_choices, predictors};

/// Arguments of `lab suite`.
#[expect(
    clippy::struct_excessive_bools,
    reason = "each is a switch of the command line"
)]
#[derive(Debug, Clone, clap::Args)]
pub(crate) struct SuiteArgs {
    /// Suites (paper, identity, hiccups, own), scene files or embedded scenes, run in this process with and without range of
    /// motion, and scored against plain triangulation. The fixed scenes are below `$FARFIELD_DATA`, else ../shared; if they are
    /// missing, scenes of the project's own clips run.
    #[arg(value_name = "NAME|FILE", required = true)]
    scenes: Vec<String>,
    /// Run the scenes at this rate instead of their own, ticks per second.
    #[arg(long, value_name = "HZ", value_parser = rate_hz)]
    rate_hz: Option<f64>,
    /// Print JSON instead of tables.
    #[arg(long)]
    json: bool,
    /// Plot the error of each actor over time as SVG to this folder, one file per scene.
    #[arg(long, value_name = "DIR")]
    plot: Option<PathBuf>,
    /// Render images and read them with the embedded networks, instead of making maps from the truth.
    #[arg(long)]
    pixels: bool,
    /// With `--pixels`: give people by hand where they come in, instead of detecting them.
    #[arg(long, requires = "pixels")]
    given: bool,
    /// Use only the first seconds of each scene.
    #[arg(long, value_name = "S")]
    seconds: Option<f64>,
    /// Exit with code 1 if a figure is worse than its loose limit; omits the studies of single parts.
    #[arg(long)]
    check: bool,
}

fn rate_hz(text: &str) -> Result<f64, String> {
    let rate = text.parse().ok();
    rate.filter(|rate: &f64| rate.is_finite() && *rate > 0.0)
        .ok_or_else(|| format!("found {text}, expected a number above 0"))
}

/// All figures of a suite for `--json`.
#[derive(Debug, Serialize)]
struct SuiteReport {
    /// Which scenes are replaced or left out, and why.
    note: Option<String>,
    scenes: Vec<SceneReport>,
    studies: Vec<MethodStudy>,
    bars: Vec<BarVerdict>,
    /// Reported standard deviations of the live poses of all scenes against their errors.
    calibration: UncertaintyCalibration,
    /// Figures worse than the loose limits.
    behind_limits: Vec<String>,
}

/// Runs the suites and scenes of `args`, and prints their figures: the table of each scene when it is ready, or JSON at the
/// end.
///
/// # Errors
/// A scene is missing or wrong, none is left to run, a run fails, a plot cannot be written, or with `--check` a figure is
/// worse than its limit.
pub(crate) fn suite(args: &SuiteArgs) -> Result<(), NodeError> {
    let root = recordings_folder();
    let mut chosen = choose(&args.scenes, &root).map_err(NodeError::Refused)?;
    if args.pixels {
        chosen.leave_out_mirrors();
    }
    if chosen.scenes.is_empty() {
        let why = chosen.note.unwrap_or_default();
        return Err(NodeError::Refused(anyhow!(
            "no scene is left to run: {why}"
        )));
    }
    let (input, _network) = input(args).map_err(NodeError::Failed)?;
    if let Some(folder) = &args.plot {
        std::fs::create_dir_all(folder)
            .with_context(|| format!("creating {}", folder.display()))
            .map_err(NodeError::Refused)?;
    }
    let say = |text: &str| {
        if args.json {
            Ok(())
        } else {
            output::print(&format!("{text}\n"))
        }
    };
    if let Some(note) = &chosen.note {
        say(&format!("NOTE: {note}\n")).map_err(NodeError::Failed)?;
    }
    let report = run(args, &input, chosen.scenes, chosen.note, &say).map_err(NodeError::Failed)?;
    if args.json {
        let text = serde_json::to_string_pretty(&report).map_err(NodeError::failed)?;
        output::print(&format!("{text}\n")).map_err(NodeError::Failed)?;
    }
    if args.check && !report.behind_limits.is_empty() {
        let text = report.behind_limits.join("\n");
        return Err(NodeError::Failed(anyhow!("behind its limit: {text}")));
    }
    Ok(())
}

fn run(
    args: &SuiteArgs,
    input: &Input,
    scenes: Vec<NamedScene>,
    note: Option<String>,
    say: &dyn Fn(&str) -> anyhow::Result<()>,
) -> anyhow::Result<SuiteReport> {
    let mut report = SuiteReport {
        note,
        scenes: Vec::new(),
        studies: Vec::new(),
        bars: Vec::new(),
        calibration: UncertaintyCalibration::default(),
        behind_limits: Vec::new(),
    };
    for NamedScene { name, scene, cuts } in scenes {
        let mut scene = scene;
        if let Some(seconds) = args.seconds {
            scene = scene.shortened(seconds);
        }
        if let Some(rate_hz) = args.rate_hz {
            scene = scene.with_rate(rate_hz);
        }
        if args.pixels {
            scene = without_map_faults(scene);
        }
        let scene = Arc::new(scene);
        let of_scene = SceneReport::make(&name, &scene, cuts, input)
            .with_context(|| format!("running scene {name}"))?;
        say(&format!("{of_scene}\n"))?;
        if let Some(folder) = &args.plot {
            write_plot(&folder.join(format!("{}.svg", file_name(&name))), &of_scene)?;
        }
        if let Some(calibration) = &of_scene.with_range_of_motion.calibration {
            report.calibration.add(calibration);
        }
        report.scenes.push(of_scene);
        if *input == Input::Maps && !args.check {
            for study in studies(&name, scene)? {
                say(&format!("{study}\n"))?;
                report.studies.push(study);
            }
        }
    }
    if report.scenes.len() > 1 && !report.calibration.is_empty() {
        say(&format!("all scenes\n{}\n", report.calibration))?;
    }
    say(&format!("{}\n", Overview(&report.scenes)))?;
    report.bars = verdicts(&report.scenes);
    report.behind_limits = behind_limits(&report.scenes);
    if args.seconds.is_none() && args.rate_hz.is_none() {
        let lines: Vec<String> = report.bars.iter().map(ToString::to_string).collect();
        say(&format!("bars\n{}", lines.join("\n")))?;
    }
    Ok(report)
}

/// The studies of a scene of this name.
fn studies(name: &str, scene: Arc<Scene>) -> anyhow::Result<Vec<MethodStudy>> {
    if name.ends_with("futsal") {
        return Ok(vec![camera_choices(name, &scene)?]);
    }
    if !name.ends_with("sprint") {
        return Ok(Vec::new());
    }
    Ok(vec![predictors(name, scene)?])
}

/// The input of the cameras, and the folder of the networks, which must live as long as they are used.
fn input(args: &SuiteArgs) -> anyhow::Result<(Input, Option<TempDir>)> {
    if !args.pixels {
        return Ok((Input::Maps, None));
    }
    let folder = tempfile::tempdir().context("making a folder for the embedded networks")?;
    let network = folder.path().join(write_network(folder.path())?);
    let detector = if args.given {
        None
    } else {
        Some(folder.path().join(write_detector(folder.path())?))
    };
    Ok((Input::Pixels { network, detector }, Some(folder)))
}

fn file_name(scene: &str) -> String {
    scene.replace(' ', "-")
}

fn write_plot(path: &Path, report: &SceneReport) -> anyhow::Result<()> {
    std::fs::write(path, report.plot()).with_context(|| format!("writing {}", path.display()))
}

/// Arguments of `lab agreement`.
#[derive(Debug, clap::Args)]
pub(super) struct AgreementArgs {
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
pub(super) fn agreement(args: &AgreementArgs) -> Result<(), NodeError> {
    let root = recordings_folder();
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
        alarms.extend(
            report
                .warnings()
                .map(|warning| format!("[{name}] {warning}")),
        );
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

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Debug, clap::Parser)]
    struct SuiteLine {
        #[command(flatten)]
        args: SuiteArgs,
    }

    fn parsed(words: &[&str]) -> Result<SuiteArgs, clap::Error> {
        let words = [&["suite"], words].concat();
        <SuiteLine as clap::Parser>::try_parse_from(words).map(|line| line.args)
    }

    #[test]
    fn at_least_one_scene_is_required() {
        assert!(parsed(&[]).is_err());
        assert!(parsed(&["own", "--given"]).is_err());
        let args = parsed(&["own", "x.toml", "--seconds", "2", "--json"]).unwrap();
        assert_eq!(args.scenes, ["own", "x.toml"]);
        assert!(args.json && args.seconds == Some(2.0));
    }

    #[test]
    fn an_invalid_rate_is_refused() {
        assert_eq!(
            parsed(&["own", "--rate-hz", "30"]).unwrap().rate_hz,
            Some(30.0)
        );
        for rate in ["0", "-5", "inf", "fast"] {
            assert!(
                parsed(&["own", &format!("--rate-hz={rate}")]).is_err(),
                "{rate}"
            );
        }
    }
}
