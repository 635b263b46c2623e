//! The lean fusion binary, for hosts that run nothing else.

use std::process::ExitCode;

use clap::Parser;
use farfield_fusion::node::{self, FusionArgs};

/// The fusion node of a Farfield venue: patches in, skeletons and boxes out.
#[derive(Debug, Parser)]
#[command(name = "farfield-fusion", version)]
struct FusionCli {
    #[command(flatten)]
    fusion: FusionArgs,
}

fn main() -> ExitCode {
    node::main(FusionCli::parse().fusion)
}
