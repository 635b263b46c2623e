//! What can be said on the command line. Wrong usage ends with exit code 2.
//!
//! `-h` of every command fits a terminal of 24 rows and 80 columns and has an example: the first paragraph of an
//! option's text is all of it there, the others are for `--help`.

use std::ffi::{OsStr, OsString};
use std::process::ExitCode;

use clap::{Parser, Subcommand};
use farfield_edge::node::EdgeArgs;
use farfield_fusion::node::RecordArgs;
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
use crate::parameters::ParametersArgs;
use crate::run::RunArgs;
use crate::simulate::SimulateArgs;
use crate::status::StatusArgs;

/// Markerless motion capture for wide fields.
///
/// Exit codes: 0 done, 1 ran but failed, 2 wrong input or usage, 130 interrupted. With `--json` what went wrong is JSON,
/// too: `{"error": ..., "exit_code": 2}`. `RUST_LOG=debug` says more of what happens. `farfield completions` and
/// `farfield man` are for whoever installs it, `farfield evaluate` for who has a truth.
#[derive(Debug, Parser)]
#[command(
    name = "farfield",
    version,
    // As many commands as there are leave no rows for more, not even for the empty one that comes before `{after-help}`.
    help_template = "{about}\nUsage: {usage}\n{subcommands}\n\
                     Example: farfield demo    (-h after a command: its options; --help: all of it)"
)]
pub(crate) struct FarfieldCli {
    #[command(subcommand)]
    pub(crate) command: FarfieldCommand,
}

/// One thing to do.
#[derive(Debug, Subcommand)]
pub(crate) enum FarfieldCommand {
    /// Run all nodes of a venue on this machine.
    #[command(after_help = "Example: farfield run hall.toml --ticks 300..900 --overlay")]
    Run(RunArgs),
    /// Look whether a venue can be run.
    ///
    /// Files, sources, calibration, networks; draws what every camera sees.
    #[command(after_help = "Example: farfield check hall.toml --out looks/")]
    Check(CheckArgs),
    /// Look whether this machine can do what a venue asks of it.
    ///
    /// Inference, programs, disk, clock, ports, keys.
    #[command(after_help = "Example: farfield doctor hall.toml")]
    Doctor(DoctorArgs),
    /// Make a venue of a folder of recordings and a calibration.
    #[command(after_help = "Example: farfield init recordings/ --calibration calibration.toml")]
    Init(InitArgs),
    /// Make a venue of keypoints that another program has found.
    ///
    /// Pose2Sim, `OpenPose`, `AlphaPose`, COCO, `MMPose`, `DeepLabCut`, SLEAP, Caliscope, `FreeMoCap`; with its calibration.
    #[command(after_help = "Example: farfield import my-pose2sim-trial --rate 60")]
    Import(ImportArgs),
    /// Find how cameras see and where they stand.
    ///
    /// From pictures of a board, from a point that was carried through the field, from another program's files.
    #[command(after_help = "Example: farfield calibrate points seen/*.txt --lens lenses.toml")]
    Calibrate(Box<CalibrateArgs>),
    /// Start the edge node of one viewpoint.
    #[command(after_help = "Example: farfield edge hall.toml --viewpoint north-east --from-fusion")]
    Edge(EdgeArgs),
    /// Start the fusion node.
    #[command(after_help = "Example: farfield fusion hall.toml --live --listen quic/10.0.0.1:7447")]
    Fusion(FusionCommandArgs),
    /// Record everything that is said in a venue, as an MCAP file.
    #[command(after_help = "Example: farfield record hall.toml --out recordings/")]
    Record(RecordArgs),
    /// Show how the nodes of a running venue are.
    #[command(after_help = "Example: farfield status hall.toml --watch")]
    Status(StatusArgs),
    /// Solve a recording again, as it was or otherwise.
    #[command(after_help = "Example: farfield replay hall.mcap --set smoothing.cutoff_hz=3")]
    Replay(ReplayCommandArgs),
    /// Look at a recording in a browser.
    #[command(after_help = "Example: farfield view hall.mcap")]
    View(ViewArgs),
    /// List every parameter of a venue file.
    ///
    /// With unit, default, range and what it is.
    #[command(after_help = "Example: farfield parameters")]
    Parameters(ParametersArgs),
    /// Score poses against a truth.
    #[command(
        hide = true,
        after_help = "Example: farfield evaluate out/poses.jsonl truth.jsonl"
    )]
    Evaluate(EvaluateArgs),
    /// Write the poses of a run for other programs.
    ///
    /// Animation, biomechanics, tables: BVH, glTF, C3D, CSV, Parquet, `OpenSim` models.
    #[command(after_help = "Example: farfield export out --format glb,c3d --name 1=Ada")]
    Export(ExportArgs),
    /// List who is in a run or recording; name, merge, split people.
    ///
    /// What is done is a line in a file beside the run or recording, which exports heed, and can be undone.
    #[command(after_help = "Example: farfield people out name 3 Anna")]
    People(PeopleArgs),
    /// Show it all at work on simulated people, scored.
    ///
    /// People who do not exist, cameras that see them, every node of a venue around them, and how far the poses are from
    /// the truth.
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
    /// Measure how many people this machine carries.
    ///
    /// People and viewpoints, and at which rate.
    #[command(after_help = "Example: farfield bench --viewpoints 4 --people 8")]
    Bench(BenchArgs),
    /// Print what a shell needs to complete commands.
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
    /// What this process was told; else its exit code, when all is said: help that was asked for, or wrong usage.
    pub(crate) fn of_process() -> Result<Self, ExitCode> {
        let words = joined(std::env::args_os());
        Self::try_parse_from(&words).map_err(|error| {
            // Where nobody reads there is nobody to tell.
            drop(error.print());
            if let Some(word) = words.get(1).filter(|word| is_venue(word)) {
                let word = word.display();
                say(format_args!("tip: `farfield run {word}` runs a venue"));
            }
            if error.use_stderr() && words.iter().any(|word| word == "--json") {
                let said = error.to_string();
                let said = said.trim().strip_prefix("error: ").unwrap_or(said.trim());
                say_json(said, EXIT_REFUSED);
            }
            u8::try_from(error.exit_code()).map_or(ExitCode::FAILURE, ExitCode::from)
        })
    }
}

