//! What can be said on the command line. Wrong usage ends with exit code 2.

use clap::{Parser, Subcommand};
use farfield_edge::node::EdgeArgs;
use farfield_fusion::node::{FusionArgs, RecordArgs, ReplayArgs};

use crate::bench::BenchArgs;
use crate::certs::CertsArgs;
use crate::demo::DemoArgs;
use crate::evaluate::EvaluateArgs;
use crate::parameters::ParametersArgs;
use crate::run::RunArgs;
use crate::simulate::SimulateArgs;
use crate::status::StatusArgs;

/// Markerless motion capture for wide fields.
///
/// Exit codes: 0 done, 1 ran but failed, 2 wrong input or usage, 130 interrupted.
#[derive(Debug, Parser)]
#[command(name = "farfield", version)]
pub(crate) struct FarfieldCli {
    #[command(subcommand)]
    pub(crate) command: FarfieldCommand,
}

/// One thing to do.
#[derive(Debug, Subcommand)]
pub(crate) enum FarfieldCommand {
    /// Bring up all nodes of a venue on this machine and work through its recordings.
    Run(RunArgs),
    /// Start the edge node of one viewpoint.
    Edge(EdgeArgs),
    /// Start the fusion node.
    Fusion(FusionArgs),
    /// Record everything that is said in a venue, as an MCAP file.
    Record(RecordArgs),
    /// Show how the nodes of a running venue are.
    Status(StatusArgs),
    /// Solve a recording again: as it was, or with other parameters or another calibration.
    Replay(ReplayArgs),
    /// List every parameter of a venue file: unit, default, range and what it is.
    Parameters(ParametersArgs),
    /// Score poses against a truth.
    Evaluate(EvaluateArgs),
    /// Show the whole system at work on people who do not exist, and how far it is from the truth.
    Demo(DemoArgs),
    /// Make the keys of a venue: an authority, and one certificate per node.
    Certs(CertsArgs),
    /// Record a simulated scene as a venue that `farfield run` takes.
    Simulate(SimulateArgs),
    /// Measure how many people and viewpoints this machine carries, and at which rate.
    Bench(BenchArgs),
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_command_line_is_consistent() {
        use clap::CommandFactory as _;
        FarfieldCli::command().debug_assert();
    }
}
