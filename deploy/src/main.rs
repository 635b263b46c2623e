//! The operator's one command: brings a venue up, and looks at what came out.

mod certs;
mod cli;
mod demo;
mod evaluate;
mod output;
mod overlay;
mod parameters;
mod run;
#[cfg(test)]
mod samples;
mod simulate;
mod study;
mod suite;
mod venue_folder;

use std::process::ExitCode;
use std::sync::Arc;

use clap::Parser as _;
use farfield_fusion::node::{Ending, exit_code};
use farfield_testbed::simulated::VenueSources;

use crate::cli::{Cli, Command};

fn main() -> ExitCode {
    match Cli::parse().command {
        Command::Run(args) => run::main(args),
        Command::Edge(args) => farfield_edge::node::main(args, Arc::new(VenueSources::default())),
        Command::Fusion(args) => farfield_fusion::node::main(args),
        Command::Record(args) => farfield_fusion::node::record(args),
        Command::Replay(args) => farfield_fusion::node::replay(&args, output::print),
        Command::Demo(args) => demo::main(&args),
        Command::Simulate(args) => simulate::main(args),
        Command::Study { study } => exit_code(study::study(&study).map(|()| Ending::Done)),
        Command::Certs(args) => exit_code(certs::certs(&args).map(|()| Ending::Done)),
        Command::Parameters(args) => exit_code(parameters::print(&args).map(|()| Ending::Done)),
        Command::Evaluate(args) => exit_code(evaluate::evaluate(&args).map(|()| Ending::Done)),
    }
}