/// `words` with the values of options that can do without one joined to them: `--overlay 42` is `--overlay=42`, but what
/// follows `--overlay` in `run --overlay hall.toml` is the venue.
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

/// Whether a word may be meant for ticks: venues, scenes and recordings are called otherwise.
fn is_tick(word: &OsStr) -> bool {
    let bytes = word.as_encoded_bytes();
    let digits = bytes.strip_prefix(b"-").unwrap_or(bytes);
    digits.first().is_some_and(u8::is_ascii_digit) && !is_venue(word) && !bytes.ends_with(b".mcap")
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory as _;

    use super::*;

    /// A terminal as terminals have been since they had a size.
    const ROWS: usize = 24;
    const COLUMNS: usize = 80;

    #[test]
    fn the_command_line_is_consistent() {
        FarfieldCli::command().debug_assert();
    }

    /// Every command, and those below it: `calibrate`, `calibrate board` and so on.
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
        assert!(nested, "commands below commands are looked at, too");
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
    fn every_example_is_understood() {
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
    fn an_option_that_can_do_without_a_value_does_not_eat_the_venue() {
        for (said, understood) in [
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
            assert_eq!(words(said), understood);
        }
        let parsed = FarfieldCli::try_parse_from(["farfield", "run", "--overlay", "hall.toml"]);
        let FarfieldCommand::Run(args) = parsed.unwrap().command else {
            unreachable!("it is a run");
        };
        assert_eq!(args.venue, std::path::Path::new("hall.toml"));
        assert_eq!(args.overlay, Some(None));
    }

    #[test]
    fn what_may_follow_an_option_without_a_value_is_understood_of_every_command_that_has_it() {
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
