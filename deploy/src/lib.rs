//! The operator's one command: brings a venue up, and looks at what came out.
//!
//! It is a library so that a program that starts nodes as processes of its own can be one of them
//! itself: what [`knows`] a first argument hands on to [`main`].

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
mod simulate;
mod venue_folder;

use std::process::ExitCode;
use std::sync::Arc;

use clap::{CommandFactory as _, Parser as _};
use farfield_fusion::node::{Ending, exit_code};
use farfield_sim::simulated::VenueSources;

use crate::cli::{Cli, Command};

/// Does what the command line of this process says.
///
/// Ends the process itself, with exit code 2, on wrong usage.
pub fn main() -> ExitCode {
    match Cli::parse().command {
        Command::Run(args) => run::main(args),
        Command::Edge(args) => farfield_edge::node::main(args, Arc::new(VenueSources::default())),
        Command::Fusion(args) => farfield_fusion::node::main(args),
        Command::Record(args) => farfield_fusion::node::record(args),
        Command::Replay(args) => farfield_fusion::node::replay(&args, output::print),
        Command::Demo(args) => demo::main(&args),
        Command::Simulate(args) => simulate::main(args),
        Command::Certs(args) => exit_code(certs::certs(&args).map(|()| Ending::Done)),
        Command::Parameters(args) => exit_code(parameters::print(&args).map(|()| Ending::Done)),
        Command::Evaluate(args) => exit_code(evaluate::evaluate(&args).map(|()| Ending::Done)),
    }
}

/// Whether `command` is one that [`main`] takes as a first argument.
pub fn knows(command: &str) -> bool {
    Cli::command().find_subcommand(command).is_some()
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
