//! The lean fusion binary, for hosts that run no other node.

use std::process::ExitCode;

use clap::Parser;
use farfield_fusion_node::FusionArgs;
use farfield_node::command_line::{is_file, joined};

/// The fusion node of a Farfield venue: patches in, skeletons and boxes out.
#[derive(Debug, Parser)]
#[command(name = "farfield-fusion", version)]
struct FusionCli {
    #[command(flatten)]
    fusion: FusionArgs,
}

fn main() -> ExitCode {
    let words = joined(std::env::args_os(), |before, word| {
        before.last().is_some_and(|option| option == "--record") && is_file(word)
    });
    farfield_fusion_node::main(FusionCli::parse_from(words).fusion)
}
