//! The command `farfield`: runs venues, inspects and exports results, and makes venues to try it on.
//!
//! Read [`main`] first: each command is a module of this crate, or a call to the node that it starts. `farfield run`
//! starts the nodes of a venue as processes of its own, each again this program (`farfield edge`, `farfield fusion`);
//! `farfield simulate` and `farfield demo` make the folder of a simulated venue, and the demo runs it.
//!
//! It is a library so that another program can act as `farfield`. A program that passes every first argument accepted
//! by [`knows`] on to [`main`] can start itself as the nodes. The program `lab` does.

mod bench;
mod calibrate;
mod certs;
mod check_venue;
mod cli;
mod demo;
mod doctor;
mod evaluate;
mod exchange;
mod init;
mod keys;
mod listeners;
mod manual;
mod networks;
pub mod output;
mod overlay;
mod parameters;
mod recording_checks;
mod report_lines;
mod run;
#[cfg(test)]
mod samples;
mod sheet_fingerprint;
mod signals;
mod simulate;
mod status;
mod venue_folder;

use std::process::ExitCode;
use std::sync::Arc;

use clap::CommandFactory as _;
use farfield_edge::network::answer_trial;
use farfield_node::process::{Ending, ErrorFormat, NodeError, exit_code, exit_code_with_format};
use farfield_sim::simulated::VenueSources;

use crate::cli::{FarfieldCli, FarfieldCommand};

/// Runs the command line of this process. Wrong usage is reported with exit code 2.
pub fn main() -> ExitCode {
    if let Some(code) = answer_trial() {
        return code;
    }
    let command = match FarfieldCli::from_process() {
        Ok(cli) => cli.command,
        Err(code) => return code,
    };
    let done = |done: Result<(), NodeError>| done.map(|()| Ending::Done);
    match command {
        FarfieldCommand::Run(args) => run::main(args),
        FarfieldCommand::Edge(args) => {
            farfield_edge::node::main(args, Arc::new(VenueSources::default()))
        }
        FarfieldCommand::Fusion(args) => listeners::fusion(args),
        FarfieldCommand::Record(args) => farfield_fusion_node::record(args),
        FarfieldCommand::Status(args) => {
            exit_code_with_format(status::status(&args), ErrorFormat::as_json_if(args.json))
        }
        FarfieldCommand::Replay(args) => listeners::replay(args),
        FarfieldCommand::View(args) => listeners::view::main(&args),
        FarfieldCommand::Check(args) => check_venue::main(&args),
        FarfieldCommand::Demo(args) => demo::main(&args),
        FarfieldCommand::Doctor(args) => doctor::main(&args),
        FarfieldCommand::Init(args) => init::main(&args),
        FarfieldCommand::Import(args) => exit_code_with_format(
            done(exchange::import::import_folder(&args)),
            ErrorFormat::as_json_if(args.json),
        ),
        FarfieldCommand::Networks(args) => networks::main(&args),
        FarfieldCommand::Simulate(args) => simulate::main(args),
        FarfieldCommand::Calibrate(args) => calibrate::main(&args),
        FarfieldCommand::Certs(args) => exit_code(done(certs::certs(&args))),
        FarfieldCommand::Completions(args) => {
            exit_code(done(manual::completions(&args, FarfieldCli::command())))
        }
        FarfieldCommand::Man(args) => exit_code(done(manual::man(&args, FarfieldCli::command()))),
        FarfieldCommand::Bench(args) => exit_code_with_format(
            done(bench::bench(&args)),
            ErrorFormat::as_json_if(args.is_json()),
        ),
        FarfieldCommand::Parameters(args) => exit_code_with_format(
            done(parameters::print(&args)),
            ErrorFormat::as_json_if(args.json),
        ),
        FarfieldCommand::Export(args) => exit_code_with_format(
            done(exchange::export::export_run(&args)),
            ErrorFormat::as_json_if(args.json),
        ),
        FarfieldCommand::People(args) => exit_code_with_format(
            done(exchange::people::people(&args)),
            ErrorFormat::as_json_if(args.json),
        ),
        FarfieldCommand::Evaluate(args) => exit_code_with_format(
            done(evaluate::evaluate(&args)),
            ErrorFormat::as_json_if(args.json),
        ),
    }
}

/// Whether [`main`] accepts `command` as a first argument.
pub fn knows(command: &str) -> bool {
    FarfieldCli::command().find_subcommand(command).is_some()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_real_commands_are_accepted() {
        assert!(knows("edge") && knows("fusion") && knows("simulate"));
        assert!(!knows("--help") && !knows("farfield") && !knows(""));
    }
}
