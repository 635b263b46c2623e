//! The command `farfield`: starts a venue, looks at what came out, and makes venues to try it on.
//!
//! Read [`main`] first: each command is a module of this crate, or a call to the node that it starts. `farfield run`
//! starts the nodes of a venue as processes of its own, each again this program (`farfield edge`, `farfield fusion`);
//! `farfield simulate` and `farfield demo` make the folder of a simulated venue, and the demo runs it.
//!
//! It is a library, so that another program can stand in for it: one that hands every first argument which [`knows`]
//! accepts on to [`main`] can start itself as the nodes. The program `lab` does.

mod bench;
mod certs;
mod cli;
mod demo;
mod evaluate;
pub mod output;
mod overlay;
mod parameters;
mod run;
#[cfg(test)]
mod samples;
mod signals;
mod simulate;
mod status;
mod venue_folder;

use std::process::ExitCode;
use std::sync::Arc;

use clap::{CommandFactory as _, Parser as _};
use farfield_node::process::{Ending, exit_code};
use farfield_sim::simulated::VenueSources;

use crate::cli::{FarfieldCli, FarfieldCommand};

/// Does what the command line of this process says.
///
/// Ends the process itself, with exit code 2, on wrong usage.
pub fn main() -> ExitCode {
    match FarfieldCli::parse().command {
        FarfieldCommand::Run(args) => run::main(args),
        FarfieldCommand::Edge(args) => {
            farfield_edge::node::main(args, Arc::new(VenueSources::default()))
        }
        FarfieldCommand::Fusion(args) => farfield_fusion::node::main(args),
        FarfieldCommand::Record(args) => farfield_fusion::node::record(args),
        FarfieldCommand::Status(args) => exit_code(status::status(&args)),
        FarfieldCommand::Replay(args) => farfield_fusion::node::replay(&args, output::print),
        FarfieldCommand::Demo(args) => demo::main(&args),
        FarfieldCommand::Simulate(args) => simulate::main(args),
        FarfieldCommand::Bench(args) => exit_code(bench::bench(&args).map(|()| Ending::Done)),
        FarfieldCommand::Certs(args) => exit_code(certs::certs(&args).map(|()| Ending::Done)),
        FarfieldCommand::Parameters(args) => {
            exit_code(parameters::print(&args).map(|()| Ending::Done))
        }
        FarfieldCommand::Evaluate(args) => {
            exit_code(evaluate::evaluate(&args).map(|()| Ending::Done))
        }
    }
}

/// Whether `command` is one that [`main`] takes as a first argument.
pub fn knows(command: &str) -> bool {
    FarfieldCli::command().find_subcommand(command).is_some()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_commands_that_start_nodes_are_known_and_others_are_not() {
        assert!(knows("edge") && knows("fusion") && knows("simulate"));
        assert!(!knows("--help") && !knows("farfield") && !knows(""));
    }
}
